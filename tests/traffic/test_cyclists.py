"""Cyclists: at the road edge with the curb on their right, slow in curves, leaning; the figure and its asset."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from pxr import Usd

from mmw.config import TrafficConfig
from mmw.config.agent_keys import ROLE_MOUNTS
from mmw.core.constants import FRAME_RATE_HZ, GRAVITY
from mmw.core.errors import InputError
from mmw.core.resources import assets_dir
from mmw.core.transforms import rotate
from mmw.traffic.cyclists import (
    ACCELERATION,
    CURB_OFFSET,
    CYCLING_SPEED,
    LATERAL_ACCELERATION,
    curve_speeds,
    road_edges,
    simulate_cyclists,
)
from mmw.traffic.demand import TrafficDemand, VehicleTrack
from mmw.traffic.ground_height import Ground
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.roads.sidewalk_prims import Sidewalk
from mmw.traffic.roads.town_asset import Town
from mmw.traffic.route import PATH_STEP
from mmw.usd.validate import validate_stage
from mmw.usd.vehicle_catalog import load_cyclists
from mmw.worlds.vehicles.build import build_cyclists
from mmw.worlds.vehicles.cyclist_model import build_cyclist

HALF = 30.0
"""Half the side of a square block [m]; a road of 6 m is around it."""


def square(half: float, z: float) -> np.ndarray:
    return np.array([(half, -half, z), (half, half, z), (-half, half, z), (-half, -half, z)])


def block(is_reversed: bool = False) -> Town:
    """Return a block with its walk line 2 m from the curb, 0.15 m above the road."""
    ring = np.concatenate([square(HALF, 0.0), square(HALF + 6.0, 0.0)])
    faces = [(k, k + 4, (k + 1) % 4 + 4) for k in range(4)] + [(k, (k + 1) % 4 + 4, (k + 1) % 4) for k in range(4)]
    points = square(HALF - 2.0, 0.15)
    walk = Sidewalk("walk_000", points[::-1] if is_reversed else points, True)
    return Town(Path("town.usda"), LaneGraph(), ring, np.array(faces, np.int32), (walk,))


def cyclists(town: Town, count: int = 3, frames: int = 1200, ranks: tuple[int, ...] = ()) -> list[VehicleTrack]:
    traffic = TrafficConfig(spawn_center_m=(HALF, 0, 0), cyclist_count=count, vru_cyclist_ranks=ranks)
    return simulate_cyclists(TrafficDemand(town, traffic, {}, frames, 7))


@pytest.mark.parametrize("is_reversed", [False, True])
def test_edge_has_the_curb_on_the_right(is_reversed: bool) -> None:
    town = block(is_reversed)
    (line,) = road_edges(town.sidewalks[0], Ground(town.points, town.faces))
    assert line.is_closed and np.abs(line.points[:, 2]).max() < 1e-4
    reach = np.abs(line.points[:, :2]).max(axis=1)
    straight = np.abs(line.points[:, :2]).min(axis=1) < HALF - 10.0
    np.testing.assert_allclose(reach[straight], HALF + CURB_OFFSET, atol=0.11)
    turn = np.cross(np.append(line.points[0, :2], 0.0), np.append(np.diff(line.points[:2, :2], axis=0)[0], 0.0))
    assert turn[2] < 0.0  # clockwise: the block is on the right


def test_cyclists_keep_to_their_speed_and_slow_down_in_curves() -> None:
    town = block()
    (line,) = road_edges(town.sidewalks[0], Ground(town.points, town.faces))
    limit = curve_speeds(line)
    curvature = np.abs(np.gradient(line.heading, PATH_STEP))
    assert (limit**2 * curvature)[5:-5].max() < 1.6 * LATERAL_ACCELERATION  # the curve is rounded over a wheelbase
    assert np.abs(np.diff(limit**2)).max() <= 2.0 * ACCELERATION * PATH_STEP + 1e-9
    for track in cyclists(town):
        steps = np.linalg.norm(np.diff(track.poses[:, :3], axis=0), axis=1) * FRAME_RATE_HZ
        assert steps.max() <= CYCLING_SPEED[1] and steps.min() > 1.0
        change = np.linalg.norm(np.diff(track.poses[:, :3], n=2, axis=0), axis=1) * FRAME_RATE_HZ**2
        assert change.max() < 2.0 * LATERAL_ACCELERATION


def test_weight_and_centrifugal_force_are_along_the_body() -> None:
    (track,) = cyclists(block(), count=1)
    force = -np.gradient(np.gradient(track.poses[:, :3], axis=0), axis=0) * FRAME_RATE_HZ**2 - (0, 0, GRAVITY)
    left = rotate(track.poses[:, 3:], np.tile([0.0, 1.0, 0.0], (len(force), 1)))
    assert np.abs(left[:, 2]).max() > 0.1  # it leans somewhere
    assert np.abs((force * left).sum(axis=1))[20:-20].max() < 0.8


def test_names_roles_and_errors() -> None:
    tracks = cyclists(block(), ranks=(2,))
    assert [(track.name, track.role) for track in tracks] == [
        ("cyc_001", "vehicle"), ("cyc_002", "vehicle"), ("vru_1", "vru"),
    ]  # fmt: skip
    assert cyclists(block(), count=0) == []
    with pytest.raises(
        InputError, match=r"cyclist_count = 200: the town's road edges beside walk lines have \d+ places"
    ):
        cyclists(block(), count=200)


def test_figure_is_made_of_closed_bodies_on_two_wheels() -> None:
    shape = build_cyclist()
    bodies = trimesh.Trimesh(shape.points, shape.faces, process=False).split()
    assert len(bodies) > 50 and all(body.is_watertight and body.volume > 0 for body in bodies)
    low = shape.points[shape.points[:, 2] < 0.005]
    assert low[:, 0].min() == pytest.approx(-0.53, abs=0.06) and low[:, 0].max() == pytest.approx(0.53, abs=0.06)
    phone = np.array(ROLE_MOUNTS["vru"])
    assert np.linalg.norm(shape.points - phone, axis=1).min() > 0.08
    assert not any(body.contains([phone])[0] for body in bodies if body.bounds[0][2] < phone[2] < body.bounds[1][2])


def test_committed_asset_is_what_the_builder_makes(tmp_path: Path) -> None:
    (path,) = build_cyclists(tmp_path)
    shipped = assets_dir() / "cyclists" / path.stem
    assert {file.name for file in path.parent.iterdir()} == {file.name for file in shipped.iterdir()}
    for file in path.parent.iterdir():
        assert file.read_bytes() == (shipped / file.name).read_bytes()
    assert validate_stage(Usd.Stage.Open(str(shipped / path.name))) == []
    (model,) = load_cyclists().values()
    assert (model.name, model.label) == ("cyclist", "bicycle") and 1.7 < model.height < 2.0 and model.length < 1.9
