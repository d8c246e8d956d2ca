"""DeepMIMO scenarios, opened by DeepMIMO itself: its channels against ours, in every attitude and for arrays."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pyarrow.fs as fs
import pytest
import trimesh

from mmw.channel import CarrierPaths, PlanarArray, apply_arrays, frequency_response, rotations_from_poses
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.dataset import open_dataset
from mmw.dataset.export.deepmimo.scenarios import FORMAT
from mmw.dataset.export.deepmimo.scene import GROUND
from mmw.dataset.export.exporter import Selection, export
from tests.fixtures.export_radio import BLOCKED, CAVS, SCENARIO, WEATHER, antenna, generate_dataset
from tests.fixtures.small_dataset import small_dataset

dm = pytest.importorskip(
    "deepmimo", reason="DeepMIMO 4.0.5 is not installed; pip install deepmimo==4.0.5", exc_type=ImportError
)

from deepmimo.core.rt_params import RayTracingParameters  # noqa: E402  # after importorskip

FRAMES, CARRIER = 4, 28e9
NAME = f"{SCENARIO}_{WEATHER}_28ghz"
SUBCARRIERS, SPACING = 64, 480e3


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return generate_dataset(tmp_path_factory.mktemp("made") / "data", FRAMES)


@pytest.fixture(scope="module")
def packed(root: Path, exported) -> Path:
    return exported("deepmimo", {"scene": "off"}, root)


@pytest.fixture(scope="module")
def dynamic(root: Path, exported) -> Path:
    return exported("deepmimo", {"mode": "dynamic"}, root)


@pytest.fixture
def load(packed: Path, monkeypatch: pytest.MonkeyPatch):
    """Return DeepMIMO's `load`, run where the export is, and the side files of the only pair of sets."""

    def open_scenario(out: Path = packed, name: str = NAME):
        monkeypatch.chdir(out)
        folder = out / "deepmimo_scenarios" / name.lower()
        return dm.load(name), {path.name: dict(np.load(path)) for path in sorted(folder.glob("*s_*.npz"))}

    return open_scenario


def our_paths(root: Path, peer: str = "rsu_1") -> tuple[CarrierPaths, np.ndarray, np.ndarray]:
    """Return paths of one transmitter, links frame by frame and CAV by CAV, and both ends' rotations."""
    data = open_dataset(root)
    paths, poses = data.paths(CARRIER), data.read("poses")
    paths = paths.take(np.flatnonzero(paths.keys["peer"] == peer))
    return paths, rotations_from_poses(poses, paths, "tx"), rotations_from_poses(poses, paths, "rx")


def channels(dataset, sides: dict, tx: tuple[int, int], rx: tuple[int, int], pattern: str = "isotropic", **options):
    """Return DeepMIMO's channels; shapes are (elements along y, elements along z)."""
    turns = sides["transmitters_t000.npz"]["rotation_deg"][0], sides["receivers_r001.npz"]["rotation_deg"]
    antennas = [
        {"shape": np.array(shape), "rotation": turn, "radiation_pattern": pattern}
        for shape, turn in zip((tx, rx), turns, strict=True)
    ]
    every = np.arange(SUBCARRIERS)
    ofdm = {"subcarriers": SUBCARRIERS, "bandwidth": SUBCARRIERS * SPACING, "selected_subcarriers": every}
    times = options.pop("times", None)
    parameters = dm.ChannelParameters(bs_antenna=antennas[0], ue_antenna=antennas[1], ofdm=ofdm, **options)
    return dataset.compute_channels(parameters, times=times)


def from_corner(shape: tuple[int, int], pattern: str) -> tuple[PlanarArray, np.ndarray]:
    """Return an array of ours with an element at its center, and the elements that start there, in DeepMIMO's order.

    DeepMIMO counts along y first, then upwards, from the element at the antenna's place.
    """
    along, up = shape
    array = PlanarArray(num_rows=2 * up - 1, num_cols=2 * along - 1, pattern=pattern)
    places = array.element_positions(CARRIER) * 2 * CARRIER / SPEED_OF_LIGHT
    wanted = [(0.0, float(m), float(n)) for n in range(up) for m in range(along)]
    return array, np.array([np.flatnonzero(np.abs(places - place).max(axis=1) < 1e-9)[0] for place in wanted])


def our_channels(root: Path, tx, rx, pattern: str = "iso", peer: str = "rsu_1", time_s=0.0) -> np.ndarray:
    paths, tx_turn, rx_turn = our_paths(root, peer)
    (tx_array, sent), (rx_array, heard) = from_corner(tx, pattern), from_corner(rx, pattern)
    a = apply_arrays(paths, tx_array, rx_array, CARRIER, tx_turn, rx_turn)[:, heard][:, :, sent]
    h = frequency_response(a, paths, np.arange(SUBCARRIERS) * SPACING, CARRIER, time_s)
    return h / np.sqrt(SUBCARRIERS)


def relative_error(found: np.ndarray, expected: np.ndarray) -> float:
    """Return the largest error of a link over the rms of its channel."""
    axes = tuple(range(1, expected.ndim))
    scale = np.sqrt((np.abs(expected) ** 2).mean(axis=axes))
    error = np.abs(found - expected).max(axis=axes)
    assert error[scale == 0].max(initial=0.0) == 0.0
    return float((error[scale > 0] / scale[scale > 0]).max())


@pytest.mark.parametrize(("tx", "rx"), [((1, 1), (1, 1)), ((16, 1), (4, 1)), ((4, 3), (2, 2)), ((1, 8), (1, 1))])
def test_channels_are_ours(root, load, tx, rx):
    """Both ends turned in yaw, pitch and roll; linear and planar arrays; 64 subcarriers; one link without a path."""
    dataset, sides = load()
    assert type(dataset).__name__ == "Dataset"
    h = channels(dataset, sides, tx, rx)
    expected = our_channels(root, tx, rx)
    assert h.shape == expected.shape == (FRAMES * len(CAVS), rx[0] * rx[1], tx[0] * tx[1], SUBCARRIERS)
    assert relative_error(h, expected) < 1e-5


def test_half_wave_dipoles_turn_with_their_agents(root, load):
    """DeepMIMO's own pattern on our isotropic gains is our half-wave dipole, but for its rounded directivity."""
    dataset, sides = load()
    h = channels(dataset, sides, (4, 1), (2, 1), "halfwave-dipole")
    expected = our_channels(root, (4, 1), (2, 1), "hw_dipole")
    ratio = np.vdot(expected, h) / np.vdot(expected, expected)
    assert abs(ratio - 1) < 2e-3
    assert relative_error(h / ratio, expected) < 1e-5


def test_doppler_of_the_side_file(root, load, packed):
    dataset, sides = load()
    extra = np.load(packed / "deepmimo_scenarios" / NAME.lower() / "extra_t000_tx000_r001.npz")
    dataset.set_doppler(np.nan_to_num(extra["doppler"]))
    times = np.array([0.0, 1e-3, 4e-3])
    h = channels(dataset, sides, (4, 1), (1, 1), doppler=True, times=times)
    expected = np.moveaxis(our_channels(root, (4, 1), (1, 1), time_s=times), -2, -1)
    assert relative_error(h, expected) < 1e-5


def test_geometry_and_interactions(root, load, packed):
    """Positions, delays, angles and interactions are those of the tables; the strongest path stands first."""
    dataset, sides = load()
    poses = open_dataset(root).read("poses").to_pydict()
    receivers = sides["receivers_r001.npz"]
    assert receivers["agent"].tolist() == [*CAVS] * FRAMES
    assert receivers["frame"].tolist() == np.repeat(np.arange(FRAMES), len(CAVS)).tolist()
    expected = [antenna(poses, frame, cav) for frame in range(FRAMES) for cav in CAVS]
    np.testing.assert_allclose(dataset.rx_pos, expected, atol=1e-9)
    np.testing.assert_allclose(np.ravel(dataset.tx_pos), antenna(poses, 0, "rsu_1"), atol=1e-9)
    blocked = BLOCKED[0] * len(CAVS) + CAVS.index(BLOCKED[1])
    assert np.flatnonzero(dataset.los == -1).tolist() == [blocked]
    assert (np.delete(dataset.num_paths, blocked) == 5).all()
    assert (np.diff(np.nan_to_num(dataset.power, nan=-400)) <= 0).all()
    los = dataset.inter == 0
    gap = (dataset.rx_pos - np.ravel(dataset.tx_pos))[np.nonzero(los)[0]]
    length = np.linalg.norm(gap, axis=1)
    np.testing.assert_allclose(dataset.delay[los], length / SPEED_OF_LIGHT, rtol=1e-12)
    friis = 20 * np.log10(SPEED_OF_LIGHT / CARRIER / (4 * np.pi * length))
    assert (dataset.power[los] <= friis + 1e-9).all()  # the rest is polarization
    np.testing.assert_allclose(dataset.aod_az[los], np.degrees(np.arctan2(gap[:, 1], gap[:, 0])), atol=1e-9)
    np.testing.assert_allclose(dataset.aoa_az[los], np.degrees(np.arctan2(-gap[:, 1], -gap[:, 0])), atol=1e-9)
    np.testing.assert_allclose(dataset.aod_el[los], np.degrees(np.arccos(gap[:, 2] / length)), atol=1e-6)
    assert set(dataset.inter_str.ravel()) == {"n", "", "R", "RS"}  # 13 is a reflection, then scattering
    points = np.isfinite(dataset.inter_pos).all(axis=-1).sum(axis=-1)
    np.testing.assert_array_equal(points[~np.isnan(dataset.inter)], dataset.num_inter[~np.isnan(dataset.inter)])
    extra = np.load(packed / "deepmimo_scenarios" / NAME.lower() / "extra_t000_tx000_r001.npz")
    assert set(extra["path_id"][0]) == {7_000_000_000_000_000_000 + path for path in range(5)}
    assert set(np.unique(extra["inter_object"])) == {-1, 20, 21}


def test_dynamic_scenario_holds_v2v(root, load, dynamic):
    """One scene a frame with a box for each object; CAVs transmit too."""
    dataset, _ = load(dynamic)
    assert len(dataset) == FRAMES
    scene = dataset[2]
    assert [(pair.txrx["tx_set_id"], pair.txrx["tx_idx"]) for pair in scene] == [(0, 0), (2, 0), (2, 1)]
    objects = scene[0].scene.objects
    boxes = open_dataset(root).read("boxes", frames=range(2, 3)).to_pydict()
    assert [item.name for item in objects] == ["ground", *(f"object_{number}" for number in boxes["object_id"])]
    found = np.array([item.bounding_box.center for item in list(objects)[1:]])
    np.testing.assert_allclose(found, np.stack([boxes[axis] for axis in "xyz"], axis=-1), atol=1e-5)


def test_every_channel_of_a_dynamic_scenario_is_ours(root, load, dynamic):
    """All frames, all transmitters, all receivers: DeepMIMO's own classes, and the channels of our links or zero."""
    dataset, _ = load(dynamic)
    assert type(dataset).__name__ == "DynamicDataset" and len(dataset) == FRAMES
    checked = 0
    for frame in range(FRAMES):
        scene, folder = dataset[frame], dynamic / "deepmimo_scenarios" / NAME.lower() / f"frame_{frame:06d}"
        assert type(scene).__name__ == "MacroDataset"
        ends = {path.stem: dict(np.load(path)) for path in folder.glob("*s_*.npz")}
        receivers = ends["receivers_r001"]
        for pair in scene:
            sent = ends[f"transmitters_t{pair.txrx['tx_set_id']:03d}"]
            peer = str(sent["agent"][pair.txrx["tx_idx"]])
            turns = {
                "transmitters_t000.npz": {"rotation_deg": sent["rotation_deg"][pair.txrx["tx_idx"]][None]},
                "receivers_r001.npz": receivers,
            }
            h = channels(pair, turns, (4, 1), (2, 1))
            keys, expected = our_paths(root, peer)[0].keys, our_channels(root, (4, 1), (2, 1), peer=peer)
            for index, agent in enumerate(receivers["agent"]):
                link = np.flatnonzero((keys["frame"] == frame) & (keys["agent"] == agent))
                if len(link) and expected[link].any():
                    assert relative_error(h[index : index + 1], expected[link]) < 1e-5
                    checked += 1
                else:
                    assert (h[index] == 0).all()
    # Three links from the roadside unit, both directions between two vehicles; one blocked.
    assert checked == FRAMES * 5 - 1


def test_max_paths_and_stored_antennas(root, tmp_path, load):
    out = tmp_path / "out"
    options = {"scene": "off", "max_paths": "2", "pattern": "stored"}
    export(root, "deepmimo", out, Selection(agents=("cav_3",), frames=range(1, 3)), options)
    dataset, sides = load(out)
    assert dataset.power.shape == (2, 2)
    assert sides["receivers_r001.npz"]["agent"].tolist() == ["cav_3", "cav_3"]
    rows = open_dataset(root).read("paths", frames=range(1, 2), agent="cav_3").to_pylist()
    gains = sorted((abs(row["a_re"] + 1j * row["a_im"]) for row in rows if row["carrier_hz"] == CARRIER), reverse=True)
    np.testing.assert_allclose(dataset.power[0], 20 * np.log10(gains[:2]), atol=1e-9)


def test_parameters(packed):
    params = json.loads((packed / "deepmimo_scenarios" / NAME.lower() / "params.json").read_text())
    assert params["rt_params"]["frequency"] == CARRIER
    assert params["rt_params"]["raw_params"]["weather"] == WEATHER
    ground = params["materials"]["material_0"]
    assert (ground["name"], ground["permittivity"], ground["conductivity"]) == ("asphalt", 2.5, pytest.approx(0.03))
    assert params["txrx_sets"]["txrx_set_1"]["num_active_points"] == FRAMES * len(CAVS) - 1


@pytest.mark.parametrize("name", ["packed", "dynamic"])
def test_every_parameter_of_deepmimo_is_there(root, name, request, monkeypatch):
    """`dm.summary` prints all of them."""
    monkeypatch.chdir(out := request.getfixturevalue(name))
    params = json.loads((out / "deepmimo_scenarios" / NAME.lower() / "params.json").read_text())["rt_params"]
    own = {field.name: field.type for field in dataclasses.fields(RayTracingParameters) if field.name != "gps_bbox"}
    assert params.keys() == own.keys()
    for key, value in params.items():
        assert type(value).__name__ == own[key], key
    text = dm.summary(NAME.lower(), print_summary=False)
    assert "GPS" not in text  # the dataset has no place on Earth that it would print
    assert "- Terrain reflection: True" in text and "- Casting range (el): 180.0°" in text
    boxes = len(open_dataset(root).read("boxes", frames=range(1)))
    assert f"- Total objects: {0 if name == 'packed' else 1 + boxes}" in text


def test_impossible_exports_are_refused(root, tmp_path):
    with pytest.raises(ValueError, match="max_paths=0: is no number of paths"):
        export(root, "deepmimo", tmp_path / "a", Selection(), {"max_paths": "0"})
    with pytest.raises(ValueError, match="mode=dynamic or other agents"):
        export(root, "deepmimo", tmp_path / "b", Selection(agents=("rsu_1",)), {})


@pytest.mark.filterwarnings("ignore:All-NaN:RuntimeWarning")  # of DeepMIMO, which computes the maximum of no paths
def test_nothing_but_a_blocked_receiver(root, tmp_path, load):
    """A scenario without any path loads, and its channel is zero."""
    frame, agent, _ = BLOCKED
    out = tmp_path / "out"
    export(root, "deepmimo", out, Selection(agents=(agent,), frames=range(frame, frame + 1)), {"scene": "off"})
    dataset, _ = load(out)
    assert dataset.los.tolist() == [-1] and dataset.power.shape == (1, 1)
    assert not dataset.compute_channels().any()


def test_one_frame_of_a_dynamic_scenario(root, tmp_path, load):
    """DeepMIMO treats one scene as a static scenario and looks for it in the scenario's own folder."""
    out = tmp_path / "out"
    export(root, "deepmimo", out, Selection(frames=range(2, 3)), {"mode": "dynamic"})
    dataset, _ = load(out)
    assert [pair.power.shape for pair in dataset] == [(3, 5), (3, 5), (3, 5)]
    assert dataset[0].scene.objects[0].label == "terrain"


def test_a_dataset_that_is_elsewhere(root, packed, tmp_path):
    """Matrices need the tables alone, the town needs the stages."""
    elsewhere = open_dataset(root, fs.LocalFileSystem())
    options = {option.name: option.default for option in FORMAT.options}
    with pytest.raises(ValueError, match="give scene=off"):
        FORMAT.tasks(elsewhere, Selection(), options)
    (task,) = (t for t in FORMAT.tasks(elsewhere, Selection(), options | {"scene": "off"}) if "28" in t.name)
    task.run(tmp_path)
    file = Path("deepmimo_scenarios") / NAME.lower() / "power_t000_tx000_r001.npz"
    assert (tmp_path / file).read_bytes() == (packed / file).read_bytes()


@pytest.mark.slow
def test_town_of_a_traced_scenario(tmp_path, load):
    """Reflections of the tracer lie on triangles of the object that they name; delays are those of their points."""
    data = open_dataset(small_dataset())
    export(data.root, "deepmimo", tmp_path / "out", Selection(weathers=("sunny",), frames=range(2)), {"scene": "mesh"})
    name = next(path.name for path in (tmp_path / "out" / "deepmimo_scenarios").iterdir() if "28ghz" in path.name)
    found, _ = load(tmp_path / "out", name)
    extra = np.load(tmp_path / "out" / "deepmimo_scenarios" / name / "extra_t000_tx000_r001.npz")
    objects_by_id = {row["object_id"]: row for row in data.read("objects").to_pylist()}
    scene = {item.name: item for item in found.scene.objects}
    assert {item.label for item in scene.values()} >= {"terrain", "buildings", "vegetation"}
    checked = 0
    for receiver, path in np.argwhere(found.inter == 1):
        item = objects_by_id[extra["inter_object"][receiver, path, 0]]
        point = np.asarray(found.inter_pos)[receiver, path, :1]
        ends = np.stack([np.ravel(found.tx_pos), np.asarray(found.rx_pos)[receiver]])
        length = np.linalg.norm(ends - point, axis=1).sum()
        assert found.delay[receiver, path] * SPEED_OF_LIGHT == pytest.approx(length, rel=1e-6)
        if item["actor"] is None:
            mesh = scene["ground" if item["label"] in GROUND else item["prim_path"]]
            triangles = np.array([face.vertices for face in mesh.faces])
            near = trimesh.triangles.closest_point(triangles, np.repeat(point, len(triangles), axis=0))
            assert np.linalg.norm(near - point, axis=1).min() < 0.02
            checked += 1
    assert checked > 0


@pytest.mark.slow
def test_a_town_of_prisms_is_drawn(tmp_path, load, monkeypatch):
    """The scene is the town's, and as light as DeepMIMO's own: `scene.plot` draws it, `dm.stats` measures it."""
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("Agg")
    data = open_dataset(small_dataset())
    scenes = {}
    for shape in ("hull", "mesh"):
        out = tmp_path / shape
        export(data.root, "deepmimo", out, Selection(weathers=("sunny",), frames=range(2)), {"scene": shape})
        name = next(path.name for path in (out / "deepmimo_scenarios").iterdir() if "28ghz" in path.name)
        found, _ = load(out, name)
        scenes[shape] = found.scene
        scene = json.loads((out / "deepmimo_scenarios" / name / "params.json").read_text())["scene"]
        objects = found.scene.objects
        assert (scene["representation"], scene["n_objects"]) == (shape, len(objects))
        assert scene["n_faces"] == sum(len(item.faces) for item in objects)
        assert scene["n_triangular_faces"] == sum(face.num_triangular_faces for item in objects for face in item.faces)
    hulls, meshes = (scenes[shape].objects for shape in ("hull", "mesh"))
    assert [(one.name, one.label) for one in hulls] == [(one.name, one.label) for one in meshes]
    for hull, mesh in zip(hulls, meshes, strict=True):
        for end in ("min", "max"):
            ours, theirs = ([getattr(one.bounding_box, f"{axis}_{end}") for axis in "xyz"] for one in (hull, mesh))
            assert np.abs(np.array(ours) - theirs).max() < 0.3  # small corners of outlines are left out
    assert sum(len(one.faces) for one in hulls) < 0.1 * sum(len(one.faces) for one in meshes)
    axes = scenes["hull"].plot(proj_3d=False)
    assert f"Objects: {sum(one.label == 'objects' for one in hulls)}" in axes.get_title()
    some = [one for one in hulls if one.label in ("terrain", "buildings")]
    monkeypatch.setattr(scenes["hull"], "objects", some)
    scenes["hull"].plot().get_figure().canvas.draw()
    pyplot.close("all")
