"""Link the lanes of successive lane sections where a file leaves the links out."""

from dataclasses import replace
from itertools import pairwise

from mmw.worlds.importers.opendrive.records import LaneRecord, RoadRecord, Section


def link_sections(road: RoadRecord) -> RoadRecord:
    """Return a road whose lanes are linked to those of the same number in the next lane section.

    That is done on a side of the road where neither section has any link to the other, and both have the same lanes.
    """
    sections = list(road.sections)
    for k, (before, after) in enumerate(pairwise(road.sections)):
        for side in (1, -1):
            one, two = _side(sections[k], side), _side(sections[k + 1], side)
            is_same = one.keys() == two.keys() and all(one[n].kind == two[n].kind for n in one)
            has_links = any(lane.successor for lane in one.values()) or any(lane.predecessor for lane in two.values())
            if not is_same or has_links or not one or before.end != after.start:
                continue
            forward = {n: replace(lane, successor=n) for n, lane in one.items()}
            back = {n: replace(lane, predecessor=n) for n, lane in two.items()}
            sections[k] = replace(sections[k], lanes=sections[k].lanes | forward)
            sections[k + 1] = replace(sections[k + 1], lanes=sections[k + 1].lanes | back)
    return road if tuple(sections) == road.sections else replace(road, sections=tuple(sections))


def _side(section: Section, side: int) -> dict[int, LaneRecord]:
    return {number: lane for number, lane in section.lanes.items() if number * side > 0}
