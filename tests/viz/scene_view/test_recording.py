"""Entities of a scene's recording, read back by Rerun's own reader."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rerun")

from mmw.channel import Paths
from mmw.channel.radio_map.radio_map import RadioMap
from mmw.core.transforms import quaternion_to_matrix
from mmw.physics.weather.weather import PRESETS
from mmw.scene import Scene, Transmitter
from mmw.viz.plots.style import scale_colors
from mmw.viz.scene_view import show
from mmw.viz.scene_view.coverage import choose_coverage
from tests.fixtures.rrd_files import Recording, read_recording
from tests.fixtures.scenes import two_cars
from tests.fixtures.street_scene import street_scene

CAR, UE = "world/paths/28GHz/car\\ from\\ bs", "world/paths/28GHz/ue\\ from\\ bs"


def recorded(scene: Scene, folder: Path, **options) -> Recording:
    file = show(scene, save=folder / "scene.rrd", **options)
    assert file == folder / "scene.rrd" and [path.name for path in folder.iterdir()] == ["scene.rrd"]
    return read_recording(file)


def rgb(packed: float) -> np.ndarray:
    return np.array([int(packed) >> shift & 255 for shift in (24, 16, 8)])


@pytest.fixture(scope="module")
def recording(
    street: Scene, street_paths: Paths, street_map: RadioMap, tmp_path_factory: pytest.TempPathFactory
) -> Recording:
    folder = tmp_path_factory.mktemp("recording")
    return recorded(street, folder, paths=street_paths, radio_map=street_map, metric="rss")


def test_everything_is_there_and_without_time(recording: Recording) -> None:
    own = {name for name in recording.rows if not name.startswith("/__")}
    assert own == {
        "/world", "/world/town/asphalt", "/world/town/marble_facade", "/world/town/window_glass", "/world/actors",
        "/world/actors/cav_1/car_paint_red", "/world/actors/veh_001/car_glass", "/world/transmitters/bs",
        "/world/receivers/car", "/world/receivers/ue", f"/{CAR}", f"/{UE}", "/world/coverage", "/legend",
    }  # fmt: skip
    assert all(list(recording.rows[name]) == [None] for name in own)


def test_meshes_have_the_town_and_the_cars(recording: Recording) -> None:
    wall = recording.array("world/town/marble_facade", None, "Mesh3D:vertex_positions")
    np.testing.assert_allclose([wall.min(axis=0), wall.max(axis=0)], [(-100, 10, 0), (100, 10, 15)])
    np.testing.assert_allclose(
        recording.array("world/town/marble_facade", None, "Mesh3D:vertex_normals"), [(0, -1, 0)] * 4
    )
    assert rgb(recording.at("world/town/marble_facade", None, "Mesh3D:albedo_factor")[0]).tolist() == [188] * 3
    car = recording.array("world/actors/cav_1/car_paint_red", None, "Mesh3D:vertex_positions")
    np.testing.assert_allclose([car.min(axis=0), car.max(axis=0)], [(-22.25, -3.9, 0), (-17.75, -2.1, 1.5)], atol=1e-5)
    assert len(recording.at("world/actors/cav_1/car_paint_red", None, "Mesh3D:triangle_indices")) == 12


def test_actors_and_antennas_have_their_names(street: Scene, recording: Recording) -> None:
    assert recording.at("world/actors", None, "Points3D:labels") == ["cav_1", "veh_001", "rsu_1"]
    places = recording.array("world/actors", None, "Points3D:positions")
    np.testing.assert_allclose(places, [(-20, -3, 1.5), (19.7, 3, 2.4), (0, 9, 5)], atol=1e-5)  # above them
    for entity, device in (
        ("world/transmitters/bs", street.transmitters["bs"]),
        ("world/receivers/car", street.receivers["car"]),
    ):
        position, rotation, _ = street.antenna_state(device)
        assert recording.at(entity, None, "Points3D:labels") == [device.name]
        np.testing.assert_allclose(recording.array(entity, None, "Transform3D:translation")[0], position, atol=1e-5)
        columns = recording.array(entity, None, "Transform3D:mat3x3")[0].reshape(3, 3)
        np.testing.assert_allclose(columns.T, rotation, atol=1e-6)


def test_antennas_are_turned(tmp_path: Path) -> None:
    scene = street_scene()
    scene.transmitters["bs"].look_at((10.0, 3.0, 0.0))
    found = recorded(scene, tmp_path).array("world/transmitters/bs", None, "Transform3D:mat3x3")[0].reshape(3, 3).T
    np.testing.assert_allclose(found, quaternion_to_matrix(scene.transmitters["bs"].orientation), atol=1e-6)


def test_paths_are_lines_by_link_with_kind_and_gain(street_paths: Paths, recording: Recording) -> None:
    gains = 20.0 * np.log10(np.abs(street_paths.a[:, 0]))
    limits = (max(gains.min(), gains.max() - 60.0), gains.max())
    for entity, name, end in ((CAR, "car", (-20, -3, 1.8)), (UE, "ue", (40, -6, 1.5))):
        own = np.flatnonzero(np.array(street_paths.rx_names)[street_paths.rx] == name)
        own = own[np.argsort(gains[own], kind="stable")]
        strips = recording.at(entity, None, "LineStrips3D:strips")
        assert len(strips) == len(own)
        for path, strip in zip(own, strips, strict=True):
            inner = street_paths.vertices[path, : street_paths.depth[path]]
            np.testing.assert_allclose(strip, [(-30, 6, 8), *inner, end], atol=1e-4)
        labels = recording.at(entity, None, "LineStrips3D:labels")
        assert labels == [f"{street_paths.kind[path]}, {gains[path]:.1f} dB" for path in own]
        colors = [rgb(color) for color in recording.at(entity, None, "LineStrips3D:colors")]
        np.testing.assert_allclose(colors, scale_colors(gains[own], *limits), atol=1)
        widths = recording.array(entity, None, "LineStrips3D:radii")
        assert (np.diff(np.abs(widths)) >= 0.0).all()  # the stronger, the wider; negative: on the screen


def test_coverage_is_a_mesh_with_a_color_for_each_cell(street_map: RadioMap, recording: Recording) -> None:
    expected = choose_coverage(street_map, "rss")
    points = recording.array("world/coverage", None, "Mesh3D:vertex_positions").reshape(-1, 3, 3)
    np.testing.assert_allclose(points, expected.triangles, atol=1e-4)
    colors = [rgb(color) for color in recording.at("world/coverage", None, "Mesh3D:vertex_colors")]
    np.testing.assert_array_equal(colors, np.repeat(expected.colors[expected.cell], 3, axis=0))


def test_a_clip_cuts_surfaces_and_leaves_paths_and_antennas_whole(
    street: Scene, street_paths: Paths, street_map: RadioMap, tmp_path: Path
) -> None:
    box = (-25.0, -11.0, -1.0, 30.0, 11.0, 2.0)
    found = recorded(street, tmp_path, paths=street_paths, radio_map=street_map, clip=box)
    meshes = [name[1:] for name in found.rows if name.startswith(("/world/town", "/world/actors/", "/world/coverage"))]
    assert len(meshes) == 6
    every = np.concatenate([found.array(name, None, "Mesh3D:vertex_positions") for name in meshes])
    np.testing.assert_allclose([every.min(axis=0), every.max(axis=0)], [(-25, -11, 0), (30, 11, 2)], atol=1e-5)
    assert len(found.at(CAR, None, "LineStrips3D:strips")) == (street_paths.rx == 0).sum()
    np.testing.assert_allclose(found.array("world/transmitters/bs", None, "Transform3D:translation")[0], (-30, 6, 8))


def test_a_scene_alone_has_no_legend(tmp_path: Path) -> None:
    scene = Scene(two_cars(1), {"sunny": PRESETS["sunny"]}, device="cpu", name="bare")
    found = recorded(scene, tmp_path)
    assert not [name for name in found.rows if name.startswith(("/legend", "/world/paths", "/world/transmitters"))]


def test_only_the_strongest_paths_are_shown(
    street: Scene, street_paths: Paths, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level("INFO", "mmw"):
        found = recorded(street, tmp_path, paths=street_paths, max_paths=2, carrier_hz=3.5e9)
    strips = [
        name
        for name in found.rows
        if name.startswith("/world/paths")
        for _ in found.at(name[1:], None, "LineStrips3D:strips")
    ]
    assert len(strips) == 2 and all("3.5GHz" in name for name in strips)
    assert f"the strongest 2 of {len(street_paths)} paths" in caplog.text


def test_names_of_any_kind_are_entities(tmp_path: Path) -> None:
    scene = street_scene()
    scene.add(Transmitter("mast/1 of 2", position=(0.0, 0.0, 5.0)))
    assert "/world/transmitters/mast\\/1\\ of\\ 2" in recorded(scene, tmp_path).rows
