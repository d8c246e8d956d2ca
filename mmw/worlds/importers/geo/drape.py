"""Lay a flat world over heights: the ground follows them, objects stand on them, lanes run over them."""

from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mmw.core.mesh import TriangleMesh
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.roads.town_asset import DRIVABLE_LABELS
from mmw.worlds.importers.geo.relief import Relief
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.towns.ground_height import Ground
from mmw.worlds.towns.mesh_part import MeshPart

GROUND_LABELS = ("road", "road_line", "sidewalk", "terrain", "water")
"""Semantic classes of what follows the heights; everything else stands on them."""
LONGEST = (4.0, 15.0)
"""Least and largest length of edges that follow the heights [m]: twice their spacing in between; design values."""

Height = Callable[[np.ndarray], np.ndarray]


def drape(scene: ImportedScene, relief: Relief, standing: str) -> ImportedScene:
    """Return a world over heights.

    Args:
        scene: A world whose ground is flat at z = 0, kerbs aside.
        relief: The heights.
        standing: Begin of the paths of what stands on the heights already.
    """
    longest = float(np.clip(2.0 * relief.spacing, *LONGEST))
    parts: list[MeshPart] = []
    objects: dict[str, list[MeshPart]] = defaultdict(list)
    for part in scene.parts:
        if part.path.startswith(standing):
            parts.append(part)
        elif part.label in GROUND_LABELS:
            parts.append(follow(part, relief.height, longest))
        else:
            objects["/".join(part.path.split("/")[:2])].append(part)
    for members in objects.values():
        parts += stand(members, relief.height)
    lanes = None if scene.lanes is None else _on_roads(scene.lanes, parts, relief.height)
    every = np.concatenate([part.points[:, 2] for part in parts if part.label in GROUND_LABELS])
    note = (
        f"terrain: z = 0 is {relief.zero:.2f} m of the raster's heights, "
        f"the lowest around the map; the ground rises to {every.max():.1f} m"
    )
    return replace(scene, parts=parts, lanes=lanes, notes=(*scene.notes, note))


def _on_roads(lanes: LaneGraph, parts: list[MeshPart], height: Height) -> LaneGraph:
    """Return lanes on the very faces of the roads; beside them, on the heights."""
    roads = [part for part in parts if part.label in DRIVABLE_LABELS]
    ground = Ground(roads) if roads else None
    raised = {}
    for name, lane in lanes.lanes.items():
        points = _raised(lane.points, height)
        if ground is not None:
            z = ground.height(*points[:, :2].T)
            points[:, 2] = np.where(np.isfinite(z), z, points[:, 2])
        raised[name] = replace(lane, points=points)
    return LaneGraph(raised)


def follow(part: MeshPart, height: Height, longest: float) -> MeshPart:
    """Return a part of the ground raised by the heights below it, with edges of at most some length in plan [m]."""
    mesh = split_edges(part.mesh, longest)
    return replace(part, points=_raised(mesh.points, height), faces=mesh.faces)


def stand(parts: list[MeshPart], height: Height) -> list[MeshPart]:
    """Return the parts of an object moved up to the lowest ground below its foot."""
    points = np.concatenate([part.points for part in parts])
    foot = points[points[:, 2] <= points[:, 2].min() + 0.5, :2]
    base = float(height(np.unique(np.round(foot, 2), axis=0)).min())
    return [replace(part, points=part.points + np.array([0.0, 0.0, base])) for part in parts]


def _raised(points: np.ndarray, height: Height) -> np.ndarray:
    return points + np.column_stack([np.zeros((len(points), 2)), height(points[:, :2])])


def split_edges(mesh: TriangleMesh, longest: float) -> TriangleMesh:
    """Return a mesh whose edges are no longer than some length in plan [m]; neighbors stay edge to edge.

    Every longer edge gets a vertex in its middle, whichever triangles it has, so meshes that share edges still do.
    """
    points, faces = mesh.points, mesh.faces.astype(np.int64)
    while True:
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        unique, inverse = np.unique(edges, axis=0, return_inverse=True)
        long = np.linalg.norm(points[unique[:, 1], :2] - points[unique[:, 0], :2], axis=1) > longest
        if not long.any():
            return TriangleMesh(points, faces.astype(np.int32))
        middle = np.full(len(unique), -1)
        middle[long] = len(points) + np.arange(long.sum())
        points = np.concatenate([points, points[unique[long]].mean(axis=1)])
        faces = _split(faces, middle[inverse.reshape(-1, 3)])


def _split(faces: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Return triangles [M, 3] split at the middles of their edges ab, bc, ca, [M, 3]; -1 is an edge that stays."""
    count = (middle >= 0).sum(axis=1)
    out = [faces[count == 0]]
    for k in range(3):  # turned so that edge k is ab
        turn = np.array([k, (k + 1) % 3, (k + 2) % 3])
        f, m = faces[:, turn], middle[:, turn]
        one = (count == 1) & (m[:, 0] >= 0)
        (a, b, c), n = f[one].T, m[one, 0]
        out += [np.column_stack([a, n, c]), np.column_stack([n, b, c])]
        two = (count == 2) & (m[:, 2] < 0)
        (a, b, c), (n, o, _) = f[two].T, m[two].T
        out += [np.column_stack([n, b, o]), np.column_stack([a, n, o]), np.column_stack([a, o, c])]
    three = count == 3
    (a, b, c), (n, o, p) = faces[three].T, middle[three].T
    out += [np.column_stack(t) for t in ((a, n, p), (n, b, o), (p, o, c), (n, o, p))]
    return np.concatenate(out)
