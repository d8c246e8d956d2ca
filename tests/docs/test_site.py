"""The documentation site: built strictly, nothing loaded from another host."""

import ast
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
    pytest.importorskip("mkdocstrings_handlers.python")
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


API = {
    page.stem: re.findall(r"^::: (\S+)$", page.read_text(), re.M)
    for page in sorted((DOCS / "reference/api").glob("*.md"))
}
"""Page of the reference -> public modules on it, and functions that are methods elsewhere."""

METHODS = ["mmw.viz.scene_view.show.show", "mmw.viz.scene_view.picture.render_picture",
           "mmw.viz.scene_view.path_plots.plot_paths"]  # fmt: skip
"""Functions that `Scene.show`, `Scene.render` and `Paths.plot` are."""


def exported(module: str) -> list[str]:
    """Return `__all__` of a module without importing it, as the site reads it: PyTorch and matplotlib are extras."""
    path = ROOT / module.replace(".", "/")
    source = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    for node in ast.parse(source.read_text()).body:
        match node:
            case ast.Assign(targets=[ast.Name(id="__all__")]):
                return ast.literal_eval(node.value)
    raise AssertionError(f"{source} has no __all__")


def text_below(html: str, name: str) -> str:
    """Return the documentation of a name: the text between its signature and the next heading."""
    section = re.split(r"<h\d id=", html.split(f'id="{name}" class="doc doc-heading"')[1])[0]
    return re.sub(r"<[^>]+>", "", section.split('class="doc doc-contents')[1].partition(">")[2]).strip()


@pytest.mark.parametrize("page", API)
def test_every_public_name_is_documented(page: str, site: Path) -> None:
    html = (site / "reference" / "api" / f"{page}.html").read_text()
    assert API[page]
    for name in set(API[page]) & set(METHODS):
        assert len(text_below(html, name).split()) >= 3, name
    for module in set(API[page]) - set(METHODS):
        assert exported(module)
        for name in exported(module):
            assert len(text_below(html, f"{module}.{name}").split()) >= 3, f"{module}.{name}"


def test_the_reference_names_nothing_private(pages: dict[str, HtmlPage]) -> None:
    for page in API:
        html = pages[f"reference/api/{page}.html"]
        targets = [value for _, key, value in html.attributes if key == "id"]
        texts = "".join(text for holder, text in html.texts if holder not in ("script", "style"))
        for text in [*targets, texts]:
            assert not re.search(r"(?<![\w/])_[A-Za-z]\w*|\._[A-Za-z]\w*", text), (page, text[:99])


def test_public_modules_are_on_one_page() -> None:
    """Modules with `__all__` are public, but for the one whose functions are methods."""
    modules = [module for page in API.values() for module in page]
    assert len(modules) == len(set(modules)) and set(METHODS) < set(modules)
    files = {path for path in (ROOT / "mmw").rglob("*.py") if re.search(r"^__all__ = ", path.read_text(), re.M)}
    names = {".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__") for path in files}
    assert names - {"mmw.viz.scene_view"} == set(modules) - set(METHODS)
