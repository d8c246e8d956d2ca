"""Describe the parts of props: meshes with a material and a label, x to the front and z up."""

from collections.abc import Callable

import numpy as np

from mmw.worlds.towns.primitives import Mesh, lathe

Piece = tuple[str, Mesh, str, str]
"""Name, mesh, material and semantic label of one part of a prop; the first part's label is that of the prop."""

PropMaker = Callable[[np.random.Generator], list[Piece]]

ROOT = 0.6
"""How far posts and trunks reach into the ground, so that nothing floats on a slope [m]."""


def pole(height: float, radius: float, top: float | None = None, sides: int = 5) -> Mesh:
    """Return an upright post of `height` above the ground, tapered to the radius `top` [m]."""
    return lathe([(radius, -ROOT), (top or radius, height)], sides)


def upright(mesh: Mesh) -> Mesh:
    """Return a mesh made in the plane z = const turned so that its upward side looks along +x.

    A point (a, b, c) goes to (c, a, b): what was drawn as (x, y) becomes (y, z).
    """
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    return Mesh(mesh.points @ turn.T, mesh.faces)
