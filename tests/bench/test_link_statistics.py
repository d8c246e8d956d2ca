"""The page of channel statistics is that of its file; the file is filled by a measurement."""

import json
from pathlib import Path

import numpy as np
import pytest

from bench.link_statistics import burst_frames, lives, measure, store
from bench.link_statistics_page import FILE, PAGE, channel_statistics_page
from mmw.channel.path_table import KEY_TYPE, CarrierPaths


def test_the_page_is_current() -> None:
    records = json.loads(FILE.read_text())["records"]
    assert PAGE.read_text(encoding="utf-8") == channel_statistics_page(records), "python -m bench.link_statistics_page"


def test_bursts_cover_the_scenario() -> None:
    assert burst_frames(np.arange(100, 200), 3, 2) == [100, 101, 102, 197, 198, 199]
    assert burst_frames(np.arange(5), 5, 1) == [0, 1, 2, 3, 4]
    with pytest.raises(ValueError, match="2 bursts of 3 frames; the scenario has 5"):
        burst_frames(np.arange(5), 3, 2)


def test_frames_in_between_tell_fades_from_steps() -> None:
    """Over 25 ms one path fades by 0.5 dB in each, one loses 6 dB at once, and one has another name from the 12th on.

    Of 15 pairs of frames 10 ms apart the first changes by 5 dB in all, the second in 10; the third has 5 with one name.
    """
    count = 25
    frame = np.repeat(np.arange(count), 4)
    level = np.stack(
        [
            np.full(count, 1.0),
            0.1 * 10.0 ** (-0.025 * np.arange(count)),
            np.where(np.arange(count) < 15, 0.1, 0.05),
            np.full(count, 0.1),
        ],
        axis=1,
    ).reshape(-1)
    path_id = np.tile([1, 2, 3, 4], count)
    path_id[(path_id == 4) & (frame >= 12)] = 5
    keys = np.empty(count, dtype=KEY_TYPE)
    for index in range(count):
        keys[index] = ("town", "sunny", index, "cav_1", "rsu_1", "antenna", "antenna")
    zeros, rows = np.zeros(len(frame)), len(frame)
    paths = CarrierPaths(
        carrier_hz=28e9, keys=keys, link=frame, row=np.arange(rows), is_los=np.zeros(rows, dtype=bool),
        tau=1e-7 * np.tile([1.0, 2.0, 3.0, 4.0], count), transfer=np.zeros((rows, 2, 2), dtype=complex),
        a=level.astype(complex), theta_t=zeros, phi_t=zeros, theta_r=zeros, phi_r=zeros, doppler_hz=zeros,
        interaction=np.zeros((rows, 0), dtype=np.int8), vertex=np.zeros((rows, 0, 3)), first_segment_m=zeros,
        edge=np.full((rows, 3), np.nan), curvature=np.full((rows, 6), np.nan),
    )  # fmt: skip
    found = lives(paths, path_id, np.zeros(rows, dtype=bool), 1000)
    assert found["thinned_jumps"] == pytest.approx(25 / 50)
    assert found["thinned_jumps_gradual"] == pytest.approx(15 / 25)
    assert found["thinned_jumps_with_step"] == pytest.approx(10 / 25)
    assert found["thinned_jumps_abrupt"] == pytest.approx(10 / 25)
    assert found["thinned_births_of_one_wave"] == found["thinned_births_renamed"] == 1.0
    assert found["births"] == 1 and found["jumps"] == pytest.approx(1 / (4 * 24 - 1))
    assert "thinned_jumps" not in lives(paths, path_id, np.zeros(rows, dtype=bool), 100)


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
