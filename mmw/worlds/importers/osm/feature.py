"""Nodes, ways and relations of an OpenStreetMap extract in meters."""

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import shapely

from mmw.worlds.towns.plan_geometry import polygons_of


@dataclass(frozen=True)
class Feature:
    """A node, way or relation with tags."""

    id: str
    """Kind and number, such as `w123`."""
    tags: dict[str, str]
    xy: np.ndarray
    """Position of a node, line of a way [m], shape [N, 2]; of a relation, no points."""
    area: shapely.Polygon | shapely.MultiPolygon | None = None
    """Valid area enclosed by a closed way or multipolygon [m]; None for others, and where it encloses none."""


@dataclass
class Extract:
    """Everything with tags."""

    path: Path
    origin: tuple[float, float]
    """Latitude and longitude of (0, 0) [deg]."""
    points: list[Feature] = field(default_factory=list)
    ways: list[Feature] = field(default_factory=list)
    relations: list[Feature] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    root: ElementTree.Element = field(default_factory=lambda: ElementTree.Element("osm"), repr=False)
    """The elements of the file."""
    places: dict[str, np.ndarray] = field(default_factory=dict, repr=False)
    """Id of a node -> its position [m], shape [2]."""
    frame: shapely.Polygon | None = None
    """Border at which everything was cut [m]; None if it was not."""


def is_building(tags: dict[str, str]) -> bool:
    """Return whether tags say building or building part."""
    return tags.get("building", "no") != "no" or tags.get("building:part", "no") != "no"


def polygonal(geometry: shapely.Geometry) -> shapely.Polygon | shapely.MultiPolygon | None:
    """Return the polygons of a geometry, repaired; None if it has none, as an area that is folded to a line."""
    found = polygons_of(shapely.make_valid(geometry), 0.0)
    if len(found) < 2:
        return found[0] if found else None
    return shapely.MultiPolygon(found)
