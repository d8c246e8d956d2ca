"""Stages are shared where nothing differs that decides them, and only there."""

import pytest

from mmw.config import load_config
from mmw.generation.shared_stages import stage_identity


def identity(*changes: str) -> object:
    config = load_config("quickstart", changes)
    return stage_identity(config, config.scenarios[0])


@pytest.mark.parametrize(
    "change",
    [
        "weathers=[sunny, rainy]", "channel.carriers_hz=[28e9]", "channel.max_depth=2", "compute.batch_frames=3",
        "output.shard_frames=5", "frames={start: 4, count: 6}", "scenarios.0.description=other",
        "vary={weather: {sunny: {wind_m_s: [1, 2]}}}|vary={weather: {sunny: {wind_m_s: [3, 4]}}}",
    ],
)  # fmt: skip
def test_what_does_not_decide_a_stage(change: str) -> None:
    first, _, second = change.partition("|")
    assert identity(first) == (identity(second) if second else identity())


@pytest.mark.parametrize(
    "change",
    [
        "seed=1", "frames.count=11", "weathers=[rainy]", "scenarios.0.traffic.vehicle_count=12",
        "scenarios.0.town=town05",
        "scenarios.0.rsus.0.yaw_deg=1", "sensors.lidar.mount.cav.yaw_deg=5", "sensors.lidar.rate_hz=50",
        "channel.antennas=[{power_dbm: 30}]", "channel.enabled=false", "vary={spawn: {}}",
        "vary={spawn: {radius_m: 99}}", "vary={rsu: {}}",
    ],
)  # fmt: skip
def test_what_decides_a_stage(change: str) -> None:
    assert identity(change) != identity()
    assert identity(change) == identity(change)


def test_every_change_of_the_drawn_places_counts() -> None:
    assert identity("vary={spawn: {radius_m: 99}}") != identity("vary={spawn: {radius_m: 98}}")
    assert identity("vary={rsu: {radius_m: 99}}") != identity("vary={rsu: {radius_m: 98}}")
