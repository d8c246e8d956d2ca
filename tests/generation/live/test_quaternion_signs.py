"""Signs of live quaternions are those of a stage that is written and read, gaps included."""

import numpy as np
import pytest
from pxr import Usd

from mmw.core.transforms import normalize, quaternion_from_ypr
from mmw.generation.live.quaternion_signs import QuaternionSigns, SignsPart, joined, parted
from mmw.scene.stage.layer import animate, define, new_layer
from mmw.usd.actors import actor_poses, find_actors, poses_read_back
from mmw.usd.prim_specs import set_value


def stage_of(poses: np.ndarray) -> Usd.Stage:
    """Return a stage with one actor a column of poses [F, V, 7]."""
    from pxr import Sdf

    layer = new_layer("signs.usda", {}, 100.0, len(poses))
    for column in range(poses.shape[1]):
        prim = define(layer, f"/World/actor_{column}")
        animate(prim, poses[:, column])
        set_value(prim, "mmw:actor:role", Sdf.ValueTypeNames.Token, "vehicle")
    return Usd.Stage.Open(layer)


@pytest.mark.parametrize("first", [0, 3])
def test_signs_are_those_of_the_stage(first: int) -> None:
    """Jumps by half a turn, whose product is zero up to rounding, and random ones, with gaps of one to many rows."""
    generator = np.random.default_rng(4)
    count, actors = 80, 40
    yaw, pitch, roll = generator.uniform(-np.pi, np.pi, (3, actors)) * np.array([[1.0], [0.1], [0.1]])
    poses = np.full((count, actors, 7), np.nan)
    for row in range(count):
        yaw = yaw + 0.05
        if row in (15, 40, 60):
            yaw = yaw + np.where(np.arange(actors) % 2, np.pi, generator.uniform(-np.pi, np.pi, actors))
        sign = generator.choice([-1.0, 1.0], actors)[:, None]
        poses[row, :, :3] = generator.normal(size=(actors, 3))
        poses[row, :, 3:] = sign * quaternion_from_ypr(yaw, pitch, roll)
    for start, most in ((14, 1), (38, 2), (50, 10)):
        for column in range(actors):
            poses[start + 1 - int(generator.integers(1, most + 1)) : start + 1, column] = np.nan
    stage = stage_of(poses)
    found = find_actors(stage, {})
    expected, _ = actor_poses(found, np.arange(first, count, dtype=np.float64), np.eye(4))
    signs, rows = QuaternionSigns(actors), []
    for row, pose in enumerate(poses):
        turn = signs.write(normalize(pose[:, 3:]))
        if row >= first:
            read = poses_read_back(np.concatenate([pose[:, :3], turn], axis=1))
            rows.append(np.concatenate([read[:, :3], signs.read(read[:, 3:], turn)], axis=1))
    order = [int(actor.name.split("_")[1]) for actor in found]
    assert np.stack(rows)[:, order].tobytes() == expected.tobytes()
    assert (np.isnan(expected[:, :, 0]).sum(axis=0) >= 3).all()


def test_parts_go_on_together_and_alone() -> None:
    """Each part has the signs of its own actors, whichever others went on with it."""
    turns = normalize(np.random.default_rng(5).normal(size=(6, 3, 4, 4)))  # rows, parts, actors
    alone = [QuaternionSigns(4) for _ in range(3)]
    parts = [SignsPart(QuaternionSigns(4), 0, 1) for _ in range(3)]
    wholes = []
    for row, chosen in zip(turns, ([0, 1, 2], [0, 1, 2], [1], [0, 2], [0, 1, 2], [2, 1, 0]), strict=True):
        whole = joined([parts[part] for part in chosen])
        found = whole.write(row[chosen].reshape(-1, 4)).reshape(-1, 4, 4)
        read = whole.read(-row[chosen].reshape(-1, 4), found.reshape(-1, 4)).reshape(-1, 4, 4)
        for place, (part, own) in enumerate(zip(chosen, parted(whole, len(chosen)), strict=True)):
            parts[part] = own
            written = alone[part].write(row[part])
            assert np.array_equal(found[place], written)
            assert np.array_equal(read[place], alone[part].read(-row[part], written))
        wholes.append(whole)
    assert wholes[0] is wholes[1] and len(set(map(id, wholes))) == 5
