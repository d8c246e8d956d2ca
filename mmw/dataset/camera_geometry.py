"""Transform points between world, agent, sensor and pixels by the poses and intrinsics of a dataset."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mmw.core.camera_models import Distortion, Intrinsics
from mmw.core.errors import InputError
from mmw.core.remember import remembered
from mmw.core.transforms import invert, make_pose, normalize, quaternion_from_ypr, transform_points
from mmw.sensors.render.projection import project, unproject

__all__ = [
    "CORNERS", "EDGES", "POSE_COLUMNS", "Camera", "box_corners", "from_world", "intrinsics_from_row", "pose_from_row",
    "poses_from_rows", "to_world",
]  # fmt: skip

POSE_COLUMNS = ("x", "y", "z", "qx", "qy", "qz", "qw")
"""Columns of a pose in `poses` and `sensors`."""

CORNERS = np.array([[sx, sy, sz] for sx in (-0.5, 0.5) for sy in (-0.5, 0.5) for sz in (-0.5, 0.5)])
"""Corners of a box over its size, shape [8, 3]: z changes first, then y, then x."""

EDGES = np.array([(a, b) for a in range(8) for b in range(a + 1, 8) if bin(a ^ b).count("1") == 1])
"""Edges of a box as pairs of `CORNERS`, shape [12, 2]."""


def pose_from_row(row: Mapping[str, Any]) -> np.ndarray:
    """Return the pose (x, y, z, qx, qy, qz, qw) of a row of `poses` or `sensors`, shape [7]."""
    return poses_from_rows([row])[0]


def poses_from_rows(rows: Sequence[Mapping[str, Any]]) -> np.ndarray:
    """Return the poses of some rows, shape [N, 7], see `pose_from_row`."""
    values = [[row[name] for name in POSE_COLUMNS] for row in rows]
    return _normalized(np.array(values, dtype=np.float64).reshape(-1, len(POSE_COLUMNS)))


def poses_of_columns(columns: Sequence[np.ndarray]) -> np.ndarray:
    """Return the poses of some rows by their `POSE_COLUMNS`, shape [N, 7], see `pose_from_row`."""
    return _normalized(np.ascontiguousarray(np.array(columns, dtype=np.float64).T))


def _normalized(pose: np.ndarray) -> np.ndarray:
    return np.concatenate([pose[:, :3], normalize(pose[:, 3:])], axis=1)


def from_world(pose: ArrayLike, points: ArrayLike) -> np.ndarray:
    """Return points of the world in the frame that a pose describes [m], shape [..., 3].

    Args:
        pose: Agent to world or sensor to world, shape [7].
        points: World points [m], shape [..., 3].

    Examples:
        >>> import numpy as np
        >>> pose = [10.0, 0.0, 2.0, 0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]  # looks north
        >>> from_world(pose, [10.0, 5.0, 2.0]).round().astype(int).tolist()  # 5 m ahead
        [5, 0, 0]
    """
    return transform_points(invert(pose), points)


def to_world(pose: ArrayLike, points: ArrayLike) -> np.ndarray:
    """Return points of the frame that a pose describes in the world [m], shape [..., 3]."""
    return transform_points(pose, points)


def intrinsics_from_row(row: Mapping[str, Any]) -> Intrinsics:
    """Return the camera that a row of `sensors` describes, its lens included.

    Raises:
        InputError: If the sensor is no camera, or its lens has another number of coefficients.
    """
    if any(row[name] is None for name in ("fx", "fy", "cx", "cy", "width", "height")):
        raise InputError(f"sensor {row['sensor']!r} of {row['agent']}: is of type {row['type']}; a camera is needed")
    given = [float(value) for value in row["coefficients"] or ()]
    wanted = {"fisheye": 4, "brown_conrady": 8}.get(row["lens"], len(given))
    if len(given) != wanted:
        raise InputError(
            f"sensor {row['sensor']!r} of {row['agent']}: its lens {row['lens']} has {len(given)} coefficients; "
            f"{wanted} are needed"
        )
    if row["lens"] == "fisheye":
        k1, k2, k3, k4 = given
        lens = Distortion("fisheye", radial=(k1, k2, k3, k4))
    elif row["lens"] == "brown_conrady":
        k1, k2, p1, p2, k3, k4, k5, k6 = given
        lens = Distortion("brown_conrady", radial=(k1, k2, k3, 0.0), rational=(k4, k5, k6), tangential=(p1, p2))
    else:
        lens = Distortion()
    size = int(row["width"]), int(row["height"])
    return Intrinsics(*size, *(float(row[name]) for name in ("fx", "fy", "cx", "cy")), lens)


@remembered()
def known_intrinsics(row: Mapping[str, Any]) -> Intrinsics:
    """Return `intrinsics_from_row`, made once for a row that does not change."""
    return intrinsics_from_row(row)


@dataclass(frozen=True)
class Camera:
    """A camera at one instant.

    Examples:
        >>> import mmw
        >>> frame = mmw.open_dataset("out/quickstart").frame("town03_roundabout", "sunny", 0)
        >>> camera = frame.agents["cav_1"].views["front"].camera
        >>> pixels = camera.pixels(frame.boxes.corners)  # of all boxes; NaN behind the camera
        >>> pixels.shape, bool(camera.is_inside(pixels).any())
        ((20, 8, 2), True)
    """

    intrinsics: Intrinsics
    pose: np.ndarray
    """Sensor to world, shape [7]; x along the optical axis, y left, z up."""

    def pixels(self, points: ArrayLike) -> np.ndarray:
        """Return the places of world points in the image, column and row [px], shape [..., 2].

        Pixel (u, v) is the one with these whole parts; points beside the image lie outside it, those behind a camera
        that is no fisheye are NaN.

        Args:
            points: World points [m], shape [..., 3].
        """
        return project(self.intrinsics, from_world(self.pose, points))

    def depths(self, points: ArrayLike) -> np.ndarray:
        """Return the depth of points of the world along the optical axis [m], shape [...]."""
        return from_world(self.pose, points)[..., 0]

    def is_inside(self, pixels: ArrayLike) -> np.ndarray:
        """Return whether places [..., 2] are in the image, shape [...]; False for NaN."""
        place = np.asarray(pixels, dtype=np.float64)
        size = [self.intrinsics.width, self.intrinsics.height]
        return np.asarray(((place >= 0.0) & (place < size)).all(axis=-1))

    def rays(self, pixels: ArrayLike) -> np.ndarray:
        """Return the unit directions through places of the image in the world, shape [..., 3].

        Args:
            pixels: Column and row [px]; (u + 0.5, v + 0.5) is the center of pixel (u, v), shape [..., 2].

        Raises:
            InputError: If the lens gives one of them no direction of its own.
        """
        turn = np.concatenate([np.zeros(3), self.pose[3:]])
        return transform_points(turn, unproject(self.intrinsics, np.asarray(pixels, dtype=np.float64)))

    def points(self, depth: np.ndarray) -> np.ndarray:
        """Return the world point behind every pixel [m], shape [H, W, 3]; NaN where depth is not finite.

        Args:
            depth: Depth along the optical axis [m], inf for nothing, shape [H, W].

        Raises:
            InputError: If the image differs in size from the camera's.
        """
        size = (self.intrinsics.height, self.intrinsics.width)
        if depth.shape != size:
            raise InputError(f"depth image of shape {depth.shape}; the camera has {size}; give an image of it")
        v, u = np.mgrid[: size[0], : size[1]] + 0.5
        ray = unproject(self.intrinsics, np.stack([u, v], axis=-1))
        far = np.where(np.isfinite(depth), depth, np.nan) / ray[..., 0]
        return to_world(self.pose, ray * far[..., None])


def box_corners(rows: Mapping[str, Any]) -> np.ndarray:
    """Return the corners of boxes in the world [m], shape [N, 8, 3], in the order of `CORNERS`.

    Args:
        rows: Columns of table `boxes`, shape [N] each: x, y, z, yaw, pitch, roll, length, width, height.
    """
    names = ("x", "y", "z", "yaw", "pitch", "roll", "length", "width", "height")
    x, y, z, yaw, pitch, roll, *size = (np.asarray(rows[name], dtype=np.float64) for name in names)
    pose = make_pose(np.stack([x, y, z], axis=-1), quaternion_from_ypr(yaw, pitch, roll))
    return transform_points(pose[:, None], CORNERS * np.stack(size, axis=-1)[:, None])
