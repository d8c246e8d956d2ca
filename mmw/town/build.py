"""Build a town asset: YAML description -> roads, terrain, buildings, props -> USD."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely

from mmw.paths import assets_dir
from mmw.town.author import PAYLOAD, write_town
from mmw.town.blocks import place_lots
from mmw.town.buildings import build_building
from mmw.town.description import TownDescription, load_town
from mmw.town.furnish import furnish
from mmw.town.ground import Ground
from mmw.town.lanes import LaneGraph
from mmw.town.network import build_network
from mmw.town.parts import MeshPart
from mmw.town.terrain import build_terrain


@dataclass(frozen=True)
class TownReport:
    """What was built."""

    path: Path
    """The interface layer."""
    meshes: dict[str, int]
    """Group -> number of Mesh prims."""
    triangles: dict[str, int]
    """Group -> number of triangles."""
    buildings: int
    props: int
    lanes: int
    size: int
    """Bytes of the interface layer and its payload."""

    def __str__(self) -> str:
        """Return one line for people."""
        groups = ", ".join(f"{group} {count:,}" for group, count in self.triangles.items())
        return (
            f"{self.path}: {self.buildings} buildings, {self.props} props, {self.lanes} lanes, "
            f"{sum(self.triangles.values()):,} triangles ({groups}), {self.size / 1e6:.2f} MB"
        )


def town_parts(description: TownDescription) -> tuple[list[MeshPart], LaneGraph]:
    """Return all meshes of a town, ground first, and its lane graph.

    Raises:
        ValueError: If the description cannot be built; the message says where.
    """
    network = build_network(description)
    parts = [*network.parts, *build_terrain(description, network)]
    ground = Ground(parts)
    carriageway, corridor = (shapely.normalize(area) for area in (network.carriageway, network.corridor))
    islands = [shapely.Point(ring.centre[:2]).buffer(ring.radius) for ring in description.roundabouts]
    every = np.concatenate([part.points for part in parts])
    land = shapely.box(*every[:, :2].min(axis=0), *every[:, :2].max(axis=0))
    lots, blocks = place_lots(description, corridor, land, ground, islands)
    for number, lot in enumerate(lots):
        rng = np.random.default_rng([description.blocks.seed, 2, number])
        parts += build_building(lot.name, description.blocks.styles[lot.style], lot.site, lot.storeys, rng)
    parts += furnish(description, carriageway, network.lanes, lots, blocks, ground)
    return parts, network.lanes


def build_town(description_path: str | Path, out_dir: str | Path, materials: str | Path | None = None) -> TownReport:
    """Build a town from its YAML file and write `<name>.usda` and `geometry.usdc`.

    Args:
        description_path: The YAML file.
        out_dir: Folder of the town asset.
        materials: The material library to reference; the shipped one by default.

    Raises:
        ValueError: If the description is wrong or cannot be built.
    """
    description = load_town(description_path)
    parts, lanes = town_parts(description)
    path = write_town(out_dir, description.name, parts, lanes, description.weather, materials)
    meshes: Counter[str] = Counter()
    triangles: Counter[str] = Counter()
    for part in parts:
        group = part.path.split("/")[0]
        meshes[group] += 1
        triangles[group] += len(part.faces)
    components = {tuple(part.path.split("/")[:2]) for part in parts}
    count = Counter(group for group, _ in components)
    size = path.stat().st_size + (path.parent / PAYLOAD).stat().st_size
    return TownReport(path, dict(meshes), dict(triangles), count["Buildings"], count["Props"], len(lanes.lanes), size)


def build_shipped_town(name: str, out_dir: str | Path | None = None) -> TownReport:
    """Rebuild a shipped town, in place unless another folder is given.

    Raises:
        ValueError: If no town of this name has a description.
    """
    folder = assets_dir() / "towns" / name
    if not (folder / f"{name}.yaml").is_file():
        known = ", ".join(sorted(path.parent.name for path in folder.parent.glob("*/*.yaml")))
        raise ValueError(f"town = {name!r}: no description; shipped towns are: {known}; name one of them")
    return build_town(folder / f"{name}.yaml", out_dir or folder)
