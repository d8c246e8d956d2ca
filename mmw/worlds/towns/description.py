"""The YAML file of a town: cross-sections, nodes, roads, junctions, roundabouts, terrain; blocks and props besides."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from mmw.config.section import Name, Section, Vec3
from mmw.config.yaml_file import ConfigError, read_yaml, validated
from mmw.config.yaml_loader import short
from mmw.core.errors import InputError
from mmw.worlds.towns.block_description import BlockDescription

MAX_NUMBER = 20_000
"""Largest number of a description but its seeds: the reach of a world [m], see `mmw.worlds.importers.mesh_cleanup`."""

Identifier = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=40)]
"""A name that becomes part of a prim path."""


class Profile(Section):
    """A cross-section, the same on both sides of the reference line."""

    lanes: int = Field(1, ge=1, le=4, description="lanes a direction (count)")
    width: float = Field(3.5, ge=2.5, le=6, description="width of a lane [m]")
    shoulder: float = Field(0.5, ge=0.2, le=4, description="paved strip outside the outermost lane [m]")
    centre: float = Field(0.0, ge=0, le=6, description="strip between the directions [m]")
    median: Literal["painted", "grass", "concrete"] = Field(
        "painted", description="the strip between the directions: paint, or top of a kerbed island (token)"
    )
    kerb_height: float = Field(0.14, ge=0, le=0.3, description="height of the kerb; 0 for none [m]")
    kerb_width: float = Field(0.15, ge=0, le=0.5, description="width of the kerb stone; 0 for none [m]")
    walk: float = Field(2.0, ge=0, le=8, description="width of the sidewalk; 0 for none [m]")
    verge: float = Field(0.5, ge=0, le=5, description="grass outside the sidewalk, level with it [m]")
    oneway: bool = Field(False, description="all lanes run along the reference line (flag)")

    @model_validator(mode="after")
    def _median_fits(self) -> "Profile":
        least = 1.0 + 2 * self.kerb_width
        if self.median != "painted" and (self.oneway or self.centre < least or self.kerb_height == 0):
            raise InputError(
                f"median: {self.median} with center {self.centre} m, kerb_height {self.kerb_height} m, oneway "
                f"{self.oneway}; an island needs two directions, center of {least} m or more and a kerb; correct one"
            )
        return self


class Bridge(Section):
    """The part of a road that is a structure: between walls where it is low, on piers where it is high."""

    start: float | None = Field(
        None, alias="from", description="station where the structure begins; the start of the road if absent [m]"
    )
    end: float | None = Field(None, alias="to", description="station where it ends; the end if absent [m]")
    deck: float = Field(1.2, ge=0.5, le=4, description="thickness from the carriageway to the soffit [m]")
    parapet: float = Field(1.1, ge=0.4, le=4, description="height of the parapets above the kerb [m]")
    piers_every: float = Field(25.0, ge=10, le=100, description="distance of the piers, about [m]")
    columns: Literal["round", "square"] = Field("round", description="cross-section of the columns (token)")
    column_width: float = Field(1.4, ge=0.5, le=4, description="diameter or side of a column [m]")
    fill_below: float = Field(3.0, ge=2, le=12, description="least height above the ground without walls and fill [m]")

    @model_validator(mode="after")
    def _has_room(self) -> "Bridge":
        if self.fill_below < self.deck + 1:
            raise InputError(
                f"fill_below {self.fill_below} m with a deck of {self.deck} m leaves no space below; "
                f"{self.deck + 1} m or more is needed; raise fill_below"
            )
        return self


class Road(Section):
    """A road from one node to another along straight lines whose corners are rounded by arcs."""

    id: Identifier = Field(description="name of the road (name)")
    start: Identifier = Field(alias="from", description="node at station 0 (name)")
    end: Identifier = Field(alias="to", description="node at the other end (name)")
    profile: Identifier = Field(description="cross-section (name)")
    speed: float = Field(13.9, gt=1, lt=50, description="speed limit [m/s]")
    via: tuple[Vec3, ...] = Field((), description="corner points and the radius that rounds each: x, y, radius [m]")
    z: tuple[tuple[float, float], ...] = Field((), description="changes of grade on the way: station, height [m]")
    priority: int = Field(0, ge=0, le=9, description="the road of higher number goes first at junctions (number)")
    bridge: Bridge | None = Field(None, description="the part that is a bridge or an elevated road (section)")


class Junction(Section):
    """Differences from the defaults at one node."""

    corner_radius: float | None = Field(default=None, ge=3, le=40, description="radius of the kerb at corners [m]")
    uturn: bool = Field(default=False, description="whether vehicles may turn back (flag)")
    parallel: bool = Field(default=False, description="every lane may turn, each into its own lane (flag)")
    crosswalks: bool = Field(default=True, description="zebra crossings on the arms (flag)")


class Roundabout(Section):
    """A one-way ring with an island; every arm gets a node `<id>_<arm>` that roads lead to."""

    id: Identifier = Field(description="name of the roundabout (name)")
    centre: Vec3 = Field(description="x, y, z of the middle [m]")
    radius: float = Field(27.75, ge=12, le=200, description="radius of the ring's reference line [m]")
    profile: Identifier = Field(description="cross-section of the ring, oneway (name)")
    arms: dict[Identifier, float] = Field(
        description="arm -> direction from the center, counter-clockwise from east [deg]"
    )
    corner_radius: float = Field(8.0, ge=3, le=40, description="radius of the kerb at entries and exits [m]")
    speed: float = Field(9.0, gt=1, lt=50, description="speed limit on the ring [m/s]")


class Terrain(Section):
    """The ground between and around the roads."""

    spacing: float = Field(default=5.0, ge=1, le=50, description="size of the grid [m]")
    margin: float = Field(default=40.0, ge=5, le=1000, description="how far the ground reaches beyond the roads [m]")


class TownDescription(BlockDescription):
    """One town."""

    name: Name = Field(description="name of the town (name)")
    corner_radius: float = Field(8.0, ge=3, le=40, description="radius of the kerb at junction corners [m]")
    vertical_curve: float = Field(12.0, ge=2, le=200, description="length over which a grade changes [m]")
    profiles: dict[Identifier, Profile] = Field(description="cross-sections (map)")
    nodes: dict[Identifier, Vec3] = Field(description="x, y, z of every node [m]")
    roads: tuple[Road, ...] = Field(description="roads (list)")
    junctions: dict[Identifier, Junction] = Field(default_factory=dict, description="exceptions by node (map)")
    roundabouts: tuple[Roundabout, ...] = Field((), description="roundabouts (list)")
    terrain: Terrain = Field(default_factory=Terrain, description="the ground (section)")

    @model_validator(mode="after")
    def _names_exist(self) -> "TownDescription":
        ids = [road.id for road in self.roads] + [ring.id for ring in self.roundabouts]
        twice = sorted({name for name in ids if ids.count(name) > 1})
        if twice:
            raise InputError(f"{', '.join(twice)} names two roads or roundabouts; give each its own id")
        nodes = set(self.nodes) | {f"{ring.id}_{arm}" for ring in self.roundabouts for arm in ring.arms}
        for road in self.roads:
            for key, node in (("from", road.start), ("to", road.end)):
                if node not in nodes:
                    raise InputError(f"road {road.id!r}: {key} = {node!r}; nodes are: {', '.join(sorted(nodes))}")
        for owner in (*self.roads, *self.roundabouts):
            if owner.profile not in self.profiles:
                known = ", ".join(sorted(self.profiles))
                raise InputError(f"{owner.id!r}: profile = {owner.profile!r}; profiles are: {known}")
        for ring in self.roundabouts:
            if not self.profiles[ring.profile].oneway:
                raise InputError(f"roundabout {ring.id!r}: profile {ring.profile!r} is two-way; set oneway: true")
            if len(ring.arms) < 3:
                raise InputError(f"roundabout {ring.id!r}: {len(ring.arms)} arms; a ring needs 3 or more")
        for name in self.junctions:
            if name not in nodes:
                raise InputError(f"junctions: {name!r} is no node; nodes are: {', '.join(sorted(nodes))}")
        return self


def _check_reach(path: Path, content: Any, key: str = "") -> None:
    """Raise ConfigError for a number that no length of a town has: things are placed every few meters up to there."""
    inner = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for name, value in inner:
        if isinstance(value, int | float) and name != "seed" and not abs(value) <= MAX_NUMBER:
            raise ConfigError(
                [f"{path}: {key}{name} = {short(value, 30)}: -{MAX_NUMBER:,} to {MAX_NUMBER:,} is needed; correct it"]
            )
        _check_reach(path, value, f"{key}{name}.")


def load_town(path: str | Path) -> TownDescription:
    """Return the description that a town's YAML file holds.

    Raises:
        ConfigError: If the file does not exist, is not YAML, or holds a wrong key or value; one line a problem, with
            file, key, value, and what is needed.
    """
    path = Path(path)
    data = read_yaml(path, "a map with name, profiles, nodes and roads")
    _check_reach(path, data)
    return validated(TownDescription, {key: value for key, value in data.items() if value is not None}, path)
