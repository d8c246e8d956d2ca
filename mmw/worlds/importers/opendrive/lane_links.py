"""Join the ends of lanes by the links of OpenDRIVE roads and junctions."""

from collections import defaultdict

from mmw.worlds.importers.opendrive.document import Document
from mmw.worlds.importers.opendrive.records import Connection, RoadRecord, Section

DRIVEN = (
    "driving", "entry", "exit", "onRamp", "offRamp", "connectingRamp", "slipLane", "HOV", "bus", "taxi",
    "bidirectional",
)  # fmt: skip
"""Lane types that vehicles drive on."""

End = tuple[str, str, int]
"""Road id, `start` or `end` of the road, lane number."""


def end_section(road: RoadRecord, contact: str) -> Section:
    """Return the lane section at the `start` or `end` of a road."""
    return road.sections[0 if contact == "start" else -1]


def find_joints(document: Document) -> dict[End, list[End]]:
    """Return the ends of driven lanes that meet, both ways. A link to a junction that is not there joins nothing.

    Roads that are too short to be built are left out: what they link meets directly.

    Raises:
        InputError: If the file is read strictly and a link names a road or lane that does not exist.
    """
    joints: dict[End, list[End]] = defaultdict(list)
    for road in document.roads.values():
        for contact, link in (("start", road.predecessor), ("end", road.successor)):
            if link is None or link.kind != "road":
                continue
            if link.target not in document.roads:
                _lose(document, f"{contact} of road {road.id!r} (to road {link.target!r})", link.target)
                continue
            for lane in end_section(road, contact).lanes.values():
                other = lane.predecessor if contact == "start" else lane.successor
                if lane.kind in DRIVEN and other is not None:
                    _join(document, joints, (road.id, contact, lane.number), (link.target, link.contact, other))
    for junction in document.junctions.values():
        for connection in junction.connections if junction.kind != "virtual" else ():
            roads = connection.incoming, connection.connecting
            if absent := [name for name in roads if name not in document.roads]:
                _lose(document, f"connection of junction {junction.id!r} (to road {absent[0]!r})", absent[0])
                continue
            contact = _incoming_end(document, junction.id, connection)
            if contact:
                for first, second in connection.lanes:
                    if end_section(document.roads[connection.incoming], contact).lanes.get(first) is not None:
                        ends = (
                            (connection.incoming, contact, first),
                            (connection.connecting, connection.contact, second),
                        )
                        _join(document, joints, *ends)
    for key in sorted(document.welded):
        _weld(document.roads[key], joints)
    return joints


def _lose(document: Document, element: str, target: str) -> None:
    """Note a link to a road that is not there, unless the road was left out, which has a note already."""
    if target not in document.lost:
        cure = "export the whole network, or remove the link"
        document.repair(element, "the link names a road that does not exist", "the link was left out", cure)


def _weld(road: RoadRecord, joints: dict[End, list[End]]) -> None:
    """Join what meets the start of each lane of a road to what meets its end, and take the road out."""
    passed = {}
    for number in road.sections[0].lanes:
        last: int | None = number
        for section in road.sections[:-1]:
            last = section.lanes[last].successor if last in section.lanes else None
        passed[number] = last
    for number, last in passed.items():
        before = joints.get((road.id, "start", number), [])
        after = [] if last is None else joints.get((road.id, "end", last), [])
        for one in before:
            for other in after:
                for first, second in ((one, other), (other, one)):
                    if second not in joints[first]:
                        joints[first].append(second)
    for end in [end for end in joints if end[0] == road.id]:
        for other in joints.pop(end):
            if end in joints.get(other, []):
                joints[other].remove(end)


def lost_junctions(document: Document) -> list[str]:
    """Return a note if roads are linked to junctions that the file does not have, as SUMO writes dead ends."""
    links = [link for road in document.roads.values() for link in (road.predecessor, road.successor)]
    lost = [link.target for link in links if link and link.kind != "road" and link.target not in document.junctions]
    if not lost:
        return []
    return [f"{len(lost)} roads end at junctions that the file does not have, such as {lost[0]!r}: dead ends"]


def _join(document: Document, joints: dict[End, list[End]], first: End, second: End) -> None:
    lanes = [end_section(document.roads[road], contact).lanes.get(lane) for road, contact, lane in (first, second)]
    if lanes[1] is None:
        document.repair(
            f"lane {first[2]} of road {first[0]!r} (to lane {second[2]} at the {second[1]} of road {second[0]!r})",
            "the link names a lane that does not exist", "the link was left out", "correct the lane link",
        )  # fmt: skip
        return
    if all(lane is not None and lane.kind in DRIVEN for lane in lanes):
        for one, other in ((first, second), (second, first)):
            if other not in joints[one]:
                joints[one].append(other)


def _incoming_end(document: Document, junction: str, connection: Connection) -> str:
    """Return which end of the incoming road lies at a connection: `start`, `end`, or empty if neither does."""
    road, connecting = document.roads[connection.incoming], document.roads[connection.connecting]
    link = connecting.predecessor if connection.contact == "start" else connecting.successor
    if link is not None and link.kind == "road" and link.target == road.id:
        return link.contact
    for contact, own in (("end", road.successor), ("start", road.predecessor)):
        if own is not None and own.kind == "junction" and own.target == junction:
            return contact
    return ""
