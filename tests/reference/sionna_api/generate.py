"""Run the Sionna RT code of `docs/coming-from/sionna-rt.md` and keep its numbers.

In an environment with mmw, sionna-rt==2.2.0, pandas and an LLVM library of version 16 or newer:

    DRJIT_LIBLLVM_PATH=/path/to/libLLVM.so python -m tests.reference.sionna_api.generate
"""

import contextlib
import hashlib
import json
from importlib.metadata import version
from pathlib import Path

import numpy as np

from tests.fixtures.doc_pages import ROOT
from tests.fixtures.side_by_side import tasks_of

PAGE = ROOT / "docs" / "coming-from" / "sionna-rt.md"
SCENE = ROOT / "examples" / "coming_from"
HERE = Path(__file__).resolve().parent
RESULTS = {
    1: ("h",), 2: ("a", "tau"), 3: ("rss_dbm",), 4: ("before", "after"), 5: ("h",), 6: ("a", "tau"), 7: ("h",),
    8: ("h",), 9: ("table",), 10: ("taps", "grid"),
}  # fmt: skip
"""Number of a task -> names that its code defines."""


def digest(code: str) -> str:
    """Return the SHA-256 of a piece of code."""
    return hashlib.sha256(code.encode()).hexdigest()


def main() -> None:
    """Write `numbers.npz` and `manifest.json` beside this file."""
    numbers: dict[str, np.ndarray] = {}
    digests: dict[str, str] = {}
    with contextlib.chdir(SCENE):
        for task in tasks_of(PAGE):
            if not task.other:
                continue
            names: dict = {"__name__": "__main__"}
            exec(compile(task.other, f"task {task.number}", "exec"), names)
            digests[str(task.number)] = digest(task.other)
            for name in RESULTS[task.number]:
                numbers[f"{task.number}/{name}"] = np.asarray(names[name])
            if task.number == 3:
                numbers["3/cell_centers"] = names["radio_map"].cell_centers.numpy()
    np.savez_compressed(HERE / "numbers.npz", **numbers)
    versions = {name: version(name) for name in ("sionna-rt", "mitsuba", "drjit", "numpy")}
    content = {"versions": versions, "variant": "llvm_ad_mono_polarized", "code_sha256": digests}
    (HERE / "manifest.json").write_text(json.dumps(content, indent=2) + "\n")


if __name__ == "__main__":
    main()
