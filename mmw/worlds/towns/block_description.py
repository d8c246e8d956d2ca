"""Sections `blocks`, `buildings`, `props` and `weather` of a town's YAML: everything between the roads."""

from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import Literal

from pydantic import Field, model_validator

from mmw.config.section import Name, Section
from mmw.core.errors import InputError
from mmw.physics.weather.optics import rain_visibility
from mmw.physics.weather.weather import PRESETS, Weather
from mmw.worlds.towns.place_description import ParkingLot, PavedArea, Skybridge, StreetBays, Vec2

Span = tuple[float, float]


def is_named(name: str, patterns: Sequence[str]) -> bool:
    """Return whether a name is one of `patterns`, in which `*` stands for anything."""
    return any(fnmatchcase(name, pattern) for pattern in patterns)


class BuildingStyle(Section):
    """Appearance and plot of one kind of building."""

    facade: str = Field("marble_facade", description="material of the walls (material name)")
    glass: str = Field("window_glass", description="material of the windows (material name)")
    roof: str = Field("concrete_roof", description="material of the roof (material name)")
    door: str = Field("wood", description="material of the entrance (material name)")
    windows: Literal["punched", "ribbon", "curtain"] = Field("punched", description="layout of the windows (token)")
    roof_form: Literal["flat", "gable", "hip"] = Field("flat", description="form of the roof (token)")
    storeys: tuple[int, int] = Field((3, 5), description="fewest and most storeys (count)")
    storey_m: float = Field(3.4, gt=2, lt=8, description="height of an upper storey [m]")
    ground_storey_m: float = Field(4.2, gt=2, lt=10, description="height of the ground storey [m]")
    bay_m: float = Field(4.5, gt=1, lt=20, description="width of a window bay, adjusted so that whole bays fit [m]")
    window_fraction: float = Field(0.55, gt=0, lt=1, description="part of a bay's width that is window (fraction)")
    sill_m: float = Field(0.9, ge=0, lt=3, description="wall below the windows of a storey [m]")
    head_m: float = Field(0.6, gt=0, lt=3, description="wall above the windows of a storey [m]")
    parapet_m: float = Field(0.9, ge=0.1, lt=3, description="height of the parapet of a flat roof [m]")
    pitch: float = Field(0.7, gt=0, lt=2, description="rise over run of a pitched roof (fraction)")
    front_m: Span = Field((16, 28), description="shortest and longest street front [m]")
    depth_m: Span = Field((12, 18), description="shallowest and deepest plan [m]")
    gap_m: float = Field(4.0, ge=1, description="least distance to the next building [m]")
    setback_m: float = Field(4.5, ge=3, description="distance from the road corridor to the front [m]")
    podium_storeys: int = Field(0, ge=0, description="storeys of a wider base below a tower; 0 for none (count)")
    plans: tuple[Literal["rectangle", "l_shape", "corner_cut"], ...] = Field(
        ("rectangle",), min_length=1, description="forms of the plan, one is drawn for each building (tokens)"
    )
    mullion_m: float = Field(0.0, ge=0, lt=1, description="frame between the panes of a curtain wall; 0 for none [m]")
    plant_room: bool = Field(False, description="one plant room on the roof instead of single units (flag)")
    shop_front: bool = Field(False, description="glass along the ground storey's front, sign and awning (flag)")
    balconies: bool = Field(False, description="balconies on the street front of punched facades (flag)")

    @model_validator(mode="after")
    def _fits_together(self) -> "BuildingStyle":
        if self.roof_form != "flat" and self.plans != ("rectangle",):
            raise InputError(f"roof_form {self.roof_form!r} with plans {self.plans}; only a flat roof covers them")
        if self.mullion_m and self.windows != "curtain":
            raise InputError(f"mullion_m with windows {self.windows!r}; only a curtain wall has mullions")
        if self.balconies and self.windows != "punched":
            raise InputError(f"balconies with windows {self.windows!r}; balconies belong to punched windows")
        return self


class District(Section):
    """A disc of the town with its own mix of styles; the first district that holds a lot decides."""

    name: Name = Field(description="name of the district (name)")
    center: Vec2 = Field(description="center of the disc, x east, y north [m]")
    radius_m: float = Field(gt=0, description="radius of the disc [m]")
    styles: dict[str, float] = Field(description="style -> weight (fraction)")
    coverage: float = Field(1.0, ge=0, le=1, description="part of the possible lots that are built on (fraction)")


class OpenSpace(Section):
    """A disc that no building is put on; trees may be scattered over it."""

    center: Vec2 = Field(description="center of the disc, x east, y north [m]")
    radius_m: float = Field(gt=0, description="radius of the disc [m]")
    trees: int = Field(0, ge=0, description="trees scattered over the disc (count)")


class BlocksSection(Section):
    """Automatic buildings along every street front."""

    seed: int = Field(1, ge=0, description="seed of sizes, styles and scatter (number)")
    reach_m: float = Field(60.0, ge=0, description="how far from the roads anything is built [m]")
    most_fall_m: float = Field(3.5, gt=0, description="largest height difference of the ground under one building [m]")
    styles: dict[str, BuildingStyle] = Field(default_factory=dict, description="name -> style (map)")
    districts: tuple[District, ...] = Field((), description="mixes of styles; order matters (list)")
    open_spaces: tuple[OpenSpace, ...] = Field((), description="parks and squares (list)")

    @model_validator(mode="after")
    def _styles_exist(self) -> "BlocksSection":
        for district in self.districts:
            for style in district.styles:
                if style not in self.styles:
                    known = ", ".join(sorted(self.styles))
                    raise InputError(f"district {district.name!r} uses style {style!r}; styles are: {known}")
        return self


class PlacedBuilding(Section):
    """A building at a given place."""

    name: Name = Field(description="name of the prim (name)")
    style: str = Field(description="one of `blocks.styles` (name)")
    center: Vec2 = Field(description="center of the plan, x east, y north [m]")
    size_m: Vec2 = Field(description="street front and depth [m]")
    yaw_deg: float = Field(
        0.0, description="direction of the front's outward normal, counter-clockwise from east [deg]"
    )
    storeys: int = Field(4, ge=1, description="storeys (count)")


class PlacedProp(Section):
    """One prop at a given place."""

    kind: str = Field(description="kind of prop, such as `bus_shelter` (name)")
    at: Vec2 = Field(description="position, x east, y north [m]")
    yaw_deg: float = Field(0.0, description="direction of the prop's front, counter-clockwise from east [deg]")


class PropRow(Section):
    """One kind of prop repeated along all kerbs."""

    kind: str = Field(description="kind of prop, such as `street_lamp` (name)")
    every_m: float = Field(gt=2, description="distance from one to the next [m]")
    offset_m: float = Field(description="distance from the kerb, outward; must leave the carriageway free [m]")
    clear_m: float = Field(1.0, ge=0, description="least distance to buildings and to other props [m]")
    start_m: float = Field(0.0, ge=0, description="distance of the first one from the start of its kerb [m]")
    jitter_m: float = Field(0.0, ge=0, description="largest shift along the kerb, either way [m]")
    along: tuple[str, ...] = Field(("*",), description="roads whose kerbs have the row, with * for anything (names)")


class PropLine(Section):
    """One kind of prop end to end along a line, such as a fence around a field."""

    kind: Literal["fence", "field_fence", "hedge", "guard_rail"] = Field(description="kind of panel (token)")
    points: tuple[Vec2, ...] = Field(
        min_length=2, description="corners of the line; gaps stay at carriageways and buildings [m]"
    )


class PropsSection(Section):
    """Street furniture and trees."""

    rows: tuple[PropRow, ...] = Field((), description="rows along the kerbs, earlier rows have the right of way (list)")
    placed: tuple[PlacedProp, ...] = Field((), description="single props (list)")
    lines: tuple[PropLine, ...] = Field((), description="fences, hedges and guard rails along lines (list)")
    signalled: tuple[str, ...] = Field((), description="junctions with a traffic light at every approach (names)")
    give_way: tuple[str, ...] = Field((), description="junctions with signs on lanes that give way (names)")
    crown_detail: int = Field(3, ge=2, le=4, description="fineness of crowns near roads; 2 for many trees (number)")
    scattered_trees: int = Field(0, ge=0, description="trees over the open land between buildings (count)")
    fences: bool = Field(False, description="whether houses get a fence along the street (flag)")


class TownWeather(Section):
    """One weather variant of the town."""

    rain_rate_mm_h: float = Field(0.0, ge=0, description="rain rate [mm/h]")
    visibility_m: float = Field(20_000.0, gt=0, description="meteorological optical range [m]")
    ground_itu: str = Field("", description="radio material of the ground; empty keeps the library's (name)")


def _variant(weather: Weather) -> TownWeather:
    """Return the variant of a preset; its visibility is that of the rain, to 10 m, else that of the fog."""
    return TownWeather(
        rain_rate_mm_h=weather.rain_mm_h,
        visibility_m=round(rain_visibility(weather.rain_mm_h), -1) if weather.rain_mm_h else weather.visibility_m,
        ground_itu="itu_wet_ground" if weather.has_wet_ground else "",
    )


SHIPPED_WEATHER = {name: _variant(PRESETS[name]) for name in ("sunny", "rainy", "foggy")}
"""Weather variants of the shipped towns, from the presets of the same names."""


class BlockDescription(Section):
    """Everything of a town that is not road or terrain."""

    blocks: BlocksSection = Field(default_factory=BlocksSection, description="automatic buildings (section)")
    buildings: tuple[PlacedBuilding, ...] = Field((), description="buildings placed by hand (list)")
    props: PropsSection = Field(default_factory=PropsSection, description="street furniture (section)")
    skybridges: tuple[Skybridge, ...] = Field((), description="walkways between buildings, over roads (list)")
    lots: tuple[ParkingLot, ...] = Field((), description="car parks (list)")
    bays: tuple[StreetBays, ...] = Field((), description="cars parked along kerbs (list)")
    paved: tuple[PavedArea, ...] = Field((), description="parts of the terrain with another surface (list)")
    weather: dict[Name, TownWeather] = Field(
        default_factory=lambda: dict(SHIPPED_WEATHER), description="variants (map)"
    )

    @model_validator(mode="after")
    def _styles_exist(self) -> "BlockDescription":
        for building in self.buildings:
            if building.style not in self.blocks.styles:
                known = ", ".join(sorted(self.blocks.styles))
                raise InputError(f"building {building.name!r} uses style {building.style!r}; styles are: {known}")
        return self
