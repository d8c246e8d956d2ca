"""Join the ends of lanes by the links of OpenDRIVE roads and junctions."""

from collections import defaultdict

from mmw.core.errors import InputError
from mmw.worlds.importers.opendrive.records import Connection, Document, RoadRecord, Section

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

    Raises:
        InputError: If a link names a road or lane that does not exist.
    """
    joints: dict[End, list[End]] = defaultdict(list)
    for road in document.roads.values():
        for contact, link in (("start", road.predecessor), ("end", road.successor)):
            if link is None or link.kind != "road":
                continue
            if link.target not in document.roads:
                raise InputError(
                    f"{document.path}: road {road.id!r}: its {contact} is linked to road {link.target!r}, which "
                    "does not exist; export the whole network, or remove the link"
                )
            for lane in end_section(road, contact).lanes.values():
                other = lane.predecessor if contact == "start" else lane.successor
                if lane.kind in DRIVEN and other is not None:
                    _join(document, joints, (road.id, contact, lane.number), (link.target, link.contact, other))
    for junction in document.junctions.values():
        for connection in junction.connections if junction.kind != "virtual" else ():
            where = f"{document.path}: junction {junction.id!r}"
            for name in (connection.incoming, connection.connecting):
                if name not in document.roads:
                    raise InputError(
                        f"{where}: a connection names road {name!r}, which does not exist; export the whole network"
                    )
            contact = _incoming_end(document, junction.id, connection)
            if contact:
                for first, second in connection.lanes:
                    if end_section(document.roads[connection.incoming], contact).lanes.get(first) is not None:
                        ends = (
                            (connection.incoming, contact, first),
                            (connection.connecting, connection.contact, second),
                        )
                        _join(document, joints, *ends)
    return joints


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
        raise InputError(
            f"{document.path}: road {first[0]!r}: lane {first[2]} is linked to lane {second[2]} at the {second[1]} of "
            f"road {second[0]!r}, which does not exist; correct the lane link"
        )
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
