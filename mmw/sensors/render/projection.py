"""Project points to pixels and pixels to directions, in float64, as `kernels/camera/camera.py` does on the device."""

from typing import Protocol

import numpy as np

from mmw.config.lens import LensConfig
from mmw.core.camera_models import Intrinsics
from mmw.core.errors import InputError
from mmw.core.remember import remembered

NEAREST = 1e-6
"""Depth over distance from which on a point counts as before a pinhole."""


class CameraSection(Protocol):
    """Keys of a camera's section that set its projection."""

    @property
    def width_px(self) -> int: ...
    @property
    def height_px(self) -> int: ...
    @property
    def fov_deg(self) -> float: ...
    @property
    def lens(self) -> LensConfig: ...
    @property
    def range_m(self) -> float: ...


@remembered()
def intrinsics_of(config: CameraSection) -> Intrinsics:
    """Return the intrinsics of a configured camera.

    Raises:
        InputError: If the lens does not fit the image (never for a section that was checked, `check_lens`).
    """
    return config.lens.intrinsics(config.width_px, config.height_px, config.fov_deg)


def project(camera: Intrinsics, points: np.ndarray) -> np.ndarray:
    """Return where points lie in the image, column and row [px] with pixel edges at whole numbers, shape [..., 2].

    Pixel (u, v) is the one with these whole parts. Points beside the image get places outside it: beyond the image the
    distortion goes on linearly, so that nothing folds back. Points behind a camera that is no fisheye are NaN.

    Args:
        camera: Intrinsics.
        points: Points in the sensor frame (x along the optical axis, y left, z up), shape [..., 3].
    """
    points = np.asarray(points, dtype=np.float64)
    x, across = points[..., 0], -points[..., 1:]
    if camera.distortion.model == "fisheye":
        aside = np.hypot(across[..., 0], across[..., 1])
        angle = np.arctan2(aside, x)
        share = np.where(aside > 0.0, angle / np.maximum(aside, np.finfo(float).tiny), 1.0)
        q = across * share[..., None]
    else:
        is_ahead = x > NEAREST * np.linalg.norm(points, axis=-1)
        q = np.where(is_ahead[..., None], across / np.where(is_ahead, x, 1.0)[..., None], np.nan)
    if camera.distortion.model != "pinhole":
        stretch = np.maximum(np.hypot(q[..., 0], q[..., 1]) / camera.reach(), 1.0)[..., None]
        q = stretch * camera.distortion.distort(q / stretch)[0]
    return np.array([camera.cx, camera.cy]) + np.array([camera.fx, camera.fy]) * q


def unproject(camera: Intrinsics, pixels: np.ndarray) -> np.ndarray:
    """Return the unit directions through points of the image, sensor frame, shape [..., 3].

    Args:
        camera: Intrinsics.
        pixels: Column and row [px], pixel edges at whole numbers: (u + 0.5, v + 0.5) is a pixel's center; [..., 2].

    Raises:
        InputError: If the lens gives one of them no direction of its own.
    """
    pixels = np.asarray(pixels, dtype=np.float64)
    target = (pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    if camera.distortion.model == "pinhole":
        q = target
    else:
        q, share = camera.distortion.undistort(target)
        if share.min(initial=1.0) < 1.0:
            place = pixels.reshape(-1, 2)[int(np.argmin(share))]
            raise InputError(
                f"pixel ({place[0]:g}, {place[1]:g}): the lens, {camera.distortion.model}, folds before it; a pixel of "
                "the image is needed; correct the pixel"
            )
    if camera.distortion.model == "fisheye":
        angle = np.hypot(q[..., 0], q[..., 1])
        aside = -q * np.sinc(angle / np.pi)[..., None]  # sin(angle) / angle
        return np.concatenate([np.cos(angle)[..., None], aside], axis=-1)
    ray = np.concatenate([np.ones((*q.shape[:-1], 1)), -q], axis=-1)
    return ray / np.linalg.norm(ray, axis=-1, keepdims=True)
