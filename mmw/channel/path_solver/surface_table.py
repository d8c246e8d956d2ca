"""Tabulate the flat surfaces of a scene: plane, box and triangles in float64, in the frame of their carrier."""

from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
import warp as wp

from mmw.channel.path_solver.box_trees import box_trees, triangle_trees
from mmw.channel.path_solver.curved_surfaces import CurvedTable, make_curved_table
from mmw.channel.path_solver.edge_table import MIN_BEND_RAD, WedgeTable, make_wedge_table
from mmw.channel.path_solver.foliage import Foliage
from mmw.channel.path_solver.outlines import OutlineTable, make_outline_table
from mmw.channel.path_solver.town_hits import KeptHits
from mmw.channel.path_solver.workspace import Workspace
from mmw.core.host_kernels import HOST
from mmw.core.planar_surfaces import linked_rows
from mmw.kernels.channel.finite_surfaces import Outlines
from mmw.kernels.channel.path_names import NamedSurfaces
from mmw.kernels.channel.surfaces import Surfaces
from mmw.kernels.core import structs
from mmw.physics.em.vectors import dot, norm
from mmw.scene.device_scene import DeviceScene
from mmw.scene.mesh_edges import find_edges

SAME_PLANE_M = 1e-4
"""Farthest that the corners of a surface's box may lie from the plane of its group, beyond what they do from its
own [m]: less than float32 rays resolve in a town."""

REACH_M = 100.0
"""Distance over which the tilt of two normals is measured against `SAME_PLANE_M` in the first, coarse search [m]."""


@dataclass(frozen=True)
class SurfaceTable:
    """Surfaces of the town and of every instance, by global id 0 to G - 1; their geometry is on the device."""

    owner: np.ndarray
    """Instance that carries the surface, -1 for the town, shape [G], int32."""
    object_id: np.ndarray
    """Object id, shape [G], int32."""
    material_id: np.ndarray
    """Material id, shape [G], int32."""
    area: np.ndarray
    """Area [m^2], shape [G]."""
    plane_count: int
    """K: number of planes; coplanar surfaces of one carrier have one."""
    is_slab: np.ndarray
    """True if a wave passes through the surface in some weather: its material is a slab, shape [G], bool."""
    is_rough: np.ndarray
    """True if the surface scatters in some weather, shape [G], bool."""
    device: Surfaces
    """Surfaces for kernels; geometry rows, one for each surface of a model, are in the frame of their carrier."""
    wedges: WedgeTable
    """Convex edges between the surfaces; none unless requested."""
    has_wedges: bool
    """True if wedges were requested."""
    plane: np.ndarray
    """Plane of every surface, shape [G], int32."""
    lead: np.ndarray
    """Largest surface of every plane, shape [K], int32."""
    outlines: OutlineTable | None = None
    """Outlines of the planes; None where surfaces reflect as if they were infinite."""
    curved: CurvedTable | None = None
    """Curved surfaces; None where their facets reflect as flat ones."""
    foliage: Foliage | None = None
    """Foliage that waves pass; None if it was not requested, and foliage is a solid."""
    sizes: dict[str, int] = field(default_factory=dict)
    """Sizes of the candidate tables that were enough so far, so that the next batch starts with them."""
    scratch: dict[tuple[tuple[int, ...], Any], list[wp.array]] = field(default_factory=dict)
    """Arrays on the device that no search uses, by shape and type; see `Search.scratch`."""
    town_hits: dict[tuple[int, int], KeptHits] = field(default_factory=dict)
    """Kept hits of the town, by number of rays and depth."""
    workspaces: dict[tuple[int, tuple[int, int]], list[Workspace]] = field(default_factory=dict)
    """Memory and records of searches by number of links and shape of poses, which no search uses."""
    of_carriers: dict[tuple[float, ...], Outlines] = field(default_factory=dict)
    """Outlines on the device for the carriers that were asked for."""

    def __len__(self) -> int:
        return len(self.owner)

    @cached_property
    def has_slabs(self) -> bool:
        """Whether a wave passes through any surface in some weather."""
        return bool(self.is_slab.any())

    @cached_property
    def wall(self) -> np.ndarray:
        """Largest surface of the plane or curved surface of each, which names all of them in `path_id`, shape [G]."""
        wall = self.lead[self.plane]
        return wall if self.curved is None else np.where(self.curved.is_curved, self.curved.largest, wall)

    @cached_property
    def names_on_host(self) -> NamedSurfaces:
        """Names of surfaces and wedges for kernels of the host."""
        names, wedges = NamedSurfaces(), self.wedges
        own = self.wall, self.object_id, self.material_id, self.owner, wedges.line, wedges.surface_0
        for name, values in zip(NamedSurfaces.vars, own, strict=True):
            setattr(names, name, wp.array(values, dtype=wp.int32, device=HOST))
        return names

    @cached_property
    def is_mirror(self) -> np.ndarray | None:
        """True for surfaces that reflect as flat ones, no passed foliage and no facets, shape [G]; None for all."""
        if self.foliage is None and self.curved is None:
            return None
        out = np.ones(len(self), dtype=bool)
        if self.foliage is not None:
            out &= ~self.foliage.is_foliage
        if self.curved is not None:
            out &= ~self.curved.is_curved
        return out

    @cached_property
    def mirror_steps(self) -> tuple[np.ndarray | None, np.ndarray | None]:
        """`is_mirror` of every surface and of the largest one of every plane, then True for -1, which is no step; None
        where all are."""
        if self.is_mirror is None:
            return None, None
        return np.append(self.is_mirror, True), np.append(self.is_mirror[self.lead], True)

    @cached_property
    def mirrors_on_device(self) -> tuple[wp.array, wp.array]:
        """`is_mirror` of every surface and of the largest one of every plane; without entries where all are."""
        if self.is_mirror is None:
            none = wp.empty(0, dtype=wp.uint8, device=self.device.row.device)
            return none, none
        both = self.is_mirror, self.is_mirror[self.lead]
        of_surface, of_plane = (wp.array(values, dtype=wp.uint8, device=self.device.row.device) for values in both)
        return of_surface, of_plane

    @cached_property
    def host_area(self) -> wp.array:
        """`area`, for kernels on the host."""
        return wp.array(self.area, dtype=wp.float64, device="cpu")

    @cached_property
    def used_materials(self) -> np.ndarray:
        """Material ids that some surface has, sorted."""
        return np.unique(self.material_id)

    def outlines_on_device(self, device: str, carriers_hz: tuple[float, ...]) -> Outlines:
        """Return the outlines for kernels, made once for a set of carriers; empty where surfaces are infinite."""
        if carriers_hz not in self.of_carriers:
            made, outlines = next(iter(self.of_carriers.values()), None), self.outlines
            self.of_carriers[carriers_hz] = (
                Outlines() if outlines is None else outlines.on_device(device, carriers_hz, made)
            )
        return self.of_carriers[carriers_hz]

    def scene_struct(self, scene: DeviceScene) -> structs.Scene:
        """Return the argument of kernels that trace what stops waves."""
        return scene.struct if self.foliage is None else self.foliage.scene_without(scene)


def make_surface_table(
    scene: DeviceScene,
    *,
    wedges: bool = False,
    sheets: bool = False,
    min_bend: float = MIN_BEND_RAD,
    finite: bool = False,
    foliage: bool = False,
) -> SurfaceTable:
    """Return the surfaces of a scene; make it once and use it for every batch.

    Args:
        scene: The scene; nothing of its batch is used.
        wedges: Whether their convex edges are wanted, for diffraction.
        sheets: Whether the edges of open sheets count among them.
        min_bend: Smallest angle between the normals of a wedge's faces [rad].
        finite: Whether the outlines of the surfaces are wanted, for `channel.finite_surfaces`.
        foliage: Whether waves pass foliage, which has no wedges then.
    """
    arrays = scene.arrays
    town_count = arrays.town_surface_count
    models = [(m.points, m.faces, m.surface, m.material) for m in arrays.models]
    parts = [(arrays.points, arrays.faces, arrays.surface, arrays.material), *models]
    counts = [town_count] + [int(surface.max()) + 1 for _, _, surface, _ in models]
    row_start = np.concatenate([[0], np.cumsum(counts)])
    corners, rows, materials = [], [], []
    orders = [np.argsort(surface, kind="stable") for _, _, surface, _ in parts]
    for start, order, (points, faces, surface, material) in zip(row_start, orders, parts, strict=False):
        corners.append(points[faces[order]].reshape(-1, 3, 3))
        rows.append(start + surface[order].astype(np.int64))
        materials.append(material[order])
    triangle, row_of = np.concatenate(corners).astype(np.float64), np.concatenate(rows)
    material = np.concatenate(materials)
    row_count = int(row_start[-1])
    triangle_count = np.bincount(row_of, minlength=row_count)
    if (triangle_count == 0).any():
        raise ValueError(
            f"surfaces {np.nonzero(triangle_count == 0)[0][:5].tolist()} have no face; number surfaces without gaps"
        )
    first = np.cumsum(triangle_count) - triangle_count
    normal, offset, area = _mean_planes(triangle, row_of, first)
    corner = triangle.reshape(-1, 3)
    lower = np.minimum.reduceat(corner, 3 * first) if row_count else np.zeros((0, 3))
    upper = np.maximum.reduceat(corner, 3 * first) if row_count else np.zeros((0, 3))

    row, owner = [np.arange(town_count)], [np.full(town_count, -1)]
    objects = [np.zeros(town_count, dtype=np.int64)]
    objects[0][arrays.surface] = arrays.object_id
    for instance, actor_index in enumerate(scene.instance_actor):
        actor = arrays.actors[actor_index]
        own = np.arange(int(row_start[actor.model + 1]), int(row_start[actor.model + 2]))
        row.append(own)
        owner.append(np.full(len(own), instance))
        objects.append(np.full(len(own), actor.object_id))
    row_all = np.concatenate(row).astype(np.int32)
    table = {
        "row": row_all,
        "owner": np.concatenate(owner).astype(np.int32),
        "object_id": np.concatenate(objects).astype(np.int32),
        "material_id": material[first].astype(np.int32)[row_all] if row_count else np.zeros(0, np.int32),
        "area": area[row_all],
        "normal": normal,
        "offset": offset,
        "first": first.astype(np.int32),
        "triangle_count": triangle_count.astype(np.int32),
        "triangle": triangle,
    }
    table["is_slab"] = _in_any_weather(scene, "transmits")[table["material_id"]]
    table["is_rough"] = _in_any_weather(scene, "scatters")[table["material_id"]]
    leaves = Foliage(scene, len(row_all)) if foliage else None
    part = np.repeat(np.arange(len(counts)), counts)
    if leaves is not None:  # no plane has both, and all that scatter with the channel's foliage do
        part[:town_count][leaves.is_foliage[:town_count]] = len(counts)
        table["is_rough"] |= leaves.is_foliage
    of_row = group_coplanar(normal, offset, lower, upper, area, part)
    table["plane"] = _planes(of_row[row_all], table["owner"])
    plane_count = int(table["plane"].max()) + 1 if len(row_all) else 0
    lead = _leads(table["plane"], table["area"])
    solid = [slice(None) if leaves is None else leaves.solid_faces, *(slice(None) for _ in models)]
    meshes = []
    if wedges or finite:
        for (points, faces, surface, _), own in zip(parts, solid, strict=True):
            meshes.append((find_edges(points, faces[own]), surface[own]))
    outlines = curved = None
    if finite:
        of_plane = of_row[row_all][lead]
        outlines = make_outline_table(triangle, row_of, of_row, normal, area, of_plane, material[first], row_all)
        objects_of = [arrays.object_id[solid[0]], *(np.zeros(len(m.faces), dtype=np.int32) for m in arrays.models)]
        begin = np.cumsum([0, *(len(order) for order in orders)])
        triangles = [k + np.argsort(order)[own] for k, order, own in zip(begin, orders, solid, strict=False)]
        materials = [arrays.material[solid[0]], *(m.material for m in arrays.models)]
        described = [(*mesh, *more) for mesh, *more in zip(meshes, objects_of, materials, triangles, strict=True)]
        curved = make_curved_table(described, row_all, first, triangle_count, area, scene.device)
    return SurfaceTable(
        **{name: table[name] for name in ("owner", "object_id", "material_id", "area", "is_slab", "is_rough")},
        device=_to_device(table, lower, upper, len(scene.instance_actor), scene.device),
        plane_count=plane_count,
        wedges=make_wedge_table(
            scene,
            table["plane"],
            meshes if wedges else [],
            sheets=sheets,
            min_bend=min_bend,
            curved=curved,
        ),
        has_wedges=wedges,
        plane=table["plane"],
        lead=lead,
        outlines=outlines,
        curved=curved,
        foliage=leaves,
    )


def _leads(plane: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Return the largest surface of each plane, shape [K]."""
    member = np.lexsort((area, plane))
    return member[np.searchsorted(plane[member], np.arange(1, int(plane.max(initial=-1)) + 2)) - 1].astype(np.int32)


def _planes(group: np.ndarray, owner: np.ndarray) -> np.ndarray:
    """Return a number for every pair of group and carrier, in the order of first surfaces, shape [G], int32."""
    key = (owner.astype(np.int64) + 1) * (int(group.max(initial=0)) + 1) + group
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[inverse.reshape(-1)].astype(np.int32)


def _in_any_weather(scene: DeviceScene, name: str) -> np.ndarray:
    """Return which materials have a property of `RadioMaterial` in some weather, by material id."""
    by_weather = [[getattr(m.radio, name) for m in some] for some in scene.arrays.materials.values()]
    return np.any(by_weather, axis=0) if by_weather else np.zeros(0, dtype=bool)


def _mean_planes(triangle: np.ndarray, row_of: np.ndarray, first: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return unit normal, offset and area of each row of triangles, weighted by area."""
    if len(first) == 0:
        return np.zeros((0, 3)), np.zeros(0), np.zeros(0)
    doubled = np.cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0])
    weight = norm(doubled)
    largest = np.zeros(len(first), dtype=np.int64)
    order = np.flatnonzero(weight == np.maximum.reduceat(weight, first)[row_of])
    largest[row_of[order]] = order  # the last one written stays
    sign = np.where(dot(doubled, doubled[largest[row_of]]) < 0.0, -1.0, 1.0)
    total = np.add.reduceat(doubled * sign[:, None], first)
    area = np.add.reduceat(weight, first)
    normal = total / np.where(norm(total) > 0.0, norm(total), 1.0)[:, None]
    middle = np.add.reduceat((triangle[:, 0] + triangle[:, 1] + triangle[:, 2]) / 3.0 * weight[:, None], first)
    middle /= np.where(area > 0.0, area, 1.0)[:, None]
    return normal, dot(normal, middle), 0.5 * area


def _to_device(
    table: dict[str, np.ndarray], lower: np.ndarray, upper: np.ndarray, instance_count: int, device: str
) -> Surfaces:
    row, plane = table["row"], table["plane"]
    member = np.lexsort((table["area"], plane))
    first_member = np.searchsorted(plane[member], np.arange(int(plane.max(initial=-1)) + 2))
    plane_lower = np.minimum.reduceat(lower[row[member]], first_member[:-1]) if len(row) else np.zeros((0, 3))
    plane_upper = np.maximum.reduceat(upper[row[member]], first_member[:-1]) if len(row) else np.zeros((0, 3))
    triangles = triangle_trees(table["triangle"], table["first"], table["triangle_count"])
    members = box_trees(first_member[:-1], np.diff(first_member), lower[row[member]], upper[row[member]])
    surfaces = Surfaces()
    surfaces.triangles, surfaces.members = triangles.to_device(device), members.to_device(device)
    for name, values, dtype in (
        ("row", table["row"], wp.int32),
        ("carrier", np.where(table["owner"] < 0, instance_count, table["owner"]), wp.int32),
        ("normal", table["normal"], wp.vec3d),
        ("offset", table["offset"], wp.float64),
        ("lower", lower, wp.vec3d),
        ("upper", upper, wp.vec3d),
        ("first", table["first"], wp.int32),
        ("triangle_count", table["triangle_count"], wp.int32),
        ("corner", table["triangle"].reshape(-1, 3), wp.vec3d),
        ("is_slab", table["is_slab"], wp.uint8),
        ("plane", plane, wp.int32),
        ("lead", member[first_member[1:] - 1], wp.int32),
        ("plane_lower", plane_lower, wp.vec3d),
        ("plane_upper", plane_upper, wp.vec3d),
        ("first_member", first_member, wp.int32),
        ("member", member, wp.int32),
    ):
        setattr(surfaces, name, wp.array(values, dtype=dtype, device=device))
    return surfaces


def group_coplanar(
    normal: np.ndarray, offset: np.ndarray, lower: np.ndarray, upper: np.ndarray, area: np.ndarray, part: np.ndarray
) -> np.ndarray:
    """Return the plane group of every surface, 0 to K - 1, numbered by their first surfaces, shape [N], int32.

    Args:
        normal: Unit normals, either side, shape [N, 3].
        offset: normal . p of the planes [m], shape [N].
        lower: Low corners of the surfaces' boxes [m], shape [N, 3].
        upper: High corners [m], shape [N, 3].
        area: Areas [m^2], shape [N]; the largest surface of a group gives its plane.
        part: Surfaces of different parts never share a group, such as town and models, shape [N].
    """
    count = len(normal)
    if count == 0:
        return np.zeros(0, dtype=np.int32)
    lead = np.argmax(np.abs(normal) > 1e-6, axis=1)
    sign = np.sign(normal[np.arange(count), lead])
    sign[sign == 0.0] = 1.0
    normal, offset = normal * sign[:, None], offset * sign
    key = np.concatenate([normal * REACH_M, offset[:, None]], axis=1) / (20.0 * SAME_PLANE_M)
    group = linked_rows(key, part)
    order = np.lexsort((-area, group))
    is_first = np.append(True, group[order][1:] != group[order][:-1])
    leader = order[is_first][np.cumsum(is_first) - 1]
    leader = leader[np.argsort(order, kind="stable")]  # largest surface of each surface's group
    row = np.flatnonzero(leader != np.arange(count))
    lead, low, high = leader[row], lower[row], upper[row]
    off = np.zeros(len(row))
    for pick in product((False, True), repeat=3):
        corner = np.where(np.array(pick), high, low)
        off_own = np.abs(dot(normal[row], corner) - offset[row])
        off_lead = np.abs(dot(normal[lead], corner) - offset[lead])
        off = np.maximum(off, np.abs(off_lead - off_own))
    apart = row[off > SAME_PLANE_M]
    leader[apart] = apart
    return np.unique(leader, return_inverse=True)[1].reshape(-1).astype(np.int32)
