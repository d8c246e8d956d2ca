"""Make rows of table `boxes`."""

import numpy as np

from mmw.scene.scene_data import SceneData
from mmw.scene.table_rows import AGENT_ROLES, Columns, choices, split
from mmw.sensors.ground_truth.boxes_3d import Boxes


def box_rows(arrays: SceneData, boxes: Boxes) -> Columns:
    """Return the `boxes` table: every vehicle that is present."""
    agents = [a.name if a.role in AGENT_ROLES else None for a in arrays.actors]
    return {
        "frame": boxes.frame.astype(np.int32),
        "object_id": boxes.object_id,
        "category": choices([a.label for a in arrays.actors], boxes.actor),
        "agent": choices(agents, boxes.actor),
        **split(("x", "y", "z"), boxes.pose[:, :3]),
        **split(("yaw", "pitch", "roll"), boxes.ypr),
        **split(("length", "width", "height"), boxes.size),
        **split(("vx", "vy", "vz"), boxes.velocity),
    }
