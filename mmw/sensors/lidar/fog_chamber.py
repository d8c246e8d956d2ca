"""Place plates in fog before a LiDAR, as in a fog chamber: which come back, and how many rays return fog instead."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mmw.core.random_keys import random_key
from mmw.core.transforms import IDENTITY_POSE
from mmw.kernels.lidar.precipitation import FOG
from mmw.physics.materials.material import Material, RadioMaterial
from mmw.physics.weather.weather import Weather
from mmw.sensors.lidar.config import Lidar
from mmw.sensors.lidar.returns import LidarHits, find_returns
from mmw.sensors.lidar.sweep_arrays import SweepArrays

SEEN = 0.5
"""Share of the rays on a plate that has to come back from it, for it to be seen."""


@dataclass(frozen=True)
class PlateReturns:
    """Returns of rays that meet plates squarely; N plates, one at each distance."""

    distance_m: np.ndarray
    """Distance of the plate [m], shape [N]."""
    plate: np.ndarray
    """Share of the rays with a return of the plate [-], shape [N]."""
    fog: np.ndarray
    """Share of the rays with a return of fog [-], shape [N]."""

    def farthest(self) -> float:
        """Return the distance up to which `SEEN` of the rays return the plate [m]: 0 for nowhere.

        The share is interpolated between the last distance that has it and the next; inf if the last distance has it.
        """
        seen = np.flatnonzero(self.plate >= SEEN)
        if len(seen) == 0:
            return 0.0
        last = seen[-1]
        if last == len(self.plate) - 1:
            return math.inf
        return float(np.interp(-SEEN, -self.plate[last : last + 2], self.distance_m[last : last + 2]))


def plates_in_fog(
    config: Lidar,
    weather: Weather,
    reflectance: float,
    distance_m: Sequence[float] | np.ndarray,
    rays: int = 1000,
    seed: int = 0,
    device: str = "cpu",
) -> PlateReturns:
    """Return what a LiDAR sees of plates in a weather, one after the other, at normal incidence.

    Rays leave one point in all directions of a sphere, so that they cross patches of fog of their own, and all meet the
    plate at its distance. A plate at infinity is the open sky.

    Args:
        config: The LiDAR: its optics, returns, detection and range; its pattern does not matter.
        weather: Rain and fog.
        reflectance: Diffuse reflectance of the plates [-].
        distance_m: Distances [m], shape [N].
        rays: Rays on each plate.
        seed: Of the random numbers.
        device: Warp device name.
    """
    distance = np.asarray(distance_m, dtype=np.float32)
    directions = np.random.default_rng(seed).normal(size=(rays, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    still = config.model_copy(update={"rolling": False, "deskew": False})
    arrays = SweepArrays(still, len(distance), device, directions)
    batch_index, pose, ignore, time_s, *_ = arrays.given.host
    batch_index[:], pose[:], ignore[:], time_s[:] = 0, IDENTITY_POSE, -1, 0.0
    arrays.given.upload()
    arrays.rays.range.assign(np.repeat(distance[:, None], rays, axis=1))
    arrays.rays.cos_incidence.fill_(1.0)
    arrays.rays.object_id.zero_()
    arrays.rays.material_id.zero_()
    hits = LidarHits(still, arrays)
    plate = Material("plate", RadioMaterial("constant"), "none", reflectance, (reflectance,) * 3)
    keys = np.array([random_key(seed, "fog chamber", str(i)) for i in range(len(distance))], dtype=np.uint32)
    returns, count = find_returns(hits, [plate], weather, keys, random_key(seed, "fog chamber"))
    label, count = returns.numpy()["label"], count.numpy()
    is_there = np.arange(label.shape[2]) < count[..., None]
    return PlateReturns(
        np.asarray(distance, dtype=float),
        ((label == 0) & is_there).any(axis=2).mean(axis=1),
        ((label == FOG) & is_there).any(axis=2).mean(axis=1),
    )
