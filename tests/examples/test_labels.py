"""Beam prediction's labels, features and windows: searches against brute force, splits without leaks. No PyTorch."""

import numpy as np
import pytest

from examples.beam_prediction.config import (
    Experiment,
    FeatureConfig,
    RadioConfig,
    WindowConfig,
    fingerprint,
    load_experiment,
)
from examples.beam_prediction.features import (
    HEIGHT_STEP_M,
    HIGHEST,
    LOWEST,
    LOWEST_M,
    SPAN_STEP_M,
    camera_pixels,
    camera_view,
    column_of,
    feature_arrays,
    lidar_view,
    part_features,
)
from examples.beam_prediction.labels import beam_search, label_channels, part_labels
from examples.beam_prediction.windows import find_windows, split, window_table, with_oldest_sample
from mmw.config import load_config
from mmw.config.yaml_file import ConfigError
from mmw.core.camera_models import Distortion, Intrinsics
from mmw.core.transforms import IDENTITY_POSE, pose_from_ypr
from mmw.dataset import open_dataset
from mmw.dataset.camera_geometry import Camera
from mmw.dataset.windows import Feature, Windows, WindowSpec, open_windows, shared_frames
from tests.fixtures.learn_data import FOLDER
from tests.fixtures.small_dataset import SCENARIO, small_dataset
from tests.fixtures.window_data import bare_windows

Q = 64


def beam(q: int, antennas: int) -> np.ndarray:
    """Return f(q) or w(q) as the paper writes it."""
    return np.array([np.exp(2j * np.pi * n * q / Q) for n in range(antennas)]) / np.sqrt(antennas)


def test_labels_are_those_of_brute_force() -> None:
    """Of every pair, the power |w(p)^H H f(q)|^2; the last link has no path."""
    rng = np.random.default_rng(7)
    h = rng.standard_normal((1001, 16, 64)) + 1j * rng.standard_normal((1001, 16, 64))
    h[-1] = 0.0
    sent, received = (np.stack([beam(q, antennas) for q in range(Q)], axis=1) for antennas in (64, 16))
    power = np.abs(received.conj().T @ h @ sent) ** 2
    labels = label_channels(h, beam_search(RadioConfig()))
    pair = np.array(np.unravel_index(power.reshape(1001, -1).argmax(axis=1), (Q, Q)))
    assert np.array_equal([labels.rx_beam[:-1], labels.tx_beam[:-1]], pair[:, :-1])
    of_best = power[np.arange(1000), pair[0, :-1]]
    np.testing.assert_allclose(labels.gain_db[:-1], 10 * np.log10(of_best.max(axis=1)), rtol=0, atol=1e-9)
    np.testing.assert_allclose(labels.gains[:-1], of_best / of_best.max(axis=1, keepdims=True), rtol=1e-5, atol=1e-12)
    assert labels.tx_beam[-1] == labels.rx_beam[-1] == -1
    assert np.isnan(labels.gains[-1]).all() and np.isnan(labels.gain_db[-1])


def test_labels_of_a_dataset_are_the_beams_of_its_windows() -> None:
    dataset = open_dataset(small_dataset())
    table = part_labels(dataset, SCENARIO, "sunny", RadioConfig())
    assert table.num_rows == 3 * 4 and table["agent"].to_pylist() == sorted(table["agent"].to_pylist())
    spec = WindowSpec(
        [Feature("beams", carrier_hz=28e9), Feature("links", columns=("is_los",), carrier_hz=28e9)], past=4
    )
    windows = open_windows(dataset, spec, weathers=["sunny"], agents=["cav"])
    assert len(windows) == 3
    for sample in (windows[n] for n in range(3)):
        is_own = np.array(table["agent"]) == windows.tracks[int(sample["track"])].agent
        pairs = np.stack([table[name].to_numpy()[is_own] for name in ("rx_beam", "tx_beam")], axis=1)
        assert np.array_equal(pairs, sample["beams"])
        assert np.array_equal(table["is_los"].to_numpy()[is_own], sample["links"][:, 0] == 1.0)
        gain = 10 * np.log10(sample["beams_gain"].astype(float))
        np.testing.assert_allclose(table["gain_db"].to_numpy()[is_own], gain, atol=1e-4)


@pytest.mark.parametrize("beam_number", [0, 1, 9, 31, 33, 50, 63])
def test_a_column_is_where_the_codebook_looks(beam_number: int) -> None:
    """The array factor of precoder q is largest towards the columns of beam q."""
    u = np.linspace(-0.999, 0.999, 4001)
    phase = np.exp(1j * np.pi * np.outer(np.arange(64), u))  # half a wavelength from element to element, along y
    strongest = u[np.abs(phase.T @ beam(beam_number, 64)).argmax()]
    assert abs((column_of(strongest, 64 * 16) / 16 - beam_number + 32) % 64 - 32) < 0.1


def test_a_sweep_by_beam_and_distance_has_the_highest_return_of_each_cell() -> None:
    config = FeatureConfig(ranges=16, range_m=16.0)
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.uniform(-9, 9, (3000, 2)), rng.uniform(-3, 3, (3000, 1))], axis=1)
    points = np.concatenate([points, [[20.0, 0.0, 1.0], [0.0, 0.0, 0.0]]])  # beyond the last row, and no direction
    height, span, density = lidar_view(points, config, 32).astype(float)
    distance = np.linalg.norm(points, axis=1)
    column = column_of(np.divide(points[:, 1], distance, where=distance > 0, out=np.zeros(len(points))), 32)
    for half, is_half in enumerate((points[:, 0] >= 0, points[:, 0] < 0)):
        for row in range(16):
            for c in range(32):
                is_in = is_half & (distance >= row) & (distance < row + 1) & (column == c) & (distance > 0)
                cell = 16 * half + row, c
                assert (height[cell] > 0) == (density[cell] > 0) == is_in.any()
                if is_in.any():
                    top = LOWEST_M + (height[cell] - 1) * HEIGHT_STEP_M
                    assert abs(top - points[is_in, 2].max()) <= HEIGHT_STEP_M / 2 + 1e-9
                    wanted = min(np.ptp(points[is_in, 2]), 255 * SPAN_STEP_M)
                    assert abs(span[cell] * SPAN_STEP_M - wanted) <= SPAN_STEP_M / 2 + 1e-9
                else:
                    assert span[cell] == 0
    assert lidar_view(np.zeros((0, 3)), config, 32).max() == 0


@pytest.mark.parametrize("yaw_deg", [0.0, 180.0, 90.0])
def test_an_image_is_seen_where_the_array_looks(yaw_deg: float) -> None:
    """A mark in an image, at a direction that the camera's own projection gives, appears in the beam's column."""
    intrinsics = Intrinsics(640, 480, 224.0, 224.0, 320.0, 240.0, Distortion())
    camera = Camera(intrinsics, pose_from_ypr([0, 0, 0], np.radians(yaw_deg), 0, 0))
    pixels = camera_pixels(camera, 48, 256)
    ahead = np.array([np.cos(np.radians(yaw_deg)) + 0.1, np.sin(np.radians(yaw_deg)) + 0.1, -0.2])
    ahead /= np.linalg.norm(ahead)
    u, v = np.floor(camera.pixels(ahead) / 2).astype(int)
    image = np.zeros((240, 320, 3), dtype=np.uint8)
    image[v - 3 : v + 4, u - 3 : u + 4] = 255
    view = camera_view(image, pixels)
    assert view.shape == (96, 256, 3)
    row, column = np.argwhere(view[..., 0] == 255).mean(axis=0)
    half = 48 if ahead[0] < 0 else 0
    assert abs(column - column_of(ahead[1], 256)) < 2.0
    assert abs(HIGHEST + (LOWEST - HIGHEST) * (row - half + 0.5) / 48 - ahead[2]) < 0.02
    assert not view[pixels[..., 0] < 0].any() and (pixels[..., 0] < 0).any()


def test_features_of_a_dataset_come_in_the_shape_of_the_network() -> None:
    dataset, config = open_dataset(small_dataset()), FeatureConfig(every_frames=2, elevations=16)
    sweeps = part_features(dataset, SCENARIO, "sunny", "rsu/lidar", "lidar", config, 256)
    assert sweeps["frame"].to_pylist() == [0, 2] and set(sweeps["agent"].to_pylist()) == {"rsu_1"}
    arrays = feature_arrays(sweeps["data"].to_pylist(), "lidar", config, 256)
    cloud = dataset.frame(SCENARIO, "sunny", 2).agents["rsu_1"].sweeps["lidar"]
    assert np.array_equal(arrays[1], lidar_view(cloud.points, config, 256)) and arrays.shape == (2, 3, 128, 256)
    images = part_features(dataset, SCENARIO, "sunny", "cav/front", "camera", config, 256)
    assert len(images) == 3 * 2
    views = feature_arrays(images["data"].to_pylist(), "camera", config, 256)
    assert views.shape == (6, 3, 32, 256)
    own = dataset.frame(SCENARIO, "sunny", 2).agents[images["agent"][5].as_py()].views["front"]
    assert own.rgb is not None
    pixels = camera_pixels(Camera(own.camera.intrinsics, IDENTITY_POSE), 16, 256)
    coarse = own.rgb.reshape(24, 2, 32, 2, 3).mean(axis=(1, 3))
    assert np.abs(views[5].transpose(1, 2, 0) - camera_view(coarse, pixels)).mean() < 6


def windows_of_the_paper(config: WindowConfig) -> Windows:
    """Return the windows of the full dataset, no frame of which is missing."""
    made = load_config(FOLDER / "dataset.yaml")
    frames = {
        (scenario.name, "sunny", f"cav_{number + 1}"): range(made.frames_of(scenario).count)
        for scenario in made.scenarios
        if scenario.traffic
        for number in range(len(scenario.traffic.cav_ranks))
    }
    return bare_windows(frames, config.past - 1, 0, config.future)


def test_the_full_dataset_gives_as_many_windows_as_the_paper_has() -> None:
    experiment = load_experiment(FOLDER / "experiment.yaml")
    windows = with_oldest_sample(windows_of_the_paper(experiment.windows), experiment.features)
    assert len(windows.tracks) == 50 and len(windows) == 50_450
    parts = split(windows, experiment.windows)
    assert {name: len(part) for name, part in parts.items()} == {"train": 42_485, "val": 5_440}
    assert abs(42_485 / 43_040 - 1) < 0.02 and abs(5_440 / 5_380 - 1) < 0.02  # the paper's
    assert shared_frames(parts["train"], parts["val"]) == []


def test_windows_that_are_dealt_singly_share_frames() -> None:
    config = WindowConfig(split="window", train=8, val=1)
    windows = windows_of_the_paper(config)
    parts = split(windows, config)
    assert len(parts["train"]) + len(parts["val"]) == len(windows)
    assert len(parts["train"]) == pytest.approx(8 / 9 * len(windows), abs=1)
    chosen = [set(zip(part.track.tolist(), part.now.tolist(), strict=True)) for part in parts.values()]
    assert not chosen[0] & chosen[1]
    assert shared_frames(parts["train"], parts["val"])  # that is what this split is there to show
    assert np.array_equal(split(windows, config)["val"].now, parts["val"].now)


def test_a_held_sample_counts_as_used() -> None:
    windows = windows_of_the_paper(WindowConfig())
    found = with_oldest_sample(windows, FeatureConfig())
    assert (found.first % 10 == 0).all() and (found.now - 39 - found.first < 10).all() and len(found) == len(windows)


def test_windows_of_a_dataset_become_a_table() -> None:
    config = WindowConfig(past=2, future=1, split="track", train=1, val=1)
    features = FeatureConfig(every_frames=1)
    windows = find_windows(open_dataset(small_dataset()), RadioConfig(), config, features)
    assert len(windows) == 3 * 2 and {track.weather for track in windows.tracks} == {"sunny"}
    rows = window_table({"train": windows}).to_pylist()
    assert len(rows) == 6 and rows[0]["part"] == "train" and {row["now"] for row in rows} == {1, 2}


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("model.random_init=false", "random_init=true, from random numbers; give one of the two"),
        ("model.weights=/tmp", "give one of the two"),
        ("model.freeze=true", "random layers cannot stay as they are"),
        ("model.width=30", "heads must divide the width"),
        ("features.lidar=[lidar]", "write role/sensor, such as rsu/lidar"),
        ("features.camera=[rsu/front, rsu/front]", "name each once"),
        ("training.epoch=3", "did you mean `epochs`?"),
        ("training", "write it as section.key=value"),
        ("seeds.0.1=2", "write it as section.key=value"),
    ],
)
def test_a_wrong_value_is_one_clear_line(override: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said.replace("?", r"\?")) as error:
        load_experiment(FOLDER / "smoke.yaml", [override])
    assert len(error.value.problems) == 1


def test_every_setting_says_what_it_is() -> None:
    from pydantic import BaseModel

    models = [Experiment, *(f.annotation for f in Experiment.model_fields.values())]
    for model in models:
        if isinstance(model, type) and issubclass(model, BaseModel):
            for name, info in model.model_fields.items():
                assert info.description and info.description[-1] in ")]", f"{model.__name__}.{name} has no unit"
    assert fingerprint({"a": 1, "b": 2}) == fingerprint({"b": 2, "a": 1}) != fingerprint({"a": 2, "b": 1})


def test_configurations_of_datasets_are_valid() -> None:
    full = load_config(FOLDER / "dataset.yaml")
    assert len(full.scenarios) == 16 and full.frame_total == 16_900 and full.channel.carriers_hz == (28e9,)
    assert {sensor.name for sensor in full.sensors} == {"lidar", "front", "back", "left", "right"}
    assert all(sensor.rate_hz == 10 for sensor in full.sensors if sensor.type == "rgb")
    assert load_config(FOLDER / "dataset_smoke.yaml").frame_total == 80
