"""Find the CARLA tags of objects for instance and semantic images."""

import numpy as np

from mmw.core.errors import InputError
from mmw.scene.scene_data import SceneData
from mmw.usd.semantics import CARLA_TAG

SKY = CARLA_TAG["sky"]
"""CARLA tag of a pixel where nothing was hit."""

HIGHEST_OBJECT = 65_534
"""Highest object id that an instance image can store: 16 bits, less one value for nothing."""


def object_tags(arrays: SceneData) -> np.ndarray:
    """Return the CARLA tag of every object, with that of the sky in the last place, where -1 points. Shape [N + 1].

    The tags are those of the table `objects`.

    Raises:
        InputError: If an instance image cannot tell all objects.
    """
    highest = max((entry.object_id for entry in arrays.objects), default=-1)
    if highest > HIGHEST_OBJECT:
        raise InputError(
            f"segmentation: object ids reach {highest}; a 16-bit instance image tells ids up to {HIGHEST_OBJECT}; "
            "merge meshes of the town below one prim each, or use segmentation: false"
        )
    tags = np.full(highest + 2, CARLA_TAG["unlabeled"], dtype=np.uint8)
    for entry in arrays.objects:
        tags[entry.object_id] = entry.tag
    tags[-1] = SKY
    return tags
