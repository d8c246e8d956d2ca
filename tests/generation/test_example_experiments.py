"""The shipped examples of experiments run, in small."""

from pathlib import Path

import pytest

import mmw
from mmw.cli.verify import main as verify

pytestmark = pytest.mark.slow
SMALL = [
    "frames.count=2",
    "sensors.lidar.channels=4",
    "sensors.lidar.points_per_channel=36",
    "sensors.lidar.rate_hz=50",
]


def test_six_datasets_from_one_file(tmp_path: Path) -> None:
    found = mmw.generate("sweep_3x2", tmp_path, overrides=SMALL, device="cpu", workers=1, progress=False)
    assert list(found) == [f"seed-{seed},vehicle_count-{count}" for seed in (1, 2, 3) for count in (12, 40)]
    assert verify([str(tmp_path)]) == 0
    rain = [data.info["config"]["air"]["rainy"]["rain_mm_h"] for data in found.values()]
    assert rain[0] == rain[1] and len(set(rain)) == 3  # by seed
    boxes = [data.read("boxes", weather="sunny", frames=range(1)).num_rows for data in found.values()]
    assert boxes[1] - boxes[0] == 40 - 12


def test_eight_units_have_links_to_three_vehicles(tmp_path: Path) -> None:
    data = mmw.generate("eight_rsus", tmp_path, overrides=SMALL, device="cpu", workers=1, progress=False)
    assert verify([str(tmp_path)]) == 0
    links = data.read("links", frames=range(1)).to_pandas()
    assert set(links["peer"]) == {f"rsu_{number}" for number in range(1, 9)} and len(links) == 8 * 3 * 2
    assert links["is_los"].mean() > 0.2
    assert set(data.read("lidar").to_pandas()["agent"]) == {f"rsu_{number}" for number in range(1, 9)}
