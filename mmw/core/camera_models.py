"""Apply and invert lens distortion in float64; `kernels/camera/camera.py` does the same on the device.

Plane coordinates q of a direction point right and down. Pinhole and Brown-Conrady: q = (X / Z, Y / Z) with Z along the
optical axis. Fisheye: |q| is the angle from the axis [rad]. A pixel is at (cx + fx q'_x, cy + fy q'_y), q' distorted:

    radial       q' = q (1 + a1 s + a2 s^2 + a3 s^3 + a4 s^4) / (1 + b1 s + b2 s^2 + b3 s^3),  s = |q|^2
    tangential   q'_x += 2 p1 q_x q_y + p2 (s + 2 q_x^2),  q'_y += p1 (s + 2 q_y^2) + 2 p2 q_x q_y

Brown-Conrady has a = k1 k2 k3, b = k4 k5 k6 and p1, p2; the fisheye has a = k1 k2 k3 k4.

Source: OpenCV 4 documentation, calib3d and fisheye; D. C. Brown, "Close-range camera calibration", 1971; J. Kannala,
S. S. Brandt, "A generic camera model and calibration method", IEEE TPAMI 28(8), 2006.
"""

import functools
import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mmw.core.errors import InputError

LensModel = Literal["pinhole", "brown_conrady", "fisheye"]

MODELS: tuple[LensModel, ...] = ("pinhole", "brown_conrady", "fisheye")
"""Models by number in kernels."""

STEPS = 64
"""Steps from the optical axis to the edge of the image of an inversion."""

BORDER_POINTS = 16
"""Points on each side of the image that are inverted, corners included."""

TOLERANCE = 1e-11
"""Error of distorted plane coordinates at which an inversion has converged [-]."""


@dataclass(frozen=True)
class Distortion:
    """Lens model with its coefficients; see the module.

    Raises:
        InputError: If the model is unknown, or coefficients are missing or not finite.
    """

    model: LensModel = "pinhole"
    radial: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    rational: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tangential: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if self.model not in MODELS:
            raise InputError(f"lens: model = {self.model!r}; one of {', '.join(MODELS)} is needed; choose one")
        for name, count in (("radial", 4), ("rational", 3), ("tangential", 2)):
            values = getattr(self, name)
            if len(values) != count or not all(map(math.isfinite, values)):
                raise InputError(
                    f"lens: {name} = {values}; {count} finite numbers are needed; give 0 for an absent one"
                )

    @property
    def coefficients(self) -> tuple[float, ...]:
        """Coefficients in OpenCV's order: none, k1 k2 p1 p2 k3 k4 k5 k6 (Brown-Conrady), k1 k2 k3 k4 (fisheye)."""
        if self.model == "pinhole":
            return ()
        if self.model == "fisheye":
            return self.radial
        return (*self.radial[:2], *self.tangential, self.radial[2], *self.rational)

    def radial_factor(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the radial distortion factor, and its derivative with respect to s = |q|^2, both of the shape of s."""
        a, b = (1.0, *self.radial), (1.0, *self.rational)
        above, below = np.polyval(a[::-1], s), np.polyval(b[::-1], s)
        slope_above = np.polyval([k * x for k, x in enumerate(a)][:0:-1], s)
        slope_below = np.polyval([k * x for k, x in enumerate(b)][:0:-1], s)
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = above / below
            return factor, (slope_above - factor * slope_below) / below

    def distort(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return distorted plane coordinates of q [..., 2], same shape, and their Jacobian [..., 2, 2]."""
        x, y = q[..., 0], q[..., 1]
        s = x * x + y * y
        p1, p2 = self.tangential
        factor, slope = self.radial_factor(s)
        bent = np.stack(
            [
                x * factor + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x),
                y * factor + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y,
            ],
            axis=-1,
        )
        xx = factor + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
        xy = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
        yy = factor + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
        return bent, np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)

    def undistort(self, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the plane coordinates of distorted ones, and how far the distortion is one to one.

        Each point is continued from the optical axis outward in `STEPS` steps of Newton's method, so that the solution
        is on the branch that contains the axis.

        Args:
            target: Distorted plane coordinates, shape [..., 2].

        Returns:
            Plane coordinates, shape [..., 2], and the fraction of the segment from the axis to `target` on which the
            distortion is one to one, shape [...].
        """
        share = np.ones(target.shape[:-1])
        if self.model == "pinhole":
            return target, share
        q = np.zeros(target.shape)
        is_whole = np.ones(target.shape[:-1], dtype=bool)
        for step in range(1, STEPS + 1):
            wanted = target * (step / STEPS)
            following = q.copy()
            with np.errstate(all="ignore"):
                for _ in range(8):
                    bent, slope = self.distort(following)
                    following = following - _solve(slope, bent - wanted)
                ends, slope = self.distort(following)
                is_good = np.abs(ends - wanted).max(axis=-1) < TOLERANCE * (1.0 + np.abs(wanted).max(axis=-1))
                for part in (0.25, 0.5, 0.75, 1.0):  # positive definite on the segment: no fold, no jump across one
                    slope = self.distort(q + part * (following - q))[1]
                    is_good &= (_determinant(slope) > 0.0) & (slope[..., 0, 0] + slope[..., 1, 1] > 0.0)
                if self.model == "fisheye":
                    is_good &= np.hypot(following[..., 0], following[..., 1]) < math.pi
            share[is_whole & ~is_good] = (step - 1) / STEPS
            is_whole &= is_good
            q = np.where(is_whole[..., None], following, q)
        return q, share


def _determinant(slope: np.ndarray) -> np.ndarray:
    return slope[..., 0, 0] * slope[..., 1, 1] - slope[..., 0, 1] * slope[..., 1, 0]


def _solve(slope: np.ndarray, error: np.ndarray) -> np.ndarray:
    x, y = error[..., 0], error[..., 1]
    solved = [slope[..., 1, 1] * x - slope[..., 0, 1] * y, slope[..., 0, 0] * y - slope[..., 1, 0] * x]
    return np.stack(solved, axis=-1) / _determinant(slope)[..., None]


@dataclass(frozen=True)
class Intrinsics:
    """Camera intrinsics: image size, focal lengths, principal point and lens.

    Column u counts to the right, row v downward, both from 0; the center of pixel (u, v) is at (u + 0.5, v + 0.5).
    Code with pixel centers at whole numbers (OpenCV) uses cx - 0.5 and cy - 0.5 with the same image, and the same
    focal lengths and coefficients.

    Raises:
        InputError: If the image has no pixels, a focal length is not above 0, or a number is not finite.
    """

    width: int
    height: int
    fx: float
    """Focal length along the rows [px]."""
    fy: float
    """Focal length along the columns [px]."""
    cx: float
    """Column of the optical axis [px], pixel edges at whole numbers."""
    cy: float
    """Row of the optical axis [px], pixel edges at whole numbers."""
    distortion: Distortion = Distortion()

    def __post_init__(self) -> None:
        if not (self.width >= 1 and self.height >= 1):
            raise InputError(f"camera: {self.width} x {self.height} px; at least 1 x 1 is needed; correct the size")
        if not (0.0 < self.fx < math.inf and 0.0 < self.fy < math.inf):
            raise InputError(
                f"camera: fx = {self.fx:g}, fy = {self.fy:g} px; finite numbers above 0 are needed; correct it"
            )
        if not (math.isfinite(self.cx) and math.isfinite(self.cy)):
            raise InputError(f"camera: cx = {self.cx:g}, cy = {self.cy:g} px; finite numbers are needed; correct them")

    def reach(self) -> float:
        """Return the largest |q| in the image [-; fisheye: rad].

        Raises:
            InputError: If the lens is not one to one in the image: it folds, or sees beyond 180 deg from its axis.
        """
        return _reach(self)


@functools.lru_cache(maxsize=64)
def _reach(camera: Intrinsics) -> float:
    across, down = (np.linspace(0.0, size, BORDER_POINTS + 1) for size in (camera.width, camera.height))
    u = np.concatenate([across, across, 0.0 * down, 0.0 * down + camera.width])
    v = np.concatenate([0.0 * across, 0.0 * across + camera.height, down, down])
    target = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy], axis=-1)
    q, share = camera.distortion.undistort(target)
    if share.min() < 1.0:
        row = int(np.argmin(np.where(share < 1.0, share * np.hypot(u - camera.cx, v - camera.cy), np.inf)))
        radius = share[row] * math.hypot(u[row] - camera.cx, v[row] - camera.cy)
        fold = [camera.cx + share[row] * (u[row] - camera.cx), camera.cy + share[row] * (v[row] - camera.cy)]
        raise InputError(
            f"lens: model {camera.distortion.model} is not one to one beyond {radius:.0f} px from the optical axis "
            f"(pixel {fold[0]:.0f}, {fold[1]:.0f}), inside the image of {camera.width} x {camera.height}; each pixel "
            "needs a direction of its own; correct the coefficients, or use a smaller image or field of view"
        )
    return float(np.hypot(q[:, 0], q[:, 1]).max())


def focal_length(distortion: Distortion, width: int, fov_deg: float) -> float:
    """Return the focal length [px] for a horizontal field of view, between the centers of the left and right edges.

    The tangential part of the lens is ignored. Without distortion it is W / (2 tan(fov / 2)) of a pinhole, as in
    CARLA 0.9.15 `sensor.camera.*` (`fov`), or W / fov of an equidistant fisheye.

    Args:
        distortion: The lens.
        width: Image width [px].
        fov_deg: Horizontal field of view [deg].

    Raises:
        InputError: If the model has no such field of view, or the lens folds within it.
    """
    half = 0.5 * math.radians(fov_deg)
    if distortion.model != "fisheye":
        if not 0.0 < fov_deg < 180.0:
            raise InputError(
                f"lens: fov_deg = {fov_deg:g}; model {distortion.model} needs more than 0 and less than 180; lower it, "
                "or use lens.model: fisheye"
            )
        half = math.tan(half)
    radius = half * np.linspace(0.0, 1.0, 257)
    factor, slope = distortion.radial_factor(radius**2)
    growth = factor + 2.0 * radius**2 * slope
    if not (growth > 0.0).all():
        fold = radius[int(np.argmin(growth > 0.0))]
        fold_deg = 2.0 * math.degrees(fold if distortion.model == "fisheye" else math.atan(fold))
        raise InputError(
            f"lens: model {distortion.model} folds at a field of view of {fold_deg:.0f} deg, within fov_deg = "
            f"{fov_deg:g}; image height has to grow with the angle; correct the coefficients, or lower fov_deg"
        )
    return 0.5 * width / (half * float(factor[-1]))
