"""Count actors by kind, as the table `frames` does."""

ROLE_COLUMNS = {"cav": "cav_count", "rsu": "rsu_count", "vru": "vru_count", "uav": "uav_count", "bs": "bs_count"}
"""Role of agents -> column of `frames`."""

BODY_COLUMNS = ("vehicle_count", "pedestrian_count", "uav_count")
"""Columns of `frames` that together count every actor with a box once."""

COUNTED = (*ROLE_COLUMNS.values(), "vehicle_count", "pedestrian_count")
"""All columns of `frames` that count actors."""

RIDERS = ("bicycle", "motorcycle", "rider")
"""Classes of road users on a vehicle of their own."""


def counted_in(role: str, label: str) -> tuple[str, ...]:
    """Return the columns of `frames` that count an actor.

    A connected VRU is a person, or, on a bicycle, a vehicle too.

    Args:
        role: Role of the actor.
        label: Its semantic class.
    """
    columns = (ROLE_COLUMNS[role],) if role in ROLE_COLUMNS else ()
    if role in ("cav", "vehicle") or (role == "vru" and label in RIDERS):
        return (*columns, "vehicle_count")
    return (*columns, "pedestrian_count") if role in ("pedestrian", "vru") else columns
