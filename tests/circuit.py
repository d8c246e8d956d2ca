"""A small clean town: a ring road with two lanes one after the other, a field, and a house in the middle."""

from collections.abc import Collection
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdShade

from mmw.town.lane_prims import write_lanes
from mmw.town.lanes import Lane, LaneGraph
from tests.scenes import box_mesh
from tests.stages import add_material, add_polygons, label, new_stage

RADIUS_M = 30.0
INNER_M, OUTER_M = 26.0, 34.0
SEGMENTS = 180
FIELD_Z_M = -0.2


def on_ring(radius: float, step: np.ndarray, z: float = 0.0) -> np.ndarray:
    """Return points [N, 3] on a circle, at steps of 2 deg."""
    angle = 2.0 * np.pi * np.asarray(step, dtype=float) / SEGMENTS
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(len(angle), z)], axis=1)


def ring_lanes() -> dict[str, Lane]:
    """Return the two halves of the ring by name, counter-clockwise."""
    half = SEGMENTS // 2
    return {
        name: Lane(name, on_ring(RADIUS_M, np.arange(first, first + half + 1)), 3.5, 10.0, successors=(other,))
        for name, other, first in (("north", "south", 0), ("south", "north", half))
    }


def shown_material(stage: Usd.Stage, name: str, itu: str = "itu_concrete") -> UsdShade.Material:
    """Write a material with radio attributes (none for an empty `itu`) and a UsdPreviewSurface."""
    material = add_material(stage, f"/World/Materials/{name}", itu)
    shader = UsdShade.Shader.Define(stage, f"/World/Materials/{name}/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set((0.4, 0.4, 0.4))
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    return material


def add_thing(
    stage: Usd.Stage, path: str, points: np.ndarray, faces: np.ndarray, name: str, itu: str = "itu_concrete"
) -> Usd.Prim:
    """Write a labelled mesh with an extent and a material of its own class."""
    material = UsdShade.Material(stage.GetPrimAtPath(f"/World/Materials/{name}"))
    mesh = add_polygons(stage, path, points, faces.tolist(), material or shown_material(stage, name, itu))
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    mesh.CreateExtentAttr([tuple(map(float, low)), tuple(map(float, high))])
    label(mesh.GetPrim(), name)
    mesh.GetPrim().ApplyAPI("SemanticsLabelsAPI", "class")
    return mesh.GetPrim()


def add_block(stage: Usd.Stage, path: str, size, center, name: str = "building", turned: bool = False) -> Usd.Prim:
    """Write a labelled box; turned inside out on request."""
    points, faces = box_mesh(size, center)
    return add_thing(stage, path, points, faces[:, ::-1] if turned else faces, name)


def write_circuit(path: Path, *, missing: Collection[int] = (), lanes: dict[str, Lane] | None = None) -> Usd.Stage:
    """Write the town and return its open stage; the caller adds a defect and saves.

    Args:
        path: File to write.
        missing: Segments of the road that are left out, 0 to 179, counter-clockwise from east.
        lanes: Lanes instead of the ring's own; an empty dictionary for none.
    """
    stage = new_stage(path)
    steps = np.arange(SEGMENTS)
    points = np.concatenate([on_ring(INNER_M, steps), on_ring(OUTER_M, steps)])
    after = (steps + 1) % SEGMENTS
    quads = np.stack([steps, steps + SEGMENTS, after + SEGMENTS, after], axis=1)
    add_thing(stage, "/World/Road", points, np.delete(quads, list(missing), axis=0), "road")
    half = 60.0
    field = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    field = np.concatenate([field, np.full((4, 1), FIELD_Z_M)], axis=1)
    add_thing(stage, "/World/Field", field, np.array([[0, 1, 2, 3]]), "terrain")
    add_block(stage, "/World/House", (10.0, 12.0, 8.0), (0.0, 0.0, 3.5))
    graph = LaneGraph(ring_lanes() if lanes is None else lanes)
    if graph.lanes:
        UsdGeom.Scope.Define(stage, "/World/Lanes")
        write_lanes(stage, "/World/Lanes", graph)
    return stage
