"""Cameras without distortion: optical axes, and the rectangle around a box in an image."""

import numpy as np

from mmw.core.transforms import quaternion_from_matrix
from mmw.dataset.camera_geometry import EDGES

OPTICAL_AXES = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Rotation from optical axes (x right, y down, z forward) to a sensor's (x forward, y left, z up)."""

OPTICAL_POSE = np.concatenate([np.zeros(3), quaternion_from_matrix(OPTICAL_AXES)])
"""The same as a pose, optical frame to sensor, shape [7]."""

NEAREST_M = 0.05
"""Near clipping distance [m]; design value."""


def box_rectangle(corners: np.ndarray, intrinsic: np.ndarray) -> np.ndarray | None:
    """Return left, top, right, bottom [px] of the part of a box before a pinhole camera, reaching beyond the image.

    Args:
        corners: Corners of the box in the camera's optical frame [m], shape [8, 3], in the order of
            `mmw.dataset.export.read_sensors.box_corners`.
        intrinsic: Camera matrix [px], shape [3, 3].

    Returns:
        Shape [4]; None if the box is behind the camera.
    """
    begin, end = corners[EDGES[:, 0]], corners[EDGES[:, 1]]
    depth = np.stack([begin[:, 2], end[:, 2]])
    crosses = (depth.min(axis=0) < NEAREST_M) & (depth.max(axis=0) > NEAREST_M)
    share = (NEAREST_M - begin[crosses, 2]) / (end[crosses, 2] - begin[crosses, 2])
    points = np.concatenate(
        [corners[corners[:, 2] >= NEAREST_M], begin[crosses] + share[:, None] * (end - begin)[crosses]]
    )
    if not len(points):
        return None
    pixels = points @ intrinsic.T
    pixels = pixels[:, :2] / pixels[:, 2:]
    return np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])


def area(rectangle: np.ndarray) -> float:
    """Return the area of left, top, right, bottom; 0 if it is empty."""
    return float(np.prod(np.maximum(rectangle[2:] - rectangle[:2], 0.0)))


def clipped(rectangle: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return the part of left, top, right, bottom [px] in an image of width, height [px]; area 0 if there is none."""
    return np.clip(rectangle, 0.0, [*size, *size])
