"""The sixteen shipped scenarios: how they drive, that they replay, and that the feature that names them acts."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from mmw.config import Config, load_config
from mmw.core.resources import configs_dir
from mmw.core.transforms import quaternion_to_ypr
from mmw.scene.prepare import make_tracks
from mmw.scene.sources import scenario_source
from mmw.traffic.demand import VehicleTrack
from mmw.traffic.roads.town_asset import Town, open_town
from mmw.usd.vehicle_catalog import load_catalog
from tests.fixtures.link_census import LinkCensus, census
from tests.fixtures.traffic_measures import measure

SCENARIOS = sorted((configs_dir() / "scenarios").glob("*.yaml"))

EVERY = 50
"""Every so many frames are traced here; `docs/reference/scenarios.md` has every tenth."""


@cache
def town_of(source: Path) -> Town:
    return open_town(source)


def drive(path: Path) -> tuple[Config, Town, list[VehicleTrack]]:
    config = load_config(path)
    source = scenario_source(config.scenarios[0], path.parent)
    tracks = make_tracks(config, config.scenarios[0], source, load_catalog(), path.parent)
    return config, town_of(source), tracks


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_traffic_is_sound_at_full_length(path: Path) -> None:
    config, town, tracks = drive(path)
    seconds = config.frames_of(config.scenarios[0]).count / 100
    assert all(len(track.poses) == 100 * seconds + 1 for track in tracks)
    found = measure(tracks, town.lanes, (town.points, town.faces), load_catalog())
    assert found.min_gap > 0.3 and found.max_jerk < 10 and found.max_wheel_error < 0.02
    assert found.stuck == 0 and found.departed == 0 and found.mean_speed > 3
    moved = [float(np.linalg.norm(track.poses[-1, :3] - track.poses[0, :3])) for track in tracks]
    assert np.median(moved) > 20
    if path.stem.endswith("_slope"):
        heights = [np.ptp(track.poses[:, 2]) for track in tracks if track.role == "cav"]
        assert min(heights) > 4
    if path.stem == "town10_h_road":
        assert max(turn(track) for track in tracks if track.role == "cav") > np.radians(150)


def turn(track: VehicleTrack) -> float:
    """Return how far a vehicle has turned to the left at most [rad]."""
    yaw = np.unwrap(quaternion_to_ypr(track.poses[:, 3:])[:, 0])
    return float((yaw - yaw[0]).max())


@pytest.mark.parametrize("name", ["town05_ring_road", "town10_h_road"])
def test_a_scenario_replays_bit_by_bit(name: str) -> None:
    path = configs_dir() / "scenarios" / f"{name}.yaml"
    first, second = (drive(path)[2] for _ in range(2))
    for a, b in zip(first, second, strict=True):
        assert (a.name, a.model, a.paint) == (b.name, b.model, b.paint)
        np.testing.assert_array_equal(a.poses, b.poses)


@cache
def links_of(name: str) -> list[LinkCensus]:
    path = configs_dir() / "scenarios" / f"{name}.yaml"
    return census(load_config(path), path.parent, EVERY)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "blocker"),
    [
        ("town03_gas_station", "gas canopy"),
        ("town05_dual_skybridges", "skybridge"),
        ("town05_t_junction_overpass", "bridge"),
        ("town07_single_lane", "silo"),
        ("town10_wide_skybridge", "skybridge"),
    ],
)
def test_the_feature_blocks_and_lets_through(name: str, blocker: str) -> None:
    links = links_of(name)
    assert all(link.blockers.get(blocker, 0.0) > 0.05 for link in links)
    assert any(0.1 < link.los_share < 0.95 for link in links)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "reflector", "least"),
    [
        ("town05_cbd_crossroad", "glass", 0.4),
        ("town05_t_junction_overpass", "bridge", 0.2),
        ("town05_parking_lot", "parked car", 0.04),
    ],
)
def test_the_feature_reflects(name: str, reflector: str, least: float) -> None:
    assert all(link.reflectors.get(reflector, 0.0) >= least for link in links_of(name))


@pytest.mark.slow
def test_the_rural_crossroad_is_open() -> None:
    links = links_of("town07_crossroad")
    assert all(link.los_share > 0.8 for link in links)
    assert np.mean([link.mean_paths for link in links]) < 2.0
