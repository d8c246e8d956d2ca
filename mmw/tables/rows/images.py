"""Rows of the tables of images."""

from collections.abc import Sequence
from concurrent.futures import Future

import numpy as np

from mmw.scene_arrays import SceneArrays
from mmw.tables.rows.common import Columns, names
from mmw.views import Views


def depth_rows(
    arrays: SceneArrays, sensor: str, views: Views, images: Sequence[Future[bytes]], scenario: str, weather: str
) -> Columns:
    """Return rows of the `depth` table for one sensor: one image a row, which a thread may still be encoding."""
    agents = names(arrays, views.actor)
    paths = [
        f"{scenario}/{weather}/{agent}/{frame:06d}_{sensor}.png"
        for agent, frame in zip(agents, views.frame, strict=True)
    ]
    return {
        "frame": views.frame.astype(np.int32),
        "agent": agents,
        "sensor": sensor,
        "image": list(zip(images, paths, strict=True)),
    }
