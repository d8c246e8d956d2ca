"""CityJSON files (.json, .city.json) and sequences (.jsonl) -> scene: buildings, bridges, terrain as they are.

Source: CityJSON 2.0.1 (OGC 20-072), which differs from 1.0 and 1.1 in nothing that is read here; CityJSONSeq is a
CityJSON object in the first line and a CityJSONFeature in each of the others.
"""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mmw.core.errors import InputError
from mmw.worlds.importers.city.collector import CityCollector, Rings
from mmw.worlds.importers.city.reference_system import reference_system
from mmw.worlds.importers.imported_scene import ImportedScene

LEVELS = {"MultiSurface": 0, "CompositeSurface": 0, "Solid": 1, "MultiSolid": 2, "CompositeSolid": 2}
"""Type of a geometry -> lists around its surfaces. Points, lines and others are left out."""
CURE = "export the file again; cjval tells its faults"


@dataclass(frozen=True)
class _Vertices:
    """Vertices that the boundaries of some objects refer to."""

    points: np.ndarray
    """In the reference system, shape [N, 3]."""
    where: str


@dataclass(frozen=True)
class _Templates:
    """Geometries that instances repeat."""

    geometries: list[Any]
    vertices: _Vertices


def read_cityjson(path: str | Path, *, lod: str = "") -> ImportedScene:
    """Read a CityJSON file or sequence.

    Args:
        path: The file.
        lod: Level of detail, such as `1.2`: of each object the highest one that is not above; the highest if empty.

    Raises:
        InputError: If the file is no CityJSON, is broken, or holds nothing to build.
    """
    path = Path(path)
    limit = _level(lod, f"{path}: lod") if lod else math.inf
    first, *features = _documents(path)
    collector = CityCollector(path)
    templates = _templates(first, path)
    metadata = first.get("metadata")
    reference = metadata.get("referenceSystem") if isinstance(metadata, dict) else None
    skipped = 0
    for index, document in enumerate((first, *features)):
        where = f"{path}:{index + 1}" if features else str(path)
        objects = document.get("CityObjects", {})
        if not isinstance(objects, dict):
            raise InputError(f"{where}: CityObjects is no map of objects by id; {CURE}")
        vertices = _vertices(document, first, where)
        for name, each in objects.items():
            if not isinstance(each, dict) or not isinstance(each.get("type"), str):
                raise InputError(f"{where}: CityObjects[{name[:40]!r}] has no type; {CURE}")
            at = f"{where}: CityObjects[{name[:40]!r}]"
            surfaces = _best_surfaces(each, vertices, templates, limit, at)
            skipped += surfaces is None
            if surfaces and collector.knows(each["type"]):
                collector.add(name, each["type"], surfaces)
    if skipped:
        collector.notes.append(f"{skipped} objects with footprints, points or lines only were left out")
    return collector.build(reference_system(reference if isinstance(reference, str) else ""))


def _documents(path: Path) -> list[dict[str, Any]]:
    """Return the objects of a file: one, or one for each line of a sequence."""
    try:
        text = path.read_bytes().decode("utf-8-sig")
        lines = [line for line in text.splitlines() if line.strip()] if path.suffix.lower() == ".jsonl" else [text]
        found = [json.loads(line) for line in lines]
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); give the path of an existing file") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: broken JSON ({str(error)[:120]}); {CURE}") from None
    kinds = ["CityJSON", *["CityJSONFeature"] * (len(found) - 1)]
    if not found:
        raise InputError(f"{path}: is empty; a CityJSON object is needed; {CURE}")
    for number, (each, kind) in enumerate(zip(found, kinds, strict=True)):
        if not isinstance(each, dict) or each.get("type") != kind:
            line = f":{number + 1}" if len(found) > 1 else ""
            raise InputError(f'{path}{line}: holds no object with "type": "{kind}"; give CityJSON 1.0 to 2.0; {CURE}')
    return found


def _vertices(document: Mapping[str, Any], first: Mapping[str, Any], where: str) -> _Vertices:
    points = _array(document.get("vertices", []), f"{where}: vertices")
    transform = first.get("transform")
    if transform is None:
        return _Vertices(points, where)
    if not isinstance(transform, dict):
        raise InputError(f"{where}: transform is no map of scale and translate; {CURE}")
    scale, translate = (_array([transform.get(key)], f"{where}: transform.{key}") for key in ("scale", "translate"))
    return _Vertices(points * scale + translate, where)


def _array(value: object, where: str) -> np.ndarray:
    """Return rows of three numbers, shape [N, 3]."""
    try:
        array = np.asarray(value, np.float64)
    except (TypeError, ValueError, OverflowError):
        array = np.zeros(0)
    if value == []:
        return np.zeros((0, 3))
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(f"{where}: rows of three numbers are needed; {CURE}")
    return array


def _templates(first: Mapping[str, Any], path: Path) -> _Templates:
    found = first.get("geometry-templates")
    found = found if isinstance(found, dict) else {}
    where = f"{path}: geometry-templates"
    geometries = found.get("templates", [])
    points = _array(found.get("vertices-templates", []), f"{where}.vertices-templates")
    return _Templates(geometries if isinstance(geometries, list) else [], _Vertices(points, where))


def _level(value: object, where: str) -> float:
    """Return a level of detail as a number: `2.2` is above `2`, which 1.0 writes without digits behind the point."""
    try:
        level = float(value) if isinstance(value, str | int | float) else math.nan
    except (ValueError, OverflowError):
        level = math.nan
    if not 0.0 <= level < 10.0:
        raise InputError(f"{where} = {str(value)[:40]!r}; a level of detail such as 2.2 is needed; correct it")
    return level


def _best_surfaces(
    each: Mapping[str, Any], vertices: _Vertices, templates: _Templates, limit: float, where: str
) -> list[tuple[Rings, str]] | None:
    """Return rings and types of the surfaces of the highest level of detail, but 0; None if it has no such."""
    geometries = each.get("geometry", [])
    if not isinstance(geometries, list) or not all(isinstance(item, dict) for item in geometries):
        raise InputError(f"{where}: geometry is no list of geometries; {CURE}")
    found: dict[float, list[tuple[Rings, str]]] = {}
    for number, geometry in enumerate(geometries):
        at, matrix, used = f"{where}.geometry[{number}]", None, vertices
        if geometry.get("type") == "GeometryInstance":
            geometry, matrix, used = (
                _instance(geometry, vertices, templates, at),
                _matrix(geometry, vertices, at),
                templates.vertices,
            )
        if geometry.get("type") not in LEVELS:
            continue
        level = _level(geometry.get("lod", 2), f"{at}.lod")
        if 0.0 < level <= limit and (level >= 1.0 or each["type"] not in ("Building", "BuildingPart")):
            surfaces = list(_surfaces(geometry, used, at))
            if matrix is not None:
                surfaces = [
                    ([ring @ matrix[:3, :3].T + matrix[:3, 3] for ring in rings], kind) for rings, kind in surfaces
                ]
            found.setdefault(level, []).extend(surfaces)
    if not found:
        return None if geometries else []
    return found[max(found)]


def _instance(geometry: Mapping[str, Any], vertices: _Vertices, templates: _Templates, where: str) -> Mapping[str, Any]:
    index = geometry.get("template")
    if type(index) is not int or not 0 <= index < len(templates.geometries):
        raise InputError(f"{where}.template = {index!r}: there are {len(templates.geometries)} templates; {CURE}")
    template = templates.geometries[index]
    if not isinstance(template, dict) or template.get("type") == "GeometryInstance":
        raise InputError(f"{templates.vertices.where}.templates[{index}] is no geometry; {CURE}")
    return template


def _matrix(geometry: Mapping[str, Any], vertices: _Vertices, where: str) -> np.ndarray:
    """Return where an instance stands, shape [4, 4]: its matrix, rows first, and then its reference point."""
    values = geometry.get("transformationMatrix")
    try:
        matrix = np.asarray(values, np.float64).reshape(4, 4)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{where}.transformationMatrix: 16 numbers are needed; {CURE}") from None
    place = np.eye(4)
    (place[:3, 3],) = _ring(geometry.get("boundaries"), vertices, f"{where}.boundaries", least=1)[:1]
    return place @ matrix


def _surfaces(geometry: Mapping[str, Any], vertices: _Vertices, where: str) -> Iterator[tuple[Rings, str]]:
    """Yield rings and type of each surface of a geometry."""
    boundaries = geometry.get("boundaries", [])
    semantics = geometry.get("semantics")
    values, kinds = None, []
    if isinstance(semantics, dict):
        values, surfaces = semantics.get("values"), semantics.get("surfaces", [])
        kinds = (
            [item.get("type", "") if isinstance(item, dict) else "" for item in surfaces]
            if isinstance(surfaces, list)
            else []
        )
    for _ in range(LEVELS[geometry["type"]]):
        boundaries, values = _joined(boundaries, where), _joined_values(values)
    if not isinstance(boundaries, list):
        raise InputError(f"{where}.boundaries is no list of surfaces; {CURE}")
    if not isinstance(values, list) or len(values) != len(boundaries):
        values = [None] * len(boundaries)
    for number, (rings, value) in enumerate(zip(boundaries, values, strict=True)):
        at = f"{where}: surface {number}"
        if not isinstance(rings, list) or not rings:
            raise InputError(f"{at} has no rings; {CURE}")
        kind = kinds[value] if type(value) is int and 0 <= value < len(kinds) else ""
        yield [_ring(ring, vertices, at) for ring in rings], str(kind)


def _joined(nested: object, where: str) -> list[Any]:
    """Return the items of the lists in a list."""
    if not isinstance(nested, list) or not all(isinstance(item, list) for item in nested):
        raise InputError(f"{where}.boundaries: lists in lists are needed; {CURE}")
    return [inner for item in nested for inner in item]


def _joined_values(nested: object) -> list[Any] | None:
    """Return the values of the lists in a list; None where they do not fit, as all of a shell may be null."""
    if not isinstance(nested, list) or not all(isinstance(item, list) for item in nested):
        return None
    return [inner for item in nested for inner in item]


def _ring(ring: object, vertices: _Vertices, where: str, least: int = 0) -> np.ndarray:
    """Return the corners of a ring of indices, shape [N, 3]."""
    count = len(vertices.points)
    if not isinstance(ring, list) or len(ring) < least:
        raise InputError(f"{where}: a list of vertices is needed; {CURE}")
    if not all(type(index) is int and 0 <= index < count for index in ring):
        bad = next(index for index in ring if type(index) is not int or not 0 <= index < count)
        raise InputError(f"{where}: vertex {str(bad)[:40]} of {count} in {vertices.where} does not exist; {CURE}")
    return vertices.points[ring] if ring else np.zeros((0, 3))
