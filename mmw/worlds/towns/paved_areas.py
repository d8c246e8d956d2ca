"""Regions of the terrain with a surface of their own: faces of the same mesh, never a second layer on it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.core.mesh import TriangleMesh, merge, separate
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.place_description import PavedArea
from mmw.worlds.towns.plan_geometry import triangulate_polygons
from mmw.worlds.towns.primitives import weld

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
    return shapely.union_all(shapely.polygons(part.mesh.corners[:, :, :2]))


def cut(part: MeshPart, area: shapely.Geometry) -> tuple[TriangleMesh, TriangleMesh]:
    """Return the parts of a mesh inside and outside an area of the plan.

    Every face that the border of the area crosses is cut along it. Heights are those of the faces, so both parts
    together are the surface that was there, and along the cut they share their vertices.

    Args:
        part: A mesh that lies like terrain.
        area: Polygons in plan [m].
    """
    mesh = part.mesh
    triangles = np.asarray(shapely.polygons(mesh.corners[:, :, :2]))
    shapely.prepare(area)
    inside = shapely.contains(area, triangles)
    touched = ~inside & shapely.intersects(area, triangles)
    within, rest = [mesh.select(inside)], [mesh.select(~inside & ~touched)]
    for face, triangle in zip(np.flatnonzero(touched), triangles[touched], strict=True):
        corners = mesh.corners[face]
        common = shapely.intersection(triangle, area)
        if common.area < SNAP * SNAP:
            rest.append(mesh.select([face]))
            continue
        within.append(_lift(common, corners))
        rest.append(_lift(shapely.difference(triangle, area), corners))
    return _clean(merge(within)), _clean(merge(rest))


def _lift(piece: shapely.Geometry, corners: np.ndarray) -> TriangleMesh:
    """Return polygons in the plan of a face as triangles on its plane; `corners` [3, 3] are the face's [m]."""
    meshes = []
    edges = corners[1:, :2] - corners[0, :2]
    slope = np.linalg.solve(edges, corners[1:, 2] - corners[0, 2])
    for polygon in shapely.get_parts(piece):
        if shapely.get_dimensions(polygon) < 2 or polygon.area < SNAP * SNAP:
            continue
        rings = triangulate_polygons(polygon).reshape(-1, 2)
        z = corners[0, 2] + (rings - corners[0, :2]) @ slope
        meshes.append(separate(np.column_stack([rings, z])))
    return merge(meshes)


def _clean(mesh: TriangleMesh) -> TriangleMesh:
    """Join equal vertices and drop the faces that thereby lose their area."""
    mesh = weld(mesh)
    return mesh.select(2.0 * mesh.areas > SNAP * SNAP)


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
            if len(part.faces) and shapely.box(*part.mesh.bounds[:, :2].ravel()).intersects(region.area):
                within, rest = cut(part, region.area)
                if len(within.faces):
                    found.append(within)
                    left[k] = replace(part, points=rest.points, faces=rest.faces)
        mesh = weld(merge(found))
        if not len(mesh.faces):
            raise InputError(f"{region.path}: covers no terrain; move it off the roads, or into the town")
        paved.append(MeshPart.of(region.path, mesh, region.material, region.label))
    return [part for part in left if len(part.faces)] + paved


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
