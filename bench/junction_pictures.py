"""Draw junctions of an OpenStreetMap extract side by side: `python -m bench.junction_pictures EXTRACT.osm --out PNG`.

Every place of `--at LATITUDE,LONGITUDE` is a row, its three columns have one frame and one scale:

- SUMO's netconvert alone, with the options that SUMO's documentation recommends for OpenStreetMap and those for
  sidewalks and crossings: areas of lanes and junctions as sumo-gui draws them;
- osm2streets, from the GeoJSON files that `--osm2streets` names: those of its repository
  (tests/src/NAME/geometry.json: outlines of roads and junctions), of its package osm2streets-js-node or its web page
  (also lanes and markings);
- `mmw import --traffic`: the surfaces of the world, as they are built.

Blue lines are center lines of lanes for cars.
"""

import argparse
import json
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import shapely
import shapely.ops
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline

from mmw.core.errors import InputError
from mmw.core.geodesy import world_from_wgs84
from mmw.worlds.importers.osm.driving_side import tell_driving_side
from mmw.worlds.importers.osm.feature import Extract
from mmw.worlds.importers.osm.read_osm import read_osm
from mmw.worlds.importers.osm.xml import read_extract
from mmw.worlds.importers.sumo.netconvert import MAX_SECONDS, find_netconvert
from mmw.worlds.importers.sumo.network import Network, read_network
from mmw.worlds.towns.plan_geometry import polygons_of

RECOMMENDED = (
    "--geometry.remove", "--ramps.guess", "--junctions.join", "--tls.guess-signals", "--tls.discard-simple",
    "--tls.join", "--tls.default-type", "actuated", "--osm.sidewalks", "--osm.crossings", "--walkingareas",
)  # fmt: skip
"""Options of netconvert. Source: SUMO documentation, Networks/Import/OpenStreetMap; the last three are for people."""
GRASS, ASPHALT, JUNCTION, CYCLES, WALK, PAINT, LANE = (
    "#e3e9da", "#93979e", "#7d828a", "#bd9484", "#d2c9b6", "#ffffff", "#0072B2",
)  # fmt: skip
SURFACES = {"road": ASPHALT, "sidewalk": WALK, "road_line": PAINT}
"""Label of a surface of a world -> color."""
STREETS = {
    "road": ASPHALT, "intersection": JUNCTION, "Sidewalk": WALK, "Footway": WALK, "SharedUse": WALK,
    "sidewalk corner": WALK, "Biking": CYCLES,
}  # fmt: skip
"""Type of a feature of osm2streets -> color; of the others, those with a width are lanes, and the rest is paint."""
STRIPE = 0.5
"""Width of a stripe of a crossing, and of a gap, as sumo-gui draws it [m]."""
CREDIT = "(c) OpenStreetMap contributors, ODbL"
PANEL_INCH = 4.0
DPI = 100


@dataclass
class Plan:
    """Areas with their colors, from the lowest to the highest, and lines on them [m]."""

    title: str
    areas: list[tuple[str, shapely.Geometry]] = field(default_factory=list)
    lines: list[np.ndarray] = field(default_factory=list)


def plan_netconvert(extract: Extract, *, is_left_hand: bool) -> Plan:
    """Return netconvert's own network of an extract.

    Raises:
        InputError: If netconvert refuses it.
        MissingPackageError: If netconvert is missing.
    """
    latitude, longitude = extract.origin
    plane = f"+proj=tmerc +lat_0={latitude} +lon_0={longitude} +ellps=WGS84 +units=m +no_defs"
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "plain.net.xml"
        command = [find_netconvert(), "--osm-files", str(extract.path), "--output-file", str(target), "--proj", plane]
        command += ["--offset.disable-normalization", *RECOMMENDED, *["--lefthand"] * is_left_hand]
        done = subprocess.run(command, capture_output=True, text=True, timeout=MAX_SECONDS, check=False)
        if done.returncode:
            raise InputError(f"{extract.path}: netconvert refuses it ({done.stderr[-200:]}); choose another extract")
        return draw_network(read_network(target))


def draw_network(network: Network) -> Plan:
    """Return lanes, junctions and crossings of a network as sumo-gui draws them: lanes with white borders."""
    plan = Plan("netconvert")
    paint = []
    for edge in network.edges.values():
        for lane in edge.lanes if not edge.function else ():
            line = shapely.LineString(lane.points)
            color = WALK if lane.is_walked else ASPHALT if lane.is_driven else CYCLES
            plan.areas.append((color, line.buffer(0.5 * lane.width, cap_style="flat")))
            if not lane.is_walked:
                paint += [line.offset_curve(side * 0.5 * lane.width).buffer(0.06) for side in (1, -1)]
    plan.areas += [
        (JUNCTION, shapely.make_valid(shapely.Polygon(junction.outline)))
        for junction in network.junctions.values()
        if len(junction.outline) > 2
    ]
    for edge in network.edges.values():
        for lane in edge.lanes:
            if edge.function == "walkingarea" and len(lane.points) > 2:
                plan.areas.append((WALK, shapely.make_valid(shapely.Polygon(lane.points))))
            elif edge.function == "crossing":
                line = shapely.LineString(lane.points)
                for start in np.arange(0.5 * STRIPE, line.length - STRIPE, 2 * STRIPE):
                    stripe = shapely.ops.substring(line, start, start + STRIPE)
                    paint.append(stripe.buffer(0.5 * lane.width, cap_style="flat"))
            elif lane.is_driven and edge.function in ("", "internal") and len(lane.points) > 1:
                plan.lines.append(lane.points)
    plan.areas += [(PAINT, area) for area in paint]
    return plan


def plan_streets(files: Sequence[Path], extract: Extract) -> Plan:
    """Return what osm2streets made of an extract.

    Args:
        files: GeoJSON files, the lowest first.
        extract: The extract, whose frame counts.

    Raises:
        InputError: If a file is no GeoJSON of osm2streets.
    """
    plan = Plan("osm2streets")
    for path in files:
        try:
            features = json.loads(path.read_text())["features"]
            found = [(f["properties"], shapely.from_geojson(json.dumps(f["geometry"]))) for f in features]
            kinds = [properties["type"] for properties, _ in found]
        except (OSError, ValueError, KeyError, TypeError, shapely.errors.GEOSException) as error:
            raise InputError(
                f"{path}: is no GeoJSON of osm2streets ({error}); give files of its tests or its web page"
            ) from None
        for kind, (properties, area) in zip(kinds, found, strict=True):
            color = STREETS.get(kind, ASPHALT if "width" in properties else PAINT)
            plan.areas.append((color, shapely.transform(area, lambda xy: to_world(xy[:, ::-1], extract))))
    order = [JUNCTION, ASPHALT, CYCLES, WALK, PAINT]
    plan.areas.sort(key=lambda item: order.index(item[0]))
    return plan


def to_world(degrees: np.ndarray, extract: Extract) -> np.ndarray:
    """Return places [m], shape [N, 2], of latitudes and longitudes [deg], shape [N, 2]."""
    return world_from_wgs84(np.pad(degrees, ((0, 0), (0, 1))), (*extract.origin, 0.0))[:, :2]


def plan_import(extract: Extract, places: np.ndarray, half: float, driving_side: str) -> Plan:
    """Return the surfaces and lanes of the import around places [m], shape [N, 2]."""
    scene = read_osm(extract.path, traffic=True, driving_side=driving_side, windows="none")
    plan = Plan("mmw import --traffic")
    windows = [shapely.box(*(place - 1.5 * half), *(place + 1.5 * half)) for place in places]
    window = shapely.union_all(windows)
    for label, color in SURFACES.items():
        corners = [p.points[p.faces][:, :, :2] for p in scene.parts if p.label == label and p.material != "curb"]
        if corners:
            triangles = np.atleast_1d(shapely.polygons(np.concatenate(corners)))
            near = triangles[shapely.intersects(triangles, window)]
            plan.areas.append((color, shapely.union_all(near, grid_size=1e-4)))
    plan.lines = [lane.points[:, :2] for lane in scene.lanes.lanes.values()] if scene.lanes else []
    return plan


def draw(plans: Sequence[Plan], places: np.ndarray, half: float, credit: str) -> Figure:
    """Return a figure: a row a place [m], shape [N, 2], a column a plan; panels are 2 `half` [m] wide."""
    size = (PANEL_INCH * len(plans), PANEL_INCH * len(places) + 0.5)
    layout = ConstrainedLayoutEngine(w_pad=0.02, h_pad=0.02, wspace=0.0, hspace=0.0)
    figure = Figure(figsize=size, layout=layout)
    every = figure.subplots(len(places), len(plans), squeeze=False)
    for row, place in zip(every, places, strict=True):
        for axes, plan in zip(row, plans, strict=True):
            _draw_panel(axes, plan, place, half)
    for axes, plan in zip(every[0], plans, strict=True):
        axes.set_title(plan.title, fontsize=11)
    figure.supxlabel(credit, fontsize=8, color="#444444")
    return figure


def _draw_panel(axes: Axes, plan: Plan, place: np.ndarray, half: float) -> None:
    window = shapely.box(*(place - half), *(place + half))
    axes.set(xlim=place[0] + np.array([-half, half]), ylim=place[1] + np.array([-half, half]), xticks=[], yticks=[])
    axes.set_aspect("equal")
    axes.set_facecolor(GRASS)
    for color, area in plan.areas:
        if not shapely.intersects(area, window):
            continue
        rings = [ring for p in polygons_of(area, 0.0) for ring in (p.exterior, *p.interiors)]
        if rings:
            path = Outline.make_compound_path(*[Outline(shapely.get_coordinates(r), closed=True) for r in rings])
            axes.add_patch(PathPatch(path, facecolor=color, edgecolor="none"))
    for line in plan.lines:
        axes.plot(*line.T, color=LANE, linewidth=0.7, alpha=0.8, scalex=False, scaley=False)
    left, low = place - 0.93 * half
    axes.plot([left, left + 10.0], [low, low], color="black", linewidth=2.5, solid_capstyle="butt")
    axes.text(left + 5.0, low + 0.03 * half, "10 m", ha="center", va="bottom", fontsize=8)


def main(argv: Sequence[str] | None = None) -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("extract", type=Path, help="OpenStreetMap extract (.osm)")
    parser.add_argument("--at", nargs="+", required=True, metavar="LAT,LON", help="places [deg]; use --at=-1,2 for one")
    parser.add_argument("--out", type=Path, required=True, help="picture, .png or another format of Matplotlib")
    parser.add_argument("--osm2streets", nargs="+", type=Path, default=[], metavar="GEOJSON", help="files of it")
    parser.add_argument("--half", type=float, default=32.0, help="half the width of a panel [m]")
    parser.add_argument("--driving-side", default="", help="left or right; told from the extract by default")
    given = parser.parse_args(argv)
    extract = read_extract(given.extract, None)
    degrees = np.array([[float(value) for value in place.split(",")] for place in given.at])
    places = to_world(degrees.reshape(len(given.at), 2), extract)
    side = tell_driving_side(extract, given.driving_side)[0]
    plans = [plan_netconvert(extract, is_left_hand=side == "left")]
    plans += [plan_streets(given.osm2streets, extract)] if given.osm2streets else []
    plans += [plan_import(extract, places, given.half, side)]
    credit = f"Map data {CREDIT}" + "; osm2streets (A/B Street), Apache-2.0" * bool(given.osm2streets)
    draw(plans, places, given.half, credit).savefig(given.out, dpi=DPI)
    print(f"wrote {given.out}")


if __name__ == "__main__":
    main()
