"""Errors of the IMU: the paper's noise a sample, Allan deviations of a simulated hour, constants, bad input."""

from typing import Literal

import numpy as np
import pytest

from mmw.core.constants import FRAME_DT
from mmw.sensors import Imu
from tests.fixtures.driving_agents import assert_white
from tests.fixtures.imu_errors import imu_errors

HOUR = 360_000
PHYSICAL = Imu(mode="physical")
WANDERING = Imu(mode="physical", bias_correlation_s=60.0, accel_turn_on_std=0.1, gyro_turn_on_std=0.01)


def allan_deviation(rate: np.ndarray, tau: float, dt: float = FRAME_DT) -> np.ndarray:
    """Return the overlapping Allan deviation of series [N, ...] sampled every dt, for clusters of tau.

    Source: IEEE Std 952-1997, annex C, in terms of the integrated series.
    """
    n = round(tau / dt)
    angle = np.concatenate([np.zeros((1, *rate.shape[1:])), np.cumsum(rate, axis=0)]) * dt
    second = angle[2 * n :] - 2 * angle[n:-n] + angle[: -2 * n]
    return np.sqrt(np.mean(second**2, axis=0) / (2 * tau**2))


@pytest.mark.parametrize("config", [Imu(), PHYSICAL, WANDERING], ids=["carla", "physical", "wandering"])
def test_errors_do_not_depend_on_the_frames_or_agents_asked_for(config: Imu) -> None:
    agents = ["cav_1", "cav_2"]
    whole = imu_errors(config, range(600), 42, "town", agents)
    for frames in (range(100, 200), [599, 3, 3, 500], range(1), range(0)):
        part = imu_errors(config, frames, 42, "town", agents)
        for name in ("noise", "bias"):
            np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[:, :, list(frames)])
        np.testing.assert_array_equal(part.distortion, whole.distortion)
    alone = imu_errors(config, range(600), 42, "town", agents[1:])
    np.testing.assert_array_equal(alone.noise[:, 0], whole.noise[:, 1])
    np.testing.assert_array_equal(alone.bias[:, 0], whole.bias[:, 1])


def test_errors_differ_between_streams() -> None:
    def first(seed: int = 42, scenario: str = "town", agent: str = "cav_1", name: str = "imu") -> np.ndarray:
        config = WANDERING.model_copy(update={"name": name})
        errors = imu_errors(config, range(4), seed, scenario, [agent])
        return np.stack([errors.noise, errors.bias])

    variants = [first(), first(seed=43), first(scenario="tower"), first(agent="cav_2"), first(name="imu_2")]
    for i, one in enumerate(variants):
        for other in variants[:i]:
            assert not np.any(one == other)


def test_the_papers_noise_is_the_default() -> None:
    count = 40_000
    errors = imu_errors(Imu(), range(count), 7, "town", ["cav_1"])
    np.testing.assert_array_equal(errors.bias[0], 0.0)
    np.testing.assert_array_equal(errors.bias[1], 0.001)
    np.testing.assert_array_equal(errors.distortion, np.tile(np.eye(3), (2, 1, 1, 1)))
    scaled = np.concatenate([errors.noise[0, 0] / 0.1, errors.noise[1, 0] / 0.002], axis=1)
    assert_white(scaled)
    assert abs(np.mean(np.abs(scaled) > 1.959964) - 0.05) < 0.005


def test_physical_defaults_are_the_papers_noise_at_100_hz() -> None:
    physical = imu_errors(PHYSICAL, range(5), 7, "town", ["cav_1"])
    np.testing.assert_allclose(physical.noise, imu_errors(Imu(), range(5), 7, "town", ["cav_1"]).noise)


def test_allan_deviation_of_an_hour() -> None:
    """White noise from short clusters of the reading, random walk from the biases, both in the reading's long clusters.

    With n separate clusters in the average over axes and agents the standard error is about 1 / sqrt(2 n): 0.4 %
    (1 s, 6 axes), 1.5 % (10 s, 6 axes) and 1.9 % (40 s, 15 axes).
    """
    accel = {"density": PHYSICAL.accel_noise_density, "walk": PHYSICAL.accel_random_walk}
    gyro = {"density": PHYSICAL.gyro_noise_density, "walk": PHYSICAL.gyro_random_walk}
    found: dict[tuple[str, int], list[np.ndarray]] = {}
    for agent in range(5):
        errors = imu_errors(PHYSICAL, range(HOUR), 5, "hour", [f"cav_{agent}"])
        reading = (errors.noise + errors.bias)[:, 0]
        found.setdefault(("long", 1), []).append(allan_deviation(reading[1], 40.0))
        for sensor in (0, 1) if agent < 2 else ():
            found.setdefault(("short", sensor), []).append(allan_deviation(reading[sensor], 1.0))
            found.setdefault(("walk", sensor), []).append(allan_deviation(errors.bias[sensor, 0], 10.0))
    rms = {key: np.sqrt(np.mean(np.square(values))) for key, values in found.items()}
    for sensor, expected in enumerate((accel, gyro)):
        assert rms["short", sensor] == pytest.approx(expected["density"], rel=0.05)  # density / sqrt(1 s)
        assert rms["walk", sensor] == pytest.approx(expected["walk"] * np.sqrt(10.0 / 3.0), rel=0.05)
    both = np.hypot(gyro["density"] / np.sqrt(40.0), gyro["walk"] * np.sqrt(40.0 / 3.0))
    assert rms["long", 1] == pytest.approx(both, rel=0.05)
    assert gyro["walk"] * np.sqrt(40.0 / 3.0) > 0.75 * both  # the walk leads there


def test_random_walk_of_the_bias_grows_with_the_root_of_time() -> None:
    agents = [f"cav_{k}" for k in range(500)]
    frames = [0, 100, 10_000, 1_000_000]
    bias = imu_errors(PHYSICAL, frames, 9, "town", agents).bias - np.array([0.0, 0.001]).reshape(2, 1, 1, 1)
    np.testing.assert_array_equal(bias[:, :, 0], 0.0)
    expected = np.multiply.outer([1e-4, 1e-5], np.sqrt(np.array(frames[1:]) * FRAME_DT))
    # 1,500 values each: the standard error is 1.8 %.
    np.testing.assert_allclose(bias[:, :, 1:].std(axis=(1, 3)), expected, rtol=0.08)


def test_constant_and_correlated_biases() -> None:
    agents = [f"cav_{k}" for k in range(500)]
    bias = imu_errors(WANDERING, [0, 6_000, 60_000], 9, "town", agents).bias
    wander = np.array([1e-4, 1e-5]) * np.sqrt(30.0)  # random_walk^2 T / 2
    total = np.hypot(wander, [0.1, 0.01])
    np.testing.assert_allclose(bias.std(axis=(1, 3)), np.repeat(total[:, None], 3, axis=1), rtol=0.08)
    assert abs(bias[1].mean() - 0.001) < 5 * 0.01 / np.sqrt(1500)
    # Differences leave the constant out: one correlation time apart 2 (1 - 1 / e), ten apart 2.
    for frame, share in ((1, 2 * (1 - np.exp(-1))), (2, 2 * (1 - np.exp(-10)))):
        step = (bias[:, :, frame] - bias[:, :, 0]).std(axis=(1, 2))
        np.testing.assert_allclose(step, wander * np.sqrt(share), rtol=0.08)


def test_scale_and_alignment_have_the_spread_asked_for() -> None:
    config = Imu(mode="physical", accel_scale_std=0.01, gyro_scale_std=0.02, misalignment_std_deg=0.5)
    drawn = imu_errors(config, [0], 1, "town", [f"cav_{k}" for k in range(1000)]).distortion
    scale = np.linalg.norm(drawn, axis=-1) - 1.0
    np.testing.assert_allclose(scale.std(axis=(1, 2)), [0.01, 0.02], rtol=0.1)
    turn = drawn / np.linalg.norm(drawn, axis=-1, keepdims=True)
    angles = np.stack([turn[..., 2, 1], turn[..., 0, 2], turn[..., 1, 0]])
    np.testing.assert_allclose(angles.std(axis=(0, 2)), np.radians(0.5), rtol=0.1)


@pytest.mark.parametrize("mode", ["carla", "physical"])
@pytest.mark.parametrize("correlation", [None, 5.0])
def test_errors_belong_to_instants_at_any_rate_of_frames(
    mode: Literal["carla", "physical"], correlation: float | None
) -> None:
    """Frame 10 n of 1000 Hz is frame n of 100 Hz: a sensor of 20 Hz has the same errors in both."""
    config = Imu(mode=mode, rate_hz=20.0, bias_correlation_s=correlation)
    frames = np.arange(0, 200, 5)
    one = imu_errors(config, frames, 1, "s", ["a"])
    for rate in (20, 1000):
        other = imu_errors(config, frames * rate // 100, 1, "s", ["a"], rate)
        for name in ("noise", "bias", "distortion"):
            assert np.array_equal(getattr(one, name), getattr(other, name)), name


def test_white_noise_has_the_density_at_every_rate_of_samples() -> None:
    """A sample is a mean over its interval: its variance is density^2 / interval, 20 times less at 50 than 1000 Hz."""
    for rate in (50, 1000):
        config = Imu(mode="physical", rate_hz=float(rate), accel_noise_density=0.02)
        noise = imu_errors(config, range(0, 20_000, 1000 // rate), 1, "s", list("abcdefgh"), 1000).noise[0]
        assert noise.std() == pytest.approx(0.02 * np.sqrt(rate), rel=0.05)
