"""Make scenes of single bodies: targets with closed forms, and shipped ones."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Usd, UsdGeom, Vt

from mmw.config.physics_presets import Physics
from mmw.core.resources import assets_dir
from mmw.scene import Scene, load_scene

Mesh = tuple[np.ndarray, np.ndarray]
"""Points [m], [N, 3], and triangles, [M, 3]."""


def plate(side: float) -> Mesh:
    """Return a square across x, which faces forward."""
    half = side / 2.0
    points = np.array([[0, -half, -half], [0, half, -half], [0, half, half], [0, -half, half]])
    return points, np.array([[0, 1, 2], [0, 2, 3]])


def dihedral(side: float) -> Mesh:
    """Return two squares that stand on the axes x and y and meet in z."""
    half = side / 2.0
    points = [[0, 0, -half], [side, 0, -half], [side, 0, half], [0, 0, half], [0, side, -half], [0, side, half]]
    return np.array(points), np.array([[0, 1, 2], [0, 2, 3], [0, 3, 5], [0, 5, 4]])


def trihedral(side: float) -> Mesh:
    """Return the three right triangles between the axes, with edges along them."""
    return np.vstack([np.zeros(3), side * np.eye(3)]), np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1]])


def ball(radius: float, subdivisions: int) -> Mesh:
    """Return an icosahedron that was subdivided."""
    import trimesh.creation

    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return np.array(mesh.vertices), np.array(mesh.faces)


def write_target(path: Path, mesh: Mesh) -> None:
    """Write a stage of one mesh."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    prim = UsdGeom.Mesh.Define(stage, "/World/target")
    prim.CreatePointsAttr(Vt.Vec3fArray([Gf.Vec3f(*map(float, point)) for point in mesh[0]]))
    prim.CreateFaceVertexCountsAttr([3] * len(mesh[1]))
    prim.CreateFaceVertexIndicesAttr([int(index) for index in mesh[1].ravel()])
    stage.Save()


def load_target(mesh: Mesh, device: str, material: str | Mapping[str, Any] = "itu_pec") -> Scene:
    """Return a scene of one mesh of one material, a row of ITU-R P.2040 or an entry of `materials`."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "target.usda"
        write_target(path, mesh)
        return load_scene(path, materials={"*": material}, device=device)


def load_asset(kind: str, name: str, device: str, physics: Physics = "paper") -> Scene:
    """Return a shipped body alone: `vehicles`, `pedestrians`, `cyclists` or `drones`."""
    return load_scene(assets_dir() / kind / name / f"{name}.usda", physics=physics, device=device)
