"""Tell on which side of the road vehicles drive: from the tags, from roundabouts, else from the place on the earth."""

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.worlds.importers.osm.feature import Extract

SIDES = ("left", "right")
LEFT_HAND = {
    "Great Britain and Ireland": (
        (-11, 51), (-6, 49.8), (-1, 50.3), (1.4, 50.95), (2.2, 52.6), (0, 61.2), (-9, 61.2), (-11, 54),
    ),
    "Japan": (
        (122.8, 23.8), (132, 26), (146.5, 42), (146, 46), (140, 46), (128.9, 34.2), (128, 30),
    ),
    "Australia": (
        (112, -44.5), (155, -44.5), (154.5, -24), (143.2, -9.9), (129, -10.5), (112, -20),
    ),
    "New Zealand": (
        (165, -48), (179.5, -48), (179.5, -33.5), (165, -33.5),
    ),
    "India": (
        (68.2, 23.6), (72.5, 8), (80.5, 7.2), (88.5, 21.5), (92.2, 21), (97, 27.6), (88, 27.9), (80.5, 30.3),
        (79, 32.6), (74.6, 36.5), (71, 34), (66.5, 29.6), (61.7, 25),
    ),
    "Sri Lanka": (
        (79.5, 5.7), (82.1, 5.7), (82.1, 10), (79.5, 10),
    ),
    "Thailand": (
        (98.4, 6.6), (101.3, 6.2), (102.3, 12.3), (105.4, 14.6), (104.5, 17), (101, 17.8), (100.3, 20.2),
        (98.2, 19.5),
    ),
    "Malaysia, Singapore, Indonesia": (
        (95, 5.9), (100, 6.5), (104.6, 1.8), (117, 7.2), (126, 3.5), (141, -2.6), (141, -9.2), (119, -11), (100, -5),
    ),
    "Hong Kong and Macau": (
        (113.52, 22.1), (114.45, 22.1), (114.3, 22.54), (114.0, 22.5), (113.52, 22.21),
    ),
    "Southern Africa": (
        (12.5, -17.3), (16, -29), (18, -35), (28, -34.5), (33, -27), (40.8, -15), (40.4, -10.5), (39.6, -4.7),
        (41.6, -1.7), (41, 4), (35.9, 4.6), (34, 4.2), (30.9, 3.5), (29.6, -1), (30.5, -2.3), (29.5, -5),
        (30.7, -8.3), (28.6, -9), (28.3, -12.3), (24, -11), (24, -13), (22, -13.1), (21.9, -16.2), (23.4, -17.6),
    ),
    "Cyprus": (
        (32.2, 34.5), (34.7, 34.5), (34.7, 35.8), (32.2, 35.8),
    ),
    "Malta": (
        (14.1, 35.7), (14.7, 35.7), (14.7, 36.1), (14.1, 36.1),
    ),
    "Jamaica": (
        (-78.5, 17.6), (-76.1, 17.6), (-76.1, 18.6), (-78.5, 18.6),
    ),
}  # fmt: skip
"""Coarse outlines of where vehicles drive on the left: longitude and latitude [deg]. Design values, some ten kilometers
off at borders on land; `driving_side=` counts before them."""


def tell_driving_side(extract: Extract, given: str) -> tuple[str, str]:
    """Return `left` or `right`, and where it is known from.

    Args:
        extract: The extract; its tag `driving_side` counts, and the way that its roundabouts turn.
        given: What the user says; empty for nothing.

    Raises:
        InputError: If `given` is another word.
    """
    if given:
        if given not in SIDES:
            raise InputError(f"{extract.path}: driving_side={given}: is no side; give left or right")
        return given, "as given"
    tags = [way.tags["driving_side"] for way in extract.ways if way.tags.get("driving_side") in SIDES]
    if tags:
        return max(SIDES, key=tags.count), "the tag driving_side"
    turn = 0.0
    for way in extract.ways:
        if way.tags.get("junction") == "roundabout" and len(way.xy) > 3 and "highway" in way.tags:
            step = np.diff(way.xy, axis=0)
            bend = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
            turn += float(bend[-1] - bend[0])
    if abs(turn) > np.pi:
        return ("right" if turn > 0 else "left"), "the way that its roundabouts turn"
    place = shapely.Point(extract.origin[1], extract.origin[0])
    for name, outline in LEFT_HAND.items():
        if shapely.Polygon(outline).contains(place):
            return "left", f"its place: {name}"
    return "right", "its place"
