"""CityGML files, versions 1 to 3 (.gml, .citygml) -> scene: buildings, bridges, roads, terrain as they are.

Source: CityGML 2.0 (OGC 12-019) and 3.0 (OGC 21-006r2); polygons as in GML 3.1 and 3.2. Elements are known by their
names without namespace, which are the same in all versions.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mmw.core.errors import InputError
from mmw.worlds.importers.city.collector import CityCollector, Rings
from mmw.worlds.importers.city.reference_system import reference_system
from mmw.worlds.importers.city.surface_types import MATERIALS, OPEN
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.importers.xml_nodes import XmlNode, read_xml

CURE = "export the file again"
GEOMETRY = re.compile(r"lod([0-4])(Solid|MultiSurface|CompositeSurface|Surface|Geometry|TriangulatedSurface)")
"""Properties that hold the surfaces of a level of detail."""
SURFACES = (*MATERIALS, *OPEN)
PARTS = ("BuildingPart", "BuildingInstallation", "BuildingConstructiveElement", "BridgePart", "BridgeInstallation",
         "BridgeConstructionElement", "BridgeConstructiveElement")  # fmt: skip
"""Objects inside of others."""


@dataclass
class _Surfaces:
    """Surfaces of one object at one level of detail."""

    thematic: list[tuple[Rings, str]] = field(default_factory=list)
    """Those of walls, roofs and so on, with their type."""
    plain: list[tuple[Rings, str]] = field(default_factory=list)
    """Those of a body without such."""


def read_citygml(path: str | Path, *, lod: str = "") -> ImportedScene:
    """Read a CityGML file.

    Args:
        path: The file.
        lod: Highest level of detail, 1 to 4, that is read of an object; of each the highest if empty.

    Raises:
        InputError: If the file is no CityGML, is broken, or holds nothing to build.
    """
    path = Path(path)
    if lod and lod not in ("1", "2", "3", "4"):
        raise InputError(f"{path}: lod = {lod!r}; a level of detail from 1 to 4 is needed; correct it")
    root = read_xml(path)
    nodes = [root, *root.below()]
    for node in nodes:
        node.tag = node.tag.rpartition(":")[2]
        node.attributes = {key.rpartition(":")[2]: value for key, value in node.attributes.items()}
    if root.tag != "CityModel":
        raise InputError(f"{path}: root element <{root.tag[:60]}>; <CityModel> is needed; give a CityGML file")
    polygons = {each.attributes["id"]: each for each in nodes if each.tag == "Polygon" and "id" in each.attributes}
    references = [each.attributes["srsName"] for each in nodes if "srsName" in each.attributes]
    collector, empty = CityCollector(path), 0
    for member in nodes:
        if member.tag not in ("cityObjectMember", "featureMember"):
            continue
        for each in member.children:
            if not collector.knows(each.tag):
                continue
            for number, (item, surfaces) in enumerate(_objects(each, polygons, int(lod or 4))):
                name = item.attributes.get("id", f"{each.attributes.get('id', 'object')}_{number}")
                collector.add(name, item.tag, surfaces)
                empty += not surfaces
    if empty:
        collector.notes.append(f"{empty} objects without surfaces of this level of detail were left out")
    return collector.build(reference_system(references[0] if references else ""))


def _objects(
    top: XmlNode, polygons: dict[str, XmlNode], limit: int
) -> Iterator[tuple[XmlNode, list[tuple[Rings, str]]]]:
    """Yield an object and its parts, each with the surfaces of its highest level of detail."""
    levels: dict[int, _Surfaces] = {}
    inner: list[XmlNode] = []
    others: list[XmlNode] = []

    def visit(node: XmlNode, kind: str) -> None:
        for child in node.children:
            if child.tag in PARTS:
                inner.append(child)
                continue
            found = GEOMETRY.fullmatch(child.tag)
            if found and 1 <= int(found[1]) <= limit:
                surfaces = levels.setdefault(int(found[1]), _Surfaces())
                target = surfaces.thematic if kind else surfaces.plain
                target += [(rings, kind) for rings in _polygons(child, polygons)]
            elif found:
                others.append(child)
            else:
                is_relief = top.tag == "ReliefFeature" and child.tag in ("triangulatedSurface", "tin")
                if is_relief:
                    levels.setdefault(1, _Surfaces()).plain += [(rings, "") for rings in _polygons(child, polygons)]
                else:
                    visit(child, child.tag if child.tag in SURFACES else kind)

    visit(top, "")
    if levels:
        best = levels[max(levels)]
        yield top, best.thematic or best.plain
    elif others or not inner:
        yield top, []
    for child in inner:
        yield from _objects(child, polygons, limit)


def _polygons(node: XmlNode, known: dict[str, XmlNode]) -> Iterator[list[np.ndarray]]:
    """Yield the rings of the polygons and triangles below a property; references are followed."""
    for each in node.below():
        target = each
        if "href" in each.attributes and each.tag == "surfaceMember":
            name = each.attributes["href"].lstrip("#")
            if name not in known:
                continue  # a whole surface of another element, whose polygons are read there
            target = known[name]
        if target.tag in ("Polygon", "Triangle", "Rectangle", "PolygonPatch"):
            rings = [ring for side in target.find("exterior", "interior") for ring in side.below()]
            rings = [ring for ring in rings if ring.tag in ("LinearRing", "Ring")]
            if not rings:
                raise InputError(f"{target.where}: <{target.tag}> has no exterior with a LinearRing; {CURE}")
            yield [_ring(ring) for ring in rings]


def _ring(ring: XmlNode) -> np.ndarray:
    """Return the corners of a ring without its repeated first one, shape [N, 3]."""
    texts = [each.text for each in ring.below() if each.tag in ("posList", "pos")]
    try:
        values = np.array([float(word) for text in texts for word in text.split()])
    except ValueError:
        values = np.zeros(1)
    if len(values) % 3 or not np.isfinite(values).all():
        raise InputError(f"{ring.where}: <{ring.tag}>: triples of numbers are needed; {CURE}")
    points = values.reshape(-1, 3)
    return points[:-1] if len(points) > 1 and (points[0] == points[-1]).all() else points
