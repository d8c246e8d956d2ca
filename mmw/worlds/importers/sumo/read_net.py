"""SUMO network (.net.xml) -> scene: roads, sidewalks, paint and lanes on flat ground."""

from pathlib import Path

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.importers.mesh_cleanup import MAX_COORDINATE_M
from mmw.worlds.importers.osm.ground import MARGIN, GroundPlan, build_ground
from mmw.worlds.importers.sumo.lanes import build_lanes
from mmw.worlds.importers.sumo.network import Network, read_network
from mmw.worlds.importers.sumo.plan import plan_roads


def read_net(path: str | Path) -> ImportedScene:
    """Read a SUMO network.

    Args:
        path: The file. Its coordinates are those of the world, so that floating-car data of it drives on the lanes.

    Raises:
        InputError: If the file is no network, is broken, reaches beyond 20 km, or has no lane that cars may use.
    """
    path = Path(path)
    network = read_network(path)
    _check_reach(network)
    graph, notes = build_lanes(network)
    if not graph.lanes:
        raise InputError(f"{path}: no <lane> lets vehicles of class passenger in; one is needed; give a road network")
    plan = plan_roads(network, graph)
    layers = {"paint": plan["paint"], "paved": plan["paved"], "raised": plan["walk"]}
    x0, y0, x1, y1 = shapely.total_bounds(np.array(list(layers.values())))
    frame = shapely.box(*np.round([x0 - MARGIN, y0 - MARGIN, x1 + MARGIN, y1 + MARGIN], 3))
    lit = {lane.junction for lane in graph.lanes.values() if lane.signal}
    notes = [f"{len(lit)} junctions with traffic lights", *notes, "flat: heights of the network are not read"]
    return ImportedScene(build_ground(GroundPlan(layers, frame)), {}, graph, tuple(notes))


def _check_reach(network: Network) -> None:
    """Raise InputError for lanes and junctions too far from the origin; what is tiled must have a size."""
    lines = [(f"lane {lane.id!r}", lane.points) for lane in network.lanes.values()]
    lines += [(f"junction {each.id!r}", each.outline) for each in network.junctions.values()]
    for name, points in lines:
        reach = float(np.abs(points).max(initial=0.0))
        if reach > MAX_COORDINATE_M:
            raise InputError(
                f"{network.path}: {name} reaches {reach / 1e3:.4g} km from the origin; {MAX_COORDINATE_M / 1e3:.0f} km "
                "or less are needed; correct it, or move the network there (netconvert -s x.net.xml -o y.net.xml)"
            )
