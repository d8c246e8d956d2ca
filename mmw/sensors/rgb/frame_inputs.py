"""Gather what changes from frame to frame in the rendering of views, and hold it on the device."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.core.frame_rate import seconds
from mmw.core.kinematics import Motion, differentiate
from mmw.core.recorded_work import Input
from mmw.kernels.shading.sky import Sky
from mmw.scene.device_scene import DeviceScene
from mmw.scene.views import Views, view_twists
from mmw.sensors.render.lighting import sun_cells, sun_margin

SunPlace = tuple[float, ...]
"""Unit vector to the sun; empty where it does not shine, or casts no shadows."""


@dataclass(frozen=True)
class FrameValues:
    """Inputs that change from frame to frame, on the host."""

    weathers: tuple[str, ...]
    suns: tuple[SunPlace, ...]
    """Places of suns that cast shadows."""
    rooms: tuple[int, ...]
    """Cells that each has room for, see `mmw.sensors.render.lighting.SunCells`."""
    inputs: list[Input]
    """Values of the fields of `FrameArrays`, in their order."""


@dataclass(frozen=True)
class FrameArrays:
    """Inputs that change from frame to frame, on the device; A views, W weathers, S suns."""

    velocity: wp.array
    """Velocity of each view [m/s], shape [A], vec3."""
    rate: wp.array
    """Angular velocity of each view about the axes of the world [rad/s], shape [A], vec3."""
    time: wp.array
    """Time of each view's frame [s], shape [A]."""
    brake: wp.array
    """`mmw.sensors.render.lights.batch_brakes`."""
    key: wp.array
    """Random numbers of each view in each weather, shape [W, A], vec2ui."""
    sun_low: wp.array
    """Corner of the first cell of each sun [m], shape [S], vec2."""
    sun_size: wp.array
    """Columns and rows of the cells of each sun, shape [S], vec2i."""

    @property
    def twists(self) -> tuple[wp.array, wp.array]:
        """Velocity and angular velocity of each view."""
        return self.velocity, self.rate


def frame_values(
    scene: DeviceScene,
    views: Views,
    keys: Mapping[str, np.ndarray],
    skies: Mapping[SunPlace, Sky],
    brakes: np.ndarray,
    motion: Motion | None,
) -> FrameValues:
    """Return what changes from frame to frame.

    Args:
        scene: The scene with the frames of the views on the device.
        views: The views.
        keys: Weather -> random numbers of each view, shape [A, 2], uint32.
        skies: Place of each sun that casts shadows -> a sky with it.
        brakes: `mmw.sensors.render.lights.batch_brakes` of the scene.
        motion: `differentiate(scene.arrays.poses, scene.arrays.pose_dt)`, if at hand.
    """
    arrays, count = scene.arrays, len(views)
    velocity, rate = twists_of(scene, views, motion)
    time = seconds(arrays.numbers(views.frame), arrays.rate_hz)
    cells = [sun_cells(scene, place, sun_margin(sky)) for place, sky in skies.items()]
    key = np.array(list(keys.values()), dtype=np.uint32).reshape(len(keys), count, 2)
    inputs: list[Input] = [
        (velocity, wp.vec3),
        (rate, wp.vec3),
        (time, wp.float32),
        (brakes, wp.float32),
        (key, wp.vec2ui),
        (np.array([one.low for one in cells]).reshape(-1, 2), wp.vec2),
        (np.array([one.size for one in cells]).reshape(-1, 2), wp.vec2i),
    ]
    return FrameValues(tuple(keys), tuple(skies), tuple(one.room for one in cells), inputs)


def twists_of(scene: DeviceScene, views: Views, motion: Motion | None) -> Sequence[np.ndarray]:
    """Return velocity and angular velocity of each view, see `view_twists`; zero for those that nobody carries."""
    arrays, is_carried = scene.arrays, views.actor >= 0
    velocity, rate = np.zeros((2, len(views), 3))
    if is_carried.any():
        motion = motion or differentiate(arrays.poses, arrays.pose_dt)
        if is_carried.all():
            return view_twists(arrays, motion, views)
        velocity[is_carried], rate[is_carried] = view_twists(arrays, motion, views.take(is_carried))
    return velocity, rate
