"""Compute scene flow of LiDAR points: how far each point moves with its object until the next frame."""

import numpy as np

from mmw.core.transforms import conjugate, invert, rotate, transform_points
from mmw.scene.scene_data import SceneData
from mmw.scene.views import Views
from mmw.sensors.lidar.points import PointCloud

FLOW_STEPS_PER_METRE = 65_536.0
"""Grid of stored flow [1/m]: a power of two, so that float32 holds every grid point and compresses well."""


def scene_flow(arrays: SceneData, views: Views, points: PointCloud) -> np.ndarray:
    """Return the displacement of every point to the next frame, in the sensor frame of this frame [m].

    A point moves rigidly with its object, from the object's pose in frame k to that in frame k + 1; the motion of the
    sensor is not in it. Points of the town, of rain and of fog have zero. An object without a pose in the next frame
    (it leaves, or the recording ends) repeats its step from frame k - 1 to k; one that is there for a single frame is
    at rest.

    Args:
        arrays: The scene on the host.
        views: The views of the batch.
        points: Their points, in the sensor frame at the frame's instant.

    Returns:
        Flow along x, y and z on a grid of 1/65536 m, shape [N, 3], float32; a column is one piece of memory.
    """
    highest = max((o.object_id for o in arrays.objects), default=-1)
    highest = max(highest, *(actor.object_id for actor in arrays.actors), int(points.object_id.max(initial=-1)))
    actor_of = np.full(highest + 2, -1)  # the last entry answers for object -1
    for index, actor in enumerate(arrays.actors):
        actor_of[actor.object_id] = index
    actor_of[-1] = -1
    actor = actor_of[points.object_id]
    moving = np.flatnonzero(actor >= 0)
    flow = np.zeros((3, len(actor)), dtype=np.float32)
    if len(moving) == 0:
        return flow.T
    view = np.repeat(np.arange(len(views)), np.diff(points.offsets))[moving]
    row = np.array([arrays.frame_row(int(frame)) for frame in views.frame])[view]
    before, here, after = (_poses(arrays, row + step * arrays.pose_stride, actor[moving]) for step in (-1, 0, 1))
    xyz = np.stack([points.x[moving], points.y[moving], points.z[moving]], axis=1).astype(np.float64)
    world = transform_points(views.pose[view], xyz)
    is_last = np.isnan(after).any(axis=1, keepdims=True)
    start, end = np.where(is_last, before, here), np.where(is_last, here, after)
    is_alone = np.isnan(start).any(axis=1)
    start[is_alone] = end[is_alone] = here[is_alone]
    step = transform_points(end, transform_points(invert(start), world)) - world
    turned = rotate(conjugate(views.pose[view, 3:]), step)
    flow[:, moving] = (np.round(turned * FLOW_STEPS_PER_METRE) / FLOW_STEPS_PER_METRE).T
    return flow.T


def _poses(arrays: SceneData, row: np.ndarray, actor: np.ndarray) -> np.ndarray:
    """Return poses by row and actor, NaN beyond the recording, shape [N, 7]."""
    poses = arrays.poses[np.clip(row, 0, len(arrays.poses) - 1), actor]
    poses[(row < 0) | (row >= len(arrays.poses))] = np.nan
    return poses
