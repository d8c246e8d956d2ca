"""Report findings of a stage's checks, and merge many places into few."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from mmw.core.planar_surfaces import components

Severity = Literal["error", "warning", "info"]
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "info")
"""Error: data would be wrong, or a run stops. Warning: look at it. Info: a figure, or a rule that does not apply."""

SPOT_M = 4.0
"""Places closer than about this belong to one spot [m]; design value, a vehicle's length."""


@dataclass(frozen=True)
class Finding:
    """One finding of a rule."""

    severity: Severity
    rule: str
    """Name of the rule, such as `holes`."""
    path: str
    """Prim that it is about; two are separated by ` and `; empty for the whole stage."""
    message: str
    """Description of the finding."""
    cure: str = ""
    """Cure; empty for information."""
    place: tuple[float, float, float] | None = None
    """Place in the stage [m], x east, y north, z up; None if it has none."""

    def __str__(self) -> str:
        """Return one line for people."""
        where = "" if self.place is None else " at ({:.1f}, {:.1f}, {:.1f})".format(*self.place)
        path = f"{self.path}{where}: " if self.path or where else ""
        return f"{self.severity}: {self.rule}: {path}{self.message}" + (f"; {self.cure}" if self.cure else "")

    def record(self) -> dict[str, Any]:
        """Return the fields for JSON, the place in millimeters."""
        place = None if self.place is None else [round(value, 3) for value in self.place]
        return asdict(self) | {"place": place}


def does_not_apply(rule: str, reason: str) -> Finding:
    """Return the finding that a rule does not apply."""
    return Finding("info", rule, "", f"does not apply: {reason}")


def as_place(point: np.ndarray) -> tuple[float, float, float]:
    """Return a point [3] as a place."""
    x, y, z = (float(value) for value in point)
    return x, y, z


def listed(names: Iterable[str], most: int = 4) -> str:
    """Return the first names of a list, and how many more there are."""
    names = list(names)
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def merge_spots(points: np.ndarray) -> list[np.ndarray]:
    """Return the rows of each group of places that hang together.

    Args:
        points: Places [m], shape [N, 3].

    Returns:
        Row numbers of each spot, in the order of their first rows; an empty list for no places.
    """
    if not len(points):
        return []
    cells, cell = np.unique(np.floor(points / SPOT_M).astype(np.int64), axis=0, return_inverse=True)
    rows = {tuple(key): k for k, key in enumerate(cells.tolist())}
    steps = [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]
    links = [
        (k, rows[near])
        for (x, y, z), k in rows.items()
        for dx, dy, dz in steps
        if (near := (x + dx, y + dy, z + dz)) in rows
    ]
    first, second = np.array(links).T
    label = components(len(cells), first, second)[cell.ravel()]
    return [np.flatnonzero(label == value) for value in dict.fromkeys(label.tolist())]
