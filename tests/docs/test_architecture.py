"""The pages about the code name packages and files that exist, and every package of `mmw`."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = ("concepts/architecture.md", "development/index.md", "development/extending.md")
PICTURES = ("architecture_frame.svg", "architecture_path_gain.svg")


@pytest.mark.parametrize("page", PAGES)
def test_paths_of_a_page_exist(page: str) -> None:
    text = (DOCS / page).read_text()
    paths = set(re.findall(r"`((?:mmw|kernels|tests|configs|docs)/[\w/.-]+)`", text))
    placeholders = {path for path in paths if re.search(r"/(NAME|FORMAT)\b", path)}
    assert {path for path in paths - placeholders if not (ROOT / path).exists()} == set()
    files = {path.name for folder in ("mmw", "kernels", "tests") for path in (ROOT / folder).rglob("*.py")}
    named = {Path(name).name for name in re.findall(r"`([\w/]+\.py)`", text)}
    assert named - files == ({"FORMAT.py"} if page.endswith("extending.md") else set())


@pytest.mark.parametrize("picture", PICTURES)
def test_modules_of_a_picture_exist(picture: str) -> None:
    text = (DOCS / "images" / picture).read_text()
    paths = set(re.findall(r"\b(?:mmw|kernels)/[\w/]+(?:\.py)?", text))
    assert len(paths) >= 10
    assert {path for path in paths if not (ROOT / path).exists()} == set()
    files = {path.name for folder in ("mmw", "kernels") for path in (ROOT / folder).rglob("*.py")}
    assert set(re.findall(r"\w+\.py\b", text)) <= files


def test_every_package_is_listed() -> None:
    text = (DOCS / "concepts" / "architecture.md").read_text().split("## Packages")[1]
    listed = set(re.findall(r"`mmw\.(\w+)`", text))
    assert listed == {path.parent.name for path in (ROOT / "mmw").glob("*/__init__.py")}
