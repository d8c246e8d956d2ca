"""Maps and samples of the radar: against each other, and against what a Fourier transform must show."""

import math

import numpy as np
import pyarrow as pa
import pytest

from mmw.core.transforms import pose_from_ypr
from mmw.physics.weather.weather import PRESETS
from mmw.scene.views import make_views
from mmw.sensors import Radar
from mmw.sensors.radar.iq import radar_iq_samples
from mmw.sensors.radar.power_maps import hann_response, radar_maps
from mmw.sensors.radar.rain_clutter import rain_clutter
from mmw.sensors.radar.resolution_cells import angle_cells, cell_grid, centred
from mmw.sensors.radar.rows import radar_iq_rows, radar_map_rows
from mmw.storage.arrow_tables import table_from_columns
from tests.fixtures.radar_points import detections, make_cells, make_keys, make_rays, target
from tests.fixtures.radar_scenes import watched
from tests.fixtures.scenes import ground_part

SMALL = Radar(
    azimuth_antennas=8, elevation_antennas=2, frame_time_s=320e-6, range_m=30.0, false_alarm_probability=1e-12
)
"""16 antennas, 16 chirps, 62 samples."""


def cube(config: Radar, samples: np.ndarray, windows: int = 0) -> np.ndarray:
    """Return powers [W] over (z, y, velocity, range) of each view; the last `windows` axes get a Hann window."""
    shape = (config.elevation_antennas, config.azimuth_antennas, *samples.shape[2:])
    x = samples.reshape(len(samples), *shape).astype(complex)
    for axis in range(-windows, 0):
        n = np.arange(x.shape[axis])
        window = 1.0 - np.cos(2.0 * np.pi * n / len(n))  # mean 1: no gain
        x *= window.reshape([-1 if axis == i else 1 for i in range(-4, 0)])
    return np.abs(np.fft.fftn(x, axes=(1, 2, 3, 4)) / math.prod(shape)) ** 2


def test_one_target_peaks_in_its_cell_with_its_snr(device):
    place, views = (40, 3, 2, 0), 40
    for sign in (1, -1):
        ray = target(SMALL, (place[0], sign * place[1], sign * place[2], 0), 20.0)
        power = cube(SMALL, radar_iq_samples(SMALL, make_rays(device, [np.array([ray])] * views), make_keys(views)))
        mean = power.mean(axis=0)
        peak = np.unravel_index(mean.argmax(), mean.shape)
        grid = cell_grid(SMALL)
        found = (peak[3], centred(peak[2], grid.velocities), centred(peak[1], grid.ys), peak[0])
        assert found == (40, 3 * sign, 2 * sign, 0)  # receding and left are positive
        assert mean.max() / SMALL.noise_w == pytest.approx(101.0, abs=4.0 * math.sqrt(201.0 / views))
        noise = np.delete(mean.ravel(), mean.argmax())
        assert noise.mean() / SMALL.noise_w == pytest.approx(1.0, abs=4.0 / math.sqrt(noise.size * views) + 0.005)


def test_elevation_is_positive_upwards(device):
    config = SMALL.model_copy(update={"elevation_antennas": 8, "azimuth_antennas": 2})
    ray = target(config, (40, 0, 0, 1), 30.0)
    power = cube(config, radar_iq_samples(config, make_rays(device, [np.array([ray])]), make_keys(1)))[0]
    assert np.unravel_index(power.argmax(), power.shape) == (1, 0, 0, 40)


def peaks(profile: np.ndarray) -> int:
    """Return the number of local maxima within 6 dB of the largest."""
    before, after = np.roll(profile, 1), np.roll(profile, -1)
    return int(((profile > before) & (profile >= after) & (profile > profile.max() / 4.0)).sum())


@pytest.mark.parametrize("axis", range(3), ids=["range", "velocity", "y"])
@pytest.mark.parametrize("at", [0.0, 0.3])
def test_two_targets_are_two_peaks_as_the_formulas_say(device, axis, at):
    """Over relative phases all round, two points of one strength show two peaks a cell apart, and one at 0.75 cells."""
    phases = 8
    for separation, expected in ((0.5, 1), (0.75, 1), (1.0, 2), (1.5, 2)):
        views = []
        for phase in range(phases):
            places = [[20.0, 1.0, 1.0, 0.0], [20.0, 1.0, 1.0, 0.0]]
            places[0][axis] += at
            places[1][axis] += at + separation
            rays = np.array([target(SMALL, tuple(place), 70.0) for place in places])
            rays[1, 0] += SMALL.wavelength / 2.0 * phase / phases
            views.append(rays)
        samples = radar_iq_samples(SMALL, make_rays(device, views), make_keys(phases))
        x = samples.reshape(phases, 2, 8, 16, 62)
        # transform the axis in question eight times as finely, at the targets' place on the others
        n = {0: 62, 1: 16, 2: 8}[axis]
        others = np.fft.fftn(x, axes=[a for a in (1, 2, 3, 4) if a != 4 - axis])
        line = np.moveaxis(others, 4 - axis, -1)[:, 0]
        line = line[(slice(None), *{0: (1, 1), 1: (1, 20), 2: (1, 20)}[axis])]
        profile = (np.abs(np.fft.fft(line, 8 * n)) ** 2).mean(axis=0)
        assert peaks(profile) == expected, separation


def test_samples_do_not_depend_on_the_batch(device):
    rng = np.random.default_rng(3)
    views = [
        np.array([target(SMALL, (r, v, y, 0.0), 20.0) for r, v, y in rng.uniform([1, -7, -3], [60, 7, 3], (n, 3))])
        for n in (5, 0, 9)
    ]
    keys = make_keys(3)
    together = radar_iq_samples(SMALL, make_rays(device, views), keys)
    for i in range(3):
        alone = radar_iq_samples(SMALL, make_rays(device, [views[i]]), keys[i : i + 1])
        assert alone.tobytes() == together[i : i + 1].tobytes()


def test_hann_response_is_the_transform_of_the_window():
    n = 64
    window = 1.0 - np.cos(2.0 * np.pi * np.arange(n) / n)
    for x in (0.0, 0.3, 0.5, 1.0, 1.4, 1.99):
        expected = np.abs((window * np.exp(2j * np.pi * x * np.arange(n) / n)).mean()) ** 2
        assert hann_response(np.array(x)) == pytest.approx(expected, rel=5e-3, abs=1e-5)
    assert hann_response(np.array([2.0, 5.0])).tolist() == [0.0, 0.0]


@pytest.mark.parametrize("kind", ["range_azimuth", "range_doppler"])
def test_maps_equal_the_transform_of_the_samples(device, kind):
    """A map's pixels around a strong echo are those of the windowed transform of the samples; its peak is its power."""
    place = (30.3, 2.4, 1.2, 0.0)
    ray = np.array([target(SMALL, place, 60.0)])
    maps = radar_maps(SMALL, kind, make_cells(SMALL, device, [ray]), None, make_keys(1), device)
    power = cube(SMALL, radar_iq_samples(SMALL, make_rays(device, [ray]), make_keys(1)), windows=3)[0]
    if kind == "range_azimuth":
        cells = angle_cells(8, SMALL.horizontal_fov_deg)
        expected = power.max(axis=(0, 2))[cells % 8].T
    else:
        expected = power.max(axis=(0, 1))[centred_order(16)].T
    expected = 10.0 * np.log10(expected * 1000.0)
    assert maps.values.shape == (1, 62, expected.shape[1])
    is_echo = expected > expected.max() - 25.0
    difference = (maps.values[0] - expected)[is_echo]
    assert is_echo.sum() >= 9
    assert np.ptp(difference) < 0.6  # the samples' window is short: its lobe is a little wider
    row, column = np.unravel_index(maps.values[0].argmax(), expected.shape)
    assert maps.row_first + row * maps.row_step == pytest.approx(30 * SMALL.range_resolution)
    across = {"range_azimuth": 1 * 0.25, "range_doppler": 2 * SMALL.velocity_resolution}[kind]
    assert maps.column_first + column * maps.column_step == pytest.approx(across)


def centred_order(count: int) -> np.ndarray:
    return np.argsort(centred(np.arange(count), count))


@pytest.mark.parametrize("kind", ["range_azimuth", "range_doppler"])
def test_maps_show_detections_over_the_largest_of_the_noise(device, kind):
    ray = np.array([target(SMALL, (30.0, 2.0, 1.0, 0.0), 40.0)])
    views = 60
    maps = radar_maps(SMALL, kind, make_cells(SMALL, device, [ray] * views), None, make_keys(views), device)
    batch = detections(SMALL, device, [ray] * views)
    seen = np.diff(batch.offsets) == 1
    assert seen.sum() > 55
    assert maps.values.max(axis=(1, 2))[seen] == pytest.approx(batch.power_db, abs=0.4)  # the noise is in the one only
    behind = 16 * 1 if kind == "range_azimuth" else 7 * 1
    noise = 10.0 ** (np.delete(maps.values, [28, 29, 30, 31, 32], axis=1) / 10.0) / 1000.0 / SMALL.noise_w
    mean = sum(1.0 / k for k in range(1, behind + 1))  # of the largest of n exponential numbers
    assert noise.mean() == pytest.approx(mean, abs=4.0 * 1.3 / math.sqrt(noise.size))


def test_maps_show_rain(device):
    weather, keys = PRESETS["heavy_rain"], make_keys(1)
    clutter = rain_clutter(SMALL, weather, pose_from_ypr([0, 0, 4], 0, 0, 0)[None], np.zeros((1, 3)), keys, device)
    assert clutter is not None
    cells = make_cells(SMALL, device, [np.zeros((0, 7))])
    for kind in ("range_azimuth", "range_doppler"):
        dry = radar_maps(SMALL, kind, cells, None, keys, device).values[0]
        wet = radar_maps(SMALL, kind, cells, clutter, keys, device).values[0]
        assert (wet >= dry).all()
        assert wet.max() == pytest.approx(10.0 * np.log10(clutter.power.max() * 1000.0), abs=1e-3)
        assert wet[3].max() > dry[3].max() + 10.0


def test_rows_hold_maps_and_samples(device):
    arrays = watched([ground_part()])
    config = SMALL.model_copy(update={"on": ("rsu",)})
    views = make_views(arrays, [0], config)
    keys = make_keys(1)
    rays = [np.array([target(SMALL, (30.0, 2.0, 1.0, 0.0), 40.0)])]
    framed = {"scenario": "town_a", "weather": "sunny"}

    parts = []
    for kind in ("range_azimuth", "range_doppler"):
        maps = radar_maps(config, kind, make_cells(config, device, rays), None, keys, device)
        columns = radar_map_rows(arrays, "radar", views, maps)
        parts.append(table_from_columns("radar_maps", {**framed, **columns}))
        row = parts[-1].to_pylist()[0]
        assert (row["agent"], row["sensor"], row["kind"], row["rows"]) == ("rsu_1", "radar", kind, 62)
        assert np.array_equal(np.float32(row["values"]).reshape(row["rows"], row["columns"]), maps.values[0])
        middle = row["column_first"] + row["column_step"] * (row["columns"] // 2)
        assert middle == pytest.approx(0.0, abs=1e-6)
    assert pa.concat_tables(parts).num_rows == 2

    samples = radar_iq_samples(config, make_rays(device, rays), keys)
    row = table_from_columns("radar_iq", {**framed, **radar_iq_rows(arrays, "radar", views, samples)}).to_pylist()[0]
    shape = (row["antennas"], row["chirps"], row["samples"])
    assert shape == config.iq_shape
    stored = np.float32(row["i"]).reshape(shape) + 1j * np.float32(row["q"]).reshape(shape)
    assert np.array_equal(stored.astype(np.complex64), samples[0])
