"""The Rerun recording of a dataset, read back, against its tables."""

from pathlib import Path

import numpy as np
import pytest
from trimesh import transform_points

rr = pytest.importorskip("rerun")

from mmw.core.constants import SPEED_OF_LIGHT  # noqa: E402
from mmw.dataset import BeamSearch, Dataset  # noqa: E402
from mmw.sensors.render.projection import project  # noqa: E402
from mmw.viz.rerun.entities import (  # noqa: E402
    agent_entity,
    paths_entity,
    reading_entity,
    sensor_entity,
    series_entity,
)
from mmw.viz.rerun.recording import Looks  # noqa: E402
from mmw.viz.rerun.selection import choose_scope  # noqa: E402
from mmw.viz.rerun.viewer import save  # noqa: E402
from tests.fixtures.rrd_files import Recording, matrix, read_recording, rerun_pixels  # noqa: E402
from tests.fixtures.small_dataset import SCENARIO  # noqa: E402

FRAMES = range(4)


@pytest.fixture(scope="module")
def recording(data: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    file = tmp_path_factory.mktemp("viewer") / "all.rrd"
    notes = save(choose_scope(data, weather="rainy"), Looks(search=BeamSearch()), file)
    assert notes == []
    return read_recording(file)


def test_frames_and_seconds_are_the_only_timelines(recording: Recording) -> None:
    assert recording.timelines == {"frame", "time"}
    assert recording.times == {frame: pytest.approx(frame / 100.0) for frame in FRAMES}


def test_every_point_of_every_sweep_is_that_of_the_table(data: Dataset, recording: Recording) -> None:
    rows = data.read("lidar", scenario=SCENARIO, weather="rainy").to_pylist()
    assert len({row["agent"] for row in rows}) == 4
    for row in rows:
        entity, frame = sensor_entity(row["agent"], row["sensor"]), row["frame"]
        points = recording.array(entity, frame, "Points3D:positions")
        np.testing.assert_array_equal(points, np.stack([row[axis] for axis in "xyz"], axis=1))
        on_agent = transform_points(points, matrix(recording, entity, None))
        placed = transform_points(on_agent, matrix(recording, agent_entity(row["agent"]), frame))
        world = data.frame(SCENARIO, "rainy", frame).agents[row["agent"]].sweeps[row["sensor"]].world
        np.testing.assert_allclose(placed, world, atol=2e-4)


def test_returns_on_a_car_have_the_color_of_its_box(data: Dataset, recording: Recording) -> None:
    frame = data.frame(SCENARIO, "rainy", 1)
    box_color = dict(zip(frame.boxes["object_id"], recording.at("world/boxes", 1, "Boxes3D:colors"), strict=True))
    assert len(set(box_color.values())) == len(box_color)
    cars = 0
    for agent in frame.agents.values():
        for sensor, cloud in agent.sweeps.items():
            found = recording.at(sensor_entity(agent.name, sensor), 1, "Points3D:colors")
            for color, thing in zip(found, cloud["object_id"], strict=True):
                if thing in box_color:
                    cars += 1
                    assert color == box_color[thing]
                else:
                    assert color not in box_color.values()
    assert cars > 20


def test_boxes_are_those_of_the_table(data: Dataset, recording: Recording) -> None:
    for number in FRAMES:
        boxes = data.frame(SCENARIO, "rainy", number).boxes
        half = recording.array("world/boxes", number, "Boxes3D:half_sizes")
        turns = recording.array("world/boxes", number, "Boxes3D:quaternions")
        centers = recording.array("world/boxes", number, "Boxes3D:centers")
        assert len(centers) == len(boxes) > 5
        for index, corners in enumerate(boxes.corners):
            x, y, z, w = turns[index]
            forward = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)])
            along = (corners - centers[index]) @ forward
            np.testing.assert_allclose(along.max(), half[index, 0], atol=1e-3)
            np.testing.assert_allclose(corners.mean(axis=0), centers[index], atol=1e-3)


@pytest.mark.parametrize(
    ("table", "archetype", "frames", "component", "value"),
    [
        ("rgb", "EncodedImage", [0, 2], "media_type", "image/jpeg"),  # an image stays until the next
        ("depth", "EncodedDepthImage", [0, 1, 2, 3], "meter", 100.0),
    ],
)
def test_images_are_the_stored_files(
    data: Dataset, recording: Recording, table: str, archetype: str, frames: list, component: str, value: object
) -> None:
    rows = data.read(table, scenario=SCENARIO, weather="rainy").to_pylist()
    assert sorted({row["frame"] for row in rows}) == frames
    for row in rows:
        entity = f"{sensor_entity(row['agent'], row['sensor'])}/{table}"
        assert bytes(recording.at(entity, row["frame"], f"{archetype}:blob")[0]) == row["image"]["bytes"]
        assert recording.at(entity, row["frame"], f"{archetype}:{component}") == [value]
        assert recording.frames(entity) == frames


def test_a_return_lies_in_reruns_camera_on_the_object_that_the_camera_sees(data: Dataset, recording: Recording) -> None:
    """The pixel that Rerun's definition gives a LiDAR return shows, in the instance image, the same object."""
    checked = same = 0
    for number in FRAMES:
        frame = data.frame(SCENARIO, "rainy", number)
        for agent in frame.agents.values():
            view, sweep = agent.views.get("depth"), agent.sweeps["lidar"]
            if view is None or view.instance is None or view.depth is None:
                continue
            camera, lidar = sensor_entity(agent.name, "depth"), sensor_entity(agent.name, "lidar")
            to_camera = np.linalg.inv(matrix(recording, camera, None)) @ matrix(recording, lidar, None)
            points = transform_points(recording.array(lidar, number, "Points3D:positions"), to_camera)
            pixels = rerun_pixels(recording, camera, points)
            inside = view.camera.is_inside(pixels)
            np.testing.assert_allclose(pixels[inside], project(view.camera.intrinsics, points[inside]), atol=1e-2)
            u, v = np.floor(pixels[inside]).astype(int).T
            is_near = np.abs(view.depth[v, u] - points[inside, 0]) < 0.5  # not behind something
            same += (view.instance[v, u] == sweep["object_id"][inside])[is_near].sum()
            checked += is_near.sum()
    assert checked > 500
    assert same > 0.95 * checked


def test_pinholes_have_the_size_of_their_images(data: Dataset, recording: Recording) -> None:
    cameras = [row for row in data.read("sensors", scenario=SCENARIO).to_pylist() if row["fx"] is not None]
    assert cameras
    for row in cameras:
        entity = sensor_entity(row["agent"], row["sensor"])
        np.testing.assert_array_equal(
            recording.array(entity, None, "Pinhole:resolution")[0], [row["width"], row["height"]]
        )


def test_paths_run_from_transmitter_to_receiver_with_the_delay_of_the_table(
    data: Dataset, recording: Recording
) -> None:
    counted = 0
    for number in FRAMES:
        for link in data.frame(SCENARIO, "rainy", number).links:
            entity = paths_entity(link.carrier_hz, link.agent, link.peer)
            if not len(link.a):
                assert number not in recording.frames(entity) or recording.is_cleared(entity, number)
                continue
            strips = recording.at(entity, number, "LineStrips3D:strips")
            colors = recording.at(entity, number, "LineStrips3D:colors")
            assert len(strips) == len(link.a)
            ends = [
                matrix(recording, agent_entity(name), number) @ matrix(recording, sensor_entity(name, "antenna"), None)
                for name in (link.peer, link.agent)
            ]
            for strip, tau in zip(strips, link.paths["tau_s"], strict=True):
                line = np.array(strip, dtype=np.float64)
                np.testing.assert_allclose(line[[0, -1]], [end[:3, 3] for end in ends], atol=1e-3)
                length = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
                assert length / SPEED_OF_LIGHT == pytest.approx(tau, abs=1e-11)
                counted += 1
            order = np.argsort(np.abs(link.a))
            red = np.array([color >> 24 for color in colors])[order]
            blue = np.array([color >> 8 & 255 for color in colors])[order]
            assert (np.diff(red - blue.astype(int)) >= 0).all()  # the stronger, the hotter
    assert counted > 10


def test_series_are_the_links_and_the_best_beams(data: Dataset, recording: Recording) -> None:
    pytest.importorskip("duckdb")
    rows = data.connect().sql(
        "SELECT l.frame, l.agent, l.peer, l.carrier_hz, l.is_los, l.gain_db, b.tx_beam, b.rx_beam, b.gain "
        "FROM links l JOIN beams b USING (scenario, weather, frame, agent, peer, carrier_hz) "
        f"WHERE scenario = '{SCENARIO}' AND weather = 'rainy'"
    )
    found = rows.fetchall()
    assert len(found) == 4 * 6
    for frame, agent, peer, carrier, is_los, gain_db, tx_beam, rx_beam, gain in found:
        values = {
            series: recording.array(series_entity(series, carrier, agent, peer), frame, "Scalars:scalars")[0]
            for series in ("gain", "beam_gain", "tx_beam", "rx_beam")
        }
        (state,) = recording.at(series_entity("los", carrier, agent, peer), frame, "StateChange:state")
        if gain_db is None:
            assert state == "no path"
            assert all(np.isnan(value) for value in values.values())
        else:
            assert state == ("los" if is_los else "nlos")
            expected = {"gain": gain_db, "beam_gain": 10 * np.log10(gain), "tx_beam": tx_beam, "rx_beam": rx_beam}
            assert values == pytest.approx(expected)


def test_scalar_sensors_are_time_series_in_their_own_numbers(data: Dataset, recording: Recording) -> None:
    for table, column in (("imu", "az"), ("gnss", "latitude_deg")):
        rows = data.read(table, scenario=SCENARIO, weather="rainy").to_pylist()
        assert rows
        for row in rows:
            entity = reading_entity(row["sensor"], column, row["agent"])
            assert recording.array(entity, row["frame"], "Scalars:scalars")[0] == row[column]
    assert not list(recording.under("readings/imu/ax_bias"))  # numbers of learning windows alone


def test_every_agent_has_axes_and_a_name(recording: Recording) -> None:
    for agent in ("cav_1", "cav_2", "cav_3", "rsu_1"):
        assert recording.at(agent_entity(agent), None, "TransformAxes3D:axis_length") == [2.0]
        assert recording.at(f"{agent_entity(agent)}/name", None, "Points3D:labels") == [agent]
        assert recording.frames(agent_entity(agent)) == list(FRAMES)


def test_the_town_lies_under_the_returns(recording: Recording, data: Dataset) -> None:
    """Returns of the ground lie in planes of the town's roads and grass."""
    names = set(recording.under("world/town"))
    assert {"world/town/asphalt", "world/town/grass"} <= names
    points = recording.array("world/town/asphalt", None, "Mesh3D:vertex_positions")
    normals = recording.array("world/town/asphalt", None, "Mesh3D:vertex_normals")
    faces = recording.array("world/town/asphalt", None, "Mesh3D:triangle_indices").astype(int)
    assert faces.max() == len(points) - 1
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-3)
    assert (normals[:, 2] > 0.5).mean() > 0.9  # roads face up
    corners = points[faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    agree = (flat * normals[faces[:, 0]]).sum(axis=1)
    assert (agree >= -1e-6).mean() > 0.999  # counter-clockwise from outside
    place = data.frame(SCENARIO, "rainy", 0).agents["cav_1"].pose[:3]
    below = np.linalg.norm(points[:, :2] - place[:2], axis=1) < 10.0
    assert np.abs(points[below, 2] - place[2]).min() < 0.1


def test_a_part_is_a_part(data: Dataset, tmp_path: Path) -> None:
    scope = choose_scope(data, weather="sunny", frames=range(1, 4, 2), agents=["cav_2"])
    assert scope.frames == (1, 3)
    save(scope, Looks("intensity", with_town=False), tmp_path / "part.rrd")
    recording = read_recording(tmp_path / "part.rrd")
    assert set(recording.times) == {1, 3}
    assert {name.split("/")[2] for name in recording.under("world/agents")} == {"cav_2"}
    assert not list(recording.under("world/town"))
    assert {name.split("/")[0] for name in recording.under("gain")} == {"gain"}
    assert not list(recording.under("beam_gain"))
    assert all("cav_2" in name for name in recording.under("gain"))
    assert recording.frames("world/boxes") == [1, 3]  # boxes are everyone's
