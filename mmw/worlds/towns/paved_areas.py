"""Regions of the terrain with a surface of their own: faces of the same mesh, never a second layer on it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.place_description import PavedArea
from mmw.worlds.towns.primitives import Mesh, merge, weld

SNAP = 1e-6
"""Pieces of faces narrower than this are no surface [m]; vertices closer than this are one."""


@dataclass(frozen=True)
class Region:
    """A part of the plan with one surface."""

    path: str
    """Prim path of the mesh, below the town's root."""
    area: shapely.Geometry
    material: str
    label: str


def outline_of(part: MeshPart) -> shapely.Geometry:
    """Return the plan of a mesh that lies like terrain: no face above another."""
    return shapely.union_all(shapely.polygons(part.points[part.faces][:, :, :2]))


def cut(part: MeshPart, area: shapely.Geometry) -> tuple[Mesh, Mesh]:
    """Return the parts of a mesh inside and outside an area of the plan.

    Every face that the border of the area crosses is cut along it. Heights are those of the faces, so both parts
    together are the surface that was there, and along the cut they share their vertices.

    Args:
        part: A mesh that lies like terrain.
        area: Polygons in plan [m].
    """
    triangles = np.asarray(shapely.polygons(part.points[part.faces][:, :, :2]))
    shapely.prepare(area)
    inside = shapely.contains(area, triangles)
    touched = ~inside & shapely.intersects(area, triangles)
    within, rest = [_faces(part, inside)], [_faces(part, ~inside & ~touched)]
    for face, triangle in zip(np.flatnonzero(touched), triangles[touched], strict=True):
        corners = part.points[part.faces[face]]
        common = shapely.intersection(triangle, area)
        if common.area < SNAP * SNAP:
            rest.append(_faces(part, np.arange(len(part.faces)) == face))
            continue
        within.append(_lift(common, corners))
        rest.append(_lift(shapely.difference(triangle, area), corners))
    return _clean(merge(within)), _clean(merge(rest))


def _faces(part: MeshPart, chosen: np.ndarray) -> Mesh:
    used, faces = np.unique(part.faces[chosen], return_inverse=True)
    return Mesh(part.points[used], faces.reshape(-1, 3).astype(np.int32))


def _lift(piece: shapely.Geometry, corners: np.ndarray) -> Mesh:
    """Return polygons in the plan of a face as triangles on its plane; `corners` [3, 3] are the face's [m]."""
    meshes = []
    edges = corners[1:, :2] - corners[0, :2]
    slope = np.linalg.solve(edges, corners[1:, 2] - corners[0, 2])
    for polygon in shapely.get_parts(piece):
        if shapely.get_dimensions(polygon) < 2 or polygon.area < SNAP * SNAP:
            continue
        split = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
        rings = shapely.get_coordinates(split).reshape(-1, 4, 2)[:, :3]
        a, b, c = (rings[:, k] for k in range(3))
        area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
        rings = np.where((area < 0)[:, None, None], rings[:, ::-1], rings).reshape(-1, 2)
        z = corners[0, 2] + (rings - corners[0, :2]) @ slope
        meshes.append(Mesh(np.column_stack([rings, z]), np.arange(len(rings), dtype=np.int32).reshape(-1, 3)))
    return merge(meshes)


def _clean(mesh: Mesh) -> Mesh:
    """Join equal vertices and drop the faces that thereby lose their area."""
    mesh = weld(mesh)
    faces = mesh.faces
    a, b, c = (mesh.points[faces[:, k]] for k in range(3))
    kept = np.linalg.norm(np.cross(b - a, c - a), axis=1) > SNAP * SNAP
    used, index = np.unique(faces[kept], return_inverse=True)
    return Mesh(mesh.points[used], index.reshape(-1, 3).astype(np.int32))


def pave(terrain: Sequence[MeshPart], regions: Sequence[Region]) -> list[MeshPart]:
    """Return the terrain with its regions cut out, followed by the regions' own meshes.

    Args:
        terrain: Meshes that lie beside each other.
        regions: Later ones cut what earlier ones have left.

    Raises:
        InputError: If a region covers no terrain.
    """
    left, paved = list(terrain), []
    for region in regions:
        found = []
        for k, part in enumerate(left):
            if len(part.faces) and shapely.box(*_bounds(part)).intersects(region.area):
                within, rest = cut(part, region.area)
                if len(within.faces):
                    found.append(within)
                    left[k] = replace(part, points=rest.points, faces=rest.faces)
        mesh = weld(merge(found))
        if not len(mesh.faces):
            raise InputError(f"{region.path}: covers no terrain; move it off the roads, or into the town")
        paved.append(MeshPart(region.path, mesh.points, mesh.faces, region.material, region.label))
    return [part for part in left if len(part.faces)] + paved


def _bounds(part: MeshPart) -> np.ndarray:
    return np.concatenate([part.points[:, :2].min(axis=0), part.points[:, :2].max(axis=0)])


def area_regions(areas: Sequence[PavedArea]) -> list[Region]:
    """Return the regions of section `paved`.

    Raises:
        InputError: If an outline crosses itself.
    """
    regions = []
    for area in areas:
        polygon = shapely.Polygon(area.outline)
        if not polygon.is_valid or not polygon.area:
            raise InputError(f"paved {area.name!r}: {shapely.is_valid_reason(polygon)}; give the corners in order")
        regions.append(Region(f"Paving/{area.name}", shapely.normalize(polygon), area.material, area.label))
    return regions
