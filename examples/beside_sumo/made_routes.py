"""Write routes for any SUMO network."""

from itertools import product
from pathlib import Path

import sumolib

from mmw.core.errors import InputError


def write_routes(path: Path, network: Path, length: float) -> None:
    """Write two CAVs and twelve other vehicles of a length [m], one every half second, that cross a network.

    Raises:
        InputError: If no way leads from an edge that comes from nowhere to one that leads nowhere.
    """
    net = sumolib.net.readNet(str(network))
    edges = [edge for edge in net.getEdges() if edge.allows("passenger")]
    starts, ends = (
        [edge for edge in edges if edge.is_fringe(getattr(edge, side)())] for side in ("getIncoming", "getOutgoing")
    )
    pairs = [(start.getID(), end.getID()) for start, end in product(starts, ends) if net.getOptimalPath(start, end)[0]]
    if not pairs:
        raise InputError(f"{network}: no way crosses the network; give --routes")
    names = ["cav_a", "cav_b", *(f"car_{k}" for k in range(12))]
    trips = [
        f'<trip id="{name}" type="car" depart="{0.5 * k:.1f}" departSpeed="max" from="{start}" to="{end}"/>'
        for k, name in enumerate(names)
        for start, end in [pairs[7 * k % len(pairs)]]
    ]
    path.write_text(f'<routes><vType id="car" length="{length:.3f}"/>{"".join(trips)}</routes>')
