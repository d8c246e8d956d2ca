"""The distribution: its name, the install commands in messages, its dependencies and licences."""

import re
import subprocess
import sys
import tomllib
import warnings
from pathlib import Path

import pytest
import yaml

from mmw import __version__
from mmw.core.extras import DISTRIBUTION, EXTRA_OF, install

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
TEXTS = sorted(
    path
    for folder in ("mmw", "kernels", "tests", "bench", "examples", "docs", "configs", ".")
    for path in ((ROOT / folder).rglob("*") if folder != "." else ROOT.glob("*"))
    if path.suffix in (".py", ".md", ".yaml", ".toml", ".json") and path.is_file()
)


def test_messages_name_the_distribution() -> None:
    assert PROJECT["name"] == DISTRIBUTION
    assert install() == "pip install multimodal-wireless"
    assert install("plot", "viz") == "pip install 'multimodal-wireless[plot,viz]'"
    own = [line for lines in EXTRAS.values() for line in lines if line.startswith(f"{DISTRIBUTION}[")]
    assert own and {name for line in own for name in re.findall(r"\w+", line.split("[")[1])} <= set(EXTRAS)


def test_nobody_is_told_to_install_another_projects_mmw() -> None:
    assert len(TEXTS) > 400
    for path in TEXTS:
        text = path.read_text()
        assert not re.search(r"(?<![\w-])mmw\[(?=[a-z])(?!\.)|pip install (?:-\w+ )*'?mmw\b", text), path
        for names in re.findall(r"multimodal-wireless\[([a-z,]+)\]", text):
            assert set(names.split(",")) <= set(EXTRAS), (path, names)
    used = {name for path in TEXTS for name in re.findall(r"install\(['\"]([a-z]+)['\"]\)", path.read_text())}
    assert "ray" in used and used | set(EXTRA_OF.values()) <= set(EXTRAS)


def test_lowest_requirements() -> None:
    """Every dependency has a lower bound, and the script that CI installs from finds it."""

    def lowest(*extras: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, str(ROOT / ".ci" / "requirements"), "lowest", *extras]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    everything = lowest()
    assert everything.returncode == 0, everything.stderr
    lines = everything.stdout.splitlines()
    assert all(re.fullmatch(r"[a-z0-9-]+==[0-9.]+", line) for line in lines)
    assert {line.split("==")[0] for line in lowest("sumo").stdout.splitlines()} == {
        *(re.split("[><=]", line)[0] for line in PROJECT["dependencies"]), "libsumo",
    }  # fmt: skip
    assert "no extra nothing" in lowest("nothing").stderr


def test_every_dependency_has_its_licence() -> None:
    """THIRD_PARTY.md lists what a run may need; tests and tools of developers are not part of it."""
    listed = set(re.findall(r"^\| ([\w-]+) \| (?:core|`\w+`) \|", (ROOT / "THIRD_PARTY.md").read_text(), re.M))
    lines = [*PROJECT["dependencies"], *(line for extra in set(EXTRAS) - {"test", "dev"} for line in EXTRAS[extra])]
    assert listed == {re.split(r"[\[><=;]", line)[0] for line in lines} - {DISTRIBUTION}


def test_every_licence_file_is_there_and_filled_in() -> None:
    for name in PROJECT["license-files"]:
        assert (ROOT / name).is_file(), name
    assert "Copyright 2026 mmw developers" in (ROOT / "LICENSE").read_text()
    assert "[yyyy]" not in (ROOT / "LICENSE").read_text()


def test_the_page_lists_every_extra() -> None:
    page = (ROOT / "docs" / "getting-started" / "install.md").read_text()
    rows = re.findall(r"^\| ((?:`\w+`(?:, )?)+) \|", page, re.M)
    assert {name for row in rows for name in re.findall(r"`(\w+)`", row)} == set(EXTRAS)


def test_changelog_and_citation_have_this_release() -> None:
    heads = re.findall(r"^## \[(.+?)\](?: - (\d{4}-\d\d-\d\d))?$", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert heads[0] == ("Unreleased", "") and heads[1][0] == __version__
    dates = [date for _, date in heads[1:]]
    assert all(dates) and dates == sorted(dates, reverse=True)
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert {"cff-version", "message", "title", "authors", "license"} <= set(citation)
    assert (citation["version"], citation["date-released"]) == heads[1]


def test_hooks_run_ruff_of_the_environment() -> None:
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"][0]["hooks"]
    assert [hook["entry"].split()[:2] for hook in hooks] == [[".venv/bin/ruff", "check"], [".venv/bin/ruff", "format"]]


def test_warnings_about_our_code_are_errors_and_others_are_shown() -> None:
    with pytest.raises(UserWarning, match="ours"):
        warnings.warn("ours", stacklevel=1)
    with pytest.raises(RuntimeWarning, match="ours"):
        warnings.warn_explicit("ours", RuntimeWarning, "a.py", 1, module="mmw.channel.path_solver.solver")
    with warnings.catch_warnings(record=True) as shown:
        warnings.warn_explicit("a release of theirs", UserWarning, "a.py", 1, module="mmwave.core")
        warnings.warn_explicit("goes away", DeprecationWarning, "a.py", 1, module="mmw.storage.shard_writer")
    assert [str(item.message) for item in shown] == ["a release of theirs", "goes away"]
