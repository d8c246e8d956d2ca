"""USD's built-in shapes (Cube, Sphere, Cylinder, Cone, Capsule, Plane) as triangles."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from pxr import Usd, UsdGeom

from mmw.usd.prim_values import attribute_value

if TYPE_CHECKING:
    import trimesh

SECTIONS = 32
"""Sides of a round shape."""

SUBDIVISIONS = 3
"""Subdivisions of the icosahedron that approximates a sphere: 1,280 triangles."""

Shape = tuple[np.ndarray, np.ndarray]
"""Points [N, 3], float64, and outward triangles [M, 3], int32, in the prim's space."""


def _creation() -> Any:
    """Return `trimesh.creation`, imported late: it needs a second, and most stages have meshes alone."""
    import trimesh.creation

    return trimesh.creation


def _number(prim: Usd.Prim, name: str) -> float:
    return float(prim.GetAttribute(name).Get())


def _along_axis(prim: Usd.Prim, mesh: "trimesh.Trimesh") -> Shape:
    """Return a shape that was built along z, turned to the prim's axis if it has one; the faces stay outward."""
    shift = {"X": 1, "Y": 2, "Z": 0}[attribute_value(prim, "axis", "Z")]
    return np.roll(np.array(mesh.vertices, dtype=np.float64), shift, axis=1), np.array(mesh.faces, dtype=np.int32)


def _cube(prim: Usd.Prim) -> Shape:
    return _along_axis(prim, _creation().box((_number(prim, "size"),) * 3))


def _sphere(prim: Usd.Prim) -> Shape:
    return _along_axis(prim, _creation().icosphere(subdivisions=SUBDIVISIONS, radius=_number(prim, "radius")))


def _cylinder(prim: Usd.Prim) -> Shape:
    radius, height = _number(prim, "radius"), _number(prim, "height")
    return _along_axis(prim, _creation().cylinder(radius, height, sections=SECTIONS))


def _cone(prim: Usd.Prim) -> Shape:
    mesh = _creation().cone(_number(prim, "radius"), _number(prim, "height"), sections=SECTIONS)
    mesh.apply_translation((0.0, 0.0, -0.5 * _number(prim, "height")))  # USD's cone has its origin half way up
    return _along_axis(prim, mesh)


def _capsule(prim: Usd.Prim) -> Shape:
    height, radius = _number(prim, "height"), _number(prim, "radius")
    mesh = _creation().capsule(height, radius, count=(SECTIONS, SECTIONS // 2))
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    return _along_axis(prim, mesh)


def _plane(prim: Usd.Prim) -> Shape:
    """Return a rectangle that faces along its axis; width and length lie as UsdGeomPlane says."""
    half_width, half_length = 0.5 * _number(prim, "width"), 0.5 * _number(prim, "length")
    axis = UsdGeom.Plane(prim).GetAxisAttr().Get()
    u, v = {"X": ((0, 0, half_width), (0, half_length, 0)), "Y": ((half_width, 0, 0), (0, 0, half_length)),
            "Z": ((half_width, 0, 0), (0, half_length, 0))}[axis]  # fmt: skip
    u, v = np.array(u), np.array(v)
    faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
    front = np.cross(u, v)["XYZ".index(axis)] > 0.0
    return np.array([-u - v, u - v, u + v, v - u], dtype=np.float64), faces if front else faces[:, ::-1]


SHAPES: dict[str, Callable[[Usd.Prim], Shape]] = {
    "Cube": _cube, "Sphere": _sphere, "Cylinder": _cylinder, "Cone": _cone, "Capsule": _capsule, "Plane": _plane
}  # fmt: skip
"""Prim type -> reader. Sizes are read at the default time: a shape that changes its size is not supported."""
