"""The queries of the README run as they stand and print what it says.

They run on the small dataset of the tests, in sun: agents, links, paths and objects are those of the quickstart; the
sensors are coarser.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fixtures.doc_pages import says
from tests.fixtures.small_dataset import copy_of, small_dataset

README = (Path(__file__).resolve().parents[2] / "README.md").read_text()
SECTION = README[README.index("Ask it something") : README.index("## What is in a dataset")]
QUERIES = re.findall(r"```bash\n(.*?)```\n\n```\n(.*?)```\n", SECTION, re.DOTALL)


def test_every_query_shows_its_output() -> None:
    assert len(QUERIES) == 2 and SECTION.count("```") == 4 * len(QUERIES)


@pytest.mark.parametrize("number", range(len(QUERIES)))
def test_query_prints_what_the_readme_says(tmp_path: Path, number: int) -> None:
    command, printed = QUERIES[number]
    assert command.startswith(".venv/bin/python -c ")
    (tmp_path / "out").mkdir()
    for rainy in copy_of(small_dataset(), tmp_path / "out" / "quickstart").rglob("weather=rainy"):
        shutil.rmtree(rainy)
    (tmp_path / ".venv" / "bin").mkdir(parents=True)
    (tmp_path / ".venv" / "bin" / "python").symlink_to(sys.executable)
    path = os.pathsep.join([str(Path(__file__).resolve().parents[2]), *sys.path])
    environment = {**os.environ, "PYTHONPATH": path, "PYTHONIOENCODING": "utf-8"}
    found = subprocess.run(
        ["bash", "-c", command], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert found.returncode == 0, found.stderr
    assert says(printed.strip(), found.stdout.strip()), found.stdout
