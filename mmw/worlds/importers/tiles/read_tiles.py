"""3D Tiles (tileset.json with local files, or one .b3dm) -> scene: the finest meshes, in the plane of their place.

Source: 3D Tiles 1.1 (OGC 22-025r4): frames of tiles, refinement; content as in `content`.
"""

import json
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import numpy as np

from mmw.core.errors import InputError
from mmw.worlds.importers.city.reference_system import ReferenceSystem, check_numbers, check_reach, place
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.importers.mesh_cleanup import MeshCollector, PrimNames
from mmw.worlds.importers.mesh_files import MaterialCollector, load_glb, placed_meshes
from mmw.worlds.importers.tiles.content import Model, models_of

MAX_TILES = 100_000
"""Largest number of tiles of a tileset."""
MAX_DEPTH = 64
"""Tiles inside tiles, and tilesets inside tilesets."""
EARTH = 6.0e6
"""Vertices farther from their origin than this are earth-centered [m]: the poles are at 6.36e6."""


@dataclass(frozen=True)
class _Content:
    path: Path
    matrix: np.ndarray
    """Frame of its tile to that of the tileset, column vectors, shape [4, 4]."""


@dataclass
class _Walk:
    """Contents of a tileset, found so far."""

    contents: list[_Content] = field(default_factory=list)
    left_out: Counter = field(default_factory=Counter)
    tiles: int = 0
    open_files: tuple[Path, ...] = ()


def read_tiles(path: str | Path) -> ImportedScene:
    """Read a tileset, or one batched 3D model.

    Args:
        path: A `tileset.json`, whose contents are files beside or below it, or a `.b3dm`.

    Returns:
        A mesh for each mesh of a content. Earth-centered tiles lie in the tangent plane at their middle, with the
        height over the ellipsoid of the lowest vertex as zero.

    Raises:
        InputError: If a file is broken, missing or remote, or there is nothing to build.
    """
    path = Path(path)
    walk = _Walk()
    if path.suffix.lower() == ".json":
        _walk_tileset(path, np.eye(4), walk, 0)
    else:
        walk.contents.append(_Content(path, np.eye(4)))
    names, materials = PrimNames(), MaterialCollector()
    base = names.folder("", "Model")
    found = []  # where, prim, points in the frame of the tileset, faces, material
    for content in walk.contents:
        folder = names.folder(base, content.path.stem) if len(walk.contents) > 1 else base
        for model in models_of(_bytes(content.path), str(content.path)):
            if isinstance(model, str):
                walk.left_out[model] += 1
                continue
            found += _meshes(content, model, folder, names, materials)
    if not found:
        kinds = f" (only {', '.join(sorted(walk.left_out))})" if walk.left_out else ""
        raise InputError(f"{path}: holds no mesh{kinds}; give tiles with b3dm or glb contents")
    every = np.concatenate([points for _, _, points, _, _ in found])
    system = ReferenceSystem(4978 if np.linalg.norm(every, axis=1).min() > EARTH else 0)
    world, georeference, notes = place(str(path), every, system)
    meshes, starts = MeshCollector(), np.cumsum([len(points) for _, _, points, _, _ in found])[:-1]
    for (where, prim, _, faces, material), points in zip(found, np.split(world, starts), strict=True):
        check_reach(where, points)
        meshes.add(where, prim, points, faces, material)
    if walk.left_out:
        notes.append("left out: " + ", ".join(f"{count} {kind}" for kind, count in sorted(walk.left_out.items())))
    notes = (*notes, *materials.notes, *meshes.notes())
    return ImportedScene(meshes.parts, materials.found, None, notes, georeference=georeference)


def _meshes(
    content: _Content, model: Model, folder: str, names: PrimNames, materials: MaterialCollector
) -> Iterator[tuple[str, str, np.ndarray, np.ndarray, str]]:
    """Yield the meshes of a model in the frame of the tileset; glTF has y up, tiles have z up."""
    offset = np.eye(4)
    offset[:3, 3] = model.center
    scene = load_glb(model.glb, str(content.path))
    for node, prim, points, faces, mesh in placed_meshes(scene, folder, names, content.matrix @ offset):
        check_numbers(f"{content.path}: {node}", points)
        if len(faces) and len(points):
            yield f"{content.path}: {node}", prim, points, faces, materials.name_of(mesh)


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}); download all files of the tileset to this place"
        ) from None


def _walk_tileset(path: Path, matrix: np.ndarray, walk: _Walk, depth: int) -> None:
    """Collect the contents of a tileset and of those that it refers to."""
    if path in walk.open_files or depth > MAX_DEPTH:
        raise InputError(f"{path}: the tileset contains itself, or {MAX_DEPTH} others inside each other; correct it")
    try:
        root = json.loads(_bytes(path).decode("utf-8-sig"))["root"]
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        reason = f"no {error}" if isinstance(error, KeyError) else str(error)[:100]
        raise InputError(f"{path}: is no tileset ({reason}); an object with asset and root is needed") from None
    before, walk.open_files = walk.open_files, (*walk.open_files, path)
    _walk_tile(path, root, matrix, "REPLACE", walk, "root", depth)
    walk.open_files = before


def _walk_tile(path: Path, tile: Any, matrix: np.ndarray, refine: str, walk: _Walk, name: str, depth: int) -> None:
    """Collect the contents of a tile: its own if children add to it or it has none, and those of its children."""
    walk.tiles += 1
    if not isinstance(tile, dict):
        raise InputError(f"{path}: {name[-80:]} is no tile; an object with geometricError is needed; correct it")
    if walk.tiles > MAX_TILES or depth > MAX_DEPTH:
        raise InputError(
            f"{path}: {name[-80:]}: over {MAX_TILES:,} tiles, or {MAX_DEPTH} inside each other; give a smaller tileset"
        )
    if "implicitTiling" in tile:
        raise InputError(f"{path}: {name[-80:]}: implicit tiling is not read; give a tileset that lists its tiles")
    matrix = matrix @ _transform(tile, f"{path}: {name[-80:]}")
    refine = str(tile.get("refine", refine)).upper()
    children = tile.get("children") or []
    if not isinstance(children, list):
        raise InputError(f"{path}: {name[-80:]}.children is no list of tiles; correct it")
    if refine == "ADD" or not children:
        for content in _contents(tile):
            _add_content(path, content, matrix, walk, f"{path}: {name[-80:]}", depth)
    for number, child in enumerate(children):
        _walk_tile(path, child, matrix, refine, walk, f"{name}.children[{number}]", depth + 1)


def _contents(tile: Mapping[str, Any]) -> list[Any]:
    several = tile.get("contents")
    return several if isinstance(several, list) else [tile["content"]] if tile.get("content") is not None else []


def _add_content(path: Path, content: Any, matrix: np.ndarray, walk: _Walk, where: str, depth: int) -> None:
    uri = content.get("uri", content.get("url")) if isinstance(content, dict) else None  # url: before 1.0
    if not isinstance(uri, str) or not uri or "\x00" in uri:
        raise InputError(f"{where}: its content has no uri; correct it")
    parts = urlsplit(uri)
    if parts.scheme or parts.netloc:
        raise InputError(f"{where}: {uri[:80]} is not a local file; download the whole tileset, then import that")
    file = path.parent / unquote(parts.path)
    if file.suffix.lower() == ".json":
        _walk_tileset(file, matrix, walk, depth + 1)
    elif file.suffix.lower() in (".glb", ".b3dm", ".cmpt", ".i3dm", ".pnts"):
        walk.contents.append(_Content(file, matrix))
    else:
        walk.left_out[file.suffix.lower() or "contents without a suffix"] += 1


def _transform(tile: Mapping[str, Any], where: str) -> np.ndarray:
    """Return the frame of a tile in that of its parent, shape [4, 4]; the file has columns first."""
    values = tile.get("transform")
    if values is None:
        return np.eye(4)
    try:
        matrix = np.array(values, np.float64).reshape(4, 4).T
    except (TypeError, ValueError, OverflowError):
        matrix = np.full((4, 4), np.nan)
    if not np.isfinite(matrix).all():
        raise InputError(f"{where}.transform: 16 numbers are needed; correct it")
    return matrix
