"""Read the lanes and the drivable surface of a built town, with core dependencies only."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Usd

from mmw.core.errors import InputError
from mmw.core.georeference import Georeference
from mmw.core.mesh import TriangleMesh, merge
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.roads.lane_prims import read_lanes
from mmw.traffic.roads.sidewalk_prims import Sidewalk, read_sidewalks
from mmw.usd.georeference import read_georeference
from mmw.usd.meshes import MeshReader, place, semantic_label, to_metres
from mmw.usd.open_stage import open_stage, reads_usd

DRIVABLE_LABELS = ("road", "road_line")
"""Semantic classes of the meshes that vehicles drive on."""


@dataclass(frozen=True)
class Town:
    """A town asset, as far as traffic needs it."""

    path: Path
    lanes: LaneGraph
    """Empty if the asset has none; recorded vehicles need none."""
    points: np.ndarray
    """Vertices of the drivable surface, town frame [m], shape [N, 3], float64."""
    faces: np.ndarray
    """Its triangles, shape [M, 3], int32."""
    sidewalks: tuple[Sidewalk, ...] = ()
    georeference: Georeference | None = None
    """Place on the earth; None if the asset says nothing."""


@reads_usd
def open_town(path: str | Path) -> Town:
    """Read lanes and drivable surface of a town asset.

    Raises:
        InputError: If the file cannot be read, its lanes are not whole, or it has no mesh of class road.
    """
    path = Path(path)
    stage = open_stage(path)
    root = stage.GetDefaultPrim()
    if not root:
        raise InputError(f"{path}: has no default prim; a town asset names its root as defaultPrim")
    lanes_path = root.GetPath().AppendChild("Lanes")
    lanes = read_lanes(stage, str(lanes_path)) if stage.GetPrimAtPath(lanes_path) else LaneGraph()
    reader, metres = MeshReader(stage, Usd.TimeCode.Default()), to_metres(stage)
    drivable = [mesh for mesh in reader.meshes() if semantic_label(mesh.anchor) in DRIVABLE_LABELS]
    reader.read([mesh.prim for mesh in drivable])
    road = merge(TriangleMesh(*place(reader.triangles(mesh.prim), reader.to_world(mesh) @ metres)) for mesh in drivable)
    if not len(road.faces):
        raise InputError(
            f"{path}: no mesh has the class {' or '.join(DRIVABLE_LABELS)}; vehicles need a road to stand on; label it"
        )
    sidewalks = tuple(read_sidewalks(stage, str(root.GetPath().AppendChild("Walks"))))
    return Town(path, lanes, road.points, road.faces, sidewalks, read_georeference(stage))
