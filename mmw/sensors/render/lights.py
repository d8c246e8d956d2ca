"""Collect the lights of a scene: switching times, positions, and the vehicles that brake."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from mmw.core.kinematics import Motion, differentiate_rows
from mmw.core.remember import remembered
from mmw.core.transforms import length, x_axes
from mmw.kernels.shading import lights as kernels
from mmw.physics.weather.weather import Weather
from mmw.scene.device_scene import DeviceScene, instance_actors
from mmw.scene.scene_data import MODEL_NONE, Actor, SceneData
from mmw.scene.views import frame_rows

DIPPED_SUN_DEG = 6.0
"""Altitude of the sun below which drivers switch headlights on [deg]. Design value: ambient light falls below the
1000 lux at which UNECE Regulation 48 makes automatic lights burn at altitudes of about 0 to 2 degrees; people are
earlier."""
DIPPED_RAIN_MM_H = 0.5
"""Rain rate from which they are on [mm/h]. Design value: wipers on, lights on."""
DIPPED_VISIBILITY_M = 500.0
"""Visibility below which they are on [m]. Design value: traffic laws ask for lights in fog and rain that hinder
sight."""
STREET_SUN_DEG = 0.0
"""Altitude of the sun below which street lights are on [deg]. Design value: they are switched near 70 lux on the
ground, which a clear sky gives some minutes after sunset."""
STREET_KLUX = 0.010
"""Illuminance of level ground by street lights for which the fixed exposure is made [klux]. Source: EN 13201-2:2015,
lighting class C4 of traffic areas, 10 lux on average."""

LIGHT_LABELS = frozenset({"car", "truck", "bus", "motorcycle"})
"""Classes of actors with head and taillights."""
BEAM_HEIGHT_M = 0.65
"""Height of headlights over the ground [m]; UNECE Regulation 48 allows 0.5 to 1.2. Design value."""
BEAM_COLOR = (1.02, 1.0, 0.93)
"""Linear color of headlights: white of about 5700 K; design value."""
STREET_COLOR = (1.25, 0.97, 0.60)
"""Linear color of street lights: LED of about 3500 K; design value."""
LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Weights of linear red, green and blue in luminance. Source: ITU-R BT.709."""

BRAKING_M_S2 = (0.5, 1.0)
"""Deceleration at which brake lights begin to glow, and at which they are full [m/s2]. Design value: a car that rolls
with its engine decelerates by 0.5 to 1 m/s2; UNECE Regulation 13-H asks for stop lights from 1.3."""
STANDING_M_S = (0.1, 0.3)
"""Speed below which a foot is on the brake, and above which it is not [m/s]. Design value."""

GRID_CELL_M = 15.0
"""Side of a cell of the street lights' grid [m]."""


def vehicle_lights_on(weather: Weather) -> bool:
    """Return whether vehicles have their lights on: dusk, rain, or fog."""
    return (
        weather.sun_altitude_deg < DIPPED_SUN_DEG
        or weather.rain_mm_h > DIPPED_RAIN_MM_H
        or weather.visibility_m < DIPPED_VISIBILITY_M
    )


def street_lights_on(weather: Weather) -> bool:
    """Return whether street lights are on: after sunset."""
    return weather.sun_altitude_deg < STREET_SUN_DEG


def has_lights(actor: Actor) -> bool:
    """Return whether an actor is a vehicle with lights that can be on; those of a parked one are always off."""
    return actor.label in LIGHT_LABELS and not actor.is_parked


@remembered()
def _drivers(actors: tuple[Actor, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return the instances that have lights that can be on, and their actors."""
    actor = np.array([index for index, one in enumerate(actors) if one.model != MODEL_NONE], dtype=np.int64)
    instance = np.flatnonzero(np.array([has_lights(actors[index]) for index in actor], dtype=bool))
    return instance, actor[instance]


def brake_levels(arrays: SceneData, frames: Sequence[int], motion: Motion | None = None) -> np.ndarray:
    """Return how much each instance brakes, from its acceleration along its own x axis.

    A frame's values depend on the recording alone, not on the other frames asked for.

    Args:
        arrays: The scene on the host.
        frames: The frames, S of them.
        motion: `differentiate(arrays.poses, arrays.pose_dt)`, if at hand.

    Returns:
        0 to 1, shape [S, V], float32; -1 for an instance that is no vehicle, is parked, or is absent.

    Raises:
        ValueError: If the scene does not cover a frame.
    """
    rows = frame_rows(arrays, frames)[:, None]
    instance, actor = _drivers(arrays.actors)
    level = np.full((len(rows), len(instance_actors(arrays))), -1.0, dtype=np.float32)
    if level[:, instance].size == 0:
        return level
    poses = arrays.poses[rows, actor]
    if motion is None:
        found = differentiate_rows(arrays.poses[:, actor], rows[:, 0], arrays.pose_dt)
        velocity, acceleration = found.velocity, found.acceleration
    else:
        velocity, acceleration = motion.velocity[rows, actor], motion.acceleration[rows, actor]
    forward = x_axes(poses[..., 3:])
    gain = np.add.reduce(acceleration * forward, axis=-1)
    # A vehicle in reverse that brakes accelerates forward.
    slowing = np.where(np.add.reduce(velocity * forward, axis=-1) < 0.0, gain, -gain)
    low, high = BRAKING_M_S2
    slow, fast = STANDING_M_S
    braking, standing = (slowing - low) / (high - low), (fast - length(velocity)[..., 0]) / (fast - slow)
    found = np.minimum(np.maximum(np.maximum(braking, standing), 0.0), 1.0)
    level[:, instance] = np.where(np.isfinite(poses).all(axis=-1), found, -1.0)
    return level


def batch_brakes(scene: DeviceScene, motion: Motion | None = None) -> np.ndarray:
    """Return `brake_levels` of the loaded batch, shape [max_batch_frames, V], float32, for all weathers."""
    level = brake_levels(scene.arrays, scene.batch_frames, motion)
    missing = scene.max_batch_frames - len(level)
    return np.pad(level, ((0, missing), (0, 0)), constant_values=-1.0) if missing else level


def find_street_lights(arrays: SceneData, name: str) -> np.ndarray:
    """Return where street lights are: the middle of the faces of each object of the town that is one.

    Returns:
        World frame [m], shape [L, 3], float64, in the order of their objects.
    """
    is_light = np.array([material.appearance.lamp == "street" for material in arrays.materials[name]], dtype=bool)
    rows = np.flatnonzero(is_light[arrays.material]) if len(is_light) else np.zeros(0, dtype=np.int64)
    corners = arrays.points[arrays.faces[rows]]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    objects, index = np.unique(arrays.object_id[rows], return_inverse=True)
    total = np.bincount(index, weights=area, minlength=len(objects))
    middle = corners.mean(axis=1) * area[:, None]
    summed = np.stack([np.bincount(index, weights=middle[:, k], minlength=len(objects)) for k in range(3)], axis=1)
    lit = total > 0.0
    return summed[lit] / total[lit, None]


def street_grid(
    positions: np.ndarray, reach: float, cell: float
) -> tuple[np.ndarray, int, int, np.ndarray, np.ndarray]:
    """Return a grid of cells that each list the lights which reach into them.

    Args:
        positions: Lights [m], shape [L, 3], L > 0.
        reach: Distance that their light goes [m].
        cell: Side of a cell [m].

    Returns:
        Corner of the first cell [m] [2], columns, rows, first entry of each cell [cells + 1], lights of the cells.
    """
    low = positions[:, :2].min(axis=0) - reach
    columns, rows = (int(n) for n in np.ceil((positions[:, :2].max(axis=0) + reach - low) / cell) + 1)
    lists: list[list[int]] = [[] for _ in range(columns * rows)]
    for light, position in enumerate(positions[:, :2]):
        first = np.floor((position - reach - low) / cell).astype(int)
        last = np.floor((position + reach - low) / cell).astype(int)
        for row in range(max(first[1], 0), min(last[1], rows - 1) + 1):
            for column in range(max(first[0], 0), min(last[0], columns - 1) + 1):
                corner = low + np.array([column, row]) * cell
                if np.linalg.norm(np.clip(position, corner, corner + cell) - position) <= reach:
                    lists[row * columns + column].append(light)
    starts = np.cumsum([0] + [len(entries) for entries in lists])
    return low, columns, rows, starts, np.array([light for entries in lists for light in entries], dtype=np.int64)


def _beams(arrays: SceneData) -> tuple[np.ndarray, np.ndarray]:
    """Return the instances whose headlights can be on [B], and where in their frames the beams start [m] [B, 3]."""
    actors = [arrays.actors[index] for index in instance_actors(arrays)]
    instances = [k for k, actor in enumerate(actors) if has_lights(actor)]
    starts = [(actors[k].center[0] + 0.5 * actors[k].size[0], 0.0, BEAM_HEIGHT_M) for k in instances]
    return np.array(instances, dtype=np.int32), np.array(starts, dtype=np.float32).reshape(-1, 3)


def make_lights(scene: DeviceScene, name: str, weather: Weather) -> kernels.Lights:
    """Return the lights of a scene in one weather.

    All but `brake` holds for every batch; set that from `batch_brakes` whenever another batch is loaded.
    """
    arrays, device = scene.arrays, scene.device
    result = kernels.Lights()
    result.is_on, result.is_street_on = vehicle_lights_on(weather), street_lights_on(weather)
    result.brake = wp.array(batch_brakes(scene), dtype=wp.float32, device=device)
    result.beam_color, result.street_color = _of_luminance_1(BEAM_COLOR), _of_luminance_1(STREET_COLOR)
    instances, starts = _beams(arrays)
    result.beam_count = len(instances) if result.is_on else 0
    result.beam_instance = wp.array(instances, dtype=wp.int32, device=device)
    result.beam_position = wp.array(starts, dtype=wp.vec3, device=device)
    positions = find_street_lights(arrays, name) if result.is_street_on else np.zeros((0, 3))
    result.street_count = len(positions)
    result.street_position = wp.array((positions - scene.origin).astype(np.float32), dtype=wp.vec3, device=device)
    if len(positions):
        low, columns, rows, first, lists = street_grid(
            positions - scene.origin, float(kernels.STREET_REACH_M), GRID_CELL_M
        )
        result.grid_low, result.grid_cell = (float(low[0]), float(low[1])), GRID_CELL_M
        result.grid_columns, result.grid_rows = columns, rows
        result.grid_first = wp.array(first.astype(np.int32), dtype=wp.int32, device=device)
        result.grid_light = wp.array(lists.astype(np.int32), dtype=wp.int32, device=device)
    return result


def _of_luminance_1(color: Sequence[float]) -> tuple[float, float, float]:
    luminance = float(np.dot(color, LUMINANCE))
    return color[0] / luminance, color[1] / luminance, color[2] / luminance
