"""Files at the root that hosts of repositories and other tools read."""

import re
from pathlib import Path

import yaml

from mmw import __version__

ROOT = Path(__file__).parents[2]


def test_the_citation_is_of_this_release() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert {"cff-version", "message", "title", "authors", "license"} <= set(citation)
    assert citation["version"] == __version__
    released = re.search(rf"^## \[{re.escape(__version__)}\] - (\S+)$", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert released and citation["date-released"] == released[1]


def test_ruff_of_the_hooks_is_the_one_of_the_extra() -> None:
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"][0]["hooks"]
    assert [hook["entry"].split()[:2] for hook in hooks] == [[".venv/bin/ruff", "check"], [".venv/bin/ruff", "format"]]


def test_pages_at_the_root_link_to_files() -> None:
    for name in ("CONTRIBUTING.md", "SECURITY.md", "CODE_OF_CONDUCT.md", "CHANGELOG.md", "bench/README.md"):
        path = ROOT / name
        targets = re.findall(r"\]\((?!https?:)([^)#]+)", path.read_text())
        named = re.findall(r"`(docs/[\w/-]+\.md)`", path.read_text())
        assert [target for target in targets if not (path.parent / target).is_file()] == [], name
        assert [page for page in named if not (ROOT / page).is_file()] == [], name
