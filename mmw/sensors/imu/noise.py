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
from dataclasses import dataclass

import numpy as np

from mmw.core.constants import FRAME_DT, FRAME_RATE_HZ
from mmw.core.frame_rate import instants
from mmw.core.random_keys import random_keys
from mmw.core.random_series import gauss_markov, random_walk, white_series
from mmw.core.transforms import quaternion_exp, quaternion_to_matrix
from mmw.sensors.imu.config import Imu


@dataclass(frozen=True)
class ImuErrors:
    """Errors of A agents in F frames; the first axis is accelerometer [m/s^2], gyroscope [rad/s]."""

    noise: np.ndarray
    """White noise, shape [2, A, F, 3]."""
    bias: np.ndarray
    """Bias, constant parts included, shape [2, A, F, 3]."""
    distortion: np.ndarray
    """Scale and alignment: true to read axes, shape [2, A, 3, 3]."""


def imu_errors(
    config: Imu, frames: Sequence[int], seed: int, scenario: str, agents: Sequence[str], rate_hz: int = FRAME_RATE_HZ
) -> ImuErrors:
    """Return the errors of one sensor on several agents, the same whichever frames are asked for.

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

    def keys(stream: str) -> np.ndarray:
        return random_keys((seed, scenario, agent, config.name, stream) for agent in agents)

    def pair(accel: float, gyro: float) -> np.ndarray:
        return np.array([accel, gyro]).reshape(2, 1, 1, 1)

    def triads(series: np.ndarray) -> np.ndarray:  # [A, F, 6] to [2, A, F, 3]
        return series.reshape(*series.shape[:2], 2, 3).transpose(2, 0, 1, 3)

    base, parts = instants(frames, rate_hz)
    white = triads(white_series(keys("white"), base, 6, parts))
    constant = np.zeros(white.shape) + pair(0.0, config.gyro_bias)
    if config.mode == "carla":
        perfect = np.zeros((2, len(agents), 3, 3)) + np.eye(3)
        return ImuErrors(pair(config.accel_noise_std, config.gyro_noise_std) * white, constant, perfect)
    noise = pair(config.accel_noise_density, config.gyro_noise_density) / np.sqrt(config.interval_s(rate_hz)) * white
    walk = pair(config.accel_random_walk, config.gyro_random_walk)
    if config.bias_correlation_s is None:
        wander = walk * np.sqrt(FRAME_DT) * triads(random_walk(keys("bias"), base, 6, parts))
    else:
        series = gauss_markov(keys("bias"), base, 6, config.bias_correlation_s / FRAME_DT, parts)
        wander = walk * np.sqrt(0.5 * config.bias_correlation_s) * triads(series)
    drawn = white_series(keys("constants"), [0], 18)
    turn_on, scale, turn = (triads(part) for part in np.split(drawn, 3, axis=-1))
    bias = constant + pair(config.accel_turn_on_std, config.gyro_turn_on_std) * turn_on + wander
    stretch = (1.0 + pair(config.accel_scale_std, config.gyro_scale_std) * scale)[:, :, 0, :, None]
    tilt = quaternion_to_matrix(quaternion_exp(np.radians(config.misalignment_std_deg) * turn[:, :, 0]))
    return ImuErrors(noise, bias, stretch * tilt)
