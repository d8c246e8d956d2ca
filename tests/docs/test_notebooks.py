"""The notebooks of the documentation run, and show what they were saved with."""

import json
import re
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.fixtures.doc_pages import says

nbformat = pytest.importorskip("nbformat")
pytest.importorskip("nbclient")

from tests.fixtures.notebooks import NOTEBOOKS, VARIES, code_cells, pictures_of, run_notebook, text_of  # noqa: E402

NEEDS = {"dataset_to_torch": ("torch",), "own_town": ("shapely",)}
"""Notebook -> packages of extras without which it is not run."""

PATHS = sorted(NOTEBOOKS.glob("*.ipynb"))


def test_there_are_notebooks_and_they_are_small() -> None:
    assert len(PATHS) == 5
    assert set(NEEDS) <= {path.stem for path in PATHS}
    assert sum(path.stat().st_size for path in PATHS) < 1.5e6


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_a_notebook_is_short_and_saved_with_its_outputs(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    assert len(notebook.cells) <= 12
    assert notebook.cells[0].cell_type == "markdown" and notebook.cells[0].source.startswith("# ")
    assert sum(map(pictures_of, code_cells(notebook))) >= 1
    for cell in code_cells(notebook):
        assert cell.execution_count is None and set(cell.metadata) <= {"tags"}
        for output in cell.outputs:
            assert output.output_type != "error" and output.get("name") != "stderr", cell.source
    without_pictures = re.sub(r'"image/png": "[^"]*"', "", path.read_text())
    assert not re.search(r"/(?:home|tmp|root|work|usr)/", without_pictures)
    assert json.loads(path.read_text())["metadata"]["kernelspec"]["name"] == "python3"


@pytest.mark.slow
@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_shows_what_it_was_saved_with(path: Path, tmp_path: Path) -> None:
    for package in NEEDS.get(path.stem, ()):
        if find_spec(package) is None:
            pytest.skip(f"needs {package}")
    saved, run = nbformat.read(path, as_version=4), run_notebook(path, tmp_path)
    for wanted, got in zip(code_cells(saved), code_cells(run), strict=True):
        assert pictures_of(wanted) == pictures_of(got), wanted.source
        if VARIES not in wanted.metadata.get("tags", ()):
            told = f"{wanted.source}\nsaved:\n{text_of(wanted)}\nnow:\n{text_of(got)}"
            assert says(text_of(wanted), text_of(got)), told
