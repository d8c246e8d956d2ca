"""Build a town asset: YAML description -> roads, terrain, buildings, props -> USD."""

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.core.resources import assets_dir, shipped_towns
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.roads.sidewalk_prims import Sidewalk
from mmw.usd.vehicle_catalog import load_catalog
from mmw.worlds.towns.block_description import TownWeather
from mmw.worlds.towns.blocks import forecourt_bounds, place_by_hand, place_lots
from mmw.worlds.towns.buildings import build_building
from mmw.worlds.towns.description import TownDescription, load_town
from mmw.worlds.towns.ground_height import Ground
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.network import build_network
from mmw.worlds.towns.parked_prims import ParkedCar
from mmw.worlds.towns.parking import find_parking, park_all
from mmw.worlds.towns.paved_areas import area_regions, pave
from mmw.worlds.towns.prop_placement import place_props
from mmw.worlds.towns.sidewalk_lines import obstacle_plans, sidewalk_lines
from mmw.worlds.towns.skybridges import TOUCH, build_skybridge, find_span
from mmw.worlds.towns.write_usd import PAYLOAD, write_town


@dataclass(frozen=True)
class TownReport:
    """Result of a build."""

    path: Path
    """The interface layer."""
    triangles: dict[str, int]
    """Group -> number of triangles."""
    buildings: int
    props: int
    lanes: int
    parked: int
    size: int
    """Bytes of the interface layer and its payload."""

    def __str__(self) -> str:
        """Return one line for people."""
        groups = ", ".join(f"{group} {count:,}" for group, count in self.triangles.items())
        return (
            f"{self.path}: {self.buildings} buildings, {self.props} props, {self.lanes} lanes, {self.parked} parked "
            f"cars, {sum(self.triangles.values()):,} triangles ({groups}), {self.size / 1e6:.2f} MB"
        )


@dataclass(frozen=True)
class TownParts:
    """A town before it is written."""

    meshes: list[MeshPart]
    """All meshes, ground first."""
    lanes: LaneGraph
    parked: list[ParkedCar]
    walks: list[Sidewalk]


def town_parts(description: TownDescription) -> TownParts:
    """Return what a town consists of.

    Raises:
        InputError: If the description cannot be built; the message says where.
    """
    network = build_network(description)
    parking = find_parking(description, network)
    terrain = pave(network.terrain, [*parking.regions, *area_regions(description.paved)])
    parts = [*network.parts, *terrain]
    ground = Ground(parts)
    carriageway, corridor = (shapely.normalize(area) for area in (network.carriageway, network.corridor))
    islands = [shapely.Point(ring.centre[:2]).buffer(ring.radius) for ring in description.roundabouts]
    every = np.concatenate([part.points for part in parts])
    land = shapely.box(*every[:, :2].min(axis=0), *every[:, :2].max(axis=0))

    by_hand = [lot.outline for lot in place_by_hand(description.buildings, corridor, ground)]
    below = shapely.union_all([carriageway, network.overhead])
    surfaces = Ground([*parts, *network.structure_parts]) if network.structures else ground
    spans = [find_span(bridge, below, by_hand, surfaces) for bridge in description.skybridges]
    columns = [column for span in spans for column in span.column_plans]
    above = [*(span.plan for span in spans), *([] if network.overhead.is_empty else [network.overhead])]
    paved = [*parking.blocks, *(shapely.Polygon(area.outline) for area in description.paved)]

    lots, blocks = place_lots(description, corridor, land, ground, [*islands, *above, *columns, *paved])
    for number, lot in enumerate(lots):
        rng = np.random.default_rng([description.blocks.seed, 2, number])
        style = description.blocks.styles[lot.style]
        if any(shapely.dwithin(span.plan, lot.outline, TOUCH) for span in spans):
            style = style.model_copy(update={"balconies": False})  # they would reach into the bridge
        avoided = forecourt_bounds(lot, lots[: len(by_hand)], [corridor, *paved, *columns])
        parts += build_building(lot.name, style, lot.site, lot.storeys, rng, avoided, lot.is_joined)
    parts += network.structure_parts
    for span in spans:
        parts += build_skybridge(span, ground)
    solid = [*columns, *(structure.supports for structure in network.structures)]
    solid += [bay.outline for bay in parking.bays]
    props = place_props(
        description, carriageway, network.lanes, lots, blocks, ground, solid, [*above, *paved], network.centre_lines
    )
    supports = [structure.supports for structure in network.structures]
    walks = sidewalk_lines(network.edges, [*obstacle_plans(props, ground), *columns, *supports])
    parked = park_all(parking, load_catalog() if parking.groups else {}, ground)
    return TownParts([*parts, *props], network.lanes, parked, walks)


def build_town(
    description_path: str | Path,
    out_dir: str | Path,
    materials: str | Path | None = None,
    *,
    radio_rows: Collection[str] | None = None,
) -> TownReport:
    """Build a town from its YAML file and write `<name>.usda` and `geometry.usdc`.

    Args:
        description_path: The YAML file.
        out_dir: Folder of the town asset.
        materials: The material library to reference; the shipped one by default.
        radio_rows: Radio materials that exist, such as `itu_wet_ground`; None to check them at the run only.

    Raises:
        InputError: If the description is wrong or cannot be built.
    """
    description = load_town(description_path)
    name, weather = description.name, description.weather
    try:
        _check_rows(weather, radio_rows)
        town = town_parts(description)
        parts = town.meshes
        path = write_town(out_dir, name, parts, town.lanes, weather, materials, town.parked, town.walks)
    except InputError as error:
        raise InputError(f"{description_path}: {error}") from None
    triangles: Counter[str] = Counter()
    for part in parts:
        group = part.path.split("/")[0]
        triangles[group] += len(part.faces)
    components = {tuple(part.path.split("/")[:2]) for part in parts}
    count = Counter(group for group, _ in components)
    size = path.stat().st_size + (path.parent / PAYLOAD).stat().st_size
    return TownReport(
        path,
        dict(triangles),
        count["Buildings"],
        count["Props"],
        len(town.lanes.lanes),
        len(town.parked),
        size,
    )


def _check_rows(weather: Mapping[str, TownWeather], radio_rows: Collection[str] | None) -> None:
    for name, state in weather.items():
        if state.ground_itu and radio_rows is not None and state.ground_itu not in radio_rows:
            raise InputError(
                f"weather.{name}.ground_itu = {state.ground_itu!r} is unknown; use one of {', '.join(radio_rows)}"
            )


def build_shipped_town(name: str, out_dir: str | Path | None = None) -> TownReport:
    """Rebuild a shipped town, in place unless another folder is given.

    Raises:
        InputError: If no town of this name has a description.
    """
    if name not in shipped_towns():
        known = ", ".join(shipped_towns())
        raise InputError(f"town = {name!r}; shipped towns are: {known}; name one of them, or give a YAML file")
    folder = assets_dir() / "towns" / name
    return build_town(folder / f"{name}.yaml", out_dir or folder)
