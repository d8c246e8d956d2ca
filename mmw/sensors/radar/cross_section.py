"""Compute the radar cross section of a body over its aspect, by the rays and the echoes of `Radar`."""

import numpy as np
from numpy.typing import ArrayLike

from mmw.core.errors import InputError
from mmw.core.transforms import make_pose, quaternion_from_matrix
from mmw.scene.scene import Scene
from mmw.sensors.radar.config import Radar

FAR_RADII = 100.0
"""Distance of the radar from a body in radii of the body: the power of a mirror ball is 2 % short of that at infinity,
0.09 dB. Design value."""

MAX_DISTANCE_M = 900.0
"""Largest distance [m]: the rays of `Radar` end at 1,000 m. Bodies may be 18 m wide."""

MARGIN = 1.02
"""Field of view over the angle that the body fills."""


def radar_cross_section(
    scene: Scene,
    azimuth_rad: ArrayLike,
    *,
    elevation_rad: float = 0.0,
    carrier_hz: float = 76.5e9,
    weather: str | None = None,
    rays: int = 20_000,
) -> np.ndarray:
    """Return the monostatic radar cross section of the static world of a scene, such as one asset [m2], shape [N].

    The scene is seen from far away, around its middle. It has the surfaces of `Radar`: rough, so that their echoes add
    up as powers. That is the mean over small changes of aspect and carrier; a measurement at one of them scatters
    about it, by the exponential distribution where many points echo alike (Swerling 1). Smooth bodies, and several
    bounces, are the subject of `smooth_cross_section`.

    Args:
        scene: What is seen; actors of a recording are not.
        azimuth_rad: Directions from the body to the radar, counted from x toward y: 0 is in front of a vehicle or
            person [rad], shape [N].
        elevation_rad: Angle of these directions above the horizon [rad].
        carrier_hz: Carrier, 1 to 200 GHz [Hz].
        weather: Weather of the scene that wets surfaces; None for the first.
        rays: Rays cast from each direction, over the box that bounds the body. Each lies anywhere in its cell, so the
            value has a standard error, of about 1 % for a car by 20,000 rays.

    Raises:
        InputError: If the scene has no static mesh, is wider than 18 m, or an argument is out of range.

    Examples:
        >>> import mmw, numpy as np
        >>> from mmw.core.resources import assets_dir
        >>> car = mmw.load_scene(assets_dir() / "vehicles/sedan/sedan.usda", device="cpu")
        >>> around = mmw.sensors.radar_cross_section(car, np.radians(np.arange(0, 360, 10)))
        >>> round(10 * np.log10(around.mean()))
        9
    """
    toward = directions("radar_cross_section", azimuth_rad, elevation_rad)
    middle, half = middle_and_half(scene)
    level, radius = float(np.hypot(*half[:2])), float(np.linalg.norm(half))
    distance = FAR_RADII * radius
    if distance > MAX_DISTANCE_M:
        raise InputError(
            f"radar_cross_section: the scene is {2.0 * radius:.3g} m wide; the radar stands {FAR_RADII:g} radii away, "
            f"at most {MAX_DISTANCE_M:g} m; load one body alone"
        )
    tall = abs(np.sin(elevation_rad)) * level + np.cos(elevation_rad) * half[2]
    width, height = (2.0 * np.degrees(np.arctan(MARGIN * size / (distance - radius))) for size in (level, tall))
    columns = int(np.clip(np.rint(np.sqrt(rays * width / height)), 1, min(rays, 4096)))
    radar = Radar(
        output="dense", carrier_hz=carrier_hz, range_m=distance + 2.0 * radius, horizontal_fov_deg=float(width),
        vertical_fov_deg=float(height), azimuth_rays=columns, elevation_rays=int(np.clip(rays // columns, 1, 4096)),
    )  # fmt: skip
    points = scene.capture(radar, pose=looking_back(middle + distance * toward, toward), weather=weather)
    return np.array([np.sum(10.0 ** (one.rcs_dbsm.astype(np.float64) / 10.0)) for one in points])


def middle_and_half(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return the middle of the box that bounds the static world and half of its size [m], shape [3] each.

    Raises:
        InputError: If there is no static world.
    """
    low, high = scene.bounds
    if not np.isfinite(low).all():
        raise InputError("radar cross section: the scene has no static mesh; load an asset or a mesh by load_scene")
    return (low + high) / 2.0, (high - low) / 2.0


def directions(used_by: str, azimuth_rad: ArrayLike, elevation_rad: float) -> np.ndarray:
    """Return unit vectors from the body to the radar, shape [N, 3].

    Raises:
        InputError: If an angle is out of range or not a number.
    """
    azimuth = np.asarray(azimuth_rad, dtype=np.float64)
    if azimuth.ndim != 1 or not np.isfinite(azimuth).all() or not abs(elevation_rad) < np.pi / 2.0:
        raise InputError(
            f"{used_by}: azimuth_rad of shape {azimuth.shape}, elevation_rad = {elevation_rad:g}; finite azimuths of "
            "shape [N], and an elevation between -pi/2 and pi/2 are needed; correct it"
        )
    level, upward = np.cos(elevation_rad), np.full(len(azimuth), np.sin(elevation_rad))
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), upward], axis=1)


def looking_back(position: np.ndarray, toward: np.ndarray) -> np.ndarray:
    """Return poses of sensors that look back along directions, with y level, shape [N, 7]."""
    left = np.cross([0.0, 0.0, 1.0], -toward)
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    return make_pose(position, quaternion_from_matrix(np.stack([-toward, left, np.cross(-toward, left)], axis=-1)))
