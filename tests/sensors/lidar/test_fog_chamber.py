"""Fog and plates against a float64 waveform: pulse convolved with the impulse response of fog and target."""

import math
from dataclasses import replace

import numpy as np
import pytest

from mmw.core.constants import SPEED_OF_LIGHT
from mmw.physics.weather.optics import extinction, fog_backscatter
from mmw.physics.weather.weather import Weather
from mmw.sensors import Lidar
from mmw.sensors.lidar import precipitation
from mmw.sensors.lidar.fog_chamber import PlateReturns, plates_in_fog
from mmw.sensors.lidar.optics import PRESETS, LidarOptics
from mmw.sensors.lidar.precipitation import FOG_ENTRIES, air_from_tables, fog_power, fog_table
from tests.fixtures.lidar_air import echoes

STEP_M = 0.002
"""Sampling of the waveform as distance [m]."""

FULL = {"overlap_full_m": 1.0, "overlap_exponent": 1.0}


def waveform(
    optics: LidarOptics,
    weather: Weather,
    plate: tuple[float, float] | None = None,
    fog: bool = True,
    to_m: float = 40.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Return ranges [m] and received power [1/m2] of one pulse, by convolution in time.

    The emitted pulse is sin^2(pi t / (2 tau)) for 2 tau. The impulse response of fog is pi beta xi exp(-2 alpha R) /
    R^2 a meter, that of a plate (reflectance, distance) rho exp(-2 alpha R) / R^2 at one distance. Range counts from
    the middle of the pulse. Source: R. Rasshofer et al., Adv. Radio Sci. 9, 2011; M. Hahner et al., ICCV 2021.
    """
    alpha, beta = extinction(weather, optics.wavelength_nm), fog_backscatter(weather, optics.wavelength_nm)
    r = np.arange(1, int(to_m / STEP_M)) * STEP_M
    xi = np.clip((r - optics.overlap_start_m) / (optics.overlap_full_m - optics.overlap_start_m), 0.0, 1.0)
    response = np.zeros(len(r))
    if fog:
        response += math.pi * beta * xi**optics.overlap_exponent * np.exp(-2 * alpha * r) / r**2 * STEP_M
    if plate is not None:
        reflectance, distance = plate
        at = round(distance / STEP_M) - 1
        response[at:] = 0.0  # nothing comes from behind it
        response[at] = reflectance * math.exp(-2 * alpha * distance) / distance**2
    time = np.arange(0.0, 2.0 * optics.pulse_s, 2.0 * STEP_M / SPEED_OF_LIGHT)
    pulse = np.sin(math.pi * time / (2.0 * optics.pulse_s)) ** 2
    received = np.convolve(response, pulse)
    return STEP_M * (1 + np.arange(len(received))) - 0.5 * SPEED_OF_LIGHT * optics.pulse_s, received


OPTICS = {
    "hdl64": PRESETS["hdl64"],
    "modern64": PRESETS["modern64"],
    "nir1550": PRESETS["nir1550"],
    "near": replace(PRESETS["hdl64"], **FULL, pulse_s=20e-9),  # the sensor of Hahner et al.
}


@pytest.mark.parametrize("visibility_m", [10.0, 45.0, 200.0])
@pytest.mark.parametrize("name", OPTICS)
def test_mean_power_is_that_of_the_waveform(name: str, visibility_m: float) -> None:
    optics, weather = OPTICS[name], Weather(visibility_m=visibility_m)
    r, received = waveform(optics, weather)
    part = (r > optics.nearest_m) & (r < 30.0)
    alpha, beta = extinction(weather, optics.wavelength_nm), fog_backscatter(weather, optics.wavelength_nm)
    power = fog_power(r[part][::50], alpha, beta, optics)
    # The edge of the overlap of "near" falls between samples of both integrals: 1e-3 of the peak.
    np.testing.assert_allclose(power, received[part][::50], rtol=2e-3, atol=1e-3 * power.max())


@pytest.mark.parametrize("name", ["hdl64", "modern64", "near"])
def test_echoes_of_the_kernel_are_the_waveform(name: str, device: str) -> None:
    """Without noise and patches an echo has the power of the waveform at its range."""
    optics, weather = OPTICS[name], Weather(visibility_m=45.0)
    alpha = extinction(weather, 905)
    fog = fog_table(alpha, fog_backscatter(weather, 905), optics, 120.0)
    air = air_from_tables(alpha, optics, None, fog, weather.wind, (5, 6), device)
    air.fog_noise, air.fog_patchiness, air.min_power = 0.0, 0.0, 1e-9
    found = echoes(air, device, 20_000)
    r, received = waveform(optics, weather)
    for which in ("strongest", "last"):
        expected = np.interp(found[f"{which}_range"], r, received)
        part = found[f"{which}_range"] < min(fog[0][-FOG_ENTRIES - 1], 30.0)  # power fades in the last step
        # 16 entries to a step of range, linear in between: 1 % where power bends most.
        np.testing.assert_allclose(found[f"{which}_power"][part], expected[part], rtol=0.01)
    peak = received[r > optics.nearest_m].max()
    assert found["strongest_power"].max() <= 1.01 * peak and np.median(found["strongest_power"]) > 0.98 * peak


def test_a_plate_and_fog_are_on_one_scale_in_the_waveform() -> None:
    """The peak of a plate is where it stands and as high as the equation of the kernel says."""
    weather = Weather(visibility_m=45.0)
    alpha = extinction(weather, 905)
    r, received = waveform(PRESETS["hdl64"], weather, (0.9, 20.0), fog=False)
    assert r[received.argmax()] == pytest.approx(20.0, abs=2 * STEP_M)
    assert received.max() == pytest.approx(0.9 * math.exp(-2 * alpha * 20.0) / 20.0**2, rel=1e-5)


def farthest(config: Lidar, weather: Weather, reflectance: float, device: str, rays: int = 100) -> float:
    return plates_in_fog(config, weather, reflectance, np.arange(1.1, 60.0, 0.1), rays, device=device).farthest()


@pytest.mark.parametrize("visibility_m", [10.0, 30.0, 75.0])
@pytest.mark.parametrize("reflectance", [0.1, 0.9])
def test_last_returns_end_at_the_threshold(reflectance: float, visibility_m: float, device: str) -> None:
    """rho exp(-2 alpha R) / R^2 = the threshold, on a grid of 0.1 m."""
    weather = Weather(visibility_m=visibility_m)
    config = Lidar(detection="absolute", returns="last")
    r = np.linspace(1.0, 60.0, 100_000)
    power = reflectance * np.exp(-2 * extinction(weather, 905) * r) / r**2
    assert farthest(config, weather, reflectance, device) == pytest.approx(r[power > 0.1 / 50**2].max(), abs=0.1)


@pytest.mark.parametrize("preset", ["hdl64", "modern64"])
@pytest.mark.parametrize("visibility_m", [20.0, 45.0])
def test_strongest_returns_end_where_fog_is_stronger(
    preset: str, visibility_m: float, device: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In even fog, without noise, a plate is lost where the waveform's peak of fog exceeds what is seen of it."""
    monkeypatch.setattr(precipitation, "PATCHINESS", 0.0)
    precipitation.fog_table.cache_clear()
    weather, optics = Weather(visibility_m=visibility_m), replace(PRESETS[preset], threshold_snr=1e9)
    config = Lidar(preset=preset, optics={"threshold_snr": 1e9}, detection="absolute")
    r, received = waveform(optics, weather)
    peak = received[r > optics.nearest_m].max()
    assert peak > optics.min_power
    r = np.linspace(2.0, 60.0, 100_000)
    xi = np.clip((r - optics.overlap_start_m) / (optics.overlap_full_m - optics.overlap_start_m), 0.0, 1.0)
    seen = 0.9 * np.exp(-2 * extinction(weather, 905) * r) / r**2 * xi**optics.overlap_exponent
    expected = r[seen > peak].max()
    assert farthest(config, weather, 0.9, device) == pytest.approx(expected, rel=0.01, abs=0.1)
    precipitation.fog_table.cache_clear()


def test_thicker_fog_and_darker_plates_are_seen_less_far(device: str) -> None:
    reach = {
        (visibility_m, reflectance): farthest(Lidar(), Weather(visibility_m=visibility_m), reflectance, device)
        for visibility_m in (15.0, 30.0, 60.0)
        for reflectance in (0.1, 0.9)
    }
    assert all(reach[v, 0.1] < reach[v, 0.9] for v in (15.0, 30.0, 60.0))
    assert all(reach[15.0, rho] < reach[30.0, rho] < reach[60.0, rho] for rho in (0.1, 0.9))
    sky = [plates_in_fog(Lidar(), Weather(visibility_m=v), 0.1, [math.inf], 4000, device=device) for v in (45.0, 300.0)]
    assert sky[0].plate[0] == 0.0 and sky[0].fog[0] > 0.9 > 0.3 > sky[1].fog[0]


def test_farthest_interpolates() -> None:
    distance = np.array([5.0, 10.0, 15.0, 20.0])
    assert PlateReturns(distance, np.array([1.0, 0.9, 0.1, 0.0]), np.zeros(4)).farthest() == pytest.approx(12.5)
    assert PlateReturns(distance, np.zeros(4), np.zeros(4)).farthest() == 0.0
    assert PlateReturns(distance, np.ones(4), np.zeros(4)).farthest() == math.inf
