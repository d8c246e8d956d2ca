"""Find the wedges of a scene: convex edges between its flat surfaces, and edges of open sheets."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import warp as wp

from mmw.channel.path_solver.curved_surfaces import CurvedTable
from mmw.channel.path_solver.edge_lines import EdgeLines, join_edges, line_lengths
from mmw.channel.path_solver.edge_sectors import SAME_SIDE_RAD, find_contacts, open_sectors
from mmw.kernels.channel.edge_contacts import TOUCH_M
from mmw.kernels.channel.edges import Wedges
from mmw.physics.em.vectors import dot, norm
from mmw.scene.device_scene import DeviceScene
from mmw.scene.mesh_edges import MeshEdges

MIN_BEND_RAD = 0.05
"""Smallest angle between the normals of a wedge's faces by default [rad]; flatter edges, as on a rounded bonnet,
diffract nothing that the facets do not reflect."""

NO_WEDGES = (*(np.zeros((0, 3)) for _ in range(5)), *(np.zeros(0, np.int32) for _ in range(2)))
"""Result of `find_wedges` where there are none."""


@dataclass(frozen=True)
class WedgeTable:
    """Wedges of the town and of every instance, by global id 0 to E - 1, in the frame of what carries them."""

    carrier: np.ndarray
    """Instance, V for the town, shape [E], int32."""
    begin: np.ndarray
    """One end of the edge [m], shape [E, 3]."""
    end: np.ndarray
    """Other end [m], shape [E, 3]."""
    normal_0: np.ndarray
    """Outward normal of one face, shape [E, 3]."""
    normal_n: np.ndarray
    """Outward normal of the other face, of a sheet the opposite one, shape [E, 3]."""
    away: np.ndarray
    """Unit vector across the edge into the open, between the two normals, shape [E, 3]."""
    surface_0: np.ndarray
    """Global surface of the first face, shape [E], int32."""
    surface_n: np.ndarray
    """Global surface of the second face, shape [E], int32."""
    line: np.ndarray
    """Lowest wedge of the line of edges that each belongs to and of the lines beside it, shape [E], int32."""
    ahead: np.ndarray
    """Length of that line before the begin and behind the end of each [m], shape [E, 2]."""
    is_curved: np.ndarray
    """True between two facets of one curved surface, whose edge is of the mesh only, shape [E], bool."""
    device: Wedges
    """The same for kernels."""

    def __len__(self) -> int:
        return len(self.carrier)

    @cached_property
    def reach(self) -> np.ndarray:
        """Length of the line of edges that each belongs to [m], shape [E]."""
        return line_lengths(self.begin, self.end, self.ahead)


def make_wedge_table(
    scene: DeviceScene,
    plane: np.ndarray,
    meshes: Sequence[tuple[MeshEdges, np.ndarray]],
    *,
    sheets: bool,
    min_bend: float,
    curved: CurvedTable | None = None,
) -> WedgeTable:
    """Return the wedges of a scene, or none without meshes.

    Args:
        scene: The scene; nothing of its batch is used.
        plane: Plane of every surface of the scene, shape [G].
        meshes: Edges, and surface of each face, of the town and of every model.
        sheets: Whether the edges of open sheets are wanted too.
        min_bend: Smallest angle between the normals of a wedge's faces [rad].
        curved: Curved surfaces of the scene, if it has them.
    """
    arrays, instances = scene.arrays, enumerate(scene.instance_actor)
    columns, lines = [(len(scene.instance_actor), 0, NO_WEDGES)], [_lines(NO_WEDGES, scene.device)]
    if meshes:
        of_town, *of_model = (
            find_wedges(*mesh, sheets=sheets, min_bend=min_bend, device=scene.device) for mesh in meshes
        )
        columns.append((len(scene.instance_actor), 0, of_town))
        objects = np.zeros(int(arrays.surface.max(initial=-1)) + 1, dtype=np.int64)
        objects[arrays.surface] = arrays.object_id
        lines.append(_lines(of_town, scene.device, objects[of_town[5]]))
        of_models = [(found, _lines(found, scene.device)) for found in of_model]
        for k, actor in instances:
            found, joined = of_models[arrays.actors[actor].model]
            columns.append((k, int(scene.surface_offset[k]), found))
            lines.append(joined)
    vectors = [np.concatenate(values) for values in zip(*(wedges[:5] for _, _, wedges in columns), strict=True)]
    ids = [np.concatenate([wedges[k] + offset for _, offset, wedges in columns]) for k in (5, 6)]
    ids.append(np.concatenate([np.full(len(wedges[0]), carrier) for carrier, _, wedges in columns]))
    table = dict(zip(("begin", "end", "normal_0", "normal_n", "away"), vectors, strict=True))
    numbers = dict(zip(("surface_0", "surface_n", "carrier"), (values.astype(np.int32) for values in ids), strict=True))
    before = np.cumsum([0, *(len(some.name) for some in lines)])
    line = np.concatenate([some.name + k for some, k in zip(lines, before, strict=False)]).astype(np.int32)
    ahead = np.concatenate([some.ahead for some in lines])
    is_curved = np.zeros(len(line), dtype=bool)
    if curved is not None and len(line):
        s0, sn = numbers["surface_0"], numbers["surface_n"]
        is_curved = curved.is_curved[s0] & curved.is_curved[sn] & (curved.largest[s0] == curved.largest[sn])
    device = Wedges()
    reach = line_lengths(table["begin"], table["end"], ahead)
    device.reach = wp.array(reach, dtype=wp.float64, device=scene.device)
    device.is_curved = wp.array(is_curved, dtype=wp.uint8, device=scene.device)
    for name, values in table.items():
        setattr(device, name, wp.array(values, dtype=wp.vec3d, device=scene.device))
    for name, values in numbers.items():
        setattr(device, name, wp.array(values, dtype=wp.int32, device=scene.device))
    face = plane[np.concatenate([numbers["surface_0"], numbers["surface_n"]])]
    order = np.argsort(face, kind="stable")
    first = np.searchsorted(face[order], np.arange(int(plane.max(initial=-1)) + 2))
    device.first = wp.array(first, dtype=wp.int32, device=scene.device)
    device.of_plane = wp.array(order % max(len(face) // 2, 1), dtype=wp.int32, device=scene.device)
    return WedgeTable(**numbers, **table, line=line, ahead=ahead, is_curved=is_curved, device=device)


def _lines(wedges: tuple[np.ndarray, ...], device: str, object_id: np.ndarray | None = None) -> EdgeLines:
    """Return the lines of the wedges of `find_wedges`, whose objects have shape [E]; None for one object."""
    begin, end, _, _, away, *_ = wedges
    return join_edges(begin, end, away, object_id, device)


def find_wedges(
    mesh: MeshEdges, surface: np.ndarray, *, sheets: bool = False, min_bend: float = MIN_BEND_RAD, device: str = "cpu"
) -> tuple[np.ndarray, ...]:
    """Return the convex edges between flat surfaces of a mesh, and on request the free ones of open sheets.

    Faces are counter-clockwise from outside, so that convex and concave edges can be told apart; an edge between two
    faces that disagree about the outside is none. Closed bodies whose faces all look inward are turned. Where bodies
    touch, wedges are those of their union, see `mmw.channel.path_solver.edge_sectors`. Faces back to back, as of a
    sheet that has both sides, have the edge of a half-plane.

    Args:
        mesh: Edges of the mesh.
        surface: Surface of each face, shape [M].
        sheets: Whether bodies that do not close are sheets, each of whose faces has both sides.
        min_bend: Smallest angle between the normals of a wedge's faces [rad].
        device: Warp device that looks for faces that touch.

    Returns:
        begin, end, normal_0, normal_n, away, each [E, 3], and surface_0, surface_n, each [E]; sorted by the surfaces.
    """
    if not len(mesh.first):
        return NO_WEDGES
    is_sheet = mesh.is_open & sheets
    one, two = mesh.first, mesh.first + np.where(mesh.size > 1, 1, 0)
    n0, nn = mesh.normal[mesh.face[one]], mesh.normal[mesh.face[two]]
    is_folded = norm(n0 + nn) < SAME_SIDE_RAD
    depth = dot(n0, mesh.points[mesh.opposite[two]] - mesh.points[mesh.vertex[one, 0]])
    is_convex = (surface[mesh.face[one]] != surface[mesh.face[two]]) & (dot(n0, nn) < np.cos(min_bend)) & (depth < 0.0)
    has_area = mesh.has_area[mesh.face[one]] & mesh.has_area[mesh.face[two]]
    is_agreed = (mesh.size == 2) & (mesh.vertex[one, 0] != mesh.vertex[two, 0]) & has_area
    has_both_sides = is_sheet[mesh.face[one]]
    is_inner = (mesh.size == 2) & (surface[mesh.face[one]] == surface[mesh.face[two]]) & ~is_folded
    is_wedge = is_agreed & (is_convex | is_folded) & ~has_both_sides
    edges = np.flatnonzero(is_wedge | ((mesh.size != 2) | has_both_sides) & ~is_inner)
    contacts = find_contacts(mesh, edges, device)
    is_alone = np.bincount(contacts.edge, minlength=len(edges)) == 0
    free = edges[is_alone & is_wedge[edges]]
    one, two, n0, nn, is_folded = one[free], two[free], n0[free], nn[free], is_folded[free]
    between = (n0 + nn) / np.where(is_folded, 1.0, norm(n0 + nn))[:, None]
    away = np.where(is_folded[:, None], mesh.out_of_face(one), between)
    begin, end = (mesh.points[mesh.vertex[one, k]] for k in (0, 1))
    wedges = (begin, end, n0, nn, away, surface[mesh.face[one]], surface[mesh.face[two]])
    shared = np.flatnonzero(~is_alone | (mesh.size[edges] > 2) | has_both_sides[edges])
    if len(shared):
        joints = open_sectors(mesh, edges[shared], contacts.of(shared), surface, is_sheet, min_bend)
        wedges = tuple(np.concatenate(values) for values in zip(wedges, joints, strict=True))
    begin, end, n0, nn, away, s0, sn = wedges
    if len(begin) == 0:
        return NO_WEDGES
    swap = s0 > sn
    s0, sn = np.where(swap, sn, s0), np.where(swap, s0, sn)
    n0, nn = np.where(swap[:, None], nn, n0), np.where(swap[:, None], n0, nn)
    return _joined(begin, end, n0, nn, away, s0, sn)


def _joined(
    begin: np.ndarray, end: np.ndarray, n0: np.ndarray, nn: np.ndarray, away: np.ndarray, s0: np.ndarray, sn: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Return the edges with pieces that lie one behind the other on one line, between the same surfaces, made one."""
    along = (end - begin) / norm(end - begin)[:, None]
    lead = np.argmax(np.abs(along) > 1e-6, axis=1)
    flip = along[np.arange(len(along)), lead] < 0.0
    begin, end = np.where(flip[:, None], end, begin), np.where(flip[:, None], begin, end)
    along = np.where(flip[:, None], -along, along)
    foot = begin - dot(begin, along)[:, None] * along
    line = np.round(np.concatenate([along * 1e3, foot / TOUCH_M.value], axis=1)).astype(np.int64)
    is_sheet = ((s0 == sn) | (norm(n0 + nn) < SAME_SIDE_RAD))[:, None]  # sheets have many edges, others one line
    group = np.unique(np.column_stack([s0, sn, np.where(is_sheet, line, 0)]), axis=0, return_inverse=True)[1]
    group = group.reshape(-1)
    ahead = along[np.unique(group, return_index=True)[1]][group]
    low, high = dot(begin, ahead), dot(end, ahead)
    order = np.lexsort((low, group))
    group, low, high = group[order], low[order], high[order]
    by_high = np.argsort(high, kind="stable")
    rank = np.empty_like(by_high)
    rank[by_high] = np.arange(len(by_high))
    farthest = by_high[np.maximum.accumulate(group * len(rank) + rank) % len(rank)]  # of the pieces so far
    is_new = np.append(True, (group[1:] != group[:-1]) | (low[1:] > high[farthest[:-1]] + TOUCH_M.value))
    first = np.flatnonzero(is_new)
    last = np.append(first[1:], len(order)) - 1
    first_piece, last_piece = order[first], order[farthest[last]]
    vectors, ids = ([values[first_piece] for values in columns] for columns in ((n0, nn, away), (s0, sn)))
    return (begin[first_piece], end[last_piece], *vectors, *(values.astype(np.int32) for values in ids))
