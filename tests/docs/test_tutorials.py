"""Getting started, queries and tutorials run as printed and print what they say (`tests/fixtures/doc_pages.py`).

The tour's one long command makes the quickstart's dataset. It is replaced by the small dataset of the tests, which is
made from the same configuration with coarser sensors and four frames: scenario, traffic, radio paths and boxes are
the same, so what the pages print of them is compared word for word.
"""

from pathlib import Path

import pytest

from mmw.channel.antennas import patterns
from mmw.physics.materials import scattering_patterns
from tests.fixtures.doc_pages import ROOT, blocks_of, run_page, run_python, says
from tests.fixtures.small_dataset import small_dataset
from tests.fixtures.window_data import window_data

DOCS = ROOT / "docs"
QUICKSTART = "mmw run --config quickstart"

NOT_RUN = {
    "getting-started/install.md": 2,
    "getting-started/tour.md": 2,
    "getting-started/gallery.md": 2,
    "getting-started/paper.md": 0,
    "guides/configure.md": 0,
    "guides/sweeps.md": 0,
    "guides/scene.md": 0,
    "guides/python-generate.md": 0,
    "guides/closed-loop.md": 2,
    "guides/query.md": 1,
    "guides/csi.md": 0,
    "guides/radio-maps.md": 1,
    "guides/materials.md": 0,
    "guides/own-town.md": 1,
    "guides/own-sensor.md": 1,
    "guides/twin.md": 1,
}
"""Page -> blocks that are not run; each has a reason."""


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """Return a folder like a clone in which the quickstart has run."""
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    (tmp_path / "out").mkdir()
    return tmp_path


def link_dataset(clone: Path) -> None:
    (clone / "out" / "quickstart").symlink_to(small_dataset())


@pytest.mark.parametrize("page", NOT_RUN)
def test_only_the_blocks_that_say_so_are_not_run(page: str) -> None:
    assert sum(bool(block.why_not_run) for block in blocks_of(DOCS / page)) == NOT_RUN[page]


def test_install_and_configure(clone: Path) -> None:
    run_page(DOCS / "getting-started" / "install.md", clone, {QUICKSTART: lambda: link_dataset(clone)})
    run_page(DOCS / "guides" / "configure.md", clone)
    run_page(DOCS / "getting-started" / "paper.md", clone)
    assert "scenarios:" in (clone / "mine.yaml").read_text()


@pytest.mark.slow
def test_sweeps(tmp_path: Path) -> None:
    run_page(DOCS / "guides" / "sweeps.md", tmp_path)


@pytest.mark.slow
def test_gallery(clone: Path) -> None:
    run_page(DOCS / "getting-started" / "gallery.md", clone)
    assert (clone / "a.png").is_file() and (clone / "b.png").is_file()


@pytest.mark.slow
def test_tour(clone: Path) -> None:
    run_page(DOCS / "getting-started" / "tour.md", clone, {QUICKSTART: lambda: link_dataset(clone)})


@pytest.mark.slow
def test_generate_and_replay_from_python(tmp_path: Path) -> None:
    run_page(DOCS / "guides" / "python-generate.md", tmp_path)
    assert (tmp_path / "out" / "small" / "dataset.json").is_file()


@pytest.mark.slow
def test_closed_loop(tmp_path: Path) -> None:
    run_page(DOCS / "guides" / "closed-loop.md", tmp_path)


@pytest.mark.parametrize("page", ["query", "csi", "materials"])
def test_pages_on_the_quickstart(page: str, clone: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for registry in (patterns.PATTERNS, scattering_patterns.PATTERNS):  # what a page registers ends with it
        monkeypatch.setattr(registry, "_added", {})
    link_dataset(clone)
    run_page(DOCS / "guides" / f"{page}.md", clone)


@pytest.mark.slow
def test_a_scene_in_python(tmp_path: Path) -> None:
    run_page(DOCS / "guides" / "scene.md", tmp_path)


@pytest.mark.slow
def test_radio_maps(tmp_path: Path) -> None:
    run_page(DOCS / "guides" / "radio-maps.md", tmp_path)
    assert (tmp_path / "rss.png").stat().st_size > 20_000


@pytest.mark.slow
def test_tutorials_of_town_and_sensors(tmp_path: Path) -> None:
    """The second continues in the folder of the first."""
    run_page(DOCS / "guides" / "own-town.md", tmp_path)
    run_page(DOCS / "guides" / "own-sensor.md", tmp_path)


@pytest.mark.slow
def test_a_twin_of_a_made_up_crossing(tmp_path: Path) -> None:
    run_page(DOCS / "guides" / "twin.md", tmp_path)


@pytest.mark.filterwarnings(
    "ignore:This DataLoader will create",
    "ignore:.*fork:DeprecationWarning",  # one core; Python 3.12 and threads
)
def test_the_guide_of_pytorch(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed: pip install 'multimodal-wireless[torch]'")
    monkeypatch.chdir(tmp_path)
    names = run_python(ROOT / "docs" / "guides" / "torch.md", "DATASET", window_data())
    told = capsys.readouterr().out
    assert "'train':" in told and "cav_1" in told and "torch.float32" in told
    assert names["images"].shape[1:3] == (4, 3) and names["points"].shape[1:][0] == 4
    assert names["target"].shape[1:] == (10,) and len(names["test"]) > 0 and len(names["sunny"]) > 0
    assert any((tmp_path / "beams-cache").iterdir())


@pytest.mark.parametrize(
    ("wanted", "got", "same"),
    [
        ("x  -5.7 -0.0", "x  -5.8  0.0", True),  # -5.75 and a zero, on two CPUs
        ("gain -89.50 dB", "gain -89.51 dB", True),
        ("a 1.00 ...", "a 1.01 more", True),
        ("x -5.7", "x -5.9", False),
        ("x -5.7", "x 5.7", False),
        ("x 0.7", "x 0.70", False),
        ("3 links 1.0", "4 links 1.0", False),
        ("cav_1 1.0", "cav_2 1.0", False),
        ("1.0 2.0", "1.0", False),
        ("mmw 1.2.3", "mmw 1.2.4", False),
        ("1.0", "1.0\n1.0", False),
    ],
)
def test_numbers_may_be_rounded_either_way_and_no_more(wanted: str, got: str, same: bool) -> None:
    assert says(wanted, got) is same


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("```python\nprint(1 + 1)\n```\n\n```text\n3\n```\n", "the page says\n3"),
        ("```bash\nmmw run --config none.yaml\n```\n", "ends with 2"),
        ("```bash\nfalse\n```\n", "ends with 1"),
        ("```yaml\na: 1\n```\n", "give the block a title"),
        ("```python\nprint(1)\n", "is not understood"),
        ("```python hl_lines=1\nprint(1)\n```\n", "is not understood"),
    ],
)
def test_a_block_that_fails_or_differs_or_is_not_understood_is_found(tmp_path: Path, text: str, part: str) -> None:
    page = tmp_path / "page.md"
    page.write_text(text)
    with pytest.raises(AssertionError, match=part):
        run_page(page, tmp_path)


def test_a_command_that_a_stand_in_is_for_must_be_there(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("```bash\ntrue\n```\n")
    with pytest.raises(AssertionError, match="no block holds"):
        run_page(page, tmp_path, {QUICKSTART: lambda: None})
