"""Check that every sensor and antenna is in the open: one inside a vehicle, a building or the ground sees nothing."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

import math

import numpy as np
import warp as wp

from mmw.config import Config
from mmw.config.sensor_spec import spec_of
from mmw.core.errors import InputError
from mmw.core.transforms import make_pose, normalize, transform_points
from mmw.kernels.core import line_of_sight as sight
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData
from mmw.sensors.ray_batch import BLOCK_DIM

RAYS = 64
"""Rays that are sent out of each place; design value."""

INSIDE_SHARE = 0.9
"""Share of the rays that must hit an odd number of surfaces for a place that counts as inside. All do in a closed
solid or below the ground; a few may slip through an open mesh. Design value."""

REACH_M = 5_000.0
"""Length of the rays [m]: out of any town."""


def check_mounts(scene: DeviceScene, config: Config) -> None:
    """Check each sensor and antenna at the first frame in which its agent is there.

    A place is inside something if nearly all rays upward hit an odd number of surfaces: inside a closed solid every
    ray out crosses its skin once more than it enters. The winding of faces does not matter.

    Args:
        scene: Town and vehicles; another batch is loaded afterwards.
        config: Sensors and antennas.

    Raises:
        InputError: With one line for each sensor that is inside something.
    """
    arrays, problems = scene.arrays, []
    for index, actor in enumerate(arrays.actors):
        is_here = np.isfinite(arrays.poses[:, index]).all(axis=1)
        if actor.role not in ("cav", "rsu") or not is_here.any():
            continue
        places = {
            sensor.name: sensor.mount_on(actor.role).position_m
            for sensor in config.sensors
            if actor.role in sensor.on and spec_of(sensor).needs_clear_view
        }
        if config.channel.enabled:
            places["antenna"] = config.channel.antenna_position_m[actor.role]
        if not places:
            continue
        row = int(np.argmax(is_here))
        scene.load_batch([arrays.frames[row]])
        pose = make_pose(arrays.poses[row, index, :3], normalize(arrays.poses[row, index, 3:]))
        around = enclosing_objects(scene, transform_points(pose, np.array(list(places.values()))))
        for (name, position), object_id in zip(places.items(), around, strict=True):
            if object_id >= 0:
                inside = inside_words(arrays, object_id, actor.object_id, arrays.frames[row])
                problems.append(
                    f"{actor.name}: {name} at {position} m {inside}; "
                    f"raise or move {'the unit or ' if actor.role == 'rsu' else ''}its mount"
                )
    if problems:
        raise InputError("\n  ".join(problems))


def inside_words(arrays: SceneData, object_id: int, own: int, frame: int) -> str:
    """Return the words for a sensor of actor `own`, an object id, that is inside an object in a frame."""
    what = arrays.objects[object_id]
    where = "its own body" if object_id == own else f"{what.prim_path} ({what.label})"
    return f"is inside {where} in frame {frame}; it would see nothing else"


def enclosing_objects(scene: DeviceScene, position: np.ndarray) -> np.ndarray:
    """Return the object that each point is inside, -1 for a point in the open.

    Args:
        scene: Town and vehicles with a batch loaded; its first frame counts.
        position: World frame [m], shape [N, 3].

    Returns:
        Object ids, the one that most rays hit first, shape [N], int32.
    """
    turn = np.arange(RAYS) * math.pi * (3.0 - math.sqrt(5.0))  # golden angle: even in azimuth at every height
    up = np.linspace(0.02, 0.98, RAYS)
    across = np.sqrt(1.0 - up**2)
    direction = np.stack([across * np.cos(turn), across * np.sin(turn), up], axis=1).astype(np.float32)
    device, shape = scene.device, (len(position), RAYS)
    count, first = (wp.empty(shape, dtype=int, device=device) for _ in range(2))
    frame = wp.zeros(len(position), dtype=int, device=device)
    origin = (np.asarray(position) - scene.origin).astype(np.float32)
    rays = (wp.array(vectors, dtype=wp.vec3, device=device) for vectors in (origin, direction))
    inputs = [scene.struct, frame, *rays, REACH_M]
    wp.launch(sight.count_hits_kernel, shape, inputs, [count, first], device=device, block_dim=BLOCK_DIM)
    is_odd, objects = count.numpy() % 2 == 1, first.numpy()
    around = [int(np.bincount(row[row >= 0]).argmax()) if (row >= 0).any() else -1 for row in objects]
    return np.where(is_odd.mean(axis=1) >= INSIDE_SHARE, around, -1).astype(np.int32)
