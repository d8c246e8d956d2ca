"""Draw errors of an inertial measurement unit: white noise, wandering and constant biases, scale and alignment.

With x the true specific force or angular rate, a reading is

    y_k = D x_k + b_k + n_k

carla    D = 1; b = 0 (accelerometer) or `gyro_bias`; n_k = std N(0, 1) for every sample, whatever the frame rate.
physical  n_k = density / sqrt(dt) N(0, 1), dt the time from one sample to the next.
          b_k = gyro_bias + turn_on N(0, 1) + w_k with w_0 = 0, w_(k+1) = w_k + random_walk sqrt(dt) N(0, 1); with a
          correlation time T, w is stationary: w_(k+1) = exp(-dt / T) w_k + ..., of variance random_walk^2 T / 2.
          D = (1 + diag(scale N(0, 1))) exp(misalignment N(0, 1)), one for each triad: it turns, then scales.

Constants are drawn once for each agent and sensor. The Allan deviation of y at rest is density / sqrt(tau) for short
and random_walk sqrt(tau / 3) for long times. Defaults: the paper's white noise of 0.1 m/s^2 and 0.002 rad/s a sample
at 100 Hz is a density of 0.01 m/s^2/Hz^0.5 and 2e-4 rad/s/Hz^0.5; the random walks are design values of consumer MEMS.
Errors belong to the axes that are reported, so CARLA's bias is added to CARLA's axes.

Everything is a function of (seed, scenario, agent, sensor, time), and n_k of the rate of the samples too, see
`mmw.core.random_series`; weather moves nothing here.

Source: IEEE Std 952-1997, appendix C; noise model of J. Rehder et al., "Extending kalibr" (2016), section III.
"""

from collections.abc import Sequence

import numpy as np

from mmw.core.constants import FRAME_DT, FRAME_RATE_HZ
from mmw.core.frame_rate import instants
from mmw.core.random_series import gauss_markov, random_walk, white_series
from mmw.core.remember import remembered
from mmw.core.transforms import quaternion_exp, quaternion_to_matrix
from mmw.sensors.imu.config import Imu
from mmw.sensors.mounted_motion import series_keys


def noise_std(config: Imu, rate_hz: int = FRAME_RATE_HZ) -> tuple[float, float]:
    """Return the standard deviations of white noise of accelerometer [m/s^2] and gyroscope [rad/s]."""
    if config.mode == "carla":
        return config.accel_noise_std, config.gyro_noise_std
    root = float(np.sqrt(config.interval_s(rate_hz)))
    return config.accel_noise_density / root, config.gyro_noise_density / root


@remembered()
def distortion(config: Imu, seed: int, scenario: str, agents: tuple[str, ...]) -> np.ndarray:
    """Return scale and alignment of accelerometer and gyroscope of each agent: true to read axes, shape [A, 2, 3, 3].

    Args:
        config: The sensor.
        seed: Seed of the configuration.
        scenario: Name of the scenario.
        agents: Names of the agents, A of them.
    """
    if config.mode == "carla":
        return np.zeros((len(agents), 2, 3, 3)) + np.eye(3)
    _, scale, turn = _constants(config, seed, scenario, agents)
    spread = np.array([config.accel_scale_std, config.gyro_scale_std])[:, None]
    tilt = quaternion_to_matrix(quaternion_exp(np.radians(config.misalignment_std_deg) * turn))
    return (1.0 + spread * scale)[..., None] * tilt


def biases(
    config: Imu, frames: Sequence[int] | np.ndarray, seed: int, scenario: str, agents: tuple[str, ...],
    rate_hz: int = FRAME_RATE_HZ,
) -> np.ndarray:  # fmt: skip
    """Return the bias of accelerometer [m/s^2] and gyroscope [rad/s], constant parts included, shape [A, F, 2, 3].

    It is the same whichever frames are asked for.

    Args:
        config: The sensor.
        frames: Frames of the samples, F of them.
        seed: Seed of the configuration.
        scenario: Name of the scenario.
        agents: Names of the agents, A of them.
        rate_hz: Frames a second.

    Raises:
        ValueError: If a frame is negative or beyond 2^31 - 1.
    """
    constant = np.array([0.0, config.gyro_bias])[:, None] + np.zeros((len(agents), len(frames), 2, 3))
    if config.mode == "carla":
        return constant
    base, parts = instants(frames, rate_hz)
    keys = series_keys(config, seed, scenario, agents, "bias")
    walk = np.array([config.accel_random_walk, config.gyro_random_walk])[:, None]
    if config.bias_correlation_s is None:
        wander = walk * np.sqrt(FRAME_DT) * _triads(random_walk(keys, base, 6, parts))
    else:
        series = gauss_markov(keys, base, 6, config.bias_correlation_s / FRAME_DT, parts)
        wander = walk * np.sqrt(0.5 * config.bias_correlation_s) * _triads(series)
    turn_on = _constants(config, seed, scenario, agents)[0][:, None]
    return constant + np.array([config.accel_turn_on_std, config.gyro_turn_on_std])[:, None] * turn_on + wander


@remembered()
def _constants(config: Imu, seed: int, scenario: str, agents: tuple[str, ...]) -> np.ndarray:
    """Return what is drawn once for each agent: bias, scale and turn of standard deviation 1, shape [3, A, 2, 3]."""
    drawn = white_series(series_keys(config, seed, scenario, agents, "constants"), [0], 18)[:, 0]
    return _triads(drawn.reshape(-1, 3, 6)).swapaxes(0, 1)


def _triads(series: np.ndarray) -> np.ndarray:
    """Return numbers of accelerometer and gyroscope, shape [..., 6], as [..., 2, 3]."""
    return series.reshape(*series.shape[:-1], 2, 3)
