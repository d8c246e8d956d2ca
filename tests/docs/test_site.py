"""The documentation site: built strictly, nothing loaded from another host."""

import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
LOADING = {
    "script": ("src",), "img": ("src", "srcset"), "source": ("src", "srcset"), "iframe": ("src",), "embed": ("src",),
    "video": ("src", "poster"), "audio": ("src",), "track": ("src",), "object": ("data",), "link": ("href",),
    "form": ("action",), "use": ("href",), "image": ("href",), "input": ("src",),
}  # fmt: skip
"""Element -> attributes that make a browser load a file without a click."""

ELSEWHERE = re.compile(r"(?:https?:)?//", re.I)


class Page(HTMLParser):
    """Addresses that a page loads, its text outside code, and its classes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.styles: list[str] = []
        self.classes: set[str] = set()
        self.prose: list[str] = []
        self._inside: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.loads += [given[name] for name in LOADING.get(tag, ()) if name in given]
        self.styles.append(given.get("style", ""))
        self.classes |= set(given.get("class", "").split())
        if tag in ("pre", "code", "style", "script", "p"):
            self._inside.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if self._inside and self._inside[-1] == tag:
            self._inside.pop()

    def handle_data(self, data: str) -> None:
        if self._inside and self._inside[-1] == "style":
            self.styles.append(data)
        elif self._inside and self._inside[-1] == "p":
            self.prose.append(data)


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
def pages(site: Path) -> dict[str, Page]:
    return {str(path.relative_to(site)): Page(path.read_text()) for path in sorted(site.rglob("*.html"))}


def test_nothing_is_loaded_from_another_host(site: Path, pages: dict[str, Page]) -> None:
    for name, page in pages.items():
        assert page.loads, name
        assert [address for address in page.loads if ELSEWHERE.match(address)] == [], name
        assert not [style for style in page.styles if re.search(r"(?:url\(|@import)\W*(?:https?:)?//", style)], name
        # The theme's script loads diagrams and facts about a repository from other hosts.
        assert not page.classes & {"mermaid", "md-source"}, name
    sheets = list(site.rglob("*.css"))
    assert len(sheets) >= 3
    for sheet in sheets:
        assert not re.search(r"(?:url\(|@import)\s*[\"']?(?:https?:)?//", sheet.read_text()), sheet


def test_what_pages_load_is_there(site: Path, pages: dict[str, Page]) -> None:
    for name, page in pages.items():
        for address in page.loads:
            path = address.split("#")[0].split("?")[0]
            if path and not path.startswith("data:"):
                assert ((site / name).parent / path).exists() or (site / path.lstrip("/")).exists(), (name, address)


def test_markdown_is_understood_as_it_is_meant(pages: dict[str, Page]) -> None:
    """Python-Markdown requires a blank line before a list or a table; otherwise they are text."""
    for name, page in pages.items():
        text = "".join(page.prose)
        assert not re.search(r"^\s*(?:- |\* |\d+\. |\|)", text, re.M), name
        assert "```" not in text and "](" not in text, name
