"""Files of OpenStreetMap: XML, plain or packed by bzip2 or gzip, as elements."""

import bz2
import gzip
import xml.etree.ElementTree as ElementTree
import zlib
from pathlib import Path

from mmw.core.errors import InputError
from mmw.worlds.importers.xml_nodes import parse_xml

MAX_BYTES = 2**30
"""Largest text of an extract; its elements take several times as much memory. Design value: 20 km of a dense city."""
PACKED = {".bz2": bz2.open, ".gz": gzip.open}
"""Suffix -> how a packed file is opened."""
CURE = "download the extract again"


def read_elements(path: Path) -> ElementTree.Element:
    """Return the <osm> element of a file.

    Raises:
        InputError: If the file is missing, torn, too large, no well-formed XML or no OSM file.
    """
    packed = PACKED.get(path.suffix.lower())
    if packed is None:
        if path.is_file() and path.stat().st_size > MAX_BYTES:
            raise _too_large(path)
        return parse_xml(path, "osm", CURE)
    try:
        with packed(path) as file:
            data = file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; give the path of an existing file") from None
    except (OSError, EOFError, ValueError, zlib.error) as error:
        raise InputError(f"{path}: cannot be unpacked ({error}); {CURE}") from None
    if len(data) > MAX_BYTES:
        raise _too_large(path)
    return parse_xml(path, "osm", CURE, data)


def _too_large(path: Path) -> InputError:
    return InputError(f"{path}: is larger than {MAX_BYTES / 2**30:g} GiB of XML; cut out a smaller area")
