"""Names of object classes in recorded data -> classes of our vehicle models."""

VEHICLES = {
    "car": ("car", "taxi", "priorityvehicle", "parkedvehicle", "emergency.police", "emergency.ambulance", "passenger"),
    "truck": ("truck", "trailer_truck", "truck_cab"),
    "bus": ("bus", "bus.bendy", "bus.rigid", "school_bus", "articulated_bus"),
}  # fmt: skip
"""Class of our models -> names of it. Source: object types of CommonRoad 2020a, nuScenes, Waymo Open Motion, Argoverse
2 and INTERACTION, without the prefixes of `PREFIXES`."""

OTHERS = (
    "pedestrian", "person", "human", "bicycle", "bicyclist", "cyclist", "bike", "motorcycle", "motorcyclist",
    "motorbike", "wheeled_rider", "wheeled_device", "riderless_bicycle", "pedestrian/bicycle", "static", "background",
    "animal", "construction", "movable_object", "static_object", "train", "tram", "rail_urban", "constructionzone",
    "roadboundary", "building", "pillar", "median_strip", "trailer", "traffic_cone", "construction_cone",
    "construction_barrel", "stroller", "wheelchair", "dog", "sign", "bollard", "barrier",
)  # fmt: skip
"""Names of what has no vehicle model, with everything below them (`human.pedestrian.adult`); it is left out."""

PREFIXES = ("type_", "vehicle.")
"""Beginnings of names: Waymo's `TYPE_VEHICLE`, nuScenes' `vehicle.bus.rigid`."""

LABELS = {name: label for label, names in VEHICLES.items() for name in names}


def vehicle_class(name: str) -> str | None:
    """Return the class of a name in recorded data, None for what is left out; other names stay as they are.

    `vehicle` is one of these: it may be of any class, which its length tells.
    """
    word = name.strip().lower().replace(" ", "_")
    for prefix in PREFIXES:
        word = word.removeprefix(prefix)
    if word in LABELS:
        return LABELS[word]
    return None if any(word == other or word.startswith(f"{other}.") for other in OTHERS) else name
