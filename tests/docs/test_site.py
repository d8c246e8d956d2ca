"""The documentation site: built strictly, nothing loaded from another host."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fixtures.pages import HtmlPage

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
LOADING = {
    "script": ("src",), "img": ("src", "srcset"), "source": ("src", "srcset"), "iframe": ("src",), "embed": ("src",),
    "video": ("src", "poster"), "audio": ("src",), "track": ("src",), "object": ("data",), "link": ("href",),
    "form": ("action",), "use": ("href",), "image": ("href",), "input": ("src",),
}  # fmt: skip
"""Element -> attributes that make a browser load a file without a click."""

ELSEWHERE = re.compile(r"(?:https?:)?//", re.I)


def loads(page: HtmlPage) -> list[str]:
    """Return the addresses that a page loads."""
    return [value for tag, name, value in page.attributes if name in LOADING.get(tag, ())]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("material")
    out = tmp_path_factory.mktemp("site")
    result = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(out)],
        cwd=ROOT, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    return out


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[str, HtmlPage]:
    return {str(path.relative_to(site)): HtmlPage(path.read_text()) for path in sorted(site.rglob("*.html"))}


def test_nothing_is_loaded_from_another_host(site: Path, pages: dict[str, HtmlPage]) -> None:
    for name, page in pages.items():
        assert loads(page), name
        assert [address for address in loads(page) if ELSEWHERE.match(address)] == [], name
        styles = [page.text_in("style"), *(value for _, key, value in page.attributes if key == "style")]
        assert not [style for style in styles if re.search(r"(?:url\(|@import)\W*(?:https?:)?//", style)], name
        # The theme's script loads diagrams and facts about a repository from other hosts.
        classes = {word for _, key, value in page.attributes if key == "class" for word in value.split()}
        assert not classes & {"mermaid", "md-source"}, name
    sheets = list(site.rglob("*.css"))
    assert len(sheets) >= 3
    for sheet in sheets:
        assert not re.search(r"(?:url\(|@import)\s*[\"']?(?:https?:)?//", sheet.read_text()), sheet


def test_what_pages_load_is_there(site: Path, pages: dict[str, HtmlPage]) -> None:
    for name, page in pages.items():
        for address in loads(page):
            path = address.split("#")[0].split("?")[0]
            if path and not path.startswith("data:"):
                assert ((site / name).parent / path).exists() or (site / path.lstrip("/")).exists(), (name, address)


def test_markdown_is_understood_as_it_is_meant(pages: dict[str, HtmlPage]) -> None:
    """Python-Markdown requires a blank line before a list or a table; otherwise they are text."""
    for name, page in pages.items():
        text = page.text_in("p")
        assert not re.search(r"^\s*(?:- |\* |\d+\. |\|)", text, re.M), name
        assert "```" not in text and "](" not in text, name
