"""Lines of sight between antennas and actors against a brute-force oracle, and the rows that they become."""

import numpy as np

from mmw.core.transforms import transform_points
from mmw.scene.device_scene import DeviceScene
from mmw.scene.views import Views
from mmw.sensors.ground_truth.visibility import boxed_actors, start_lines, start_sight
from mmw.sensors.ground_truth.visibility_rows import point_rows, sight_rows, visible_rows
from mmw.storage.arrow_tables import table_from_columns
from tests.fixtures.antennas import antenna_at
from tests.fixtures.scenes import (
    ABSENT,
    arrays_from_parts,
    box_model,
    box_part,
    ground_part,
    pose,
    random_triangles,
    two_cars,
)
from tests.fixtures.sensor_runs import loaded
from tests.oracles.tracing import cast_rays

(ANTENNA,) = antenna_at()


def test_lines_in_triangle_soup_equal_brute_force(device: str) -> None:
    arrays = random_triangles(5, 1200, vehicles=4, frames=2)
    rng = np.random.default_rng(1)
    start, end = rng.uniform(-25, 25, (2, 200, 3))
    batch_index = rng.integers(0, 2, 200)
    found = start_lines(loaded(arrays, device), batch_index, start, end, np.full(200, -1))()
    way = end - start
    length = np.linalg.norm(way, axis=1)
    different = 0
    for frame in (0, 1):
        rows = batch_index == frame
        hits = cast_rays(arrays, frame, start[rows], way[rows] / length[rows, None])
        expected = np.where(hits.t < length[rows], hits.object_id, -1)
        clear = np.abs(hits.t - length[rows]) > 1e-3
        different += int(((found[rows] != expected) & clear).sum())
    assert (found >= 0).sum() > 40 and (found < 0).sum() > 20
    assert different <= 1  # a line that grazes an edge


def test_a_truck_and_a_house_stand_between(device: str) -> None:
    """An RSU and a CAV; one car in the open, one behind a truck, one behind a house, one that is away."""
    house = box_part("Buildings/house", (10.0, 10.0, 8.0), (0.0, 30.0, 4.0), "concrete_facade", "building")
    models = (box_model("car"), box_model("truck", (8.0, 2.5, 4.0), (0.0, 0.0, 2.0)))
    actors = [("cav_1", "cav", 0), ("open", "vehicle", 0), ("behind", "vehicle", 0), ("truck", "vehicle", 1)]
    actors += [("hidden", "vehicle", 0), ("away", "vehicle", 0), ("rsu_1", "rsu", -1)]
    places = [pose(0, 0), pose(12, 0), pose(-30, 0), pose(-15, 0), pose(0, 50), ABSENT, pose(0, 12)]
    arrays = arrays_from_parts([ground_part(80.0), house], models, actors, np.array([places]))
    names = {actor.object_id: actor.name for actor in arrays.actors}
    names |= {o.object_id: o.prim_path for o in arrays.objects if not o.actor}
    sight = start_sight(loaded(arrays, device), [0], ANTENNA)()
    seen = {
        (arrays.actors[a].name, arrays.actors[b].name): (bool(los), names.get(int(blocker)))
        for a, b, los, blocker in zip(sight.agent, sight.actor, sight.is_los, sight.blocker, strict=True)
    }
    assert seen == {
        ("cav_1", "open"): (True, None),
        ("cav_1", "behind"): (False, "truck"),
        ("cav_1", "truck"): (True, None),
        ("cav_1", "hidden"): (False, "/World/Town/Buildings/house"),
        ("rsu_1", "cav_1"): (True, None),
        ("rsu_1", "open"): (True, None),
        ("rsu_1", "behind"): (True, None),  # past the truck
        ("rsu_1", "truck"): (True, None),
        ("rsu_1", "hidden"): (False, "/World/Town/Buildings/house"),
    }


def test_the_own_roof_hides_nothing(device: str) -> None:
    """A car beside a bus with its antenna just above the roof is seen through the bus's own body."""
    models = (box_model("bus", (12.0, 2.5, 3.2), (0.0, 0.0, 1.6)), box_model("car"))
    poses = np.array([[pose(0, 0), pose(0, 3.5)]])
    arrays = arrays_from_parts([ground_part()], models, [("cav_1", "cav", 0), ("car", "vehicle", 1)], poses)
    assert start_sight(loaded(arrays, device), [0], antenna_at({"cav": (0.0, 0.0, 3.4)}, on=("cav",))[0])().is_los.all()


def test_rows_say_who_sees_what(device: str) -> None:
    arrays = two_cars(3)
    arrays.poses[1, 1] = ABSENT
    sight = start_sight(loaded(arrays, device), list(arrays.frames), ANTENNA)()
    fixed = {"scenario": "s", "weather": "sunny"}
    table = table_from_columns("box_visibility", {**fixed, **sight_rows(arrays, "antenna", sight)})
    # cav_1 looks at veh_001; the unit looks at both; veh_001 is away in frame 1.
    assert table.num_rows == 2 * 3 + 1
    assert table.column("lidar_points").null_count == table.column("pixels").null_count == table.num_rows
    free = np.array(table.column("is_los"))
    assert (np.array(table.column("blocker_id").is_null()) == free).all()
    assert len(boxed_actors(arrays.actors)) == 2

    views = Views(np.array([0, 2]), np.array([0, 1]), np.array([0, 2]), np.zeros((2, 7)), np.full(2, -1))
    counts = np.array([[0, 7], [2, 0]], dtype=np.int32)
    rows = table_from_columns("box_visibility", {**fixed, **visible_rows(arrays, "cam", views, "pixels", counts)})
    ids = [actor.object_id for actor in arrays.actors]
    assert rows.select(["frame", "agent", "object_id", "pixels"]).to_pylist() == [
        {"frame": 0, "agent": "cav_1", "object_id": ids[1], "pixels": 7},
        {"frame": 2, "agent": "rsu_1", "object_id": ids[0], "pixels": 2},
    ]
    listed = np.array([ids[0], -1, ids[0], ids[1]])
    rows = point_rows(arrays, "lidar", views, "lidar_points", np.array([0, 3, 4]), listed)
    assert rows["lidar_points"].tolist() == [2, 1] and rows["object_id"].tolist() == ids[:2]


def test_batches_do_not_change_a_line(device: str) -> None:
    arrays = two_cars(4)
    whole = start_sight(loaded(arrays, device), [0, 1, 2, 3], ANTENNA)()
    scene = DeviceScene(arrays, device, 1)
    parts = []
    for frame in range(4):
        scene.load_batch([frame])
        parts.append(start_sight(scene, [frame], ANTENNA)())
    for name in ("frame", "agent", "actor", "is_los", "blocker"):
        np.testing.assert_array_equal(np.concatenate([getattr(part, name) for part in parts]), getattr(whole, name))


def test_middle_of_the_box_is_the_target() -> None:
    """The line ends in the middle of the box, which the actor's own skin covers: it counts as seen."""
    arrays = two_cars(1)
    scene = loaded(arrays, "cpu")
    target = transform_points(arrays.poses[0, 1], np.array(arrays.actors[1].center))
    start = target + np.array([8.0, 0.0, 0.5])
    first = start_lines(scene, np.zeros(1, int), start[None], target[None], np.array([-1]))()
    assert first.tolist() == [arrays.actors[1].object_id]
