"""Read the wheels of a vehicle's meshes: the faces that turn, their center and their radius.

A Mesh, or a GeomSubset of its faces, is (part of) a wheel where it has the attribute `mmw:wheel:radius`: the radius on
which the wheel rolls, that of its tyre also on a rim. `mmw:wheel:center` is its center; left out, the middle of the
box around the faces. Both are in the space and units of the mesh's points.
"""

from collections.abc import Sequence

import numpy as np
from pxr import Usd, UsdGeom

from mmw.core.errors import InputError
from mmw.usd.prim_values import attribute_value
from mmw.usd.triangulate import Triangles

WHEEL_RADIUS = "mmw:wheel:radius"
"""Attribute that makes a Mesh or a GeomSubset a wheel."""

WHEEL_CENTER = "mmw:wheel:center"
"""Attribute with the center of a wheel."""

WHEEL_FAMILY = "wheel"
"""Family of the GeomSubsets that the shipped vehicles have; the reader accepts any family."""


def mesh_wheels(prim: Usd.Prim, triangles: Triangles, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the wheels that a mesh is, or holds.

    Args:
        prim: The Mesh prim.
        triangles: Its triangles.
        matrix: Mesh space to the actor's frame, row vectors, shape [4, 4]; its scale is the same along all axes.

    Returns:
        Wheels, center x, y, z and radius [m], actor's frame, shape [W, 4]; and the wheel of each triangle, -1 for
        none, shape [M], int32. A triangle in two wheels belongs to the last.

    Raises:
        InputError: If a radius is not above zero, or a number is not finite.
    """
    wheel = np.full(len(triangles.faces), -1, dtype=np.int32)
    wheels: list[Sequence[float]] = []
    scale = float(np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))
    for holder in (prim, *(subset.GetPrim() for subset in UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Imageable(prim)))):
        radius = attribute_value(holder, WHEEL_RADIUS)
        if radius is None:
            continue
        inside = np.ones(len(wheel), dtype=bool)
        if holder != prim:
            indices = UsdGeom.Subset(holder).GetIndicesAttr().Get()
            inside = np.isin(triangles.polygon, np.array([] if indices is None else indices, dtype=np.int64))
        if not inside.any():
            continue
        center = attribute_value(holder, WHEEL_CENTER)
        if center is None:
            corners = triangles.points[triangles.faces[inside]].reshape(-1, 3)
            center = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        x, y, z = np.array(center, dtype=np.float64) @ matrix[:3, :3] + matrix[3, :3]
        if not (np.isfinite([x, y, z]).all() and 0.0 < radius < np.inf):
            raise InputError(
                f"{holder.GetPath()}: wheel of radius {radius} about {center}; a radius above 0 and finite numbers are "
                f"needed; correct {WHEEL_RADIUS} and {WHEEL_CENTER}"
            )
        wheel[inside] = len(wheels)
        wheels.append((x, y, z, scale * float(radius)))
    return np.array(wheels, dtype=np.float64).reshape(-1, 4), wheel
