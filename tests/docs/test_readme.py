"""The README is short, and its blocks run as printed and print what it shows.

They run on the small dataset of the tests: agents, links, paths and objects are those of the quickstart; the sensors
are coarser. Its first block is CI's: `.ci/run` reads the test command from it.
"""

import os
import subprocess
import sys
from pathlib import Path

from mmw.core.extras import DISTRIBUTION
from tests.fixtures.doc_pages import ROOT, blocks_of, run_page
from tests.fixtures.small_dataset import small_dataset

README = ROOT / "README.md"
MAX_BYTES = 6144


def test_the_readme_is_short() -> None:
    assert len(README.read_bytes()) <= MAX_BYTES


def test_ci_finds_the_test_command() -> None:
    """The first block holds the quickstart and the tests, one line each; only it is not run here."""
    blocks = blocks_of(README)
    assert [bool(block.why_not_run) for block in blocks] == [True, *[False] * (len(blocks) - 1)]
    lines = blocks[0].code.splitlines()
    assert [line.split()[1].rstrip(":") for line in lines[::2]] == ["quickstart", "test"]
    for line in lines[1::2]:
        assert line.startswith("python3 -m venv .venv && .venv/bin/python -m pip install -q -e '.[")
    assert lines[1].endswith(" && .venv/bin/python -m mmw.run --config configs/quickstart.yaml")
    assert (ROOT / "configs" / "quickstart.yaml").is_file()
    command = "grep -m1 -A2 '^# test' README.md | sed -n 2p"
    assert command in (ROOT / ".ci" / "run").read_text()
    found = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == lines[3] and " -m pytest " in lines[3]


def test_the_blocks_run_and_print_what_the_readme_says(tmp_path: Path) -> None:
    languages = [block.language for block in blocks_of(README)]
    assert languages == ["bash", "python", "text", "bash", "python", "text"]
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "quickstart").symlink_to(small_dataset())
    run_page(README, tmp_path)
    assert (tmp_path / "out" / "opv2v").is_dir() and not (tmp_path / "out" / "long").exists()


def test_help_that_the_readme_names_is_there() -> None:
    assert f"`{DISTRIBUTION}" not in README.read_text()  # nothing is on PyPI yet
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    for words in (["-m", "mmw", "--help"], ["-m", "mmw", "run", "--config", "quickstart", "--print-config"]):
        found = subprocess.run(
            [sys.executable, *words], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
        )
        assert found.returncode == 0 and len(found.stdout.splitlines()) > 10, found.stderr
