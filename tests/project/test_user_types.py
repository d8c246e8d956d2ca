"""A user's script type-checks with pyright in its strict mode, against the annotations that come with mmw."""

import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = Path(__file__).with_name("user_script.py")
"""Uses the API as README, guides and notebooks do. It is checked, and never run."""


def problems_of(folder: Path, source: str) -> list[str]:
    """Return what pyright says of a script in strict mode."""
    (folder / "script.py").write_text(source)
    settings = {"typeCheckingMode": "strict", "include": ["script.py"], "extraPaths": [str(ROOT)]}
    (folder / "pyrightconfig.json").write_text(json.dumps(settings))
    options = ["--pythonpath", sys.executable, "--outputjson", "--project", str(folder)]
    command = [sys.executable, "-m", "pyright", *options]
    result = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
    found = json.loads(result.stdout)
    assert found["summary"]["filesAnalyzed"] == 1
    return [f"{one['range']['start']['line'] + 1}: {one['message']}" for one in found["generalDiagnostics"]]


@pytest.mark.slow
def test_a_script_is_clean_and_mistakes_in_it_are_found(tmp_path: Path) -> None:
    for package in ("pyright", "torch", "matplotlib"):
        if find_spec(package) is None:
            pytest.skip(f"needs {package}")
    assert problems_of(tmp_path, SCRIPT.read_text()) == []
    wrong = 'import mmw\n\nscene = mmw.load_scene(3)\nscene.add("bs")\nprint(scene.frame.missing)\n'
    assert {problem[:2] for problem in problems_of(tmp_path, wrong)} == {"3:", "4:", "5:"}
