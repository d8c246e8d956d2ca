"""Check the road under the lanes and the space over them: holes, grades, headroom, obstacles."""

import numpy as np

from mmw.traffic.ground_height import Ground
from mmw.traffic.roads.lane_graph import Lane
from mmw.traffic.roads.town_asset import DRIVABLE_LABELS
from mmw.worlds.checks.box_pairs import box_pairs, clip
from mmw.worlds.checks.findings import Finding, as_place, does_not_apply, listed, merge_spots
from mmw.worlds.checks.stage_model import StageModel

MAX_GRADE = 0.20
"""Largest grade of a lane [-]; the limit that towns are built with; steeper ones are warned of."""

STEEPEST = 0.35
"""No street is steeper [-]. Source: Baldwin Street, Dunedin, the steepest one, 34.8 %, Guinness World Records, 2020."""

ALONG_M = 0.5
"""Distance between cross-sections that are probed [m]."""

ACROSS_M = 0.25
"""Distance between probes across a lane [m]."""

SEAM_REACH_M = 0.2
"""How far around the ends of a lane the finer probes reach [m]."""

SEAM_STEP_M = 0.01
"""Distance between the finer probes [m]."""

HEIGHT_M = 0.02
"""Largest distance between a lane and the road under it [m]; design value, what a wheel would feel as a step."""

CAMBER = 0.04
"""Cross slope that a road may have to both sides of a lane [-]; design value, over the 2.5 % that drains a straight
road. A slope to one side is a bank."""

MAX_BANK = 0.12
"""Largest bank (superelevation) of a highway [-]; steeper ones are warned of.

Source: 0.04 to 0.12 by AASHTO, as Abdulhafedh, Journal of City and Development 1(1), 2019, section 1, cites it."""

STEEPEST_BANK = 0.65
"""No road that cars drive at any speed is banked more [-]: 33 degrees, the turns of Talladega Superspeedway."""

HALF_SWEPT_M = 1.25
"""Half the width that a vehicle sweeps [m]: half of 2.5 m, the widest vehicle that is allowed everywhere in Europe.

Source: Council Directive 96/53/EC, annex I, 1.2 (2.55 m)."""

LOW_M = 0.3
"""Lower end of the swept volume [m]: what is lower passes under a bumper; kerbs are."""

HIGH_M = 2.5
"""Height up to which an object is an obstacle [m]; above, it reduces the headroom."""

HEADROOM_M = 4.5
"""Least clearance above a lane [m]: what trucks are given on European roads."""

EDGE_M = 0.05
"""A road lane is probed to this far inside of its borders [m]."""


def road_findings(model: StageModel) -> list[Finding]:
    """Return holes in the road, grades, headroom and obstacles."""
    if model.lanes is None:
        return [does_not_apply(rule, "no lanes") for rule in ("holes", "grade", "clearance", "obstacles")]
    found = [finding for lane in model.lanes.lanes.values() for finding in _grade(lane)]
    banks = [np.zeros(2)] * len(model.lanes.lanes)
    if not len(model.drivable):
        text = f"no mesh has the class {' or '.join(DRIVABLE_LABELS)}, but there are lanes"
        found.append(Finding("error", "holes", "", text, "label the road meshes, so wheels find them"))
    else:
        more, banks = _holes(model)
        found += more
    return found + _obstructions(model, banks)


def _grade(lane: Lane) -> list[Finding]:
    step = np.diff(lane.points, axis=0)
    grade = np.abs(step[:, 2]) / np.maximum(np.hypot(step[:, 0], step[:, 1]), 1.0e-6)
    steep = np.flatnonzero(grade > MAX_GRADE)
    if not len(steep):
        return []
    k = int(np.argmax(grade))
    text = f"grade {grade[k]:.3f}; more than {MAX_GRADE:.2f} on {len(steep)} segments"
    severity = "error" if grade[k] > STEEPEST else "warning"
    return [Finding(severity, "grade", f"lane {lane.name}", text, "lengthen the slope", as_place(lane.points[k]))]


def probes(lane: Lane, *, is_joined: tuple[bool, bool] = (True, True)) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where a lane needs a road.

    The columns are points at the height of the lane's middle [m], shape [R, 3]; how far to the left of the middle they
    lie [m], shape [R]; and their cross-sections, numbers from 0, shape [R].

    Where no other lane joins its start or its end, the road ends there too, so it is probed to a little inside only.
    """
    half = lane.width / 2.0 - EDGE_M if not lane.junction else min(lane.width / 2.0 - EDGE_M, HALF_SWEPT_M)
    count = max(int(np.ceil(lane.length / ALONG_M)), 1)
    along = np.linspace(0.0, lane.length, count + 1)
    across = np.linspace(-half, half, 2 * max(int(np.ceil(half / ACROSS_M)), 1) + 1)
    fine = np.arange(SEAM_STEP_M, SEAM_REACH_M, SEAM_STEP_M)
    fine = fine[fine < lane.length]
    seam = np.concatenate([fine, lane.length - fine])
    row = np.concatenate(
        [np.repeat(np.arange(len(along)), len(across)), len(along) + np.repeat(np.arange(len(seam)), 5)]
    )
    stations = np.concatenate([along, seam])[row]
    offset = np.concatenate([np.tile(across, len(along)), np.tile(np.linspace(-half, half, 5), len(seam))])
    first, last = (0.0 if joined else min(EDGE_M, lane.length / 2.0) for joined in is_joined)
    stations = np.clip(stations, first, lane.length - last)
    point = np.stack([np.interp(stations, lane.station, lane.points[:, k]) for k in range(3)], axis=1)
    segment = np.clip(np.searchsorted(lane.station, stations, "right") - 1, 0, len(lane.points) - 2)
    heading = lane.headings[segment]
    point[:, 0] -= np.sin(heading) * offset
    point[:, 1] += np.cos(heading) * offset
    return point, offset, row


def _holes(model: StageModel) -> tuple[list[Finding], list[np.ndarray]]:
    """Return findings, and for every lane the bank at equal distances from its start to its end."""
    assert model.lanes is not None
    lanes = list(model.lanes.lanes.values())
    before = model.lanes.predecessors
    each = [probes(lane, is_joined=(bool(before[lane.name]), bool(lane.successors))) for lane in lanes]
    point, offset = (np.concatenate([columns[k] for columns in each]) for k in (0, 1))
    owner = np.repeat(np.arange(len(lanes)), [len(points) for points, _, _ in each])
    first = np.cumsum([0, *(rows.max() + 1 for _, _, rows in each)])
    section = np.concatenate([start + rows for start, (_, _, rows) in zip(first[:-1], each, strict=True)])
    ground = Ground(model.mesh.points, model.mesh.faces[model.drivable])
    off = ground.heights(point) - point[:, 2]
    limit = HEIGHT_M + CAMBER * np.abs(offset)
    bank = _banks(off, offset, section, np.isnan(off) | (np.abs(off) > limit))
    tilted = point + np.column_stack([np.zeros((len(point), 2)), bank * offset])
    again = np.flatnonzero(np.isnan(off) & (bank != 0.0))  # the road may lie beyond the reach of the first look
    if len(again):
        off[again] = ground.heights(tilted[again]) - point[again, 2]
    is_hole = np.isnan(off)
    is_step = ~is_hole & (np.abs(off) > limit) & (np.abs(off - bank * offset) > limit)
    findings = []
    for rule, rows in (("holes", np.flatnonzero(is_hole)), ("height", np.flatnonzero(is_step))):
        for spot in merge_spots(point[rows]):
            chosen = rows[spot]
            low, high = point[chosen].min(axis=0), point[chosen].max(axis=0)
            shown = listed(dict.fromkeys(lanes[k].name for k in owner[chosen]))
            place = as_place(point[chosen[np.argmin(np.linalg.norm(point[chosen] - (low + high) / 2, axis=1))]])
            size = f"{len(chosen)} probes within {high[0] - low[0]:.1f} x {high[1] - low[1]:.1f} m"
            if rule == "holes":
                text, cure = f"no road under {size}", "close the hole, or move the lane onto the road"
            else:
                worst = chosen[np.argmax(np.abs(off[chosen]))]
                text = f"the road lies {100.0 * off[worst]:+.1f} cm off the lane at {size}"
                cure = "lay the lane on the road; its points are on the surface"
                place = as_place(point[worst])
            findings.append(Finding("error", rule, f"lane {shown}", text, cure, place))
    for k in np.unique(owner[np.abs(bank) > MAX_BANK]):
        rows = np.flatnonzero(owner == k)
        row = rows[np.argmax(np.abs(bank[rows]))]
        text = f"bank {abs(bank[row]):.3f}; highways have up to {MAX_BANK:.2f}"
        cure = "lower the superelevation"
        findings.append(Finding("warning", "bank", f"lane {lanes[k].name}", text, cure, as_place(point[row])))
    one = bank[np.unique(section, return_index=True)[1]]  # of every cross-section
    counts = [max(int(np.ceil(lane.length / ALONG_M)), 1) + 1 for lane in lanes]
    return findings, [one[start : start + count] for start, count in zip(first[:-1], counts, strict=True)]


def _banks(off: np.ndarray, offset: np.ndarray, section: np.ndarray, is_off: np.ndarray) -> np.ndarray:
    """Return the slope of the road to one side at every probe [-], shape [R]; 0 where no probe of its section is off.

    It is the median of the slopes between the middle of the lane and the probes of a cross-section, so what lies under
    a few of them only, as a kerb, is none. Beyond `STEEPEST_BANK` it is 0, too.

    Args:
        off: Height of the road above the lane [m], NaN where there is none.
        offset: Distance of the probes to the left of the middle [m].
        section: Number of their cross-section.
        is_off: Whether the road is missing, or not at the height of the lane.
    """
    bank = np.zeros(len(off))
    order = np.argsort(section, kind="stable")
    wanted = np.unique(section[is_off])
    low, high = (np.searchsorted(section[order], wanted, side) for side in ("left", "right"))
    for start, stop in zip(low.tolist(), high.tolist(), strict=True):
        rows = order[start:stop]
        known = rows[np.isfinite(off[rows]) & (offset[rows] != 0.0)]
        slope = float(np.median(off[known] / offset[known])) if len(known) else 0.0
        bank[rows] = slope if abs(slope) <= STEEPEST_BANK else 0.0
    return bank


def _obstructions(model: StageModel, banks: list[np.ndarray]) -> list[Finding]:
    """Cut every triangle near a lane by the volume that vehicles sweep, segment by segment.

    The volume leans with the road: `banks` are those of every lane at equal distances [-].
    """
    assert model.lanes is not None
    lanes = list(model.lanes.lanes.values())
    start = np.concatenate([lane.points[:-1] for lane in lanes])
    step = np.concatenate([np.diff(lane.points, axis=0) for lane in lanes])
    owner = np.repeat(np.arange(len(lanes)), [len(lane.points) - 1 for lane in lanes])
    length = np.linalg.norm(step[:, :2], axis=1)
    middle = [(lane.station[:-1] + lane.station[1:]) / (2.0 * lane.length) for lane in lanes]
    lean = np.concatenate([np.interp(m, np.linspace(0.0, 1.0, len(b)), b) for m, b in zip(middle, banks, strict=True)])
    kept = length > 1.0e-6
    start, step, owner, length, lean = start[kept], step[kept], owner[kept], length[kept], lean[kept]
    rise = (HALF_SWEPT_M * np.abs(lean))[:, None] * (0.0, 0.0, 1.0)
    low = np.minimum(start, start + step) - rise - (HALF_SWEPT_M, HALF_SWEPT_M, -LOW_M)
    high = np.maximum(start, start + step) + rise + np.array((HALF_SWEPT_M, HALF_SWEPT_M, HEADROOM_M))
    faces = model.faces_where(not part.is_moving for part in model.parts)
    corners = model.mesh.corners[faces]
    is_road = np.array([part.label in DRIVABLE_LABELS for part in model.parts], dtype=bool)[model.part_of[faces]]
    found = []
    for i, j in box_pairs(low, high, corners.min(axis=1), corners.max(axis=1)):
        forward = step[i, :2] / length[i, None]
        away = corners[j] - start[i, None]
        s = np.einsum("pcx,px->pc", away[..., :2], forward)
        side = away[..., 1] * forward[:, None, 0] - away[..., 0] * forward[:, None, 1]
        up = away[..., 2] - s * (step[i, 2] / length[i])[:, None] - side * lean[i, None]
        local = np.stack([s, side, up], axis=2)
        bottom = np.where(is_road[j], HIGH_M, LOW_M)
        near = (local[..., 1].min(axis=1) < HALF_SWEPT_M) & (local[..., 1].max(axis=1) > -HALF_SWEPT_M)
        near &= (local[..., 2].max(axis=1) > bottom) & (local[..., 2].min(axis=1) < HEADROOM_M)
        i, j, polygon, bottom = i[near], j[near], local[near], bottom[near]
        count = np.full(len(i), 3)
        for normal, offset in (
            ((-1, 0, 0), 0.0), ((1, 0, 0), length[i]), ((0, -1, 0), HALF_SWEPT_M), ((0, 1, 0), HALF_SWEPT_M),
            ((0, 0, -1), -bottom), ((0, 0, 1), HEADROOM_M),
        ):  # fmt: skip
            polygon, count = clip(polygon, count, np.array(normal, dtype=float), offset)
        left = np.flatnonzero(count > 0)
        z = np.where(np.arange(polygon.shape[1]) < count[left, None], polygon[left, :, 2], np.inf)
        lowest = np.argmin(z, axis=1)
        at = polygon[left, lowest]
        segment = i[left]
        ahead = step[segment, :2] / length[segment, None]
        place = start[segment].copy()
        place[:, :2] += at[:, :1] * ahead + at[:, 1:2] * np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
        place[:, 2] += at[:, 0] * step[segment, 2] / length[segment] + at[:, 1] * lean[segment] + at[:, 2]
        found.append((segment, faces[j[left]], at[:, 2], np.abs(at[:, 1]), place))
    if not found:
        return []
    segment, face, height, offset, place = (np.concatenate(column) for column in zip(*found, strict=True))
    return _by_prim(model, [lanes[k] for k in owner[segment]], model.part_of[face], height, offset, place)


def _by_prim(
    model: StageModel, lanes: list[Lane], part: np.ndarray, height: np.ndarray, offset: np.ndarray, place: np.ndarray
) -> list[Finding]:
    """Return one finding for every prim that is an obstacle or reduces the headroom; all arrays [hits]."""
    findings = []
    for k in np.unique(part):
        rows = np.flatnonzero((part == k) & (height < HIGH_M))
        is_obstacle = len(rows) > 0
        rows = rows if is_obstacle else np.flatnonzero(part == k)
        row = rows[np.argmin(offset[rows] if is_obstacle else height[rows])]
        shown = listed(sorted({lanes[r].name for r in rows}))
        if is_obstacle:
            text = f"stands in the way of lane {shown}: {offset[row]:.2f} m from its middle, {height[row]:.2f} m up"
            cure = f"keep {HALF_SWEPT_M} m on each side of a lane free, from {LOW_M} m to {HIGH_M} m"
        else:
            text = f"leaves {height[row]:.2f} m above lane {shown}"
            cure = f"{HEADROOM_M} m are needed; raise it or lower the road"
        rule = "obstacles" if is_obstacle else "clearance"
        findings.append(Finding("error", rule, model.parts[k].path, text, cure, as_place(place[row])))
    return findings
