"""MCAP: recordings are read by the library, and what they hold is what the dataset has."""

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mmw.core.errors import InputError
from mmw.dataset import open_dataset
from mmw.dataset.export.exporter import Selection, export
from mmw.dataset.export.mcap import messages
from mmw.dataset.export.mcap.message_definitions import FIELDS, definition
from mmw.dataset.export.mcap.recording import START_NS, ros_name
from tests.fixtures import export_data as source
from tests.fixtures.export_radio import CAVS, SCENARIO, WEATHER, generate_dataset
from tests.fixtures.small_dataset import small_dataset

reader = pytest.importorskip("mcap_ros2.reader", reason="the extra mcap is not installed")

Recorded = dict[str, dict[int, Any]]
"""Topic -> frame -> message."""

OPTICAL = np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
"""A sensor's axes (x forward, y left, z up) to optical ones (x right, y down, z forward)."""


def recorded(path: Path) -> Recorded:
    """Return the messages of a recording; each topic has one a frame, in the order of time."""
    found: Recorded = defaultdict(dict)
    last = 0
    for one in reader.read_ros2_messages(str(path)):
        frame, rest = divmod(one.log_time_ns - START_NS, 10_000_000)
        assert rest == 0 and one.log_time_ns >= last and frame not in found[one.channel.topic]
        last = one.log_time_ns
        found[one.channel.topic][frame] = one.ros_msg
        if hasattr(one.ros_msg, "header"):
            stamp = one.ros_msg.header.stamp
            assert stamp.sec * 1_000_000_000 + stamp.nanosec == one.log_time_ns
    return found


@pytest.fixture(scope="module")
def out(exported: Callable[..., Path]) -> Path:
    return exported("mcap")


@pytest.fixture(scope="module")
def topics(out: Path) -> Recorded:
    (path,) = out.glob("*.mcap")
    return recorded(path)


def matrix(place: Any, turn: Any) -> np.ndarray:
    """Return the transform of a place and a quaternion of ROS, shape [4, 4]."""
    return source.matrix({**{axis: getattr(place, axis) for axis in "xyz"},
                          **{f"q{axis}": getattr(turn, axis) for axis in "xyzw"}})  # fmt: skip


def test_every_sample_is_there_once(topics: Recorded) -> None:
    expected = Counter({"/tf": len(source.FRAMES), "/boxes": len(source.FRAMES)})
    for row in source.rows("poses"):
        expected[f"/{row['agent']}/odometry"] += 1
    for table, names in {"lidar": ("points",), "rgb": ("compressed", "camera_info"), "gnss": ("fix",)}.items():
        for row in source.rows(table):
            expected.update(f"/{row['agent']}/{row['sensor']}/{name}" for name in names)
    assert {topic: len(found) for topic, found in topics.items()} == expected


def test_transforms_lead_from_sensors_to_the_world(topics: Recorded) -> None:
    found = {one.child_frame_id: one for one in topics["/tf"][3].transforms}

    def to_world(frame: str) -> np.ndarray:
        result = np.eye(4)
        while frame != "world":
            one = found[frame]
            result = matrix(one.transform.translation, one.transform.rotation) @ result
            frame = one.header.frame_id
        return result

    np.testing.assert_allclose(to_world("cav_2/lidar"), source.sensor_matrix(3, "cav_2", "lidar"), atol=1e-12)
    optical = source.sensor_matrix(3, "cav_1", "front") @ np.linalg.inv(OPTICAL)
    np.testing.assert_allclose(to_world("cav_1/front_optical"), optical, atol=1e-12)


def test_points_are_those_of_the_sweep(topics: Recorded) -> None:
    row = source.row("lidar", frame=2, agent="cav_1")
    cloud = topics["/cav_1/lidar/points"][2]
    kinds = {1: "i1", 2: "u1", 5: "i4", 7: "f4"}
    types = {"names": [one.name for one in cloud.fields], "formats": [kinds[one.datatype] for one in cloud.fields],
             "offsets": [one.offset for one in cloud.fields], "itemsize": cloud.point_step}  # fmt: skip
    points = np.frombuffer(bytes(cloud.data), dtype=np.dtype(types))
    assert cloud.width == len(points) == row["point_count"] and cloud.header.frame_id == "cav_1/lidar"
    for name in ("x", "y", "z", "intensity", *("object_id", "ring", "label", "return_number", "time_offset")):
        np.testing.assert_array_equal(points[name], np.array(row[name], dtype=points.dtype[name]))


def test_images_and_cameras(topics: Recorded) -> None:
    row, sensor = source.row("rgb", frame=4, agent="rsu_1"), source.row("sensors", agent="rsu_1", sensor="front")
    image, info = topics["/rsu_1/front/compressed"][4], topics["/rsu_1/front/camera_info"][4]
    assert bytes(image.data) == row["image"]["bytes"] and image.format == row["format"]
    assert image.header.frame_id == info.header.frame_id == "rsu_1/front_optical"
    assert (info.width, info.height, info.distortion_model) == (*source.SIZE, "plumb_bob")
    assert list(info.k) == [sensor["fx"], 0, sensor["cx"] - 0.5, 0, sensor["fy"], sensor["cy"] - 0.5, 0, 0, 1]
    assert list(info.p) == [*info.k[:3], 0, *info.k[3:6], 0, *info.k[6:], 0]


def test_cubes_are_the_boxes(topics: Recorded) -> None:
    rows = {row["object_id"]: row for row in source.rows("boxes", frame=5)}
    markers = topics["/boxes"][5].markers
    assert {one.id for one in markers} == set(rows) and len(markers) == len(rows)
    for one in markers:
        row = rows[one.id]
        assert (one.ns, one.type, one.header.frame_id) == (row["category"], 1, "world")
        assert one.lifetime.sec == 0 and one.lifetime.nanosec == 10_000_000
        np.testing.assert_allclose(matrix(one.pose.position, one.pose.orientation), source.box_matrix(row), atol=1e-12)
        assert (one.scale.x, one.scale.y, one.scale.z) == (row["length"], row["width"], row["height"])


def test_positions_and_speeds(topics: Recorded) -> None:
    row, fix = source.row("gnss", frame=1, agent="cav_1"), topics["/cav_1/gnss/fix"][1]
    assert (fix.latitude, fix.longitude, fix.altitude) == tuple(
        row[name] for name in ("latitude_deg", "longitude_deg", "altitude_m")
    )
    row, odometry = source.row("poses", frame=1, agent="cav_1"), topics["/cav_1/odometry"][1]
    turn = matrix(odometry.pose.pose.position, odometry.pose.pose.orientation)
    own = [getattr(odometry.twist.twist.linear, axis) for axis in "xyz"]
    np.testing.assert_allclose(turn[:3, :3] @ own, [row[f"v{axis}"] for axis in "xyz"], atol=1e-12)
    np.testing.assert_allclose(turn, source.matrix(row), atol=1e-12)


def test_links_are_plot_topics(tmp_path: Path) -> None:
    """A made-up dataset, whose links have no gains."""
    root = generate_dataset(tmp_path / "data", 3)
    export(root, "mcap", tmp_path / "out", Selection(agents=CAVS[:2]))
    found = check_links(root, tmp_path / "out" / f"{SCENARIO}_{WEATHER}.mcap", WEATHER, CAVS[:2])
    assert sum(topic.endswith("/path_count") for topic in found) > 2


@pytest.mark.slow
def test_gains_of_traced_links(tmp_path: Path) -> None:
    data = open_dataset(small_dataset())
    export(data.root, "mcap", tmp_path / "out", Selection(agents=("cav_1",), weathers=("sunny",)))
    (path,) = (tmp_path / "out").glob("*.mcap")
    found = check_links(data.root, path, "sunny", ("cav_1",))
    assert any(topic.endswith("28ghz/gain_db") for topic in found)


def check_links(root: Path, path: Path, weather: str, agents: Sequence[str]) -> dict[str, int]:
    """Check the topics of links against the rows of some agents, and return how many messages each has."""
    topics = recorded(path)
    expected = Counter()
    for row in open_dataset(root).read("links", weather=weather).to_pylist():
        if row["agent"] not in agents:
            continue
        carrier = f"{row['carrier_hz'] / 1e9:g}".replace(".", "p")
        for name in ("gain_db", "mean_delay_s", "rms_delay_s", "path_count"):
            topic = f"/{row['agent']}/links/{row['peer']}/carrier_{carrier}ghz/{name}"
            if row[name] is not None:
                expected[topic] += 1
                assert topics[topic][row["frame"]].data == row[name]
    found = {topic: len(some) for topic, some in topics.items() if "/links/" in topic}
    assert found == expected
    return found


def test_the_same_dataset_gives_the_same_bytes(out: Path, tmp_path: Path) -> None:
    export(source.dataset().root, "mcap", tmp_path / "again")
    (one,), (two,) = out.glob("*.mcap"), (tmp_path / "again").glob("*.mcap")
    assert one.read_bytes() == two.read_bytes()


def test_left_handed_samples_are_turned() -> None:
    """A specific force to the right, and a turn to the left, which CARLA counts as positive about a z that points up.

    About an axis in the mirrored plane a rate changes its sign, along the normal of the plane it keeps it.
    """
    row = {"handedness": "left", "ax": 1.0, "ay": 2.0, "az": 9.8, "gx": 0.1, "gy": 0.2, "gz": 0.3}
    left = messages.imu(0, "a/imu", row)
    right = messages.imu(0, "a/imu", {**row, "handedness": "right"})
    assert list(left["linear_acceleration"].values()) == [1.0, -2.0, 9.8]
    assert list(left["angular_velocity"].values()) == [-0.1, 0.2, -0.3]
    assert list(right["linear_acceleration"].values()) == [1.0, 2.0, 9.8]
    assert left["orientation_covariance"][0] == -1.0


def test_radar_points_are_cartesian() -> None:
    row: dict[str, Any] = {
        "range": [10.0, 2.0], "azimuth": [np.pi / 2, 0.0], "elevation": [0.0, np.pi / 6], "velocity": [1.0, -1.0],
        "power_db": None, "snr_db": [3.0, 4.0], "rcs_dbsm": None, "object_id": [7, -1],
    }  # fmt: skip
    columns = messages.radar_points(row)
    assert set(columns) == {"x", "y", "z", "velocity", "snr_db", "object_id"}
    points = np.stack([columns[axis] for axis in "xyz"], axis=-1)
    np.testing.assert_allclose(points, [[0, 10, 0], [3**0.5, 0, 1]], atol=1e-6)
    cloud = messages.point_cloud(0, "a/radar", columns)
    assert cloud["point_step"] == 24 and len(cloud["data"]) == cloud["row_step"] == 48


def test_every_definition_is_whole() -> None:
    for message in FIELDS:
        assert all(f"MSG: {name}" in definition(message) for name in FIELDS if f"{name} " in FIELDS[message])


def test_names_of_ros() -> None:
    assert [ros_name(text) for text in ("cav_1", "roof-lidar", "2nd", "a.b")] == ["cav_1", "roof_lidar", "_2nd", "a_b"]


def test_two_names_that_ros_cannot_tell_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    from mmw.dataset.export.mcap import recording

    part = SimpleNamespace(scenario="s", weather="sunny", agents=("a-b", "a_b"))
    monkeypatch.setattr(recording, "parts", lambda *_: [part])
    monkeypatch.setattr(recording, "sensors_of", lambda *_: {"a-b": {}, "a_b": {}})
    dataset: Any = None
    with pytest.raises(InputError, match="mcap: agents: two have the name a_b in ROS 2"):
        recording.plan(dataset, Selection(), {})
