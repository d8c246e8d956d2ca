"""Colours of what is shown: 8-bit sRGB, red, green, blue."""

import numpy as np
from numpy.typing import ArrayLike

from mmw.usd.semantics import CARLA_TAG

SCALE = np.array([[70, 90, 255], [40, 200, 255], [120, 235, 110], [255, 220, 50], [255, 70, 40]], dtype=np.float64)
"""Stops of the scale from low (blue) to high (red), evenly spaced; bright enough on a dark ground. Design value."""

GAIN_DB = (-140.0, -70.0)
"""Path gain at the ends of the scale [dB]: the line of sight at 28 GHz loses 80 dB in 8 m and 121 dB in 1 km.
Design value."""

VELOCITY_M_S = 10.0
"""Radial velocity at the ends of the radar's scale [m/s]. Design value."""

GOLDEN = 0.6180339887498949
"""Turn of the hue from one object to the next: neighbours in number are far apart in colour. Source: golden ratio."""

RETURNS = np.array([[190, 190, 200], [60, 140, 255], [255, 160, 40]], dtype=np.uint8)
"""LiDAR `label`: surface, rain, fog."""

CLASS_COLOR = {
    "unlabeled": (90, 90, 90), "road": (128, 64, 128), "sidewalk": (244, 35, 232), "building": (110, 110, 130),
    "wall": (102, 102, 156), "fence": (190, 153, 153), "pole": (153, 153, 153), "traffic_light": (250, 170, 30),
    "traffic_sign": (220, 220, 0), "vegetation": (107, 142, 35), "terrain": (152, 251, 152), "sky": (70, 130, 180),
    "pedestrian": (220, 20, 60), "rider": (255, 0, 0), "car": (60, 110, 255), "truck": (0, 180, 200),
    "bus": (0, 130, 160), "train": (0, 80, 100), "motorcycle": (120, 60, 230), "bicycle": (200, 90, 90),
    "static": (110, 190, 160), "dynamic": (170, 120, 50), "other": (55, 90, 80), "water": (45, 60, 150),
    "road_line": (157, 234, 50), "ground": (81, 0, 81), "bridge": (150, 100, 100), "rail_track": (230, 150, 140),
    "guard_rail": (180, 165, 180),
}  # fmt: skip
"""Class -> colour. Source: palette of Cityscapes where it has the class, lighter where that is nearly black; design
values for the others."""

_BY_TAG = np.zeros((256, 3), dtype=np.uint8)
for _label, _color in CLASS_COLOR.items():
    _BY_TAG[CARLA_TAG[_label]] = _color


def scale(values: ArrayLike, low: float, high: float) -> np.ndarray:
    """Return colours of numbers between two ends, shape [..., 3], uint8; NaN and what lies beyond take the end's."""
    share = (np.asarray(values, dtype=np.float64) - low) / (high - low)
    place = np.clip(np.nan_to_num(share, nan=0.0, neginf=0.0, posinf=1.0), 0.0, 1.0) * (len(SCALE) - 1)
    return np.stack([np.interp(place, np.arange(len(SCALE)), stop) for stop in SCALE.T], axis=-1).astype(np.uint8)


def of_gain(gain_db: ArrayLike) -> np.ndarray:
    """Return colours of path gains [dB], shape [..., 3], uint8."""
    return scale(gain_db, *GAIN_DB)


def of_velocity(velocity: ArrayLike) -> np.ndarray:
    """Return colours of radial velocities [m/s], shape [..., 3], uint8: approaching blue, receding red, rest grey."""
    share = np.clip(np.asarray(velocity, dtype=np.float64) / VELOCITY_M_S, -1.0, 1.0)[..., None]
    rest, away, near = np.array([[210.0, 210, 210], [255, 60, 40], [60, 110, 255]])
    return (rest + np.abs(share) * (np.where(share > 0.0, away, near) - rest)).astype(np.uint8)


def of_objects(object_id: ArrayLike, is_actor: ArrayLike) -> np.ndarray:
    """Return a colour for each object, shape [N, 3], uint8: actors bright, the town pale, nothing (-1) white.

    Args:
        object_id: Objects, -1 for rain and fog, shape [N].
        is_actor: True for what has a box, shape [N].
    """
    ids, actor = np.asarray(object_id, dtype=np.int64), np.asarray(is_actor, dtype=bool)
    hue = np.mod(ids * GOLDEN, 1.0)
    saturation, value = np.where(actor, 0.85, 0.25), np.where(actor, 1.0, 0.62)
    return np.where((ids < 0)[:, None], 255, _from_hsv(hue, saturation, value)).astype(np.uint8)


def of_tags(tags: ArrayLike) -> np.ndarray:
    """Return the colours of CARLA's numbers of classes, shape [N, 3], uint8; black for a number that is none."""
    return _BY_TAG[np.asarray(tags, dtype=np.uint8)]


def _from_hsv(hue: np.ndarray, saturation: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Return colours 0 to 255 of hue, saturation and value 0 to 1.

    Source: A. R. Smith, "Color gamut transform pairs", SIGGRAPH 1978, in its form with one clipped ramp a channel.
    """
    ramp = np.abs(np.mod(hue[:, None] * 6.0 + np.array([0.0, 4.0, 2.0]), 6.0) - 3.0) - 1.0
    return 255.0 * value[:, None] * (1.0 - saturation[:, None] * (1.0 - np.clip(ramp, 0.0, 1.0)))
