"""Files of OpenStreetMap as elements: XML, plain or packed by bzip2 or gzip, and PBF (extra osm)."""

import bz2
import gzip
import importlib
import xml.etree.ElementTree as ElementTree
import zlib
from pathlib import Path
from typing import Any

from mmw.core.errors import InputError
from mmw.core.extras import needed_by
from mmw.worlds.importers.xml_nodes import parse_xml

MAX_BYTES = 2**30
"""Largest text of an extract; its elements take several times as much memory. Design value: 20 km of a dense city."""
MAX_ELEMENTS = 5_000_000
"""Most nodes, ways and relations of a PBF file; design value, as many as 1 GiB of XML has."""
PACKED = {".bz2": bz2.open, ".gz": gzip.open}
"""Suffix -> how a packed file is opened."""
CURE = "download the extract again"


def read_elements(path: Path) -> ElementTree.Element:
    """Return the <osm> element of a file.

    Raises:
        InputError: If the file is missing, torn, too large, no well-formed XML or no OSM file.
        MissingPackageError: If a PBF file needs the package osmium, which is not installed.
    """
    if path.suffix.lower() == ".pbf":
        return _read_pbf(path)
    packed = PACKED.get(path.suffix.lower())
    if packed is None:
        if path.is_file() and path.stat().st_size > MAX_BYTES:
            raise _too_large(path)
        return parse_xml(path, "osm", CURE)
    try:
        with packed(path) as file:
            data = file.read(MAX_BYTES + 1)
    except (OSError, EOFError, zlib.error) as error:  # of these only the system's own errors have a number
        if getattr(error, "errno", None) is not None:
            raise InputError(f"{path}: cannot be read ({error.strerror}); give the path of an existing file") from None
        raise InputError(f"{path}: cannot be unpacked ({error}); {CURE}") from None
    if len(data) > MAX_BYTES:
        raise _too_large(path)
    return parse_xml(path, "osm", CURE, data)


def _too_large(path: Path) -> InputError:
    return InputError(f"{path}: is larger than {MAX_BYTES / 2**30:g} GiB of XML; cut out a smaller area")


def _read_pbf(path: Path) -> ElementTree.Element:
    """Return a PBF file as the elements of the XML with the same content."""
    if not path.is_file():
        raise InputError(f"{path}: no such file; give the path of an existing file")
    with needed_by(f"{path}: reading .osm.pbf"):
        osmium = importlib.import_module("osmium")
    root = ElementTree.Element("osm")
    try:
        _add_bounds(root, osmium.io.Reader(str(path), osmium.osm.osm_entity_bits.NOTHING).header().box())
        for count, entity in enumerate(osmium.FileProcessor(str(path))):
            if count >= MAX_ELEMENTS:
                raise InputError(
                    f"{path}: has more than {MAX_ELEMENTS:,} elements; cut out a smaller area, as with "
                    "osmium extract --bbox WEST,SOUTH,EAST,NORTH"
                )
            _add_entity(root, entity)
    except RuntimeError as error:  # osmium raises nothing more specific for a file that is torn
        raise InputError(f"{path}: cannot be read as PBF ({' '.join(str(error).split())[:120]}); {CURE}") from None
    return root


def _add_bounds(root: ElementTree.Element, box: Any) -> None:
    if box.valid():
        low, high = box.bottom_left, box.top_right
        corners = {"minlat": low.lat, "minlon": low.lon, "maxlat": high.lat, "maxlon": high.lon}
        ElementTree.SubElement(root, "bounds", {name: repr(value) for name, value in corners.items()})


def _add_entity(root: ElementTree.Element, entity: Any) -> None:
    """Add a node, way or relation of osmium as OSM XML has it."""
    kind = {"n": "node", "w": "way", "r": "relation"}[entity.type_str()]
    element = ElementTree.SubElement(root, kind, {"id": str(entity.id)})
    if not entity.visible:
        element.set("visible", "false")
    if kind == "node" and entity.location.valid():
        element.attrib |= {"lat": repr(entity.location.lat), "lon": repr(entity.location.lon)}
    elif kind == "way":
        for node in entity.nodes:
            ElementTree.SubElement(element, "nd", {"ref": str(node.ref)})
    elif kind == "relation":
        for member in entity.members:
            what = {"n": "node", "w": "way", "r": "relation"}[member.type]
            ElementTree.SubElement(element, "member", {"type": what, "ref": str(member.ref), "role": member.role})
    for tag in entity.tags:
        ElementTree.SubElement(element, "tag", {"k": tag.k, "v": tag.v})
