"""Types of city objects and of their surfaces -> semantic classes and materials of the library.

Source of the names: CityGML 2.0 and 3.0 (OGC 12-019, 20-010), CityJSON 2.0.1.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class ObjectClass:
    """The treatment of a type of city object."""

    group: str
    """Prim below the town's root that holds the objects."""
    label: str
    """Semantic class."""
    material: str
    """Material of surfaces without a type; empty for a building, whose surfaces are told apart by where they look."""


BUILDING = ObjectClass("Buildings", "building", "")
CLASSES = {
    "Building": BUILDING, "BuildingPart": BUILDING, "BuildingInstallation": BUILDING, "BuildingUnit": BUILDING,
    "BuildingConstructiveElement": BUILDING, "BuildingStorey": BUILDING, "OtherConstruction": BUILDING,
    "Bridge": ObjectClass("Bridges", "bridge", "concrete_structure"),
    "BridgePart": ObjectClass("Bridges", "bridge", "concrete_structure"),
    "BridgeInstallation": ObjectClass("Bridges", "bridge", "concrete_structure"),
    "BridgeConstructiveElement": ObjectClass("Bridges", "bridge", "concrete_structure"),
    "BridgeConstructionElement": ObjectClass("Bridges", "bridge", "concrete_structure"),
    "Road": ObjectClass("Roads", "road", "asphalt"),
    "TransportSquare": ObjectClass("Roads", "road", "asphalt"),
    "Square": ObjectClass("Roads", "road", "asphalt"),
    "Railway": ObjectClass("Terrain", "ground", "soil"),
    "Track": ObjectClass("Terrain", "ground", "soil"),
    "TINRelief": ObjectClass("Terrain", "terrain", "grass"),
    "ReliefFeature": ObjectClass("Terrain", "terrain", "grass"),
    "LandUse": ObjectClass("Terrain", "terrain", "grass"),
    "PlantCover": ObjectClass("Vegetation", "vegetation", "foliage"),
    "SolitaryVegetationObject": ObjectClass("Vegetation", "vegetation", "foliage"),
    "CityFurniture": ObjectClass("Furniture", "static", "metal_pole"),
    "WaterBody": ObjectClass("Terrain", "water", "water"),
}  # fmt: skip
"""Type of an object -> its treatment; objects of other types are left out, with a note."""

MATERIALS = {
    "WallSurface": "concrete_facade", "RoofSurface": "concrete_roof", "GroundSurface": "concrete_facade",
    "OuterCeilingSurface": "concrete_facade", "OuterFloorSurface": "concrete_facade", "Window": "window_glass",
    "WindowSurface": "window_glass", "Door": "wood", "DoorSurface": "wood", "InteriorWallSurface": "concrete_facade",
    "CeilingSurface": "concrete_facade", "FloorSurface": "concrete_facade", "WaterSurface": "water",
    "WaterGroundSurface": "soil", "TrafficArea": "asphalt", "AuxiliaryTrafficArea": "grass",
}  # fmt: skip
"""Type of a surface -> library; design values: the standards have no materials."""

OPEN = ("ClosureSurface", "WaterClosureSurface", "TransportationMarking", "TransportationHole")
"""Types of surfaces that are not there, or lie on another one; they are left out."""

PITCHED = "tile_roof"
"""Roofs that rise by more than `PITCH`."""
PITCH = 0.2
"""Steepest flat roof, as the sine of its angle [-]: 11 degrees; design value."""
STEEP = 0.2
"""A surface of unknown type whose normal rises by no more than this is a wall [-]; design value."""
