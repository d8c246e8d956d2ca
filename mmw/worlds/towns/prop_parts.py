"""Describe the parts of props: meshes with a material and a label, x to the front and z up."""

import numpy as np

from mmw.core.mesh import TriangleMesh, merge
from mmw.worlds.towns.primitives import box, lathe

Piece = tuple[str, TriangleMesh, str, str]
"""Name, mesh, material and semantic label of one part of a prop; the first part's label is that of the prop."""

ROOT = 0.6
"""How far posts and trunks reach into the ground, so that nothing floats on a slope [m]."""


def piece(name: str, material: str, label: str, *meshes: TriangleMesh) -> Piece:
    """Return one part of a prop, of some meshes."""
    return name, merge(meshes), material, label


def block(width: float, length: float, height: float, x: float = 0.0, y: float = 0.0) -> TriangleMesh:
    """Return a box of `width` along x, `length` along y and `height` above the ground [m] that is rooted in it."""
    return box((width, length, height + ROOT), (x, y, 0.5 * (height - ROOT)))


def pole(height: float, radius: float, top: float | None = None, sides: int = 5) -> TriangleMesh:
    """Return an upright post of `height` above the ground, tapered to the radius `top` [m]."""
    return lathe([(radius, -ROOT), (top or radius, height)], sides)


def upright(mesh: TriangleMesh) -> TriangleMesh:
    """Return a mesh made in the plane z = const turned so that its upward side looks along +x.

    A point (a, b, c) goes to (c, a, b): what was drawn as (x, y) becomes (y, z).
    """
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    return TriangleMesh(mesh.points @ turn.T, mesh.faces)
