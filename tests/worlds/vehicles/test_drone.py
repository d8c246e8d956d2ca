"""The quadrotor: closed parts of the stated size, and the committed asset."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from pxr import Usd

from mmw.config.agent_keys import ROLE_MOUNTS
from mmw.core.resources import assets_dir
from mmw.usd.validate import validate_stage
from mmw.usd.vehicle_catalog import load_drones
from mmw.worlds.vehicles.build import build_drones
from mmw.worlds.vehicles.drone_model import DRONE_MATERIAL, PAINTS, build_drone


def test_parts_are_closed_and_symmetric() -> None:
    shape = build_drone()
    bodies = trimesh.Trimesh(shape.points, shape.faces, process=False).split()
    assert len(bodies) == 3 + 4 * 4 and all(body.is_watertight and body.volume > 0 for body in bodies)
    assert set(shape.parts.tolist()) == set(DRONE_MATERIAL)
    np.testing.assert_allclose(shape.points[:, 1].min(), -shape.points[:, 1].max())


def test_motors_are_a_third_of_a_meter_apart() -> None:
    shape = build_drone()
    motors = shape.points[np.unique(shape.faces[shape.parts == "motors"])]
    front_left = motors[(motors[:, 0] > 0) & (motors[:, 1] > 0)]
    middle = 0.5 * (front_left.min(axis=0) + front_left.max(axis=0))
    assert 2 * np.hypot(*middle[:2]) == pytest.approx(0.35, abs=1e-3)


def test_committed_asset_is_what_the_builder_makes(tmp_path: Path) -> None:
    (path,) = build_drones(tmp_path)
    shipped = assets_dir() / "drones" / path.stem
    assert {file.name for file in path.parent.iterdir()} == {file.name for file in shipped.iterdir()}
    for file in path.parent.iterdir():
        assert file.read_bytes() == (shipped / file.name).read_bytes()
    assert validate_stage(Usd.Stage.Open(str(shipped / path.name))) == []


def test_model_says_its_box_and_class() -> None:
    (model,) = load_drones().values()
    assert (model.name, model.label, set(model.paints)) == ("quadrotor", "dynamic", set(PAINTS))
    assert model.paints[0] == PAINTS[0] and model.length == pytest.approx(model.width)
    assert ROLE_MOUNTS["uav"][2] < model.center[2] - 0.5 * model.height  # what hangs below it is in the open
