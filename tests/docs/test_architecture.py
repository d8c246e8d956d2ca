"""Pages and pictures name files that exist, and the architecture every package of `mmw`."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted({*ROOT.glob("*.md"), *(ROOT / "bench").glob("*.md"), *DOCS.rglob("*.md")} - {ROOT / "CHANGELOG.md"})
CACHE_FOLDERS = {"mmw/staging", "mmw/logs"}
"""Names of folders in a user's cache, not of the project."""
PICTURES = ("architecture_frame.svg", "architecture_path_gain.svg")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_files_that_a_page_names_exist(page: Path) -> None:
    """Links of pages outside `docs/` are checked here too; those of the site by the strict build."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    links = {page.parent / link for link in re.findall(r"\]\((?!https?:|#|mailto:)([^)#\s]+)", text)}
    paths = set(re.findall(r"`((?:mmw|kernels|tests|configs|docs|bench|examples)/[\w/.-]+)`", text))
    paths = {ROOT / path for path in paths - CACHE_FOLDERS if not re.search(r"/(NAME|FORMAT)\b", path)}
    assert {str(path) for path in links | paths if not path.exists()} == set()


@pytest.mark.parametrize("picture", PICTURES)
def test_modules_of_a_picture_exist(picture: str) -> None:
    text = (DOCS / "images" / picture).read_text()
    paths = set(re.findall(r"\b(?:mmw|kernels)/[\w/]+(?:\.py)?", text))
    assert len(paths) >= 10
    assert {path for path in paths if not (ROOT / path).exists()} == set()
    files = {path.name for folder in ("mmw", "kernels") for path in (ROOT / folder).rglob("*.py")}
    assert set(re.findall(r"\w+\.py\b", text)) <= files


def test_every_package_is_listed() -> None:
    """A public module counts as one; `python -m mmw` and `python -m mmw.run` are programs."""
    text = (DOCS / "concepts" / "architecture.md").read_text().split("## Packages")[1]
    listed = set(re.findall(r"`mmw\.(\w+)`", text))
    packages = {path.parent.name for path in (ROOT / "mmw").glob("*/__init__.py")}
    assert listed == packages | {path.stem for path in (ROOT / "mmw").glob("*.py")} - {"__init__", "__main__", "run"}
