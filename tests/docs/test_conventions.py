"""The tables of docs/concepts/conventions.md that convert to other tools, evaluated and compared with the code."""

from pathlib import Path

import numpy as np
import pytest

from mmw.core.transforms import (
    IDENTITY_POSE,
    invert,
    pose_from_ypr,
    pose_to_matrix,
    quaternion_from_ypr,
    quaternion_to_matrix,
    transform_points,
)
from mmw.dataset.export.carla_frames import carla_angles, carla_matrix, carla_point, carla_pose
from mmw.dataset.export.deepmimo import scenarios as deepmimo
from mmw.dataset.export.kitti import label_line
from mmw.dataset.export.pinhole import OPTICAL_POSE
from mmw.dataset.export.read_radio import Antennas
from mmw.dataset.export.read_sensors import Sensor
from tests.fixtures.pages import markdown_rows

PAGE = Path(__file__).parents[2] / "docs" / "concepts" / "conventions.md"
YPR = (0.4, -0.3, 0.2)
POINT = (3.0, -2.0, 0.7)


def rows(first: str) -> dict[str, dict[str, str]]:
    """Return the table whose first heading is `first`: first cell -> heading -> cell."""
    head, *cells = markdown_rows(PAGE.read_text(), first)
    return {row[0]: dict(zip(head, row, strict=True)) for row in cells}


TOOLS = rows("tool")
QUANTITIES = rows("quantity")


def value(cell: str, yaw: float = YPR[0], pitch: float = YPR[1], roll: float = YPR[2]) -> np.ndarray:
    """Return what a cell such as `(x, -y, z)` gives for the point and the turn of this test."""
    x, y, z = POINT
    names = {"x": x, "y": y, "z": z, "yaw": yaw, "pitch": pitch, "roll": roll, "pi": np.pi, "__builtins__": {}}
    return np.atleast_1d(np.asarray(eval(cell.split(", from")[0], names), dtype=np.float64))


def test_every_tool_is_there() -> None:
    names = " ".join(TOOLS)
    for tool in ("CARLA", "OPV2V", "nuScenes", "KITTI", "Sionna RT", "DeepMIMO", "ROS", "OpenCV"):
        assert tool in names


@pytest.mark.parametrize("tool", ["CARLA", "OPV2V"])
def test_carla(tool: str) -> None:
    cells = TOOLS[tool]
    np.testing.assert_allclose(value(cells["point"]), carla_point(POINT))
    roll, yaw, pitch = np.radians(carla_angles(YPR))
    np.testing.assert_allclose(value(cells["rotation"]), [yaw, pitch, roll])
    pose = carla_pose(pose_from_ypr(POINT, *YPR))  # x, y, z, roll, yaw, pitch, as the cell of OPV2V says
    np.testing.assert_allclose(np.radians(pose[[4, 5, 3]]), [yaw, pitch, roll])
    # Unreal's own matrix of these angles, written out: yaw and roll turn left-handed, pitch lifts the nose.
    cy, sy, cp, sp, cr, sr = (f(a) for a in (yaw, pitch, roll) for f in (np.cos, np.sin))
    unreal = [
        [cp * cy, cy * sp * sr - sy * cr, -cy * sp * cr - sy * sr],
        [cp * sy, sy * sp * sr + cy * cr, -sy * sp * cr + cy * sr],
        [sp, -cp * sr, cp * cr],
    ]
    np.testing.assert_allclose(carla_matrix(pose_from_ypr(POINT, *YPR))[:3, :3], unreal, atol=1e-12)


def test_optical_axes() -> None:
    optical = transform_points(invert(OPTICAL_POSE), POINT)
    tools = [cells for cells in TOOLS.values() if cells["axes x, y, z"] == "right, down, forward"]
    assert len(tools) == 4
    for cells in tools:
        np.testing.assert_allclose(value(cells["point"]), optical, atol=1e-12)


def test_kitti_rotation_y() -> None:
    intrinsic = np.array([[300.0, 0, 320], [0, 300.0, 240], [0, 0, 1]])
    camera = Sensor("a", "front", "rgb", IDENTITY_POSE, intrinsic, (640, 480), "pinhole", (), "{}")
    box = {"x": 20.0, "y": 1.0, "z": 0.0, "yaw": 0.4, "pitch": 0.0, "roll": 0.0}
    box |= {"length": 4.0, "width": 2.0, "height": 1.5, "category": "car"}
    fields = label_line(box, invert(OPTICAL_POSE), camera, None).split()
    np.testing.assert_allclose(float(fields[-1]), value(TOOLS["KITTI, camera"]["rotation"])[0], atol=1e-4)
    assert [float(size) for size in fields[8:11]] == [1.5, 2.0, 4.0]  # height, width, length
    np.testing.assert_allclose([float(place) for place in fields[11:14]], [-1.0, 0.75, 20.0])  # its underside


@pytest.mark.parametrize("tool", ["Sionna RT", "nuScenes", "ROS (REP 103), body"])
def test_turns_that_are_ours(tool: str) -> None:
    """R = Rz(yaw) Ry(pitch) Rx(roll), built from rotations about single axes."""
    turn = dict(zip(("yaw", "pitch", "roll"), YPR, strict=True))
    named = [name.strip(" ()") for name in TOOLS[tool]["rotation"].split(",")]
    assert sorted(named) == ["pitch", "roll", "yaw"]
    c, s = {n: np.cos(a) for n, a in turn.items()}, {n: np.sin(a) for n, a in turn.items()}
    z = np.array([[c["yaw"], -s["yaw"], 0], [s["yaw"], c["yaw"], 0], [0, 0, 1]])
    y = np.array([[c["pitch"], 0, s["pitch"]], [0, 1, 0], [-s["pitch"], 0, c["pitch"]]])
    x = np.array([[1, 0, 0], [0, c["roll"], -s["roll"]], [0, s["roll"], c["roll"]]])
    np.testing.assert_allclose(quaternion_to_matrix(quaternion_from_ypr(*YPR)), z @ y @ x, atol=1e-12)
    np.testing.assert_allclose(pose_to_matrix(pose_from_ypr(POINT, *YPR))[:3, :3], z @ y @ x, atol=1e-12)


def test_deepmimo_rotation_and_interactions(tmp_path: Path) -> None:
    pose = pose_from_ypr(POINT, *YPR)
    antennas = Antennas({(0, "a"): 0}, pose[None], np.zeros((1, 3)), ["cav"])
    deepmimo._write_ends(tmp_path / "ends.npz", antennas, [(0, "a")], 100)
    written = np.load(tmp_path / "ends.npz")["rotation_deg"][0]
    np.testing.assert_allclose(np.radians(written), value(TOOLS["DeepMIMO"]["rotation"]))
    cells = QUANTITIES["interactions"]
    ours = [int(part.split()[0]) for part in cells["mmw"].split(", ")]
    theirs = [int(part) for part in cells["DeepMIMO v4"].split(", ")]
    assert dict(zip(ours, theirs, strict=True)) == deepmimo.DIGITS
