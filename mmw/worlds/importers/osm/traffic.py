"""Lanes of an OpenStreetMap extract, by way of SUMO's netconvert."""

from dataclasses import dataclass

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.worlds.importers.osm.crossings import hold_before_crossings
from mmw.worlds.importers.osm.driving_side import tell_driving_side
from mmw.worlds.importers.osm.feature import Extract
from mmw.worlds.importers.osm.roads import road_elements
from mmw.worlds.importers.sumo.lanes import build_lanes
from mmw.worlds.importers.sumo.netconvert import convert_roads
from mmw.worlds.importers.sumo.plan import plan_roads


@dataclass(frozen=True)
class Roads:
    """Roads with lanes."""

    lanes: LaneGraph
    areas: dict[str, shapely.Geometry]
    """`paved`, `raised` and `paint` in plan."""
    crossings: list[np.ndarray]
    """Center lines of crossings with stripes [m], each of shape [N, 2]."""
    is_left_hand: bool
    notes: list[str]


def build_roads(extract: Extract, driving_side: str) -> Roads:
    """Return the roads of an extract.

    Args:
        extract: The extract.
        driving_side: `left` or `right`; empty to tell it from the extract and its place.

    Raises:
        InputError: If there is no road that cars may use.
        MissingPackageError: If netconvert is missing.
    """
    side, source = tell_driving_side(extract, driving_side)
    elements, levels = road_elements(extract)
    if elements.find("way") is None:
        raise InputError(
            f"{extract.path}: has no road that cars may use, so there is no traffic; choose another area, or import it "
            "without --traffic"
        )
    network = convert_roads(elements, is_left_hand=side == "left")
    crossings = [lane.points for e in network.edges.values() if e.function == "crossing" for lane in e.lanes[:1]]
    held = hold_before_crossings(network, extract, crossings)
    graph, notes = build_lanes(network, held)
    if not graph.lanes:
        raise InputError(
            f"{extract.path}: netconvert keeps none of its roads; choose a larger area, or import it without --traffic"
        )
    plan = plan_roads(network, graph, held)
    lit = {lane.junction for lane in graph.lanes.values() if lane.signal}
    notes = [
        f"vehicles drive on the {side} ({source}); driving_side=left or right changes it",
        f"{len(lit)} junctions with traffic lights, {len(crossings)} crossings at junctions",
        *levels,
        *notes,
    ]
    areas = {"paint": plan["paint"], "paved": plan["paved"], "raised": plan["walk"]}
    return Roads(graph, areas, crossings, side == "left", notes)
