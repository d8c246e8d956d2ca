"""Bounds of an OpenStreetMap extract: what reaches beyond them is cut."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.worlds.importers.osm.feature import Feature, is_building
from mmw.worlds.towns.plan_geometry import polygons_of

SIDE_POINTS = 16
"""Points of a side of the bounds: a parallel of 20 km bends by 14 m at 60 deg of latitude, its 16th by 5 cm."""
AROUND = 30.0
"""How far areas of ground reach beyond roads and buildings in a file without bounds [m]; design value."""


def read_bounds(root: ElementTree.Element, path: Path) -> np.ndarray | None:
    """Return south, west, north and east of all that was asked for [deg], shape [4]; None if not given.

    JOSM writes one element for each download.

    Raises:
        InputError: If an element has no degrees, or its south is north of its north.
    """
    found = []
    for box in root.findall("bounds"):
        corners = [box.get(key, "") for key in ("minlat", "minlon", "maxlat", "maxlon")]
        try:
            values = np.array([float(value) for value in corners])
        except ValueError:
            values = np.full(4, np.nan)
        if not ((np.abs(values) <= [90, 180, 90, 180]).all() and (values[:2] <= values[2:]).all()):
            raise InputError(
                f"{path}: <bounds> are {', '.join(corners)}; degrees are needed; correct or remove the line"
            )
        found.append(values)
    if not found:
        return None
    every = np.array(found)
    return np.concatenate([every[:, :2].min(axis=0), every[:, 2:].max(axis=0)])


def read_bbox(text: str) -> np.ndarray:
    """Return south, west, north and east [deg], shape [4], of a text `west,south,east,north` [deg].

    Raises:
        InputError: If it has not four numbers, or they enclose nothing on the earth.
    """
    try:
        west, south, east, north = (float(word) for word in text.split(","))
    except ValueError:
        west = south = east = north = np.nan
    if not (-180 <= west < east <= 180 and -90 <= south < north <= 90):
        raise InputError(
            f"--bbox {text}: four numbers in degrees are needed, west less than east and south less than north; give "
            "WEST,SOUTH,EAST,NORTH, such as 11.56,48.18,11.57,48.19"
        )
    return np.array([south, west, north, east])


def outline(bounds: np.ndarray, place: Callable[[np.ndarray], np.ndarray]) -> shapely.Polygon:
    """Return bounds in plan [m].

    Args:
        bounds: South, west, north and east [deg], shape [4].
        place: Map of latitudes and longitudes [deg] to the plane [m], shape [N, 2] each.
    """
    south, west, north, east = bounds
    corners = np.array([[south, west], [south, east], [north, east], [north, west], [south, west]])
    along = np.linspace(0.0, 1.0, SIDE_POINTS, endpoint=False)[:, None]
    sides = [a + along * (b - a) for a, b in pairwise(corners)]
    return shapely.Polygon(place(np.concatenate(sides)))


def default_frame(features: list[Feature]) -> shapely.Polygon | None:
    """Return a box around the roads and buildings of a file without bounds [m]; None if there are none."""
    built = [f for f in features if f.tags.get("highway") or is_building(f.tags)]
    found = [f.xy for f in built if len(f.xy)]
    found += [shapely.get_coordinates(f.area) for f in built if f.area is not None]
    if not found:
        return None
    every = np.concatenate(found)
    return shapely.box(*(every.min(axis=0) - AROUND), *(every.max(axis=0) + AROUND))


def cut(features: list[Feature], frame: shapely.Polygon) -> tuple[list[Feature], int, int]:
    """Return features inside a frame, how many were cut at it, and how many lay outside.

    A line that leaves the frame and comes back becomes several features. Buildings across the frame stay whole, for
    a cut would give them walls that do not exist.
    """
    shapely.prepare(frame)
    kept, shortened, outside = [], 0, 0
    for feature in features:
        whole = feature.area if feature.area is not None else _line(feature.xy)
        if whole is None or shapely.contains(frame, whole):
            kept.append(feature)
        elif not shapely.intersects(frame, whole):
            outside += 1
        elif feature.area is not None and is_building(feature.tags):
            kept.append(feature)
        else:
            pieces = _cut(feature, frame)
            kept += pieces
            shortened += bool(pieces)
    return kept, shortened, outside


def _line(xy: np.ndarray) -> shapely.Geometry | None:
    if len(xy) < 2:
        return shapely.Point(xy[0]) if len(xy) else None
    return shapely.LineString(xy)


def _cut(feature: Feature, frame: shapely.Polygon) -> list[Feature]:
    pieces = []
    if len(feature.xy) >= 2:
        whole = shapely.LineString(feature.xy)
        for line in shapely.get_parts(shapely.intersection(whole, frame)):
            if line.length > 0.0:
                xy = shapely.get_coordinates(line)
                start, after = (shapely.line_locate_point(whole, shapely.Point(point)) for point in xy[:2])
                xy = xy if start < after else xy[::-1]  # the sides of a way are those of its direction
                pieces.append(replace(feature, xy=xy, area=None))
    if feature.area is not None:
        area = polygons_of(shapely.intersection(feature.area, frame), 0.0)
        if area:
            pieces.append(replace(feature, xy=np.zeros((0, 2)), area=shapely.MultiPolygon(area)))
    return pieces
