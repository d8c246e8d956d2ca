"""Recorded traffic: every format and reference point gives the motion that made the table, as smooth as it was."""

import gzip
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest

from mmw.cli.run import main
from mmw.config import TrafficConfig
from mmw.core.georeference import Georeference
from mmw.core.transforms import quaternion_to_ypr
from mmw.dataset import open_dataset
from mmw.traffic.demand import TrafficDemand, VehicleTrack
from mmw.traffic.engine import simulate_traffic
from mmw.traffic.ground_height import Ground
from mmw.traffic.replay.path_fit import fill_stations, fit_path
from mmw.traffic.replay.poses import replay
from mmw.traffic.replay.recorded_vehicles import choose_model, replay_table
from mmw.traffic.replay.road_level import Decks
from mmw.traffic.replay.trajectory_table import REFERENCES, Trajectory, read_trajectories
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.roads.town_asset import open_town
from mmw.traffic.vehicle_pose import Shape
from tests.fixtures.recordings import FCD
from tests.fixtures.stages import add_polygons, label, new_stage
from tests.fixtures.traffic_towns import CATALOG, SEDAN, Height, demand, flat, height_field


def plane(height: Height = flat, half: float = 120.0) -> tuple[np.ndarray, np.ndarray]:
    """Return a square height field around the origin: vertices and triangles."""
    side = np.arange(-half, half + 2.0, 2.0)
    return height_field(side, side, height)


def decks(*surfaces: tuple[np.ndarray, np.ndarray]) -> Decks:
    """Return surfaces as one drivable mesh."""
    points = np.concatenate([points for points, _ in surfaces])
    offset = np.cumsum([0, *(len(points) for points, _ in surfaces)])
    faces = np.concatenate([faces + start for (_, faces), start in zip(surfaces, offset, strict=False)])
    return Decks(Ground(points, faces), points[:, 2].min(), points[:, 2].max())


FLAT = decks(plane())


def yaw_of(poses: np.ndarray) -> np.ndarray:
    return quaternion_to_ypr(poses[:, 3:])[:, 0]


def jerk_of(poses: np.ndarray) -> float:
    return float(np.abs(np.diff(poses[:, :3], n=3, axis=0)).max()) * 1e6


def lead_of(reference: str, shape: Shape) -> float:
    """Return how far a reference point is before the rear axle."""
    ahead = {"rear_axle": 0.0, "front_axle": shape.wheelbase, "front_bumper": shape.wheelbase + shape.front}
    return ahead.get(reference, 0.5 * shape.length - shape.rear)


def straight(time: np.ndarray, distance: np.ndarray, **changes) -> Trajectory:
    """Return samples on the x axis, heading east."""
    points = np.column_stack([distance, 0 * distance])
    values = {"id": "a", "time": time, "points": points, "height": None, "heading": 0 * distance}
    return Trajectory(**(values | changes))


@pytest.mark.parametrize("reference", REFERENCES)
@pytest.mark.parametrize("rate", [5, 10, 25, 1000])
def test_circle_is_driven_as_geometry_says(reference, rate):
    """Closed form: all points of a body on a steady turn go round one center, the rear axle along its heading."""
    rear, speed = 30.0, 7.0
    lead = lead_of(reference, SEDAN)
    if reference == "front_bumper":  # the front axle takes the line of the bumper
        rear = np.hypot(30.0, lead) ** 2 - SEDAN.wheelbase**2
        rear = np.sqrt(rear)
    turn = speed / 30.0
    time = np.arange(-1.0, 7.0 + 1e-9, 1 / rate)
    radius = np.hypot(30.0, lead)
    phase = turn * time + np.arctan2(lead, 30.0)
    points = radius * np.column_stack([np.sin(phase), -np.cos(phase)])
    samples = Trajectory("a", time, points, None, turn * time, reference=reference)
    poses = replay(samples, SEDAN, FLAT, 600)
    assert np.isfinite(poses).all()
    middle = np.hypot(poses[:, 0], poses[:, 1])
    later = slice(150, None)  # the heading at the start is forgotten within some wheelbases
    assert middle[later] == pytest.approx(np.hypot(rear, 0.5 * SEDAN.wheelbase), abs=0.05)
    around = np.unwrap(np.arctan2(poses[:, 0], -poses[:, 1]))  # of the middle, which leads the rear axle
    slip = np.unwrap(yaw_of(poses)) - around + np.arctan2(0.5 * SEDAN.wheelbase, rear)
    assert np.abs(np.angle(np.exp(1j * slip)))[later].max() < np.radians(0.7)
    if reference != "front_bumper":
        exact = turn * np.arange(600) / 100
        assert np.abs(np.angle(np.exp(1j * (yaw_of(poses) - exact))))[later].max() < np.radians(0.7)
    assert jerk_of(poses) < 10.0


def test_slope_is_stood_on():
    hill = decks(plane(lambda x, y: 0.15 * x + 3.0))
    time = np.arange(0, 5.01, 0.1)
    poses = replay(straight(time, 8.0 * time - 20), SEDAN, hill, 501)
    assert poses[:, 2] == pytest.approx(0.15 * poses[:, 0] + 3.0, abs=2e-3)
    forward = 1 - 2 * (poses[:, 4] ** 2 + poses[:, 5] ** 2)
    assert np.arccos(forward) == pytest.approx(np.arctan(0.15), abs=1e-3)


def start_stop(time: np.ndarray) -> np.ndarray:
    """Return the distance of a vehicle that brakes from 10 m/s at 2.5 m/s^2 until 4 s and starts again at 9 s."""
    brake = 10 * np.minimum(time, 4) - 1.25 * np.minimum(time, 4) ** 2
    return brake + 1.0 * np.maximum(time - 9, 0) ** 2


@pytest.mark.parametrize("rate", [10, 30, 200, 1000])
def test_a_stop_is_a_stop_and_smooth(rate):
    time = np.arange(0, 12.0 + 1e-9, 1 / rate)
    poses = replay(straight(time, start_stop(time)), SEDAN, FLAT, 1200)
    assert jerk_of(poses) < 10.0
    exact = start_stop(np.arange(1200) / 100) + poses[500, 0] - start_stop(np.array([5.0]))[0]
    assert np.abs(poses[:, 0] - exact).max() < 0.06
    assert np.ptp(poses[520:780, :2], axis=0).max() < 1e-9  # five seconds at rest: no creeping
    assert np.diff(poses[:, 0]).min() > -1e-9


def test_irregular_noisy_doubled_samples():
    generator = np.random.Generator(np.random.PCG64(2))
    time = np.sort(np.concatenate([generator.uniform(0, 10, 220), [0.0, 10.0]]))
    distance = 6.0 * time + 10 * np.sin(0.4 * time)
    clean = straight(time, distance, heading=None)
    noisy = replace(clean, points=clean.points + generator.normal(0, 0.03, clean.points.shape))
    poses = replay(noisy, SEDAN, FLAT, 1001)
    assert jerk_of(poses) < 10.0
    assert np.abs(poses[:, 1]).max() < 0.15
    again = replay(noisy, SEDAN, FLAT, 1001)
    assert np.array_equal(poses, again)


def test_vehicles_come_and_go():
    time = np.concatenate([np.arange(1.0, 3.01, 0.1), np.arange(6.0, 8.01, 0.1)])
    poses = replay(straight(time, 9 * time - 50), SEDAN, FLAT, 1000)
    there = np.isfinite(poses).all(axis=1)
    expected = np.zeros(1000, bool)
    expected[100:301] = expected[600:801] = True
    assert np.array_equal(there, expected)
    assert np.array_equal(np.isnan(poses).all(axis=1), ~expected)
    short = np.delete(np.arange(0, 5.01, 0.1), slice(10, 28))  # 1.9 s without samples are filled
    assert np.isfinite(replay(straight(short, 9 * short - 50), SEDAN, FLAT, 501)).all()


def test_the_right_deck_is_taken():
    both = decks(plane(), plane(lambda x, y: 0 * x + 6.0))
    time = np.arange(0, 2.01, 0.1)
    samples = straight(time, 5 * time)
    assert replay(samples, SEDAN, both, 200)[:, 2] == pytest.approx(6.0)
    for height in (0.0, 6.0):
        hinted = replace(samples, height=np.full(len(time), height + 0.8))
        assert replay(hinted, SEDAN, both, 200)[:, 2] == pytest.approx(height)
    ramp = decks(plane(lambda x, y: 0 * x - 1.0), plane(lambda x, y: np.clip(0.2 * x, 0, 20.0) + 4.0, half=30.0))
    through = straight(np.arange(0, 8.01, 0.1), 10 * np.arange(0, 8.01, 0.1) - 5)  # leaves the small deck's reach
    assert replay(through, SEDAN, ramp, 700)[:, 2] == pytest.approx(-1.0)


def test_impossible_motion_is_refused():
    time = np.arange(0, 4.01, 0.1)
    distance = 8 * time - 10
    jump = distance + np.where(time > 2.05, 30.0, 0.0)
    with pytest.raises(ValueError, match=r"vehicle 'a' at t = 2.00 s near .*jumps 30.8 m in 0.100 s, 308 m/s"):
        replay(straight(time, jump), SEDAN, FLAT, 401)
    with pytest.raises(ValueError, match=r"vehicle 'a' at t = .*turns back on itself"):
        replay(straight(time, 10 - np.abs(distance), heading=None), SEDAN, FLAT, 401)
    with pytest.raises(ValueError, match=r"vehicle 'a' at t = 0.00 s near \(3.0, 0.0\) m: stands still and has no hea"):
        replay(straight(time, 0 * time + 3, heading=None), SEDAN, FLAT, 401)
    with pytest.raises(ValueError, match=r"its heading is 180 deg where it moves towards 0 deg"):
        replay(straight(time, distance, heading=0 * time + np.pi), SEDAN, FLAT, 401)
    with pytest.raises(ValueError, match=r"vehicle 'a' at t = (9|10)\.\d\d s near \(1\d\d\.\d, 0.0\) m: .*road"):
        far = np.arange(0, 20.01, 0.1)
        replay(straight(far, 12 * far), SEDAN, FLAT, 1600)
    with pytest.raises(ValueError, match=r"no drivable surface below, or none near its height 40.0 m"):
        replay(straight(time, distance, height=0 * time + 40), SEDAN, FLAT, 401)
    zigzag = np.column_stack([distance, np.where(np.arange(len(time)) % 2, 1.2, 0.0)])
    with pytest.raises(ValueError, match=r"cannot be made smooth; a jerk of [\d.]+ m/s\^3 is left"):
        replay(straight(time, distance, points=zigzag, heading=None), SEDAN, FLAT, 401)


def test_parked_vehicle_stands_where_it_was():
    time = np.array([0.0, 1.0, 2.0, 3.0])
    poses = replay(straight(time, 0 * time + 3, heading=0 * time + 1.0), SEDAN, FLAT, 301)
    assert np.ptp(poses, axis=0).max() < 1e-9
    back = 0.5 * (SEDAN.front - SEDAN.rear)
    assert poses[0, :2] == pytest.approx([3 - back * np.cos(1.0), -back * np.sin(1.0)], abs=1e-6)
    assert yaw_of(poses)[0] == pytest.approx(1.0, abs=1e-6)


def test_monotone_filling():
    time, distance = np.array([0.0, 1.0, 1.5, 3.0, 4.0]), np.array([0.0, 4.0, 4.0, 4.0, 9.0])
    fine = fill_stations(time, distance, np.linspace(-1, 5, 601))
    assert np.diff(fine).min() >= 0.0
    assert fine[[100, 200, 250, 400, 500]] == pytest.approx(distance)
    assert np.ptp(fine[200:401]) == 0.0
    path = fit_path(np.column_stack([np.linspace(0, 20, 81), np.zeros(81)]), None)
    assert path.station == pytest.approx(np.linspace(0, 20, 81))


def test_formats_agree(tmp_path: Path):
    (tmp_path / "fcd.xml").write_text(FCD)
    with gzip.open(tmp_path / "fcd.xml.gz", "wt") as file:
        file.write(FCD)
    (tmp_path / "fcd.csv").write_text(
        "timestep_time;vehicle_id;vehicle_x;vehicle_y;vehicle_angle;vehicle_type\n"
        "3600.00;a;1.0;2.0;90.0;sedan\n3600.00;b;5.0;9.0;0.0;lorry\n3600.10;a;1.8;2.0;90.0;sedan\n"
        "3600.10;b;5.0;9.0;0.0;lorry\n"
    )
    (tmp_path / "own.csv").write_text(
        "id,time,x,y,yaw_deg,type,reference\nb,7.1,5,9,90,lorry,front_bumper\na,7,1,2,0,sedan,front_bumper\n"
        "a,7.1,1.8,2,0,sedan,front_bumper\nb,7,5,9,90,lorry,front_bumper\nb,7.1,5.1,9,90,lorry,front_bumper\n"
    )
    table = pyarrow.csv.read_csv(tmp_path / "own.csv")
    pyarrow.parquet.write_table(table, tmp_path / "own.parquet")
    found = {name: read_trajectories(tmp_path / name).vehicles for name in
             ("fcd.xml", "fcd.xml.gz", "fcd.csv", "own.csv", "own.parquet")}  # fmt: skip
    for name, (a, b) in found.items():
        assert (a.id, b.id, a.type, b.type) == ("a", "b", "sedan", "lorry"), name
        assert a.reference == "front_bumper"
        assert a.time == pytest.approx([0, 0.1], abs=1e-9)
        assert a.points == pytest.approx(np.array([[1, 2], [1.8, 2]]))
        assert a.heading == pytest.approx([0, 0])
        assert b.points[0] == pytest.approx([5, 9])
        assert b.heading == pytest.approx([np.pi / 2] * 2)
        assert a.height is None


def test_tables_with_latitude_and_longitude(tmp_path: Path):
    place = Georeference(48.1, 11.6, heading=0.02, scale=0.9996)
    xy = np.array([[100.0, -50.0], [108.0, -50.0]])
    rows = "".join(f"{k},a,{lat!r},{lon!r},30\n" for k, (lat, lon) in enumerate(place.degrees(xy).tolist()))
    (tmp_path / "t.csv").write_text(f"t,id,lat,lon,heading_deg\n{rows}")
    (found,) = read_trajectories(tmp_path / "t.csv", place).vehicles
    np.testing.assert_allclose(found.points, xy, atol=1e-6)
    np.testing.assert_allclose(found.heading, np.radians(30) + 0.02)  # 30 deg from true east
    with pytest.raises(ValueError, match="need a town with a geographic origin; give x and y"):
        read_trajectories(tmp_path / "t.csv")
    with pytest.raises(ValueError, match=r"is far from the town at .*latitude comes first"):
        read_trajectories(tmp_path / "t.csv", Georeference(11.6, 48.1))


def test_bad_tables_are_refused(tmp_path: Path):
    def refused(text: str, match: str, name: str = "t.csv") -> None:
        (tmp_path / name).write_text(text)
        with pytest.raises(ValueError, match=match):
            read_trajectories(tmp_path / name)

    refused(
        "t,id,x\n0,a,1\n", r"t.csv: no column y, vehicle_y, position_y, center_y; one each .* the file has t, id, x"
    )
    refused("t,id,lat\n0,a,1\n", r"t.csv: no column longitude, lon, longitude_deg; one each .* has t, id, lat")
    refused("t,id,x,y\n", r"holds no row")
    refused("t,id,x,X,y\n0,a,1,1,2\n", r"column x is there twice; names of columns must differ; remove one")
    refused("t,id,x,y\n0,a,1,2\n1,a,,2\n", r"column x: row 2 holds no number")
    refused("t,id,x,y\n0,a,one,2\n", r"column x: .*numbers are needed")
    refused("t,id,x,y\n0,,1,2\n", r"row 1 has no id")
    refused("t,id,x,y\n0,a,1,2\n0,a,9,2\n", r"vehicle 'a' is at two places 8.0 m apart at t = 0.00 s")
    refused("t,id,x,y,reference\n0,a,1,2,middle\n", r"reference = 'middle'; one of front_bumper, front_axle, center")
    refused("nonsense", r"is no .parquet, .csv or .xml file", "t.txt")
    refused("nonsense", r"cannot be read", "t.parquet")
    refused("<fcd-export><timestep time='0'>", r"cannot be read", "t.xml")
    refused("<scene/>", r"t.xml: root element <scene>; <fcd-export> .* or <commonRoad> .* is needed", "t.xml")


def test_models_by_type_and_length():
    on_plane = demand(LaneGraph(), plane())

    def model(**changes) -> str:
        generator = np.random.Generator(np.random.PCG64(1))
        return choose_model(straight(np.zeros(2), np.zeros(2), **changes), on_plane, False, generator).name

    assert model(type="van", length=4.0) == "van"
    assert model(length=7.0) == "box_truck"
    assert model(length=4.3) == "hatchback"
    assert model(type="truck", length=4.3) == "box_truck"
    assert model(type="truck") == "box_truck"
    assert CATALOG[model(type="DEFAULT_VEHTYPE")].label == "car"
    assert model() == model()


def write_table(path: Path, rows: list[tuple[str, float, float, float]]) -> Path:
    names = ("id", "t", "x", "y")
    pyarrow.csv.write_csv(pa.table(dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))), path)
    return path


def test_ranks_ids_and_presence(tmp_path: Path):
    rows = [(name, t, 8 * t - 10 * k, 4.0 * k) for k, name in enumerate("abcd") for t in np.arange(0, 2.01, 0.1)]
    rows += [("late", t, 9 * t, -8.0) for t in np.arange(1.0, 2.01, 0.1)]
    write_table(tmp_path / "t.csv", rows)

    def replayed(**changes) -> list[VehicleTrack]:
        options = {"cav_ranks": (1,), "frame_count": 200, "vehicle_count": 9, "spawn_center_m": (-30.0, 12.0, 0.0)}
        options |= {"engine": "replay", "trajectories": "t.csv"}
        return replay_table(demand(LaneGraph(), plane(), base=tmp_path, **(options | changes))).tracks

    tracks = replayed()
    assert [track.name for track in tracks] == ["cav_1", "veh_001", "veh_002", "veh_003", "veh_004"]
    assert tracks[0].role == "cav"
    assert tracks[0].poses[0, 1] == pytest.approx(8.0, abs=0.01)  # c is the second nearest, d the nearest
    assert tracks[1].poses[0, 1] == pytest.approx(12.0, abs=0.01)
    assert np.isnan(tracks[4].poses[:100]).all()
    named = replayed(cav_ranks=(), cav_ids=("a", "d"), vehicle_count=3)
    assert [round(float(track.poses[0, 1])) for track in named] == [0, 12, 8]
    fewer = replayed(vehicle_count=3)
    for track, same in zip(fewer, tracks, strict=False):  # other vehicles change nothing
        assert (track.name, track.model, track.paint) == (same.name, same.model, same.paint)
        assert np.array_equal(track.poses, same.poses, equal_nan=True)
    for changes, match in (
        ({"cav_ids": ("x",)}, r"trajectories = 't.csv': cav_ids holds 'x': the file has 5 vehicles: d, c, b, a, late"),
        ({"cav_ids": ("late",)}, r"CAV 'late' is there from 1.00 to 2.00 s .* 0 to 1.99 s"),
        ({"frame_count": 300}, r"CAV 'c' is there from 0.00 to 2.00 s"),
    ):
        with pytest.raises(ValueError, match=match):
            replayed(**changes)
    with pytest.raises(ValueError, match=r"cav_ranks holds 7: the file has 5 vehicles"):
        replayed(cav_ranks=(7,))


CONFIG = """
scenarios:
  - name: recorded
    town: town03
    traffic: {engine: replay, trajectories: drive.csv, spawn_center_m: [0, 0, 0], cav_ids: [ego]}
    rsus: [{name: rsu_1, position_m: [13.5, -29.5, 0.0], yaw_deg: 115}]
weathers: [sunny]
frames: {start: 0, count: 1}
sensors: [{type: lidar, channels: 4, points_per_channel: 32}, {type: depth, width_px: 32, height_px: 24}]
channel: {enabled: false}
"""


def test_a_users_table_becomes_a_dataset(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """A table written here: two cars on the roundabout of town03, seen in the rows of the dataset."""
    radius, speed = 29.0, 7.0
    rows = []
    for name, phase in (("ego", 0.6), ("lead", 1.2)):
        for t in np.arange(0, 1.01, 0.1):
            angle = phase + speed * t / radius
            rows.append((name, t, -0.5 + radius * np.cos(angle), -0.5 + radius * np.sin(angle)))
    write_table(tmp_path / "drive.csv", rows)
    config = tmp_path / "mine.yaml"
    config.write_text(CONFIG)
    out = tmp_path / "out"
    assert main(["--config", str(config), "--out", str(out), "--device", "cpu"]) == 0
    poses = open_dataset(out).read("poses").to_pylist()
    ego = next(row for row in poses if row["agent"] == "cav_1")
    assert np.hypot(ego["x"] + 0.5, ego["y"] + 0.5) == pytest.approx(radius, abs=0.15)
    assert np.hypot(ego["vx"], ego["vy"]) == pytest.approx(speed, rel=0.02)
    assert open_dataset(out).read("boxes").num_rows >= 2
    (tmp_path / "drive.csv").unlink()
    assert main(["--config", str(config), "--out", str(tmp_path / "again")]) == 2
    assert "traffic.trajectories = 'drive.csv': no such file" in capsys.readouterr().err


def test_a_town_without_lanes_will_do(tmp_path: Path):
    stage = new_stage(tmp_path / "bare.usda", root="/Town")
    corners = [(-90, -90, 2), (90, -90, 2), (90, 90, 2), (-90, 90, 2)]
    label(add_polygons(stage, "/Town/Road", corners, [[0, 1, 2, 3]]).GetPrim(), "road")
    stage.Save()
    town = open_town(tmp_path / "bare.usda")
    assert not town.lanes.lanes
    write_table(tmp_path / "t.csv", [("a", t, 8 * t - 5, 1.0) for t in np.arange(0, 1.01, 0.1)])
    center = {"spawn_center_m": (0.0, 0.0, 0.0)}
    traffic = TrafficConfig(engine="replay", trajectories="t.csv", cav_ids=("a",), **center)
    (track,) = simulate_traffic(TrafficDemand(town, traffic, CATALOG, 101, 1, tmp_path)).tracks
    assert track.poses[:, 2] == pytest.approx(2.0, abs=1e-4)
    for engine in ("idm", "sumo"):
        with pytest.raises(ValueError, match=rf"engine = '{engine}': .*bare.usda has no lanes"):
            simulate_traffic(TrafficDemand(town, TrafficConfig(engine=engine, **center), CATALOG, 9, 1))
