"""Turn object ids of pixels into the values of segmentation images."""

import numpy as np


def instance_image(object_id: np.ndarray) -> np.ndarray:
    """Return object ids + 1, 0 for nothing, same shape, uint16; `object_tags` checks that they fit.

    Args:
        object_id: Object in each pixel, -1 for nothing, int32.
    """
    return (object_id + 1).astype(np.uint16)


def semantic_image(object_id: np.ndarray, tags: np.ndarray) -> np.ndarray:
    """Return the CARLA tag of each pixel, that of the sky for nothing, same shape, uint8.

    Args:
        object_id: Object in each pixel, -1 for nothing, int32.
        tags: What `object_tags` returns.
    """
    return tags[object_id]
