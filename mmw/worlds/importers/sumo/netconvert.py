"""Run SUMO's netconvert on the roads of an OpenStreetMap extract."""

import importlib.util
import shutil
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np

from mmw.core.errors import InputError, MissingPackageError
from mmw.core.extras import install
from mmw.worlds.importers.sumo.network import Network, read_network

PROGRAM = "netconvert"
MAX_SECONDS = 600
"""Longest run [s]; design value, a square kilometer of a dense city takes 2 s."""
SPHERE = 6_371_000.0
"""Radius of the sphere of `plane_degrees` [m]; any would do."""
OPTIONS = (
    "--offset.disable-normalization",
    "--precision", "4",
    "--keep-edges.by-vclass", "passenger",
    "--geometry.remove",
    "--geometry.min-dist", "0.3",
    "--edges.join",
    "--roundabouts.guess",
    "--ramps.guess",
    "--junctions.join",
    "--junctions.join-dist", "12",
    "--default.junctions.radius", "6",
    "--junctions.corner-detail", "5",
    "--junctions.internal-link-detail", "15",
    "--tls.guess-signals",
    "--tls.guess-signals.dist", "30",
    "--tls.guess-signals.slack", "1",
    "--tls.discard-simple",
    "--tls.join",
    "--no-turnarounds",
    "--osm.turn-lanes",
    "--osm.sidewalks",
    "--osm.crossings",
    "--walkingareas",
)  # fmt: skip
"""Options beside those for the files. Junctions of dual carriageways are joined, and lights that stand before one
belong to it. Vehicles do not turn back: lanes are too narrow for that."""


def find_netconvert() -> str:
    """Return the program: that of the package eclipse-sumo beside this Python first, else the one on the path.

    Raises:
        MissingPackageError: If there is none.
    """
    beside = shutil.which(PROGRAM, path=str(Path(sys.executable).parent))
    spec = importlib.util.find_spec("sumo")
    inside = [str(Path(place) / "bin") for place in spec.submodule_search_locations or ()] if spec else []
    found = beside or next(filter(None, (shutil.which(PROGRAM, path=p) for p in inside)), None) or shutil.which(PROGRAM)
    if found is None:
        raise MissingPackageError(f"--traffic needs SUMO's program {PROGRAM}, which is not installed; {install('osm')}")
    return found


def plane_degrees(xy: np.ndarray) -> tuple[float, float]:
    """Return latitude and longitude [deg] that `convert_roads` maps to a point of the plane [m], shape [2].

    netconvert reads degrees only, and its maps of the ellipsoid are not the tangent plane that the world is. So points
    of the plane are written as degrees on a sphere, and the equidistant cylindrical map, R times radians, takes them
    back.
    """
    longitude, latitude = np.degrees(np.asarray(xy) / SPHERE).tolist()
    return latitude, longitude


def convert_roads(roads: ElementTree.Element, *, is_left_hand: bool) -> Network:
    """Return the network of roads of OpenStreetMap in the plane of the world [m].

    Args:
        roads: The <osm> element with roads, their nodes at `plane_degrees`, and turn restrictions.
        is_left_hand: Whether vehicles drive on the left.

    Raises:
        MissingPackageError: If the program is missing.
        InputError: If it refuses the roads; the message quotes it.
    """
    program = find_netconvert()
    plane = f"+proj=eqc +R={SPHERE} +units=m +no_defs"
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "roads.osm.xml", Path(folder) / "roads.net.xml"
        ElementTree.ElementTree(roads).write(source, encoding="utf-8", xml_declaration=True)
        side = ["--lefthand"] if is_left_hand else []
        files = ["--osm-files", str(source), "--output-file", str(target)]
        command = [program, *files, "--proj", plane, *OPTIONS, *side]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=MAX_SECONDS, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise InputError(f"{program}: cannot be run ({error}); reinstall it: {install('osm')}") from None
        if done.returncode or not target.is_file():
            said = [line for line in done.stderr.splitlines() if line.startswith("Error")]
            raise InputError(
                f"{program}: {' '.join(said)[:300] or f'ended with code {done.returncode}'}; cut out another area, or "
                "import it without --traffic"
            )
        return read_network(target)
