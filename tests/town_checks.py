"""What must hold for any shipped town, measured on the committed asset and on a rebuild from its description."""

import shutil
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import shapely
from pxr import Usd, UsdGeom, UsdSemantics, UsdShade

from mmw.paths import assets_dir
from mmw.town.author import PAYLOAD
from mmw.town.build import build_town
from mmw.town.description import load_town
from mmw.town.lane_prims import read_lanes
from mmw.town.lanes import Lane, LaneGraph
from mmw.town.network import RoadNetwork, build_network
from mmw.usd import schema
from mmw.usd.semantics import CARLA_TAG
from mmw.usd.validate import validate_stage
from tests.town_compare import assert_same_town


def folder_of(name: str) -> Path:
    return assets_dir() / "towns" / name


@cache
def stage_of(name: str) -> Usd.Stage:
    schema.register()
    return Usd.Stage.Open(str(folder_of(name) / f"{name}.usda"))


@cache
def network_of(name: str) -> RoadNetwork:
    return build_network(load_town(folder_of(name) / f"{name}.yaml"))


def assert_rebuilt(name: str, root: Path) -> None:
    """Build the town again, beside the same libraries: it is the same town, whatever CPU and libraries build it.

    Builds on x86-64 with SSE4.2, AVX2 and AVX-512 have the same bytes; other versions of SciPy, GEOS or earcut may cut
    polygons into other triangles.
    """
    shutil.copytree(assets_dir() / "materials", root / "materials")
    shutil.copytree(assets_dir() / "vehicles", root / "vehicles")
    materials = root / "materials" / "materials.usda"
    built = build_town(folder_of(name) / f"{name}.yaml", root / "towns" / name, materials).path
    assert_same_town(built.parent, folder_of(name), name)


def assert_valid_and_of_size(stage: Usd.Stage, name: str) -> None:
    """OpenUSD's validators are content; 180 to 330 thousand triangles; every mesh has a material and a class."""
    assert validate_stage(stage) == []
    triangles = 0
    for mesh in meshes_below(stage.GetPseudoRoot()):
        if not mesh.GetPrim().IsInstanceProxy():  # parked cars share the shapes of the moving ones
            triangles += len(mesh.GetFaceVertexCountsAttr().Get())
        prim = mesh.GetPrim()
        bound = material_of(prim)
        assert bound.GetAttribute("mmw:radio:itu").Get() or bound.GetAttribute("mmw:radio:model").Get() == "constant"
        assert deepest_label(prim) in CARLA_TAG, prim.GetPath()
    assert 180_000 < triangles < 330_000
    assert sum((folder_of(name) / file).stat().st_size for file in (PAYLOAD, f"{name}.usda")) < 10_000_000


def material_of(prim: Usd.Prim) -> Usd.Prim:
    """Return the Material prim that is bound to a mesh."""
    return UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0].GetPrim()


def deepest_label(prim: Usd.Prim) -> str:
    while prim and not prim.HasAPI(UsdSemantics.LabelsAPI, "class"):
        prim = prim.GetParent()
    return UsdSemantics.LabelsAPI(prim, "class").GetLabelsAttr().Get()[0]


def meshes_below(root: Usd.Prim) -> list[UsdGeom.Mesh]:
    """Return every mesh, those of instances too."""
    every = Usd.PrimRange(root, Usd.TraverseInstanceProxies())
    return [UsdGeom.Mesh(prim) for prim in every if prim.IsA(UsdGeom.Mesh)]


def assert_opens_light(name: str) -> None:
    """Without payloads a town has no mesh, and its geometry is not read; parked cars are instances."""
    path = folder_of(name) / f"{name}.usda"
    light = Usd.Stage.Open(str(path), Usd.Stage.LoadNone)
    layers = {Path(layer.realPath).name for layer in light.GetUsedLayers() if layer.realPath}
    assert not meshes_below(light.GetPseudoRoot()) and f"{name}.usda" in layers and PAYLOAD not in layers
    light.Load()
    assert meshes_below(light.GetPseudoRoot())
    models = [prim for prim in light.Traverse() if prim.GetName() == "Model"]
    assert all(prim.IsInstance() for prim in models) and len(light.GetPrototypes()) <= len(models)


def points_of(prim: Usd.Prim) -> np.ndarray:
    """Return all points of the meshes at or below a prim, in the frame of the town [m], shape [N, 3]."""
    cache, found = UsdGeom.XformCache(), []
    for mesh in meshes_below(prim):
        matrix = np.array(cache.GetLocalToWorldTransform(mesh.GetPrim()))
        found.append(np.array(mesh.GetPointsAttr().Get(), np.float64) @ matrix[:3, :3] + matrix[3, :3])
    return np.concatenate(found)


def components(stage: Usd.Stage, group: str) -> Iterator[tuple[Usd.Prim, np.ndarray]]:
    """Yield (component prim, its points [N, 3]) of a group such as `Buildings`."""
    for component in stage.GetPrimAtPath(f"/Town/{group}").GetChildren():
        yield component, points_of(component)


def assert_buildings_stand(stage: Usd.Stage, network: RoadNetwork) -> None:
    """No building reaches into a road or another building, and all feet are below the ground."""
    plans = []
    for component, points in components(stage, "Buildings"):
        low = points[points[:, 2] < points[:, 2].min() + 3.5]
        plan = shapely.convex_hull(shapely.multipoints(low[:, :2]))
        assert not plan.intersects(network.corridor), component.GetPath()
        feet = points[points[:, 2] < points[:, 2].min() + 1e-3]
        assert np.all(feet[:, 2] < network.height(*feet[:, :2].T) - 0.3), component.GetPath()
        plans.append(plan)
    first, second = shapely.STRtree(plans).query(plans, predicate="intersects")
    assert np.all(first == second)


def assert_props_stand(stage: Usd.Stage, network: RoadNetwork) -> None:
    """No prop reaches into a lane below 4.5 m, the height of a double-decker, and none floats."""
    driven = shapely.union_all(
        [shapely.LineString(lane.points[:, :2]).buffer(0.5 * lane.width) for lane in network.lanes.lanes.values()]
    )
    shapely.prepare(driven)
    for component, points in components(stage, "Props"):
        ground = network.height(*points[:, :2].T)
        low = points[points[:, 2] < ground + 4.5]
        assert not shapely.intersects_xy(driven, *low[:, :2].T).any(), component.GetPath()
        assert (points[:, 2] < ground).any(), component.GetPath()


def assert_unit_stands_free(at: tuple[float, float, float], stage: Usd.Stage, network: RoadNetwork) -> None:
    """A roadside unit stands beside the road: off the carriageway, within 12 m of it, and in nothing solid."""
    foot = shapely.Point(at[:2])
    assert 0.3 < shapely.distance(network.carriageway, foot) < 12.0
    for group in ("Buildings", "Props"):
        for component, points in components(stage, group):
            near = points[(points[:, 2] > at[2] - 1) & (points[:, 2] < at[2] + 5)]
            if len(near) and np.hypot(*(near[:, :2] - at[:2]).T).min() < 12.0:
                plan = shapely.convex_hull(shapely.multipoints(near[:, :2]))
                assert not shapely.dwithin(plan, foot, 0.2), component.GetPath()


def assert_extent(network: RoadNetwork, west_east: tuple[float, float], south_north: tuple[float, float]) -> None:
    """The carriageway spans the table's extent within 10 % of its size, on every side."""
    west, south, east, north = network.carriageway.bounds
    for found, wanted in (((west, east), west_east), ((south, north), south_north)):
        size = wanted[1] - wanted[0]
        assert np.allclose(found, wanted, atol=0.1 * size), (found, wanted)
        assert abs(found[1] - found[0] - size) < 0.1 * size


def reach(graph: LaneGraph, start: str) -> set[str]:
    """Return every lane that a vehicle on `start` can come to, by going on or by changing lanes."""
    seen, queue = {start}, [start]
    while queue:
        lane = graph.lanes[queue.pop()]
        for name in (*lane.successors, lane.left, lane.right):
            if name and name not in seen:
                seen.add(name)
                queue.append(name)
    return seen


def assert_connected(stage: Usd.Stage) -> LaneGraph:
    """From three lanes of the asset every other lane can be reached; return the lanes."""
    graph = read_lanes(stage, "/Town")
    names = sorted(graph.lanes)
    for start in (names[0], names[len(names) // 2], names[-1]):
        assert reach(graph, start) == set(names)
    return graph


def turned(lane: Lane) -> float:
    """Return the change of heading along a lane, counter-clockwise [deg]."""
    return float(np.degrees(np.sum((np.diff(lane.headings) + np.pi) % (2 * np.pi) - np.pi)))


def arc_radii(line: np.ndarray) -> np.ndarray:
    """Return the radius of the circle through every three neighbouring points of a line [m], shape [N - 2]."""
    a, b, c = line[:-2, :2], line[1:-1, :2], line[2:, :2]
    sides = [np.linalg.norm(q - p, axis=1) for p, q in ((a, b), (b, c), (a, c))]
    u, v = b - a, c - a
    area = 0.5 * np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    return sides[0] * sides[1] * sides[2] / np.maximum(4 * area, 1e-9)
