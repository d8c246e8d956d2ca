"""One building as meshes: facades cut into wall and glass cells of one plane, roofs, parapets, doors, roof equipment.

Everything is made in the frame of the plan: origin in the middle, x along the street front as seen from
the street, y into the plot, so that the front wall faces -y. Heights are those of the town frame.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.affinity import affine_transform
from shapely.geometry.polygon import orient

from mmw.core.mesh import TriangleMesh, merge
from mmw.worlds.towns.block_description import BuildingStyle
from mmw.worlds.towns.building_footprints import Plan, rectangle
from mmw.worlds.towns.facade_details import balconies, belt, entrance, shop_front
from mmw.worlds.towns.facades import DOOR, GLASS, WALL, facade_cells, height_of
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.plan_geometry import rotation
from mmw.worlds.towns.primitives import box, place, prism, wall_cells, weld
from mmw.worlds.towns.roofs import Meshes, add_chimney, add_equipment, add_plant_room, flat_roof, gable_roof, hip_roof

FORECOURT = (2.4, 1.2)  # paved ground in front of and beside a building with a flat roof [m]
SETBACK = 0.14
"""How far a tower stands back from its base on every side, by the base's width and depth (fraction)."""
AWNINGS = ("car_paint_red", "car_paint_green", "car_paint_blue", "car_paint_white")
"""Materials of awnings."""


@dataclass(frozen=True)
class Site:
    """Site of a building."""

    center: tuple[float, float]
    """Middle of the plan [m]."""
    yaw: float
    """Direction of the plan's x axis, counter-clockwise from east [rad]."""
    width: float
    """Length of the street front [m]."""
    depth: float
    """Extent away from the street [m]."""
    foot: float
    """Height from which the walls rise, below all ground at the plan [m]."""
    floor: float
    """Height of the ground floor [m]."""

    @property
    def ring(self) -> np.ndarray:
        """Corners of the plan, counter-clockwise from the left end of the street front [m], shape [4, 2]."""
        return self._in_town(rectangle(self.width, self.depth))

    @property
    def paved(self) -> np.ndarray:
        """Corners of the paving around a building with a flat roof [m], shape [4, 2], as `ring`."""
        front, side = FORECOURT
        corners = rectangle(self.width + 2 * side, self.depth + front + side)
        return self._in_town(corners + np.array([0.0, 0.5 * (side - front)]))

    def _in_town(self, local: np.ndarray) -> np.ndarray:
        return local @ rotation(self.yaw).T + np.asarray(self.center)


def _walls(
    style: BuildingStyle, plan: Plan, storeys: int, foot: float, floor: float, crown: float, ground: bool, out: Meshes
) -> None:
    """Add the facades of a block to the lists of meshes `out`."""
    ring = plan.ring()
    for side, (start, end) in enumerate(zip(ring, np.roll(ring, -1, axis=0), strict=True)):
        length = float(np.linalg.norm(end - start))
        grid = facade_cells(style, length, storeys, foot, floor, crown, ground and side == 0, ground)
        meshes = wall_cells(start, end, *grid, is_plain=True)
        for kind, name in ((WALL, "facade"), (GLASS, "glass"), (DOOR, "door")):
            if kind in meshes:
                out[name].append(meshes[kind])


def _forecourt(site: Site, avoided: Sequence[shapely.Geometry]) -> TriangleMesh:
    """Return the paving around a building, a hand's breadth below its floor, without what lies in `avoided`."""
    front, side = FORECOURT
    size = (site.width + 2 * side, site.depth + front + side, site.floor - 0.1 - site.foot)
    middle = (0.0, 0.5 * (side - front), 0.5 * (site.floor - 0.1 + site.foot))
    cos, sin = np.cos(site.yaw), np.sin(site.yaw)
    own = [affine_transform(a, [cos, sin, -sin, cos, *_origin(site)]) for a in avoided]
    paved = shapely.Polygon(rectangle(*size[:2]) + middle[:2])
    if not any(shapely.intersects(paved, area) for area in own):
        return box(size, middle, bottom=False)
    rest = shapely.normalize(shapely.difference(paved, shapely.union_all(own)))
    pieces = [part for part in shapely.get_parts(rest) if part.area > 1.0 and not part.interiors]
    rings = [shapely.get_coordinates(orient(part))[:-1] for part in pieces]
    return merge(prism(ring, site.foot, site.floor - 0.1, bottom=False) for ring in rings)


def _origin(site: Site) -> tuple[float, float]:
    """Return the town's origin in the frame of a plan [m]."""
    x, y = site.center
    cos, sin = np.cos(site.yaw), np.sin(site.yaw)
    return -cos * x - sin * y, sin * x - cos * y


def _plan(style: BuildingStyle, site: Site, rng: np.random.Generator) -> Plan:
    """Return the plan of a building; only styles with several forms draw one."""
    if style.plans == ("rectangle",):
        return Plan("rectangle", site.width, site.depth)
    form = style.plans[int(rng.integers(len(style.plans)))]
    return Plan(form, site.width, site.depth, bool(rng.integers(2)))


def build_building(
    name: str,
    style: BuildingStyle,
    site: Site,
    storeys: int,
    rng: np.random.Generator,
    avoided: Sequence[shapely.Geometry] = (),
    is_joined: bool = False,
) -> list[MeshPart]:
    """Return the meshes of one building, one for each material and use.

    Args:
        name: Name of the prim under `Buildings`.
        style: Materials, window layout and roof.
        site: Plan, ground floor and foot, in the town frame.
        storeys: Storeys above the ground floor level, the ground storey included, >= 1.
        rng: Chooses the form of the plan, roof equipment, chimneys, balconies and awnings.
        avoided: Areas that its forecourt leaves free, in the town frame.
        is_joined: Whether it shares an edge with a neighbor, so that belts and cornices have no room.
    """
    out: Meshes = defaultdict(list)
    plan, floor = _plan(style, site, rng), site.floor
    is_flat = style.roof_form == "flat"
    crown = style.parapet_m if is_flat else 0.0
    if is_flat and style.windows == "punched" and not is_joined:
        belt(plan, floor + style.ground_storey_m, out)
    base = min(style.podium_storeys, storeys - 1) if style.podium_storeys else storeys
    _walls(style, plan, base, site.foot, floor, crown, True, out)
    entrance(style, plan, site.foot, floor, out)
    top, highest = floor + height_of(style, base), plan
    if is_flat:
        flat_roof(style, plan, top, is_joined, out)
        if base < storeys:
            highest = plan.scaled(site.width - 2 * SETBACK * site.width, site.depth - 2 * SETBACK * site.depth)
            _walls(style, highest, storeys - base, top - 0.3, top, crown, False, out)
            top += height_of(style, storeys - base, ground=False)
            flat_roof(style, highest, top, is_joined, out)
        if style.plant_room:
            add_plant_room(highest, top, out)
        else:
            add_equipment(highest, top, rng, out)
    else:
        (gable_roof if style.roof_form == "gable" else hip_roof)(style, site.width, site.depth, top, out)
        add_chimney(style, site.width, site.depth, top, rng, out)
    if is_flat:
        out["forecourt"].append(_forecourt(site, avoided))
    awning = AWNINGS[int(rng.integers(len(AWNINGS)))] if style.shop_front else ""
    if style.shop_front:
        shop_front(style, plan, floor, out)
    if style.balconies:
        balconies(style, plan, floor, base, rng, out)
    material = {
        "facade": style.facade, "glass": style.glass, "door": style.door, "roof": style.roof, "chimney": "brick_facade",
        "structure": "concrete_structure", "metal": "metal_fascia", "awning": awning, "sign": "shop_sign",
        "forecourt": "concrete_sidewalk",
    }  # fmt: skip
    label = {"forecourt": "sidewalk"}
    at = (*site.center, 0.0)
    return [
        MeshPart.of(
            f"Buildings/{name}/{part}",
            place(weld(merge(out[part])), at, site.yaw),
            material[part],
            label.get(part, "building"),
        )
        for part in material
        if any(len(mesh.faces) for mesh in out[part])
    ]
