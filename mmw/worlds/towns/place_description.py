"""Sections `skybridges`, `lots`, `bays` and `paved` of a town's YAML: single places between and over the roads."""

from typing import Literal

from pydantic import Field

from mmw.config.section import PrimName, Section

Vec2 = tuple[float, float]

MIN_SOFFIT = 5.0
"""Least clear height above a carriageway [m]: 4.5 m of headroom that trucks are given, and half a meter to spare."""


class Skybridge(Section):
    """A closed walkway of glass and metal between buildings, over a road."""

    name: PrimName = Field(description="name of the prim (name)")
    start: Vec2 = Field(alias="from", description="middle of one end, x east, y north [m]")
    end: Vec2 = Field(alias="to", description="middle of the other end [m]")
    width: float = Field(8.0, ge=2, le=60, description="outer width [m]")
    soffit: float = Field(
        6.5, ge=MIN_SOFFIT, le=60, description="clear height of its underside above the highest road below it [m]"
    )
    storeys: int = Field(1, ge=1, le=6, description="storeys (count)")
    storey_m: float = Field(3.8, ge=2.5, le=8, description="height of a storey [m]")
    deck_m: float = Field(0.8, ge=0.3, le=3, description="height of the floor above the underside [m]")
    bay_m: float = Field(3.0, ge=0.8, le=20, description="width of a pane, adjusted so that whole panes fit [m]")
    mullion_m: float = Field(0.12, gt=0, le=1, description="width of the frame between two panes [m]")
    frame: str = Field("metal_fascia", description="material of frame, ends and fascia (material name)")
    glass: str = Field("glass_facade", description="material of the panes (material name)")
    underside: str = Field("concrete_structure", description="material of the soffit and the columns (material name)")
    roof: str = Field("concrete_roof", description="material of the roof (material name)")
    supports: Literal["auto", "both", "from", "to", "none"] = Field(
        "auto", description="ends on columns; auto: the ends that touch no building placed by hand (token)"
    )
    piers: tuple[float, ...] = Field(
        (), description="further rows of columns, such as on a median: distances from the end `from` [m]"
    )


class ParkingLot(Section):
    """A block of land between roads that becomes a car park: asphalt, painted bays, parked cars."""

    name: PrimName = Field(description="name of the lot (name)")
    at: Vec2 = Field(description="a point inside the block, x east, y north [m]")
    bay: Vec2 = Field((2.5, 5.0), description="width and depth of a bay [m]")
    rows: int = Field(2, ge=0, le=40, description="rows of bays, two and two back to back; 0 only paves (count)")
    aisle_m: float = Field(6.0, ge=3, le=20, description="width between two pairs of rows [m]")
    yaw_deg: float | None = Field(
        None, description="direction of the rows, counter-clockwise from east; the block's longer side if absent [deg]"
    )
    occupied: float = Field(0.6, ge=0, le=1, description="part of the bays with a parked car (fraction)")
    models: tuple[str, ...] = Field((), description="vehicle models to draw from; all that fit a bay if empty (names)")
    material: str = Field("asphalt", description="material of the surface (material name)")
    seed: int = Field(1, ge=0, description="seed of the parked cars (number)")


class StreetBays(Section):
    """Cars parked along a kerb, on the shoulder of a road."""

    along: str = Field(description="road (name)")
    side: Literal["left", "right"] = Field("right", description="side of the reference line (token)")
    start: float = Field(alias="from", ge=0, description="station where the bays begin, from the road's junction [m]")
    end: float = Field(alias="to", gt=0, description="station where the bays end [m]")
    length: float = Field(6.2, ge=5, le=20, description="length of a bay [m]")
    occupied: float = Field(0.6, ge=0, le=1, description="part of the bays with a parked car (fraction)")
    models: tuple[str, ...] = Field((), description="vehicle models to draw from; all that fit a bay if empty (names)")
    seed: int = Field(1, ge=0, description="seed of the parked cars (number)")


class PavedArea(Section):
    """A part of the terrain with another surface: a forecourt, a farmyard, a square. Its heights stay the terrain's."""

    name: PrimName = Field(description="name of the area (name)")
    outline: tuple[Vec2, ...] = Field(min_length=3, description="corners; what lies outside the terrain is cut off [m]")
    material: str = Field("concrete_sidewalk", description="material of the surface (material name)")
    label: Literal["ground", "terrain", "sidewalk"] = Field("ground", description="semantic class (token)")
