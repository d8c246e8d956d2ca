"""Live poses have the bits of a stage that is written and read, gaps included."""

import numpy as np
import pytest
from pxr import Usd

from mmw.core.transforms import quaternion_from_ypr
from mmw.generation.live import stage_poses
from mmw.generation.live.stage_poses import StagePoses, StagePosesPart, joined, parted
from mmw.scene.stage.layer import animate, define, new_layer
from mmw.usd.actors import actor_poses, find_actors
from mmw.usd.prim_specs import set_value


def stage_of(poses: np.ndarray) -> Usd.Stage:
    """Return a stage with one actor a column of poses [F, V, 7]."""
    from pxr import Sdf

    layer = new_layer("signs.usda", {}, 100.0, len(poses))
    define(layer, "/World")
    for column in range(poses.shape[1]):
        prim = define(layer, f"/World/actor_{column}")
        animate(prim, poses[:, column])
        set_value(prim, "mmw:actor:role", Sdf.ValueTypeNames.Token, "vehicle")
    return Usd.Stage.Open(layer)


@pytest.mark.parametrize(("first", "rows", "is_ours"), [(0, 1, True), (3, 1, True), (3, 7, True), (3, 7, False)])
def test_poses_are_those_of_the_stage(first: int, rows: int, is_ours: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Jumps by half a turn, whose product is zero up to rounding, and random ones, with gaps of one to many rows.

    Where USD rounds otherwise than our kernel, USD itself makes the matrices.
    """
    monkeypatch.setattr(stage_poses, "rounds_as_usd", lambda: is_ours)
    generator = np.random.default_rng(4)
    count, actors = 80, 40
    yaw, pitch, roll = generator.uniform(-np.pi, np.pi, (3, actors)) * np.array([[1.0], [0.1], [0.1]])
    pitch[::3], roll[::3] = 0.0, 0.0  # on level ground
    poses = np.full((count, actors, 7), np.nan)
    for row in range(count):
        yaw = yaw + 0.05
        if row in (15, 40, 60):
            yaw = yaw + np.where(np.arange(actors) % 2, np.pi, generator.uniform(-np.pi, np.pi, actors))
        sign = generator.choice([-1.0, 1.0], actors)[:, None]
        poses[row, :, :3] = generator.normal(size=(actors, 3))
        poses[row, :, 3:] = 3.0 * sign * quaternion_from_ypr(yaw, pitch, roll) + 0.0  # no -0, as of traffic
    for start, most in ((14, 1), (38, 2), (50, 10)):
        for column in range(actors):
            poses[start + 1 - int(generator.integers(1, most + 1)) : start + 1, column] = np.nan
    poses[:5, 2] = np.nan
    stage = stage_of(poses)
    found = find_actors(stage, {})
    expected, _ = actor_poses(found, np.arange(first, count, dtype=np.float64), np.eye(4))
    live, read = StagePoses(actors), []
    for row in range(0, count, rows):
        read.append(live.read_back(poses[row : row + rows], max(first - row, 0)))
    order = [int(actor.name.split("_")[1]) for actor in found]
    assert len(order) == actors
    assert np.concatenate(read)[:, order].tobytes() == expected.tobytes()
    assert (np.isnan(expected[:, :, 0]).sum(axis=0) >= 3).all()


def test_parts_go_on_together_and_alone() -> None:
    """Each part has the poses of its own actors, whichever others went on with it."""
    rows = np.random.default_rng(5).normal(size=(6, 2, 3, 4, 7))  # steps, rows, parts, actors
    rows[2, :, 1], rows[3, 0, 2, :2] = np.nan, np.nan
    alone = [StagePoses(4) for _ in range(3)]
    parts = [StagePosesPart(StagePoses(4), 0, 1) for _ in range(3)]
    wholes = []
    for row, chosen in zip(rows, ([0, 1, 2], [0, 1, 2], [1], [0, 2], [0, 1, 2], [2, 1, 0]), strict=True):
        whole = joined([parts[part] for part in chosen])
        read = whole.read_back(row[:, chosen].reshape(2, -1, 7)).reshape(2, -1, 4, 7)
        for place, (part, own) in enumerate(zip(chosen, parted(whole, len(chosen)), strict=True)):
            parts[part] = own
            assert np.array_equal(read[:, place], alone[part].read_back(row[:, part]), equal_nan=True)
        wholes.append(whole)
    assert wholes[0] is wholes[1] and len(set(map(id, wholes))) == 5
