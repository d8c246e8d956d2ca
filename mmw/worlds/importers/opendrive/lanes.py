"""Driving lanes of an OpenDRIVE file as a lane graph.

The lanes of one side of a road are joined across lane sections as long as they go on one to one; where a lane begins
or ends, all lanes of that side are cut. So lanes beside each other have the same extent.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.worlds.checks.lane_graph import misfit
from mmw.worlds.importers.mesh_cleanup import identifier
from mmw.worlds.importers.opendrive.cross_section import RoadShape
from mmw.worlds.importers.opendrive.crossings import join_crossings
from mmw.worlds.importers.opendrive.curbs import Sheets
from mmw.worlds.importers.opendrive.document import Document
from mmw.worlds.importers.opendrive.lane_links import DRIVEN, End, find_joints, lost_junctions
from mmw.worlds.importers.opendrive.records import LaneRecord, Section
from mmw.worlds.importers.opendrive.road_surface import mark_spans
from mmw.worlds.lane_reach import ahead, behind, partition, reach
from mmw.worlds.towns.plan_geometry import row_stations
from mmw.worlds.towns.turn_lanes import RANK, STRAIGHT

STEP = 1.0
"""Largest distance of the points of a lane on an ordinary road [m]; half of it in junctions; design value."""
DEFAULT_SPEED = 50 / 3.6
"""Speed limit where the file gives none [m/s]; design value, the limit in towns of most countries."""
MAX_GAP = 0.5
"""Linked ends of lanes are moved together over gaps up to this [m]."""
BACK = np.radians(150)
"""A lane through a junction that turns by more than this is a U-turn [rad]; design value."""
MIN_WIDTH = 2.0
"""Vehicles drive where a lane is at least this wide [m]; design value, the width of a car with its mirrors."""
FADE = 10.0
"""Length over which the end of a lane is moved [m]; design value."""


@dataclass(frozen=True)
class Chain:
    """A lane through successive lane sections of one road."""

    name: str
    shape: RoadShape
    first: int
    """Index of the first lane section, in the direction of the road."""
    numbers: tuple[int, ...]
    """Lane number in every section."""
    is_forward: bool
    """Whether vehicles drive in the direction of the road."""

    @property
    def stretch(self) -> list[tuple[Section, LaneRecord]]:
        """Sections and records along the road."""
        sections = self.shape.road.sections[self.first :]
        return [(section, section.lanes[number]) for section, number in zip(sections, self.numbers, strict=False)]


def build_lanes(
    document: Document, shapes: Mapping[str, RoadShape], names: Mapping[str, str], sheets: Sheets
) -> tuple[LaneGraph | None, list[str]]:
    """Return the lane graph, None if the file has no driving lane, and notes for people.

    Raises:
        InputError: If the file is read strictly, and a link names what does not exist, or lanes that are linked end
            more than 0.5 m apart.
    """
    chains = [chain for key, shape in shapes.items() for chain in _chains(shape, names[key])]
    courses = {chain.name: _course(chain) for chain in chains}
    narrow = [chain.name for chain in chains if not courses[chain.name].points.size]
    chains = [chain for chain in chains if courses[chain.name].points.size]
    if not chains:
        return None, ["no driving lanes: vehicles cannot drive here"]
    notes = lost_junctions(document)
    if narrow:
        notes.append(f"{len(narrow)} lanes narrower than {MIN_WIDTH:g} m left out: {_list(narrow)}")
    place = {}  # road id, section, lane number -> chain
    for chain in chains:
        for k, number in enumerate(chain.numbers):
            place[chain.shape.road.id, chain.first + k, number] = chain
    joints, last = find_joints(document), {key: len(road.sections) - 1 for key, road in document.roads.items()}
    links = {chain.name: _successors(chain, place, joints, last) for chain in chains}
    cut = {name for name in links if courses[name].ends_early}
    late = {name for name in links if courses[name].starts_late}
    for name in links:
        links[name] = [] if name in cut else [other for other in links[name] if other not in late]
    if shortened := sorted(cut | late):
        notes.append(f"{len(shortened)} lanes end or begin where they are {MIN_WIDTH:g} m wide: {_list(shortened)}")
    points = {name: courses[name].points for name in links}
    junctions = {chain.name: chain.shape.road.junction for chain in chains}
    unfit = _unfit_u_turns(points, links, junctions)
    if unfit:
        chains = [chain for chain in chains if chain.name not in unfit]
        links = {chain.name: [other for other in links[chain.name] if other not in unfit] for chain in chains}
        notes.append(f"{len(unfit)} U-turns left out, over {MAX_GAP} m from what they link: {_list(unfit)}")
    dropped = _join_ends(document, points, links, junctions, {c.name: c for c in chains})
    if dropped:
        notes.append(f"{dropped} links between lanes that lie side by side were left out")
    for name, line in points.items():
        z = sheets.nearest(line)
        line[:, 2] = np.where(np.isnan(z), line[:, 2], z)
        points[name] = line
    for name, following in links.items():
        for other in following:
            points[name][-1] = points[other][0]  # the same point in plan; heights differ by less than a micrometer
    limits = {chain.name: _speed(chain) for chain in chains}
    if count := sum(limit == 0.0 for limit in limits.values()):
        notes.append(f"{count} of {len(chains)} lanes have no speed limit; {DEFAULT_SPEED * 3.6:.0f} km/h assumed")
    first = {high for junction in document.junctions.values() for high, _ in junction.priorities}
    lanes, ranks = {}, {}
    for chain in chains:
        left, right = _beside(chain, place)
        junction = chain.shape.road.junction
        rank = 10 * (1 + (chain.shape.road.id in first)) + _rank(points[chain.name], chain.shape.road.is_left_hand)
        ranks[chain.name] = rank
        lanes[chain.name] = Lane(
            chain.name,
            points[chain.name],
            courses[chain.name].width,
            limits[chain.name] or DEFAULT_SPEED,
            identifier(f"junction_{junction}") if junction else "",
            rank if junction else 0,
            tuple(sorted(links[chain.name])),
            "" if junction else left,
            "" if junction else right,
        )
    lanes, crossings = join_crossings(_true_neighbors(lanes), ranks)
    graph = LaneGraph(lanes)
    return graph, [*notes, *crossings, *describe_graph(graph)]


def _true_neighbors(lanes: dict[str, Lane]) -> dict[str, Lane]:
    """Return the lanes without neighbors that do not lie beside them."""

    def keep(lane: Lane, side: str) -> str:
        name = lane.left if side == "left" else lane.right
        if not name or misfit(lane, lanes[name], side):
            return ""
        return "" if misfit(lanes[name], lane, "right" if side == "left" else "left") else name

    return {name: replace(lane, left=keep(lane, "left"), right=keep(lane, "right")) for name, lane in lanes.items()}


def _chains(shape: RoadShape, name: str) -> list[Chain]:
    sections, found = shape.road.sections, []
    for side in (1, -1):
        start = 0
        for k in range(1, len(sections) + 1):
            if k < len(sections) and _continues(sections[k - 1], sections[k], side):
                continue
            for number in sorted(_driven(sections[start], side), key=abs):
                numbers = [number]
                for section in sections[start : k - 1]:
                    numbers.append(section.lanes[numbers[-1]].successor or 0)
                forward = (side < 0) != shape.road.is_left_hand
                forward ^= sections[start].lanes[number].reversed
                label = f"{name}_s{start}_{'l' if side > 0 else 'r'}{abs(number)}"
                found.append(Chain(label, shape, start, tuple(numbers), forward))
            start = k
    return found


def _driven(section: Section, side: int) -> set[int]:
    return {n for n, lane in section.lanes.items() if n * side > 0 and lane.kind in DRIVEN}


def _continues(before: Section, after: Section, side: int) -> bool:
    """Whether the driving lanes of a side go on one to one from a lane section to the next."""
    onward = {number: before.lanes[number].successor for number in _driven(before, side)}
    targets = _driven(after, side)
    return (
        set(onward.values()) == targets
        and len(onward) == len(targets)
        and all(after.lanes[b].predecessor in (a, None) for a, b in onward.items() if b is not None)
    )


def _successors(
    chain: Chain,
    place: Mapping[tuple[str, int, int], Chain],
    joints: Mapping[End, list[End]],
    last_section: Mapping[str, int],
) -> list[str]:
    """Names of the lanes that begin where a lane ends."""
    road, last = chain.shape.road, chain.first + len(chain.numbers) - 1
    section, number = (last, chain.numbers[-1]) if chain.is_forward else (chain.first, chain.numbers[0])
    following = section + (1 if chain.is_forward else -1)
    found = []
    if 0 <= following < len(road.sections):
        record = road.sections[section].lanes[number]
        target = record.successor if chain.is_forward else record.predecessor
        other = place.get((road.id, following, target or 0))
        if other is not None and other.is_forward == chain.is_forward:
            found.append(other.name)
        return found
    for target, contact, lane in joints.get((road.id, "end" if chain.is_forward else "start", number), []):
        other = place.get((target, 0 if contact == "start" else last_section[target], lane))
        if other is not None and other.is_forward == (contact == "start"):
            found.append(other.name)
    return found


@dataclass(frozen=True)
class Course:
    """The part of a lane that is wide enough for vehicles, in driving direction."""

    points: np.ndarray
    """Center line [m], shape [N, 3]; none if no part is."""
    width: float
    """Least width in plan [m]: a banked lane is narrower from above."""
    starts_late: bool
    """Whether it begins behind the start of the lane."""
    ends_early: bool
    """Whether it ends before the end of the lane."""


def _course(chain: Chain) -> Course:
    """Return the longest part of a lane that is nowhere narrower than `MIN_WIDTH`."""
    step = STEP * (0.5 if chain.shape.road.junction else 1.0)
    rows, widths = [], []
    for k, (section, lane) in enumerate(chain.stretch):
        count = max(2, int(np.ceil((section.end - section.start) / step)) + 1)
        s = np.linspace(section.start, section.end, count)[1 if k else 0 :]
        inner, outer = chain.shape.borders(section, s)[lane.number]
        rows.append(chain.shape.place(s, 0.5 * (inner + outer)))
        widths.append(np.abs(outer - inner) * np.cos(chain.shape.road.superelevation.at(s)))
    points, width = np.concatenate(rows), np.concatenate(widths)
    if not chain.is_forward:
        points, width = points[::-1].copy(), width[::-1]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], width >= MIN_WIDTH - 1e-6, [False]]))).reshape(-1, 2)
    station = row_stations(points)
    runs = [(station[stop - 1] - station[start], start, stop) for start, stop in edges.tolist() if stop - start > 1]
    if not runs:
        return Course(np.zeros((0, 3)), 0.0, False, False)
    _, start, stop = max(runs, key=lambda run: (run[0], -run[1]))
    least = float(np.floor(1e4 * width[start:stop].min()) / 1e4)
    return Course(points[start:stop], least, start > 0, stop < len(points))


def _speed(chain: Chain) -> float:
    """Lowest speed limit along a lane [m/s]; 0 if there is none."""
    found = []
    for section, lane in chain.stretch:
        table = lane.speeds or chain.shape.road.speeds
        ends = [*(s for s, _ in table[1:]), np.inf]
        found += [v for (s, v), end in zip(table, ends, strict=False) if s < section.end and end > section.start]
    return min(found, default=0.0)


def _rank(points: np.ndarray, is_left_hand: bool) -> int:
    """Rank of a lane through a junction: straight on before turns, the near turn before the one across traffic."""
    step = np.diff(points[:, :2], axis=0)
    heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    turn = float(heading[-1] - heading[0]) * (-1 if is_left_hand else 1)
    if abs(turn) < STRAIGHT:
        return RANK["straight"]
    if abs(turn) > BACK:
        return RANK["back"]
    return RANK["left" if turn > 0 else "right"]


def _beside(chain: Chain, place: Mapping[tuple[str, int, int], Chain]) -> tuple[str, str]:
    """Names of the lanes to the left and to the right that vehicles may change to; empty for none."""
    found = {}
    for step in (1, -1):  # in lane numbers, which grow to the left of the road
        number = chain.numbers[0] + step
        other = place.get((chain.shape.road.id, chain.first, number))
        is_beside = other is not None and other.is_forward == chain.is_forward and number * chain.numbers[0] > 0
        side = "left" if (step > 0) == chain.is_forward else "right"
        found[side] = other.name if is_beside and other is not None and _may_change(chain, step) else ""
    return found["left"], found["right"]


def _may_change(chain: Chain, step: int) -> bool:
    """Whether the paint lets vehicles cross to the lane beside over more than half of the length."""
    allowed = total = 0.0
    for section, lane in chain.stretch:
        outward = step * lane.number > 0
        owner = lane if outward else section.lanes[lane.number + step]
        total += section.end - section.start
        covered = 0.0
        for mark, end in mark_spans(owner, section):
            length = end - mark.start
            covered += length
            permitted = mark.kind != "solid" and "solid solid" not in mark.kind
            if mark.change:  # increase: to the lane with the larger number
                permitted = mark.change == "both" or mark.change == ("increase" if step > 0 else "decrease")
            allowed += length * permitted
        allowed += section.end - section.start - covered
    return allowed > 0.5 * total


def _unfit_u_turns(
    points: Mapping[str, np.ndarray], links: Mapping[str, list[str]], junctions: Mapping[str, str]
) -> list[str]:
    """Return the U-turns that do not fit their links; SUMO gives these a shape of few corners."""
    gaps: dict[str, float] = {}
    turns: dict[str, list[np.ndarray]] = {}
    for name, following in links.items():
        for other in following:
            gap = float(np.linalg.norm(points[other][0] - points[name][-1]))
            for inner, outer in ((name, points[other][:2]), (other, points[name][-2:])):
                if junctions[inner] and gap > gaps.get(inner, 0.0):
                    gaps[inner] = gap
                if junctions[inner]:
                    turns.setdefault(inner, []).append(np.diff(outer[:, :2], axis=0)[0])
    found = []
    for name in sorted(gaps):
        steps = [step / np.linalg.norm(step) for step in turns[name]]
        if gaps[name] > MAX_GAP and min(float(a @ b) for a in steps for b in steps) < np.cos(BACK):
            found.append(name)
    return found


def _join_ends(
    document: Document,
    points: dict[str, np.ndarray],
    links: dict[str, list[str]],
    junctions: Mapping[str, str],
    chains: Mapping[str, Chain],
) -> int:
    """Move the ends of linked lanes together, drop links to the side within a road, and return how many."""
    dropped = 0
    for name in sorted(links):
        for other in list(links[name]):
            gap = points[other][0] - points[name][-1]
            size = float(np.linalg.norm(gap))
            if size > MAX_GAP and chains[name].shape is chains[other].shape:
                links[name].remove(other)
                dropped += 1
            elif size > MAX_GAP:
                x, y, z = points[name][-1]
                links[name].remove(other)
                document.repair(
                    f"lane {name} (ends at ({x:.2f}, {y:.2f}, {z:.2f}), {size:.2f} m from lane {other})",
                    f"the lanes are linked and lie over {MAX_GAP} m apart", "the link was left out",
                    "correct the link or the shape of the road",
                )  # fmt: skip
            elif size > 0:
                if junctions[name] and not junctions[other]:
                    _move(points[name], -1, gap)
                else:
                    _move(points[other], 0, -gap)
    for name, following in links.items():
        for other in list(following):
            gap = float(np.linalg.norm(points[other][0] - points[name][-1]))
            if gap > 0.01:
                following.remove(other)
                document.repair(
                    f"lane {name} ({gap:.3f} m from lane {other})", "lanes with different ends are linked at one place",
                    "the link was left out", "let the roads end at one place",
                )  # fmt: skip
    return dropped


def _move(points: np.ndarray, end: int, shift: np.ndarray) -> None:
    """Move one end of a line, in place, and the points near it less and less."""
    station = row_stations(points)
    away = station if end == 0 else station[-1] - station
    part = np.clip(1 - away / min(FADE, 0.5 * station[-1]), 0.0, 1.0)
    points += (part * part * (3 - 2 * part))[:, None] * shift


def describe_graph(graph: LaneGraph) -> list[str]:
    """Return notes on lanes that lead nowhere, and on parts of the graph that hang together with no other."""
    notes = []
    ends = sorted(name for name, lane in graph.lanes.items() if not lane.successors)
    starts = sorted(name for name, before in graph.predecessors.items() if not before)
    for names, verb in ((ends, "lead nowhere"), (starts, "come from nowhere")):
        notes += [f"{len(names)} lanes {verb}: {_list(names)}"] * bool(names)
    parts = partition(graph, lambda name: reach(name, ahead(graph), behind(graph)))
    if len(parts) > 1:
        rest = "; ".join(f"{len(part)} with {part[0]}" for part in parts[1:6])
        notes.append(f"the lane graph falls into {len(parts)} parts: {len(parts[0])} lanes with {parts[0][0]}; {rest}")
    return notes


def _list(names: list[str]) -> str:
    return ", ".join(names[:6]) + (", ..." if len(names) > 6 else "")
