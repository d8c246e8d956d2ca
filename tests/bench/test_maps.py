"""The table of an archive of maps: figures of a drive by hand, rows of maps that fail, Markdown."""

from pathlib import Path

import numpy as np
import pytest

from bench.maps import Row, main, motion_figures, nearest_box, summary, table_line
from mmw.traffic.demand import VehicleTrack
from tests.fixtures.traffic_towns import CATALOG
from tests.fixtures.xodr_files import Plan, document, lane, mark, road, section


def track(name: str, x: np.ndarray, y: float, *, waits: bool = False, role: str = "vehicle") -> VehicleTrack:
    """Return a sedan that looks east, at some x in every frame."""
    poses = np.zeros((len(x), 7))
    poses[:, 0], poses[:, 1], poses[:, 6] = x, y, 1.0
    poses[np.isnan(x)] = np.nan
    return VehicleTrack(name, role, "sedan", "white", poses, np.full(len(x), waits))


def test_figures_of_a_drive() -> None:
    still, way = np.zeros(101), np.linspace(-10.0, 0.0, 101)
    late = np.where(np.arange(101) < 50, np.nan, way)
    tracks = [
        track("cav_1", still, 0.0, role="cav"), track("veh_001", way, 0.3), track("veh_002", still, 20.0, waits=True),
        track("veh_003", late, 40.0), track("veh_004", late[::-1], 60.0),
    ]  # fmt: skip
    assert motion_figures(tracks, CATALOG) == {
        "placed": 4, "entered": 1, "left": 1, "overlaps": 1, "standing": 0.25, "queued": 0.25, "cavs_gone": 0
    }  # fmt: skip
    half = 0.5 * CATALOG["sedan"].width
    assert nearest_box(tracks[2:3], CATALOG, np.array([0.0, 25.0, 0.0])) == pytest.approx(5.0 - half, abs=0.01)


def test_a_row_tells_a_failure_and_the_summary_counts() -> None:
    rows = [
        Row("a.xodr", failed="import: no | road"),
        Row("b.xodr", 1.0, 250.0, 4, {}, 20, 20, 0, 0, 0, 0.05, 0.1, 0, 3.0),
    ]
    assert table_line(rows[0]).endswith("| import: no \\| road |")
    assert table_line(rows[1]) == "| b.xodr | 1.0 | 250 | 4 | 0 | 20 | 20 | 0 | 0 | 0 | 5% | 10% | 3.0 |  |"
    assert summary(rows) == (
        "2 maps: 1 import, 1 without errors of the check; 1 drive, 1 without overlaps, 1 with at most 10 % standing; "
        "1 failed"
    )


@pytest.mark.slow
def test_folder_of_two_maps(tmp_path: Path) -> None:
    """One drives, the other one is broken; each in a process of its own."""
    one = section(0.0, [], mark("none"), [lane(-1, "driving", 3.5), lane(-2, "shoulder", 2.0)])
    (tmp_path / "good.xodr").write_text(document(road("1", Plan(0, 0, 0).line(200.0), one)))
    (tmp_path / "bad.xodr").write_text("<OpenDRIVE>")
    main([str(tmp_path), "--out", str(tmp_path / "out"), "--seconds", "1"])
    text = (tmp_path / "out" / "maps.md").read_text()
    assert "2 maps: 1 import, 1 without errors of the check; 1 drive, 1 without overlaps" in text
    assert "| bad.xodr | " in text and "import: " in text
