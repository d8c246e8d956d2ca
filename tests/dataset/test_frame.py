"""One frame as an object, and transforms from the world to an agent, a sensor, a pixel and back."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import mmw
from mmw.core.camera_models import Distortion, Intrinsics
from mmw.core.transforms import compose, make_pose, pose_from_ypr, quaternion_from_ypr, quaternion_to_matrix
from mmw.dataset import Dataset
from mmw.dataset.camera_geometry import Camera, box_corners, from_world, intrinsics_from_row, pose_from_row, to_world
from mmw.dataset.frame import Frame
from tests.fixtures.small_dataset import SCENARIO, small_dataset


@pytest.fixture(scope="module")
def data() -> Dataset:
    return mmw.open(small_dataset())


@pytest.fixture(scope="module")
def frame(data: Dataset) -> Frame:
    return data.frame(SCENARIO, "rainy", 2)


def test_open_is_lazy_and_mmw_stays_light() -> None:
    code = (
        "import sys, mmw\nassert not {'pyarrow', 'numpy', 'warp', 'duckdb'} & set(sys.modules)\n"
        "mmw.open, mmw.connect\nassert 'duckdb' not in sys.modules and 'warp' not in sys.modules\n"
        "try:\n    mmw.opened\nexcept AttributeError as error:\n    assert 'opened' in str(error)\n"
        "else:\n    raise SystemExit('no error')\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(__file__).parents[2])


def test_agents_and_their_samples(frame: Frame, data: Dataset) -> None:
    assert list(frame.agents) == ["cav_1", "cav_2", "cav_3", "rsu_1"]
    assert frame.time_s == 0.02 and frame.row["cav_count"] == 3
    cav, rsu = frame.agents["cav_2"], frame.agents["rsu_1"]
    assert (cav.role, rsu.role) == ("cav", "rsu")
    assert set(cav.sweeps) == {"lidar"} and set(cav.samples("imu")) == {"imu"}
    assert set(cav.samples("gnss")) == {"gnss"} and cav.sensor("imu").az > 5.0 and not rsu.samples("imu")
    assert set(cav.views) == {"front"} and set(rsu.views) == {"front", "depth"}
    (row,) = data.read("lidar", weather="rainy", frames=range(2, 3), agent="cav_2").to_pylist()
    cloud = cav.sweeps["lidar"]
    assert len(cloud) == row["point_count"] > 1000
    np.testing.assert_array_equal(cloud.points[:, 1], np.float32(row["y"]))
    np.testing.assert_array_equal(cloud["object_id"], row["object_id"])
    assert not cav.radars
    with pytest.raises(ValueError, match="sensor 'lidr': cav_2 has antenna, front, gnss, imu, lidar"):
        cav.sensor_pose("lidr")


def test_images_are_decoded_on_demand(frame: Frame, data: Dataset) -> None:
    rsu = frame.agents["rsu_1"]
    view = rsu.views["depth"]
    assert view.rgb is None and view.flow is None and view.normals is None
    assert view.depth is not None and view.depth.shape == (120, 160) and np.isinf(view.depth).any()
    assert view.instance is not None and view.semantic is not None
    assert ((view.instance == -1) == np.isinf(view.depth)).all() and (view.semantic[view.instance == -1] == 11).all()
    front = frame.agents["cav_1"].views["front"]
    assert front.rgb is not None and front.rgb.shape == (48, 64, 3) and front.rgb.dtype == np.uint8
    assert data.frame(SCENARIO, "rainy", 1).agents["cav_1"].views["front"].rgb is None  # every second frame


def test_links_hold_their_paths(frame: Frame) -> None:
    assert len(frame.links) == 6 and len(frame.agents["cav_1"].links) == 2
    for link in frame.links:
        count = len(link.a)
        assert (link.gain_db is None) == (count == 0)
        if count:
            assert link.gain_db == pytest.approx(10 * np.log10(np.sum(np.abs(link.a) ** 2)))
        for path in range(count):
            assert len(link.vertices(path)) == link.paths["order"][path]
    reflected = [(link, p) for link in frame.links for p in range(len(link.a)) if link.paths["kind"][p] == "specular"]
    assert reflected
    for link, path in reflected:  # the length over the vertices is c times the delay
        ends = [frame.agents[name].sensor_pose("antenna")[:3] for name in (link.peer, link.agent)]
        points = np.concatenate([ends[:1], link.vertices(path), ends[1:]])
        length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
        assert length == pytest.approx(299_792_458.0 * link.paths["tau_s"][path], rel=1e-6)


def test_lidar_points_and_depth_agree_in_pixels(frame: Frame) -> None:
    """Returns of the LiDAR, through the world, fall on pixels whose depth is theirs."""
    rsu = frame.agents["rsu_1"]
    cloud, view = rsu.sweeps["lidar"], rsu.views["depth"]
    depth = view.depth
    assert depth is not None
    surface = cloud.world[cloud["label"] == 0]
    pixels = view.camera.pixels(surface)
    inside = view.camera.is_inside(pixels)
    column, row = pixels[inside].astype(int).T
    own = view.camera.depths(surface)[inside]
    near = np.abs(depth[row, column] - own) < 0.1 + 0.15 * own
    assert inside.sum() > 200 and near.mean() > 0.9


def test_depth_goes_to_points_and_back(frame: Frame) -> None:
    view = frame.agents["rsu_1"].views["depth"]
    depth = view.depth
    assert depth is not None
    points = view.camera.points(depth)
    known = np.isfinite(depth)
    assert (np.isfinite(points).all(axis=-1) == known).all()
    np.testing.assert_allclose(view.camera.depths(points)[known], depth[known], rtol=1e-6)
    v, u = np.nonzero(known)
    np.testing.assert_allclose(view.camera.pixels(points)[known], np.stack([u, v], axis=1) + 0.5, atol=1e-6)
    with pytest.raises(ValueError, match=r"\(10, 10\); the camera has \(120, 160\)"):
        view.camera.points(np.ones((10, 10)))


LENSES = [
    ("pinhole", []),
    ("brown_conrady", [-0.2, 0.05, 0.001, -0.002, 0.01, 0.0, 0.0, 0.0]),
    ("fisheye", [0.02, -0.01, 0.002, 0.0]),
]


@pytest.mark.parametrize(("lens", "coefficients"), LENSES)
def test_stored_intrinsics_project_with_their_lens(lens: str, coefficients: list[float]) -> None:
    row = {"agent": "a", "sensor": "c", "type": "rgb", "fx": 300.0, "fy": 310.0, "cx": 322.0, "cy": 239.0}
    row |= {"width": 640, "height": 480, "lens": lens, "coefficients": coefficients}
    camera = Camera(intrinsics_from_row(row), pose_from_ypr([1.0, 2.0, 3.0], 0.4, 0.1, -0.05))
    assert camera.intrinsics.distortion.model == lens
    assert list(camera.intrinsics.distortion.coefficients) == coefficients
    pixels = np.array([[100.5, 200.5], [322.0, 239.0], [600.0, 50.0]])
    rays = camera.rays(pixels)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0)
    np.testing.assert_allclose(camera.pixels(np.array([1.0, 2.0, 3.0]) + 25.0 * rays), pixels, atol=1e-6)
    ahead = quaternion_to_matrix(camera.pose[3:])[:, 0]
    np.testing.assert_allclose(rays[1], ahead, atol=1e-12)


def test_a_point_straight_ahead_left_and_up() -> None:
    camera = Camera(Intrinsics(640, 480, 320.0, 320.0, 320.0, 240.0), make_pose([0, 0, 0], [0, 0, 0, 1]))
    np.testing.assert_allclose(camera.pixels([[10, 0, 0], [10, 5, 0], [10, 0, 5]]), [[320, 240], [160, 240], [320, 80]])
    assert camera.is_inside([[0, 0], [639.9, 479.9], [640, 10], [np.nan, 3], [-0.1, 3]]).tolist() == [1, 1, 0, 0, 0]
    assert np.isnan(camera.pixels([-1.0, 0, 0])).all() and camera.intrinsics.distortion == Distortion()


def test_frames_of_reference() -> None:
    pose = pose_from_ypr([10.0, -4.0, 1.0], np.pi / 2)
    np.testing.assert_allclose(from_world(pose, [10.0, -1.0, 1.5]), [3.0, 0.0, 0.5], atol=1e-12)
    np.testing.assert_allclose(to_world(pose, [3.0, 0.0, 0.5]), [10.0, -1.0, 1.5], atol=1e-12)
    row = dict(zip(("x", "y", "z", "qx", "qy", "qz", "qw"), 2.0 * pose, strict=True))
    np.testing.assert_allclose(pose_from_row(row)[3:], pose[3:])  # a unit quaternion


def test_corners_of_boxes(frame: Frame) -> None:
    corners = frame.boxes.corners
    assert corners.shape == (len(frame.boxes), 8, 3)
    for index in (0, 7):
        row = {name: values[index] for name, values in frame.boxes.columns.items()}
        turn = quaternion_to_matrix(quaternion_from_ypr(row["yaw"], row["pitch"], row["roll"]))
        far = np.array([row["x"], row["y"], row["z"]]) + turn @ [row["length"] / 2, row["width"] / 2, row["height"] / 2]
        np.testing.assert_allclose(corners[index, 7], far, atol=1e-6)
    assert box_corners(
        {name: [] for name in ["x", "y", "z", "yaw", "pitch", "roll", "length", "width", "height"]}
    ).shape == (0, 8, 3)


def test_the_antenna_of_an_agent(frame: Frame) -> None:
    cav = frame.agents["cav_1"]
    expected = compose(cav.pose, [0.0, 0.0, 2.5, 0.0, 0.0, 0.0, 1.0])
    np.testing.assert_allclose(cav.sensor_pose("antenna"), expected)


@pytest.mark.parametrize("key", [("town99", "sunny", 0), (SCENARIO, "snowy", 0), (SCENARIO, "sunny", 4)])
def test_a_frame_that_is_not_there_is_named(data: Dataset, key: tuple[str, str, int]) -> None:
    with pytest.raises(ValueError, match=r"has no frame .*; it has frames 0 to 3 of town03_roundabout rainy"):
        data.frame(*key)


def test_tables_as_pandas_and_numpy(data: Dataset) -> None:
    rows = data.pandas("lidar", weather="sunny", frames=range(1, 2), agent="cav_1", columns=["frame", "x"])
    assert list(rows.columns) == ["frame", "x"] and isinstance(rows["x"][0], np.ndarray)
    columns = data.numpy("lidar", weather="sunny", frames=range(1, 2), agent="cav_1")
    np.testing.assert_array_equal(columns["x"][0], rows["x"][0])
    assert columns["agent"].tolist() == ["cav_1"] and columns["flow_x"][0] is None
    assert data.numpy("links")["gain_db"].dtype == np.float64
    assert data.numpy("depth", frames=range(1))["image"][0]["path"].endswith(".png")
    only = data.read("rgb", sensor="front", columns=["sensor"])
    assert only.num_rows == data.arrow("rgb").count_rows() and data.read("rgb", sensor="none").num_rows == 0


def test_every_frame_range_reads_the_rows_of_a_filter(data: Dataset) -> None:
    """Files are left out by their names; the rows are the same as those of a filter over all files."""
    whole = data.read("poses").to_pylist()
    for begin in range(-1, 6):
        for end in range(begin, 6):
            for step in (1, 2):
                frames = range(max(begin, 0), max(end, 0), step)
                found = data.read("poses", weather="rainy", frames=frames).to_pylist()
                assert found == [row for row in whole if row["weather"] == "rainy" and row["frame"] in frames]
