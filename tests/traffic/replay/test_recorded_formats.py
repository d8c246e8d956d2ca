"""Recorded motion of datasets and CommonRoad: positions, times, headings and sizes are those of the file."""

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from mmw.traffic.replay.object_classes import vehicle_class
from mmw.traffic.replay.recorded_vehicles import choose_model, replay_table
from mmw.traffic.replay.trajectory_table import Trajectory, read_trajectories
from mmw.traffic.roads.lane_graph import LaneGraph
from tests.fixtures.recordings import COMMONROAD, EAST, SPEED, TIMES, obstacle
from tests.fixtures.traffic_towns import demand, flat, height_field

SIDE = np.arange(-120.0, 121.0, 2.0)


@pytest.mark.parametrize("version", COMMONROAD)
def test_obstacles_of_commonroad(version: str, tmp_path: Path):
    (tmp_path / "s.xml").write_text(COMMONROAD[version])
    recording = read_trajectories(tmp_path / "s.xml")
    (car,) = recording.vehicles
    assert (car.id, car.type, car.length, car.width, car.reference) == ("31", "car", 4.4, 1.8, "center")
    assert car.time == pytest.approx(TIMES, abs=1e-9)
    assert car.points == pytest.approx(np.column_stack([EAST, np.full(len(EAST), 3.0)]))
    assert car.heading == pytest.approx(np.zeros(len(EAST)))
    assert recording.notes == ("s.xml: left out, for they are no vehicles with a model: 1 pedestrian",)


def test_intervals_of_commonroad_have_a_middle(tmp_path: Path):
    text = COMMONROAD["2020a"].replace(
        "<orientation><exact>0.0</exact>",
        "<orientation><intervalStart>-0.1</intervalStart><intervalEnd>0.3</intervalEnd>", 1,
    )  # fmt: skip
    (tmp_path / "s.xml").write_text(text)
    assert read_trajectories(tmp_path / "s.xml").vehicles[0].heading[0] == pytest.approx(0.1)


def test_obstacles_without_exact_places_are_named(tmp_path: Path):
    """An occupancy set, and a point mass without a heading."""
    vague = '<dynamicObstacle id="5"><type>car</type><initialState><position><circle><radius>2</radius></circle>'
    vague += "</position><time><exact>0</exact></time></initialState><occupancySet/></dynamicObstacle></commonRoad>"
    text = COMMONROAD["2020a"].replace("</commonRoad>", vague)
    (tmp_path / "s.xml").write_text(text.replace("<orientation><exact>0.0</exact></orientation>", ""))
    recording = read_trajectories(tmp_path / "s.xml")
    assert [car.heading for car in recording.vehicles] == [None]
    assert recording.notes[0] == "s.xml: 1 obstacles with areas as places, or no trajectory, were left out"
    (tmp_path / "s.xml").write_text(f'<commonRoad timeStepSize="0.1">{vague}')
    with pytest.raises(ValueError, match=r"<commonRoad> has no dynamic obstacle with points as places \(1 have areas"):
        read_trajectories(tmp_path / "s.xml")


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ('timeStepSize="0.1"', "", r"s.xml: <commonRoad> timeStepSize is missing; a number is needed"),
        ("<x>-10.0</x>", "<x>west</x>", r"<dynamicObstacle id='31'> <initialState> position/point/x is 'west'; a numb"),
        ("<length>4.4</length>", "<length/>", r"<dynamicObstacle id='31'> shape/rectangle/length is ''"),
        ("<exact>0</exact>", "", r"<dynamicObstacle id='31'> <initialState> time/exact is missing"),
    ],
)
def test_faults_of_commonroad_name_the_obstacle(old: str, new: str, match: str, tmp_path: Path):
    (tmp_path / "s.xml").write_text(COMMONROAD["2020a"].replace(old, new, 1))
    with pytest.raises(ValueError, match=match):
        read_trajectories(tmp_path / "s.xml")


def test_a_lanelet_without_a_place_is_no_silent_origin(tmp_path: Path):
    point = "<x>west</x><y>0.0</y>"
    lanelet = f'<lanelet id="7"><leftBound><point>{point}</point></leftBound></lanelet>'
    text = COMMONROAD["2020a"]
    (tmp_path / "s.xml").write_text(text.replace("</commonRoad>", f"{lanelet}</commonRoad>"))
    with pytest.raises(ValueError, match=r"<lanelet id='7'> leftBound point 0 x is 'west'; a number is needed"):
        read_trajectories(tmp_path / "s.xml")


def columns(**others: object) -> dict[str, object]:
    """Return the tracks of a car and a person, x from `EAST`."""
    count = len(TIMES)
    return {"x": [*EAST, *EAST], "y": [3.0] * count + [9.0] * count, **others}


START = 1_532_402_927_612_460  # microseconds of a day in 2018, as nuScenes counts
DATASETS = {
    "argoverse_2": ("timestep", [*range(21), *range(21)], "track_id", "object_type", "vehicle", "pedestrian"),
    "interaction": ("timestamp_ms", [*range(100, 2101, 100)] * 2, "track_id", "agent_type", "car",
                    "pedestrian/bicycle"),
    "nuscenes": ("timestamp", [START + 100_000 * k for k in range(21)] * 2, "instance_token", "category_name",
                 "vehicle.car", "human.pedestrian.adult"),
    "waymo": ("timestamp_micros", [START + 100_000 * k for k in range(21)] * 2, "object_id", "object_type",
              "TYPE_VEHICLE", "TYPE_PEDESTRIAN"),
    "seconds": ("timestamp", [START / 1e6 + 0.1 * k for k in range(21)] * 2, "track_id", "class", "car", "Cyclist"),
    "dates": ("timestamp", [datetime(2024, 5, 1) + timedelta(seconds=0.1 * k) for k in range(21)] * 2, "track_id",
              "class", "car", "person"),
}  # fmt: skip


@pytest.mark.parametrize("suffix", ["parquet", "csv"])
@pytest.mark.parametrize("name", DATASETS)
def test_tracks_of_datasets(name: str, suffix: str, tmp_path: Path):
    time, times, track, kind, car, person = DATASETS[name]
    renamed = {"x": "position_x", "y": "position_y"} if name == "argoverse_2" else {}
    rows = columns(heading=[0.0] * 42, length=[4.7] * 42, width=[1.9] * 42)
    rows |= {time: times, track: ["b7"] * 21 + ["a2"] * 21, kind: [car] * 21 + [person] * 21}
    table = pa.table({renamed.get(key, key): value for key, value in rows.items()})
    path = tmp_path / f"tracks.{suffix}"
    (pyarrow.parquet.write_table if suffix == "parquet" else pyarrow.csv.write_csv)(table, path)
    recording = read_trajectories(path)
    (found,) = recording.vehicles
    assert (found.id, found.length, found.width) == ("b7", 4.7, 1.9)
    assert found.time == pytest.approx(TIMES, abs=1e-6)
    assert found.points == pytest.approx(np.column_stack([EAST, np.full(21, 3.0)]))
    assert recording.notes == (f"tracks.{suffix}: left out, for they are no vehicles with a model: 1 {person}",)


def test_nanoseconds_keep_their_digits(tmp_path: Path):
    """Numbers of 1e18 are 256 apart in float64: 1 ms samples would be 0.02 % off."""
    times = [315_969_904_359_876_000 + 1_000_001 * k for k in range(5)]
    table = pa.table({"timestamp_ns": times, "track_id": ["a"] * 5, "x": [0.0, 1, 2, 3, 4], "y": [0.0] * 5})
    pyarrow.parquet.write_table(table, tmp_path / "t.parquet")
    (found,) = read_trajectories(tmp_path / "t.parquet").vehicles
    assert found.time == pytest.approx(1.000001e-3 * np.arange(5), rel=1e-12)


def test_classes_of_datasets():
    names = {"vehicle.bus.rigid": "bus", "TYPE_CYCLIST": None, "human.pedestrian.adult": None, "Truck": "truck",
             "movable_object.trafficcone": None, "TYPE_VEHICLE": "TYPE_VEHICLE", "city_bus": "city_bus", "": "",
             "DEFAULT_VEHTYPE": "DEFAULT_VEHTYPE", "priorityVehicle": "car"}  # fmt: skip
    assert {name: vehicle_class(name) for name in names} == names


def test_a_width_tells_models_of_one_length_apart():
    on_plane = demand(LaneGraph(), height_field(SIDE, SIDE, flat))
    generator = np.random.Generator(np.random.PCG64(1))
    shapes = {shape.name: shape for shape in on_plane.shapes}
    for shape in shapes.values():
        size = {"length": shape.length, "width": 2.0 * shape.half_width}
        vehicle = Trajectory("a", np.zeros(2), np.zeros((2, 2)), None, None, type="vehicle", **size)
        found = choose_model(vehicle, on_plane, False, generator)
        assert (found.length, found.half_width) == (shape.length, shape.half_width)


def test_vehicles_follow_the_scenario_and_those_off_the_road_are_named(tmp_path: Path):
    text = COMMONROAD["2020a"].replace("</commonRoad>", "")
    text += obstacle('dynamicObstacle id="7">', "dynamicObstacle", "truck", 300.0)
    text += obstacle('dynamicObstacle id="9">', "dynamicObstacle", "car", -4.0) + "</commonRoad>"
    (tmp_path / "s.xml").write_text(text)
    options = {"engine": "replay", "trajectories": "s.xml", "frame_count": 201, "spawn_center_m": (0.0, 0.0, 0.0)}

    def drive(**changes):
        return replay_table(demand(LaneGraph(), height_field(SIDE, SIDE, flat), base=tmp_path, **(options | changes)))

    result = drive(cav_ids=("31",), vehicle_count=3)
    assert [track.name for track in result.tracks] == ["cav_1", "veh_001"]
    middle = result.tracks[0].poses[:, :2]
    exact = SPEED * np.arange(201) / 100 - 10.0
    offset = middle[:, 0] - exact  # of the point midway between the axles from the middle of the body
    assert np.ptp(offset) < 0.02
    assert abs(offset[0]) < 0.3
    assert middle[:, 1] == pytest.approx(3.0, abs=1e-3)
    speed = np.diff(middle[:, 0]) * 100
    assert speed == pytest.approx(SPEED, rel=1e-3)
    assert "1 pedestrian" in result.notes[0]
    assert (
        "vehicles left out, for they cannot be replayed: 1, '7'; the first: vehicle '7' at t = 0.00" in result.notes[1]
    )
    with pytest.raises(ValueError, match=r"trajectories = 's.xml': vehicle '7' at t = 0.00 s near .*no drivable surf"):
        drive(cav_ids=("7",), vehicle_count=3)
