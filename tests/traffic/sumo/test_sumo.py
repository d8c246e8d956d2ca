"""SUMO: the network equals the lanes, and its vehicles move as smoothly as those of mmw's engine."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from mmw.config import TrafficConfig
from mmw.core.errors import InputError, MissingPackageError
from mmw.traffic.demand import TrafficDemand, VehicleTrack
from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.traffic.roads.town_asset import open_town
from mmw.traffic.sumo.network import SumoNetwork, make_network
from mmw.traffic.sumo.process import SumoProcess
from mmw.traffic.sumo.routes import lane_limits
from mmw.traffic.sumo.simulation import simulate_sumo
from tests.fixtures.sumo_installed import needs_sumo
from tests.fixtures.traffic_measures import Measures, measure
from tests.fixtures.traffic_towns import crossroad, demand, hill, oval, roundabout, surface


def test_a_missing_system_library_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "libsumo.py").write_text("raise ImportError('libXrender.so.1: cannot open shared object file')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    process = SumoProcess(TemporaryDirectory(), {})
    with pytest.raises(MissingPackageError, match=r"cannot be loaded: libXrender\.so\.1.*package manager"):
        process.step()


@needs_sumo
def test_what_sumo_cannot_read_is_told_once_and_its_files_are_removed() -> None:
    holder = TemporaryDirectory()
    process = SumoProcess(holder, {"options": ["--net-file", "none.net.xml", "--no-step-log"]})
    with pytest.raises(InputError, match=r"engine = 'sumo': SUMO failed: .*; correct the lanes"):
        process.step()
    assert not Path(holder.name).exists()
    with pytest.raises(InputError, match="SUMO has ended; reset the simulation"):
        process.step()


def network_of(graph: LaneGraph) -> SumoNetwork:
    return make_network(graph, {name: lane.speed for name, lane in graph.lanes.items()})


@pytest.mark.parametrize("make", [crossroad, roundabout])
def test_every_lane_and_connection_is_there(make, tmp_path: Path):
    graph = make()
    network = network_of(graph)
    network.write(tmp_path / "town.net.xml")
    root = ElementTree.parse(tmp_path / "town.net.xml").getroot()
    lanes = {lane.get("id"): lane for lane in root.iter("lane")}
    assert set(lanes) == set(network.internal)
    assert set(network.internal.values()) == set(graph.lanes)
    for name, lane in lanes.items():
        ours = graph.lanes[network.internal[name]]
        shape = np.array([[float(v) for v in point.split(",")] for point in lane.get("shape").split()])
        assert shape == pytest.approx(ours.points, abs=5.1e-5)
        assert float(lane.get("width")) == ours.width
    found = set()
    for link in root.iter("connection"):
        if link.get("from").startswith(":"):
            continue
        before = network.internal[f"{link.get('from')}_{link.get('fromLane')}"]
        after = network.internal[f"{link.get('to')}_{link.get('toLane')}"]
        found.add((before, network.internal[link.get("via")], after))
    expected = {
        (lane.name, connection, graph.lanes[connection].successors[0])
        for lane in graph.lanes.values()
        if not lane.junction
        for connection in lane.successors
    }
    assert found == expected


def test_neighbours_share_an_edge_numbered_from_the_right():
    ring = roundabout()
    network = network_of(ring)
    for name, lane in ring.lanes.items():
        if not lane.junction and lane.right:
            mine, other = network.place[name], network.place[lane.right]
            assert (mine.edge, mine.index) == (other.edge, other.index + 1)
    edges = {edge.get("id"): edge for edge in network.root.iter("edge")}
    for name, spot in network.place.items():
        lengths = {lane.get("length") for lane in edges[spot.edge]}
        assert len(lengths) == 1  # SUMO needs it
        own = np.linalg.norm(np.diff(ring.lanes[name].points[:, :2], axis=0), axis=1).sum()
        assert float(lengths.pop()) == pytest.approx(own * spot.scale, abs=1e-3)


@pytest.mark.parametrize("make", [crossroad, roundabout])
def test_right_of_way(make):
    """Links are numbered as incoming lanes list them; crossing links are foes, and those that yield rank lower."""
    graph = make()
    network = network_of(graph)
    for junction in network.root.iter("junction"):
        connections = [network.internal[name] for name in junction.get("intLanes").split()]
        coming = [network.internal[name] for name in junction.get("incLanes").split()]
        assert connections == [connection for lane in coming for connection in graph.lanes[lane].successors]
        rows = junction.findall("request")
        assert [int(row.get("index")) for row in rows] == list(range(len(connections)))
        foes = np.array([[c == "1" for c in row.get("foes")[::-1]] for row in rows])
        yields = np.array([[c == "1" for c in row.get("response")[::-1]] for row in rows])
        assert np.array_equal(foes, foes.T)
        assert np.array_equal(yields | yields.T, foes)
        assert not (yields & yields.T).any()
        priority = np.array([graph.lanes[connection].priority for connection in connections])
        i, j = np.nonzero(yields)
        assert (priority[i] <= priority[j]).all()
        for i, one in enumerate(connections):
            for j, other in enumerate(connections):
                same_start = graph.predecessors[one] == graph.predecessors[other]
                if i != j and not same_start and graph.lanes[one].successors == graph.lanes[other].successors:
                    assert foes[i, j]  # they merge


def test_lanes_without_a_junction_are_joined():
    """A road that goes on as another one, as importers may have it: a connection without an internal lane."""

    def lane(name: str, first: float, *successors: str) -> Lane:
        points = np.column_stack([np.linspace(first, first + 50, 26), np.zeros(26), np.zeros(26)])
        return Lane(name, points, 3.5, 10.0, successors=successors)

    graph = LaneGraph({x.name: x for x in (lane("a", 0, "b"), lane("b", 50, "c"), lane("c", 100))})
    root = network_of(graph).root
    assert [(c.get("from"), c.get("to"), c.get("via")) for c in root.iter("connection")] == [
        ("a", "b", None),
        ("b", "c", None),
    ]
    assert [edge.get("to") for edge in root.iter("edge")][:2] == [edge.get("from") for edge in root.iter("edge")][1:]


def test_bends_limit_the_speed():
    """Closed form: v = sqrt(2.3 R) on a circle, the lane's own limit on a straight line."""
    angle = np.linspace(0, np.pi, 120)
    circle = Lane("c", np.column_stack([20 * np.cos(angle), 20 * np.sin(angle), 0 * angle]), 3.5, 30.0)
    line = Lane("s", np.column_stack([np.linspace(0, 80, 41), np.zeros(41), np.zeros(41)]), 3.5, 12.0)
    limits = lane_limits(LaneGraph({"c": circle, "s": line}))
    middle = limits["c"][200:400]
    assert middle == pytest.approx(np.sqrt(2.3 * 20), rel=0.02)
    assert limits["s"] == pytest.approx(12.0)
    assert len(limits["c"]) == pytest.approx(20 * np.pi / 0.1, abs=3)


def drive(needed: TrafficDemand) -> tuple[list[VehicleTrack], Measures]:
    """Return the tracks of a scenario and their measures, after a check that all vehicles move smoothly and apart."""
    town, tracks = needed.town, simulate_sumo(needed).tracks
    found = measure(tracks, town.lanes, (town.points, town.faces), needed.catalog)
    assert found.max_jerk < 10.0
    assert found.max_lateral < 2.6
    assert found.min_gap > 0.2
    return tracks, found


@pytest.mark.slow
@needs_sumo
def test_sumo_drives_smoothly_over_a_hill():
    graph = crossroad(hill)
    options = {"frame_count": 1000, "cav_ranks": (5, 2)}
    scenario = demand(graph, surface(graph, hill), **options)
    tracks, found = drive(scenario)
    assert [track.name for track in tracks[:3]] == ["cav_1", "cav_2", "veh_001"]
    assert found.max_wheel_error < 0.02
    assert found.mean_speed > 2.0
    drawn = demand(graph, surface(graph, hill), **(options | {"cav_ranks": (0, 1), "cav_pool": 2}))
    assert {track.role for track in simulate_sumo(drawn).tracks[:2]} == {"cav"}
    again = simulate_sumo(scenario).tracks
    assert all(np.array_equal(one.poses, same.poses) for one, same in zip(tracks, again, strict=True))


@needs_sumo
@pytest.mark.parametrize("lane_changes", [True, False])
def test_sumo_changes_lanes_where_it_may(lane_changes):
    options = {"frame_count": 1000, "vehicle_count": 40, "cav_ranks": (5, 2), "lane_changes": lane_changes}
    _, found = drive(demand(oval(), **options))
    assert (found.max_offset > 1.0) == lane_changes  # half a lane's width only between lanes


@needs_sumo
@pytest.mark.slow
def test_sumo_on_the_roundabout_of_town03():
    from mmw.core.resources import town_path
    from mmw.usd.vehicle_catalog import load_catalog

    town, catalog = open_town(town_path("town03")), load_catalog()
    traffic = TrafficConfig(vehicle_count=40, spawn_center_m=(-0.5, -0.5, 0.0), cav_ranks=(1, 4, 8))
    _, found = drive(TrafficDemand(town, traffic, catalog, frame_count=1001, seed=42))
    assert found.stuck == 0
