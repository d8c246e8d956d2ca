"""Coherent sums of radar echoes: exact phases, cells and samples against NumPy, scintillation, detection by Rice."""

import numpy as np
import pytest
import scipy.stats
import warp as wp

from mmw.kernels.radar.trace import RadarRays
from mmw.sensors import Radar
from mmw.sensors.radar.detection import cell_echoes, detect
from mmw.sensors.radar.iq import radar_iq_samples
from mmw.sensors.radar.points import LABEL_OBJECT
from mmw.sensors.radar.resolution_cells import bin_rays, cell_grid, sum_cells, unravel
from tests.fixtures.radar_points import make_keys, make_rays, target
from tests.fixtures.radar_scenes import AT_ORIGIN, turntable, wall_ahead, watched, with_paths
from tests.fixtures.scenes import two_cars

SMALL = Radar(
    azimuth_antennas=16, elevation_antennas=4, frame_time_s=1e-3, false_alarm_probability=1e-12, coherent=True
)


def amplitudes(rays: RadarRays) -> np.ndarray:
    return np.sqrt(rays.power.numpy().astype(np.float64)) * np.exp(2j * np.pi * rays.turns.numpy().astype(np.float64))


def test_phases_are_those_of_the_exact_distance(device):
    """A plate ahead: 4 pi R / wavelength with R = x / cos, to a hundredth of a turn; float32 has 0.004 a step of R."""
    config = Radar(mount=AT_ORIGIN, horizontal_fov_deg=20.0, vertical_fov_deg=10.0, coherent=True)
    rays, _ = with_paths(watched([wall_ahead(43.21, 30.0)]), device, config)
    angles = (getattr(rays, name).numpy().astype(np.float64) for name in ("azimuth", "elevation"))
    azimuth, elevation = angles
    x = float(np.float32(43.21))
    turns = 2.0 * x / (np.cos(azimuth) * np.cos(elevation)) / config.wavelength
    gap = (rays.turns.numpy() - turns + 0.5) % 1.0 - 0.5
    assert np.abs(gap).max() < 0.01 and np.ptp(turns) > 100.0


def test_cells_are_the_numpy_sum_of_their_scatterers(device):
    rng = np.random.default_rng(3)
    count = 4000
    place = rng.uniform((5.0, -0.5, -0.1), (9.0, 0.5, 0.1), (count, 3))
    rows = np.column_stack([place, rng.choice([0.0, 3.0], count), rng.exponential(1e-15, count),
                            rng.exponential(1.0, count), rng.integers(0, 3, count)])  # fmt: skip
    rays = make_rays(device, [rows[:2500], rows[2500:]])
    turns = rng.uniform(0.0, 1.0, rays.range.shape).astype(np.float32)
    rays.turns = wp.array(turns, dtype=float, device=device)
    order = bin_rays(SMALL, rays)
    cells, powers = sum_cells(order, rays, coherent=True), sum_cells(order, rays)
    assert cells.path_type is None and powers.path_type is None
    values, grid = amplitudes(rays), cell_grid(SMALL)
    expected: dict[tuple, complex] = {}
    for view, part in enumerate((rows[:2500], rows[2500:])):
        for ray, (r, azimuth, elevation, v, *_) in enumerate(np.float32(part).astype(np.float64)):
            y, z = np.sin(azimuth) * np.cos(elevation), np.sin(elevation)
            key = (view, round(r / grid.range_step), round(v / grid.velocity_step) % grid.velocities,
                   round(y / grid.y_step) % grid.ys, round(z / grid.z_step) % grid.zs)  # fmt: skip
            expected[key] = expected.get(key, 0.0) + values[view, ray]
    r, v, y, z = unravel(grid, cells.cell)
    keys = list(zip(cells.view, r, v % grid.velocities, y % grid.ys, z % grid.zs, strict=True))
    assert len(keys) == len(expected) > 100
    np.testing.assert_allclose(cells.power, [abs(expected[key]) ** 2 for key in keys], rtol=1e-4, atol=1e-22)
    for name in ("range", "velocity", "y", "z", "object_id"):
        np.testing.assert_array_equal(getattr(cells, name), getattr(powers, name))
    np.testing.assert_allclose(cells.rcs / cells.power, powers.rcs / powers.power, rtol=1e-4)


@pytest.mark.parametrize("merges", [True, False])
def test_samples_are_the_numpy_sum_of_the_echoes(device, merges):
    """The first sample of the first antenna and chirp is the sum of all amplitudes; with ghosts and the ground too."""
    config = Radar(
        multipath="full", iq=True, azimuth_rays=80, elevation_rays=30, azimuth_antennas=2, elevation_antennas=1,
        frame_time_s=40e-6, reference_snr_db=100.0,
    )  # fmt: skip
    rays, keys = with_paths(two_cars(2), device, config, merges=merges)
    samples = radar_iq_samples(config, rays, keys)
    near = rays.range.numpy() < config.range_cells * config.range_resolution
    expected = np.where(near, amplitudes(rays), 0.0).sum(axis=1)
    power = rays.power.numpy().sum(axis=1)
    assert len(np.unique(rays.path_type.numpy()[rays.power.numpy() > 0.0])) >= 4
    assert np.abs(samples[:, 0, 0, 0] - expected).max() < 1e-3 * np.sqrt(power.max())


def test_a_turning_body_scintillates_about_its_incoherent_power(device, tmp_path):
    """A car in one range cell of 20 m, from 400 sides: its power is exponential, its mean that of the sum of powers.

    The mean of 400 exponential ratios is 1 within 4 / sqrt(400) = 0.2, and their deviation 1 within 0.3.
    """
    config = Radar(
        mount=AT_ORIGIN, horizontal_fov_deg=14.0, vertical_fov_deg=8.0, azimuth_rays=100, elevation_rays=40,
        bandwidth_hz=7.5e6, azimuth_antennas=1, elevation_antennas=1, frame_time_s=20e-6, coherent=True,
    )  # fmt: skip
    arrays = turntable("vehicles/sedan/sedan.usda", 38.0, np.arange(0.0, 360.0, 0.9), tmp_path)
    rays, _ = with_paths(arrays, device, config)
    order = bin_rays(config, rays)
    coherent, powers = sum_cells(order, rays, coherent=True), sum_cells(order, rays)
    assert len(coherent.power) == len(powers.power) == 400  # one cell in each frame
    ratio = coherent.power / powers.power
    assert ratio.mean() == pytest.approx(1.0, abs=4.0 / np.sqrt(len(ratio)))
    assert ratio.std() == pytest.approx(1.0, abs=0.3)
    exponential = 1.0 - np.exp(-np.sort(ratio))
    steps = np.arange(1, len(ratio) + 1) / len(ratio)
    assert np.abs(exponential - steps).max() < 1.95 / np.sqrt(len(ratio))  # Kolmogorov-Smirnov, 0.1 %
    assert np.abs(np.diff(10.0 * np.log10(coherent.power))).max() > 10.0


@pytest.mark.parametrize("snr_db", [5.0, 10.0, 13.0])
def test_steady_echoes_are_detected_by_marcums_q(device, snr_db):
    config = SMALL.model_copy(update={"false_alarm_probability": 1e-4})
    places = [(r, v, 0.0, 0.0) for r in range(2, 200, 2) for v in range(-24, 24, 2)]
    rays = make_rays(device, [np.array([target(config, place, snr_db) for place in places])])
    rays.turns = wp.zeros(rays.range.shape, dtype=float, device=device)
    cells = sum_cells(bin_rays(config, rays), rays, coherent=True)
    found = detect(config, cells, None, make_keys(1, f"q {snr_db}"), device)
    # Rice: twice the power over its noise is chi-squared of two degrees, off center by twice the SNR.
    snr = 10.0 ** (snr_db / 10.0)
    chance = scipy.stats.ncx2.sf(-2.0 * np.log(1e-4), 2, 2.0 * snr)
    sigma = np.sqrt(len(places) * chance * (1.0 - chance))
    assert (found.label == LABEL_OBJECT).sum() == pytest.approx(len(places) * chance, abs=4.0 * sigma)
    echo = cell_echoes(config, cells, make_keys(1, f"q {snr_db}")) / config.noise_w
    assert echo.mean() == pytest.approx(1.0 + snr, abs=4.0 * np.sqrt((1.0 + 2.0 * snr) / len(echo)))
