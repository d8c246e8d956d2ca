"""Draw a scenario's town from above: lanes and buildings of the stage in the dataset."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mmw.dataset import Dataset

if TYPE_CHECKING:
    from pxr import Usd

BUILDING = "building"
"""Semantic class of the meshes whose outlines are drawn."""


@dataclass(frozen=True)
class TownPlan:
    """Lanes and buildings in the plan of the world; both may be empty."""

    lanes: tuple[np.ndarray, ...] = ()
    """Center lines [m], shape [N, 2] each."""
    widths: tuple[float, ...] = ()
    """Width of each lane [m]."""
    buildings: tuple[np.ndarray, ...] = ()
    """Convex outlines of the buildings' meshes [m], counter-clockwise, shape [K, 2] each."""

    def within(self, low: np.ndarray, high: np.ndarray) -> "TownPlan":
        """Return what reaches into a rectangle.

        Args:
            low: Its least x and y [m].
            high: Its greatest.
        """

        def is_in(points: np.ndarray) -> bool:
            return bool((points.min(axis=0) <= high).all() and (points.max(axis=0) >= low).all())

        kept = [(line, width) for line, width in zip(self.lanes, self.widths, strict=True) if is_in(line)]
        buildings = tuple(outline for outline in self.buildings if is_in(outline))
        return TownPlan(tuple(line for line, _ in kept), tuple(width for _, width in kept), buildings)


def read_town_plan(data: Dataset, scenario: str) -> TownPlan:
    """Return the map of a scenario; an empty one if the dataset is not local or has no stage of it.

    Args:
        data: The dataset.
        scenario: Scenario name.

    Raises:
        InputError: If the stage cannot be read.
    """
    if data.filesystem is not None:
        return TownPlan()
    for suffix in (".usdc", ".usda"):
        path = Path(data.root) / "stages" / f"{scenario}{suffix}"
        if path.is_file():
            return _read_stage(path, path.stat().st_mtime_ns)
    return TownPlan()


@lru_cache(maxsize=8)
def _read_stage(path: Path, changed_ns: int) -> TownPlan:
    """Read a stage once for each content that the file has had."""
    from mmw.usd.open_stage import open_stage, usd_errors

    with usd_errors(path):
        return _plan_of(open_stage(path))


def _plan_of(stage: "Usd.Stage") -> TownPlan:
    """Return lanes and buildings of a stage."""
    from pxr import Usd, UsdGeom

    from mmw.traffic.roads.lane_prims import WIDTH, read_lanes
    from mmw.usd.meshes import MeshReader, semantic_label, to_metres

    lines, widths = [], []
    for root in stage.GetPseudoRoot().GetChildren():
        if any(prim.IsA(UsdGeom.BasisCurves) and prim.HasAttribute(WIDTH) for prim in Usd.PrimRange(root)):
            found = read_lanes(stage, str(root.GetPath())).lanes.values()
            lines += [lane.points[:, :2] for lane in found]
            widths += [lane.width for lane in found]
    reader, metres = MeshReader(stage, Usd.TimeCode.Default()), to_metres(stage)
    buildings = []
    for mesh in reader.meshes():
        if semantic_label(mesh.anchor) == BUILDING:
            matrix = reader.to_world(mesh) @ metres
            points = reader.triangles(mesh.prim).points @ matrix[:3, :3] + matrix[3, :3]
            outline = convex_outline(points[:, :2])
            if len(outline) > 2:
                buildings.append(outline)
    return TownPlan(tuple(lines), tuple(widths), _without_covered(buildings))


def convex_outline(points: np.ndarray) -> np.ndarray:
    """Return the corners of the convex hull of points in a plane, counter-clockwise, shape [K, 2].

    Source: A. M. Andrew, "Another efficient algorithm for convex hulls in two dimensions", 1979 (monotone chain).
    """
    points = np.unique(np.round(points, 2), axis=0)  # centimeters are enough for a map
    if len(points) < 3:
        return points

    def half(ordered: np.ndarray) -> list[np.ndarray]:
        chain: list[np.ndarray] = []
        for point in ordered:
            while len(chain) > 1:
                (ax, ay), (bx, by) = chain[-1] - chain[-2], point - chain[-2]
                if ax * by - ay * bx > 0.0:
                    break
                chain.pop()
            chain.append(point)
        return chain[:-1]

    return np.array(half(points) + half(points[::-1]))


def _without_covered(outlines: list[np.ndarray]) -> tuple[np.ndarray, ...]:
    """Return outlines without those whose bounds another one's bounds hold: windows and trims of a wall."""
    if not outlines:
        return ()
    bounds = np.array([[*outline.min(axis=0), *outline.max(axis=0)] for outline in outlines])
    area = (bounds[:, 2] - bounds[:, 0]) * (bounds[:, 3] - bounds[:, 1])
    kept: list[int] = []
    for index in np.argsort(-area, kind="stable").tolist():
        low, high = bounds[kept, :2], bounds[kept, 2:]
        is_held = (low <= bounds[index, :2]).all(axis=1) & (high >= bounds[index, 2:]).all(axis=1)
        if not is_held.any():
            kept.append(index)
    return tuple(outlines[index] for index in sorted(kept))
