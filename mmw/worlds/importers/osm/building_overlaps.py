"""Keep buildings apart from each other and off the carriageway."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import shapely

from mmw.worlds.importers.osm.buildings import MIN_AREA, Body, roof_form
from mmw.worlds.towns.plan_geometry import intersect_areas, polygons_of

HEADROOM = 4.6
"""Height of a passage for lanes through a building [m]: 4.5 m for trucks, and a decimeter of wall above."""
ABOVE = 1.5
"""Least height of what stays over a passage [m]; design value."""
OVERLAP = 1e-3
"""Overlaps of plans below this are rounding [m^2]; design value, the least that `mmw town check` tells."""
THIN = 0.05
"""Remains thinner than twice this are dropped [m]; design value."""
LARGE = 10.0
"""A larger overlap with a carriageway is a passage, a smaller one an inaccuracy of the map [m^2]; design value."""


def keep_apart(bodies: list[Body], paved: shapely.Geometry | None) -> tuple[list[Body], list[str]]:
    """Return buildings that neither overlap nor stand on the carriageway, and notes for people.

    Where two overlap, the higher one stays whole. Where a building spans a carriageway, it gets a passage; where it
    only reaches into it, its plan is trimmed.

    Args:
        bodies: The buildings.
        paved: What vehicles need [m]; None without lanes.
    """
    notes = []
    if paved is not None and not paved.is_empty:
        cleared = [_off_road(body, paved) for body in bodies]
        changed = sum(pieces != [body] for body, pieces in zip(bodies, cleared, strict=True))
        notes += [f"{changed} buildings reached over lanes: trimmed, or given a passage"] * bool(changed)
        bodies = [piece for pieces in cleared for piece in pieces]
    return _disjoint(bodies, notes), notes


def _off_road(body: Body, paved: shapely.Geometry) -> list[Body]:
    if body.bottom >= HEADROOM or not shapely.intersects(body.plan, paved):
        return [body]
    shared = intersect_areas(body.plan, paved).area
    if shared < OVERLAP:
        return [body]
    rest = _pieces(body, shapely.difference(body.plan, paved, grid_size=1e-3))
    if shared < LARGE or body.eaves < HEADROOM + ABOVE:
        return rest
    lower = [replace(piece, eaves=HEADROOM, rise=0.0, form="flat", storeys=1) for piece in rest]
    upper = replace(body, bottom=HEADROOM, name=f"{body.name}_over", storeys=max(1, body.storeys - 1))
    return [*lower, upper]


def _pieces(body: Body, area: shapely.Geometry) -> list[Body]:
    """Return a body on other plans; a roof that does not fit its new plan becomes flat."""
    kept = [p for p in polygons_of(area, MIN_AREA) if not shapely.is_empty(p.buffer(-THIN))]
    made = []
    for k, plan in enumerate(kept):
        plan = shapely.orient_polygons(shapely.remove_repeated_points(plan, 0.01))
        form = roof_form(body.form, plan)
        is_same = form == body.form
        eaves, rise = (body.eaves, body.rise) if is_same else (body.eaves + body.rise, 0.0)
        name = body.name if not k else f"{body.name}_{chr(ord('a') + (k - 1) % 26)}{(k - 1) // 26 or ''}"
        made.append(replace(body, plan=plan, name=name, form=form, eaves=eaves, rise=rise))
    return made


def _disjoint(bodies: list[Body], notes: list[str]) -> list[Body]:
    """Take what two buildings share from the lower one."""
    if len(bodies) < 2:
        return bodies
    plans = np.array([body.plan for body in bodies])
    first, second = shapely.STRtree(plans).query(plans, predicate="intersects")
    near: dict[int, list[int]] = {}
    rank = {k: r for r, k in enumerate(sorted(range(len(bodies)), key=lambda k: _order(bodies[k])))}
    for i, j in zip(first.tolist(), second.tolist(), strict=True):
        if rank[i] < rank[j]:
            near.setdefault(j, []).append(i)
    pieces: dict[int, list[Body]] = {k: [body] for k, body in enumerate(bodies)}
    changed = 0
    for j in sorted(near, key=lambda k: rank[k]):
        before = pieces[j]
        for i in sorted(near[j], key=lambda k: rank[k]):
            for whole in list(pieces[i]):
                pieces[j] = [left for piece in pieces[j] for left in _without(piece, whole)]
        changed += pieces[j] != before
    if changed:
        notes.append(f"{changed} buildings overlapped higher ones in plan; what they share was taken from them")
    return [piece for k in range(len(bodies)) for piece in pieces[k]]


def _order(body: Body) -> tuple[float, float, str]:
    return -(body.eaves + body.rise), -body.plan.area, body.name


def _without(body: Body, other: Body) -> Iterable[Body]:
    """Return a body less what it shares with a higher one."""
    top = body.eaves + body.rise
    if min(top, other.eaves + other.rise) - max(body.bottom, other.bottom) < 1e-3:
        return [body]
    if not shapely.intersects(body.plan, other.plan):
        return [body]
    if intersect_areas(body.plan, other.plan).area < OVERLAP:
        return [body]
    made = _pieces(body, shapely.difference(body.plan, other.plan, grid_size=1e-3))
    if other.bottom > body.bottom + 0.1:  # what lies below the higher one stays
        under = replace(body, eaves=other.bottom, rise=0.0, form="flat", name=f"{body.name}_under")
        made += _pieces(under, shapely.intersection(body.plan, other.plan, grid_size=1e-3))
    return made
