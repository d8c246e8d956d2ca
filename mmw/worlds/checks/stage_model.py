"""A stage as the checks see it: every mesh in meters, the lanes, and what could not be read."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from pxr import Usd

from mmw.core.bvh import RayMesh
from mmw.core.errors import InputError
from mmw.core.mesh import TriangleMesh, merge
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.roads.lane_prims import has_lanes, read_lanes
from mmw.traffic.roads.town_asset import DRIVABLE_LABELS
from mmw.usd.actors import FIXED_ROLES, find_actors
from mmw.usd.meshes import MeshReader, bound_materials, check_placed, place, to_metres
from mmw.usd.open_stage import open_stage
from mmw.worlds.checks.findings import Finding

GROUND_LABELS = (*DRIVABLE_LABELS, "sidewalk", "terrain", "ground", "water", "bridge")
"""Semantic classes that support objects."""


@dataclass(frozen=True, eq=False)
class StageMesh(TriangleMesh):
    """One mesh prim in the world frame; a mesh that is used many times is as many parts."""

    prim: Usd.Prim
    path: str
    source: str
    """Prim that holds the mesh: the same for all uses of one prototype."""
    object_path: str
    """Prim path of the object: the actor, else the nearest component, else the mesh prim."""
    label: str
    materials: tuple[Usd.Prim | None, ...]
    """Bound materials, the one of purpose `radio` first; None for faces without one."""
    is_actor: bool
    is_moving: bool
    """True for a part of an actor that changes its place over time."""


@dataclass(frozen=True)
class StageModel:
    """A stage that was read for a check."""

    stage: Usd.Stage
    open_s: float
    """Time that opening the stage took [s]."""
    parts: tuple[StageMesh, ...]
    lanes: LaneGraph | None
    """Lanes in meters, z up; None if the stage has none or they cannot be read."""
    problems: tuple[Finding, ...] = field(default=())
    """Parts that could not be read."""

    @cached_property
    def mesh(self) -> TriangleMesh:
        """Triangles of all parts, in order."""
        return merge(self.parts)

    @cached_property
    def part_of(self) -> np.ndarray:
        """Part of each triangle, shape [M]."""
        return np.repeat(np.arange(len(self.parts)), [len(part.faces) for part in self.parts])

    @cached_property
    def rays(self) -> RayMesh:
        """All triangles, to cast rays on; there must be one."""
        return RayMesh(self.mesh.points, self.mesh.faces)

    def faces_where(self, is_chosen: Iterator[bool]) -> np.ndarray:
        """Return the numbers of the triangles of chosen parts, given one truth value a part."""
        return np.flatnonzero(np.fromiter(is_chosen, bool, len(self.parts))[self.part_of])

    @cached_property
    def drivable(self) -> np.ndarray:
        """Numbers of the triangles that vehicles drive on."""
        return self.faces_where(part.label in DRIVABLE_LABELS for part in self.parts)

    @cached_property
    def ground(self) -> np.ndarray:
        """Numbers of the triangles that support objects."""
        return self.faces_where(part.label in GROUND_LABELS for part in self.parts)


def open_stage_model(path: Path) -> StageModel:
    """Open a stage and read it, as far as that is possible.

    Raises:
        InputError: If there is no such file, or USD cannot read it.
    """
    start = time.perf_counter()
    stage = open_stage(path)
    open_s = time.perf_counter() - start
    problems = [
        Finding("error", "files", "", str(error).strip().splitlines()[-1], "repair the path")
        for error in stage.GetCompositionErrors()
    ]
    meters = to_metres(stage)
    parts, broken = _read_parts(stage, meters)
    lanes, bad_lanes = _read_lanes(stage)
    return StageModel(stage, open_s, tuple(parts), lanes, (*problems, *broken, *bad_lanes))


def _read_parts(stage: Usd.Stage, meters: np.ndarray) -> tuple[list[StageMesh], list[Finding]]:
    start = stage.GetStartTimeCode() if stage.HasAuthoredTimeCodeRange() else 0.0
    reader, problems, parts = MeshReader(stage, Usd.TimeCode(start), keeps_flat=True), [], []
    actors = {}
    try:
        actors = {actor.path: actor for actor in find_actors(stage, {}) if actor.role not in FIXED_ROLES}
    except InputError as error:
        problems.append(Finding("error", "actors", "", str(error)))
    moves: dict[str, bool] = {}
    meshes = reader.meshes()
    while True:
        try:
            mesh = next(meshes)
        except StopIteration:
            return parts, problems
        except InputError as error:
            problems.append(Finding("error", "mesh", "", str(error)))
            return parts, problems
        path = str(mesh.prim.GetPath())
        try:
            triangles = reader.triangles(mesh.prim)
        except InputError as error:
            problems.append(Finding("error", "mesh", path, str(error).removeprefix(f"{path}: ")))
            continue
        if not len(triangles.faces):
            continue
        owner = next((str(p) for p in mesh.anchor.GetPath().GetPrefixes() if str(p) in actors), "")
        if owner and owner not in moves:
            moves[owner] = _moves(actors[owner].prim)
        points, faces = place(triangles, reader.to_world(mesh) @ meters)
        try:
            check_placed(path, points)
        except InputError as error:
            problems.append(Finding("error", "mesh", path, str(error).removeprefix(f"{path}: ")))
            continue
        source = mesh.prim.GetPrimInPrototype() if mesh.prim.IsInstanceProxy() else mesh.prim
        parts.append(
            StageMesh(
                prim=mesh.prim,
                path=path,
                source=str(source.GetPath()),
                object_path=owner or str(reader.component(mesh.anchor).GetPath()),
                label=reader.label(mesh.prim),
                points=points,
                faces=faces,
                materials=tuple(bound_materials(mesh.prim, triangles.polygon)[0]),
                is_actor=bool(owner),
                is_moving=moves.get(owner, False),
            )
        )


def _moves(prim: Usd.Prim) -> bool:
    return any(
        len(attribute.GetTimeSamples()) > 1
        for path in prim.GetPath().GetPrefixes()
        for attribute in prim.GetStage().GetPrimAtPath(path).GetAttributes()
        if attribute.GetName().startswith("xformOp:")
    )


def _read_lanes(stage: Usd.Stage) -> tuple[LaneGraph | None, list[Finding]]:
    if not has_lanes(stage):
        return None, []
    try:
        return read_lanes(stage, "/"), []
    except InputError as error:
        return None, [Finding("error", "lanes", "", str(error))]
