"""The page of channel statistics is that of its file; the file is filled by a measurement."""

import json
from pathlib import Path

import numpy as np
import pytest

from bench.link_statistics import burst_frames, measure, store
from bench.link_statistics_page import FILE, PAGE, channel_statistics_page


def test_the_page_is_current() -> None:
    records = json.loads(FILE.read_text())["records"]
    assert PAGE.read_text(encoding="utf-8") == channel_statistics_page(records), "python -m bench.link_statistics_page"


def test_bursts_cover_the_scenario() -> None:
    assert burst_frames(np.arange(100, 200), 3, 2) == [100, 101, 102, 197, 198, 199]
    assert burst_frames(np.arange(5), 5, 1) == [0, 1, 2, 3, 4]
    with pytest.raises(ValueError, match="2 bursts of 3 frames; the scenario has 5"):
        burst_frames(np.arange(5), 3, 2)


@pytest.mark.slow
def test_a_measurement_fills_the_file(tmp_path: Path) -> None:
    records = measure("town03_roundabout", "paper", 3, 2, "cpu")
    assert [own["carrier_hz"] for own in records] == [28e9, 4.9e9]
    for own in records:
        assert own["links"] == 18 and own["clear"] + own["foliage"] + own["blocked"] == pytest.approx(1.0)
        assert own["los"]["links"] + own["nlos"]["links"] == round(18 * (1.0 - own["without_path"]))
        for part in (own["los"], own["nlos"]):
            for name in ("k_los_db", "k_strongest_db", "k_moments_db", "delay_spread_ns"):
                low, middle, high = (float(value) for value in part[name])
                assert low <= middle <= high
        assert all(float(value) == -np.inf for value in own["nlos"]["k_los_db"])
    file = tmp_path / "data" / "statistics.json"
    store(file, records)
    store(file, [{**records[0], "links": 7}])
    stored = json.loads(file.read_text())["records"]
    assert [own["carrier_hz"] for own in stored] == [4.9e9, 28e9] and stored[1]["links"] == 7
    page = channel_statistics_page(stored)
    assert "| town03_roundabout | paper | 18 |" in page and "TR 38.901" in page
