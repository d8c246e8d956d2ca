"""Datasets of two seeds with `vary`: complete, other drives, units and weather, and their rows can be made again."""

from pathlib import Path

import numpy as np
import pytest

import mmw
from mmw.cli.verify import main as verify

CHANGES = [
    "frames.count=3", "weathers=[rainy]", "sensors=[{type: imu}, {type: gnss}]", "channel.candidates=exhaustive",
    "scenarios.*.traffic.vehicle_count=12", "scenarios.*.traffic.cav_ranks=[0, 1]",
    "vary={spawn: {radius_m: 100}, rsu: {radius_m: 40}, weather: {rainy: {rain_mm_h: [2, 40]}}}",
    "sweep={grid: {seed: [1, 2]}}",
]  # fmt: skip


@pytest.mark.slow
def test_two_seeds_are_two_worlds(tmp_path: Path) -> None:
    found = mmw.generate("town10_crossroad", tmp_path, overrides=CHANGES, device="cpu", workers=1, progress=False)
    one, other = found["seed-1"], found["seed-2"]
    assert verify([str(tmp_path), "--rerender", "3"]) == 0
    for agent in ("rsu_1", "cav_1"):
        first, second = (data.read("poses", agent=agent).to_pandas()[["x", "y"]].to_numpy() for data in (one, other))
        assert np.linalg.norm(first[0] - second[0]) > 3.0
    rain = [data.info["config"]["air"]["rainy"]["rain_mm_h"] for data in (one, other)]
    assert rain[0] != rain[1] and all(2 <= value <= 40 for value in rain)
