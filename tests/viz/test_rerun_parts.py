"""Parts of the viewer: scopes, colors, the town's meshes, gaps, notes and damaged datasets."""

from pathlib import Path

import numpy as np
import pyarrow.compute as pc
import pyarrow.fs as pafs
import pytest

rr = pytest.importorskip("rerun")

from mmw.core.mesh import TriangleMesh  # noqa: E402
from mmw.core.transforms import quaternion_from_ypr  # noqa: E402
from mmw.dataset import Dataset, open_dataset  # noqa: E402
from mmw.storage.codecs.images import decode_depth, encode_depth  # noqa: E402
from mmw.usd.semantics import CARLA_TAG  # noqa: E402
from mmw.viz.plots import style  # noqa: E402
from mmw.viz.rerun import selection as scope  # noqa: E402
from mmw.viz.rerun.entities import agent_entity, paths_entity, sensor_entity, series_entity  # noqa: E402
from mmw.viz.rerun.frames import flat_boxes  # noqa: E402
from mmw.viz.rerun.recording import Looks  # noqa: E402
from mmw.viz.rerun.samples import depth_image  # noqa: E402
from mmw.viz.rerun.selection import choose_scope  # noqa: E402
from mmw.viz.rerun.sensor_mounts import sensor_notes  # noqa: E402
from mmw.viz.rerun.town import town_meshes  # noqa: E402
from mmw.viz.rerun.viewer import save  # noqa: E402
from tests.fixtures.rrd_files import read_recording  # noqa: E402
from tests.fixtures.scenes import two_cars  # noqa: E402
from tests.fixtures.small_dataset import SCENARIO, copy_of, part, rewrite, small_dataset  # noqa: E402

FLAT = Looks(with_town=False)


def test_the_first_scenario_and_weather_and_all_frames_and_agents_are_shown(data: Dataset) -> None:
    found = choose_scope(data)
    assert (found.scenario, found.weather, found.frames) == (SCENARIO, "sunny", (0, 1, 2, 3))
    assert found.agents == ("cav_1", "cav_2", "cav_3", "rsu_1")
    assert found.notes == ()


def test_many_frames_are_thinned_with_a_note(data: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scope, "MAX_FRAMES", 3)
    found = choose_scope(data)
    assert found.frames == (0,)
    assert found.notes == ("1 of 4 frames, every 10th; --frames shows others",)


@pytest.mark.parametrize(
    ("where", "message"),
    [
        ({"scenario": "nowhere"}, r"no scenario 'nowhere'; it has town03_roundabout"),
        ({"weather": "snowy"}, r"no weather 'snowy'; it has sunny, rainy"),
        ({"frames": range(10, 20)}, r"none of the frames 10:20:1; it has 0 to 3"),
        ({"agents": ["cav_9"]}, r"no agent 'cav_9'; it has cav_1, cav_2, cav_3, rsu_1"),
    ],
)
def test_absent_names_give_one_line(data: Dataset, where: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        choose_scope(data, **where)


def test_a_dataset_without_rows_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "dataset.json").write_bytes((small_dataset() / "dataset.json").read_bytes())
    with pytest.raises(ValueError, match="holds no frames yet"):
        choose_scope(open_dataset(tmp_path))


def test_tables_that_are_missing_are_named_in_one_line(tmp_path: Path) -> None:
    root = copy_of(small_dataset(), tmp_path / "few")
    for name in ("lidar", "links", "path_gains", "rgb"):
        (root / name).rename(tmp_path / name)
    notes = save(choose_scope(open_dataset(root), frames=range(1)), FLAT, tmp_path / "few.rrd")
    assert notes == ["the dataset has no lidar, rgb, links, paths: not shown"]
    recording = read_recording(tmp_path / "few.rrd")
    assert not list(recording.under("gain"))
    assert recording.frames("world/boxes") == [0]


def test_an_absent_town_is_omitted_with_a_note(tmp_path: Path) -> None:
    root = copy_of(small_dataset(), tmp_path / "bare")
    (root / "stages").unlink()
    notes = save(choose_scope(open_dataset(root), frames=range(1)), Looks(), tmp_path / "bare.rrd")
    assert any(note.startswith("the town is not shown:") and "stages" in note for note in notes)


def test_a_dataset_elsewhere_is_shown_without_its_town(tmp_path: Path) -> None:
    root = small_dataset()
    elsewhere = pafs.SubTreeFileSystem(root.parent.as_posix(), pafs.LocalFileSystem())
    found = choose_scope(open_dataset(root.name, elsewhere), frames=range(1), agents=["rsu_1"])
    notes = save(found, Looks(), tmp_path / "far.rrd")
    assert any("the town is not shown" in note and "elsewhere" in note for note in notes)
    assert read_recording(tmp_path / "far.rrd").frames(sensor_entity("rsu_1", "lidar")) == [0]


def test_an_agent_that_leaves_is_cleared_with_its_links(tmp_path: Path) -> None:
    root = copy_of(small_dataset(), tmp_path / "left")
    for table in ("poses", "links", "path_gains", "lidar", "depth", "rgb"):
        name = part(table, frame=2)
        if (root / name).exists():
            rewrite(root, name, lambda rows: rows.filter(pc.not_equal(rows.column("agent").cast("string"), "cav_2")))
    save(choose_scope(open_dataset(root)), FLAT, tmp_path / "left.rrd")
    recording = read_recording(tmp_path / "left.rrd")
    assert recording.frames(agent_entity("cav_2")) == [0, 1, 2]
    assert recording.is_cleared(agent_entity("cav_2"), 2)
    assert recording.frames(sensor_entity("cav_2", "lidar")) == [0, 1]
    assert recording.frames(agent_entity("cav_1")) == [0, 1, 2, 3]
    link = (28e9, "cav_2", "rsu_1")
    assert recording.is_cleared(paths_entity(*link), 2)
    assert recording.is_cleared(series_entity("los", *link), 2)
    assert np.isnan(recording.array(series_entity("gain", *link), 2, "Scalars:scalars")).all()
    assert not recording.is_cleared(series_entity("gain", 28e9, "cav_1", "rsu_1"), 2)


def test_a_damaged_file_is_named_and_gives_no_recording(tmp_path: Path) -> None:
    root = copy_of(small_dataset(), tmp_path / "bad")
    file = root / part("lidar")
    file.write_bytes(file.read_bytes()[:-100])
    with pytest.raises(ValueError, match=r"lidar.*part-000000.parquet.*damaged"):
        save(choose_scope(open_dataset(root)), FLAT, tmp_path / "bad.rrd")
    assert [path.name for path in tmp_path.iterdir()] == ["bad"]


def test_a_recording_has_its_ending_and_colors_their_names(data: Dataset, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"must end in \.rrd"):
        save(choose_scope(data), FLAT, tmp_path / "out.mp4")
    with pytest.raises(ValueError, match="object, class, intensity, label"):
        Looks("height")


@pytest.mark.parametrize("by", ["class", "intensity", "label"])
def test_lidar_can_be_colored_otherwise(data: Dataset, tmp_path: Path, by: str) -> None:
    save(
        choose_scope(data, weather="rainy", frames=range(1), agents=["cav_1"]),
        Looks(by, with_town=False),
        tmp_path / "a.rrd",
    )
    found = read_recording(tmp_path / "a.rrd").at(sensor_entity("cav_1", "lidar"), 0, "Points3D:colors")
    rgb = np.array([[color >> 24, color >> 16 & 255, color >> 8 & 255] for color in found])
    sweep = data.frame(SCENARIO, "rainy", 0).agents["cav_1"].sweeps["lidar"]
    if by == "label":
        assert (sweep["label"] == 1).sum() > 0  # rain
        np.testing.assert_array_equal(rgb, style.LABEL_COLORS[sweep["label"]])
    elif by == "class":
        objects = {row["object_id"]: row["label"] for row in data.read("objects", scenario=SCENARIO).to_pylist()}
        expected = [style.CLASS_COLORS[objects[thing]] if thing >= 0 else (255,) * 3 for thing in sweep["object_id"]]
        np.testing.assert_array_equal(rgb, expected)
    else:
        brightest, darkest = np.argmax(sweep["intensity"]), np.argmin(sweep["intensity"])
        assert rgb[brightest, 0] - rgb[brightest, 2] > rgb[darkest, 0] - rgb[darkest, 2]  # hotter


def test_colors() -> None:
    found = style.scale_colors([-1000.0, -140.0, -70.0, np.nan], *style.GAIN_DB)
    np.testing.assert_array_equal(found, style.SCALE[[0, 0, -1, 0]])
    near, rest, away = style.velocity_colors([-50.0, 0.0, 50.0]).astype(int)
    assert near[2] > 200 > near[0]
    assert np.ptp(rest) == 0
    assert away[0] > 200 > away[2]
    found = style.object_colors(np.arange(200)).astype(int)
    assert np.abs(np.diff(found, axis=0)).sum(axis=1).min() > 100  # neighbors differ
    pale = style.object_colors([5], [False]).astype(int)
    assert np.ptp(pale) < np.ptp(found[5])
    assert set(style.CLASS_COLORS) == set(CARLA_TAG)
    assert len(set(style.CLASS_COLORS.values())) == len(CARLA_TAG)


def test_depth_before_rounding_is_in_metres() -> None:
    metres = np.array([[0.0, 1.234567], [700.5, 3.0]], dtype=np.float32)
    found = depth_image({"depth_m": metres.ravel(), "image": None}, (2, 2))
    assert isinstance(found, rr.DepthImage)
    np.testing.assert_array_equal(
        found.buffer.as_arrow_array().to_pylist()[0], np.frombuffer(metres.tobytes(), np.uint8)
    )
    assert found.meter.as_arrow_array().to_pylist() == [1.0]
    stored = encode_depth(np.array([[0, 250]], dtype=np.uint16))
    coded = depth_image({"depth_m": None, "image": {"bytes": stored}}, (1, 2))
    assert isinstance(coded, rr.EncodedDepthImage)
    assert (
        decode_depth(bytes(coded.blob.as_arrow_array().to_pylist()[0]))[0, 1] * coded.meter.as_arrow_array()[0].as_py()
        == 250
    )
    assert depth_image({"depth_m": None, "image": None}, (1, 1)) is None


def test_rectangles_are_those_of_visible_pixels() -> None:
    seen = {"u_min": 3, "v_min": 4, "u_max": 13, "v_max": 8, "object_id": 7}
    hidden = {**dict.fromkeys(seen), "object_id": 8}
    boxes = flat_boxes([seen, hidden])
    assert boxes.half_sizes.as_arrow_array().to_pylist() == [[5.0, 2.0]]
    assert boxes.centers.as_arrow_array().to_pylist() == [[8.0, 6.0]]
    assert len(flat_boxes([]).half_sizes.as_arrow_array()) == 0


def test_lenses_that_bend_and_unknown_sensors_are_named() -> None:
    straight = {"agent": "cav_1", "sensor": "front", "type": "rgb", "lens": "pinhole"}
    bent, sonar = straight | {"sensor": "fish", "lens": "fisheye"}, straight | {"type": "sonar", "lens": None}
    assert sensor_notes([straight, {**straight, "type": "antenna", "lens": None}]) == []
    lens, unknown = sensor_notes([straight, bent, sonar])
    assert lens.startswith("cav_1 fish: the lens bends") and unknown.startswith("sonar: no installed package")


def test_meshes_of_the_town_have_every_face_near_the_agents() -> None:
    arrays = two_cars(1)
    everywhere = np.array([np.inf, np.inf])
    (weather,) = list(arrays.materials)[:1]
    meshes = town_meshes(arrays, weather, -everywhere, everywhere)
    assert sum(len(mesh.faces) for mesh in meshes) == len(arrays.faces) > 0
    area = sum(TriangleMesh(mesh.points.astype(np.float64), mesh.faces).areas.sum() for mesh in meshes)
    assert area == pytest.approx(TriangleMesh(arrays.points, arrays.faces).areas.sum(), rel=1e-5)
    assert all(len(mesh.points) <= 3 * len(mesh.faces) for mesh in meshes)
    assert town_meshes(arrays, weather, everywhere, everywhere) == []
    assert quaternion_from_ypr(0.0, 0.0, 0.0).tolist() == [0, 0, 0, 1]  # order that Rerun is given
