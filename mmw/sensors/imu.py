"""Inertial measurement unit: specific force and angular rate from float64 poses, noise, and the inverse integrator.

A sample at frame k is the reading at the instant of frame k, in the sensor frame (x forward, y left, z up):

    specific force  f_k = R_k^-1 (a_k + g z)    rest on level ground reads (0, 0, +9.81)
    angular rate    w_k

where a_k and w_k are the central differences of `mmw.sensors.kinematics`, taken of the mounted sensor, so lever arms
are exact. `integrate_imu` inverts them. The first and last frame of a recording rest on an extrapolated neighbour.

The readings do not depend on which frames are asked for, as long as the same recording is given. Noise is a function of
(seed, scenario, agent, sensor, frame) alone.

Source: sign and frame as CARLA 0.9.15 `sensor.other.imu`, in a right-handed frame.
"""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mmw.config import ImuConfig
from mmw.constants import FRAME_DT, GRAVITY
from mmw.poses import compose, conjugate, multiply, normalize, quaternion_exp, rotate
from mmw.scene_arrays import SceneArrays
from mmw.sensors.kinematics import differentiate, window
from mmw.views import mount_pose, sensor_actors

GRAVITY_W = np.array([0.0, 0.0, GRAVITY])
"""What a resting accelerometer feels, world frame [m/s^2]."""

BLOCKS_PER_FRAME = 2
"""Philox counter steps of one frame: two blocks of four 64-bit numbers, which make eight normal deviates."""


@dataclass(frozen=True)
class ImuBatch:
    """IMU samples of a batch, in the sensor frame, shape [A] or [A, 3]; rows are ordered by frame, then by actor."""

    frame: np.ndarray
    """Frame number, shape [A], int64."""
    actor: np.ndarray
    """Index of the agent in `SceneArrays.actors`, shape [A], int32."""
    accel: np.ndarray
    """Specific force as measured [m/s^2]."""
    gyro: np.ndarray
    """Angular rate as measured [rad/s]."""
    accel_true: np.ndarray
    """Specific force without noise [m/s^2]."""
    gyro_true: np.ndarray
    """Angular rate without noise and bias [rad/s]."""


def make_imu(arrays: SceneArrays, frames: Sequence[int], config: ImuConfig, seed: int, scenario: str) -> ImuBatch:
    """Return the IMU samples of every agent that carries the sensor.

    Args:
        arrays: The scene on the host; the frames around `frames` are differentiated too, so give all batches the same
            recording.
        frames: Frames of the batch.
        config: Mount and noise.
        seed: Seed of the run.
        scenario: Name of the scenario.

    Raises:
        ValueError: If the scene does not cover a frame.
    """
    rows = np.array([arrays.frame_row(int(frame)) for frame in frames], dtype=np.int64)
    part = window(rows)
    actors = sensor_actors(arrays, config)
    true = np.full((2, len(rows), len(actors), 3), np.nan)
    noise = np.zeros((2, len(rows), len(actors), 3))
    for column, index in enumerate(actors):
        actor = arrays.actors[index]
        accel, gyro = measure(arrays.poses[part, index], mount_pose(config, actor.role))
        true[:, :, column] = accel[rows - part.start], gyro[rows - part.start]
        noise[:, :, column] = imu_noise(config, frames, seed, scenario, actor.name)
    frame = np.repeat(np.asarray(frames, dtype=np.int64), len(actors))
    actor = np.tile(actors, len(rows))
    true, noise = true.reshape(2, -1, 3), noise.reshape(2, -1, 3)
    keep = np.isfinite(true).all(axis=(0, 2))
    true, noise = true[:, keep], noise[:, keep]
    return ImuBatch(frame[keep], actor[keep], *(true + noise), *true)


def measure(poses: np.ndarray, mount: np.ndarray, dt: float = FRAME_DT) -> tuple[np.ndarray, np.ndarray]:
    """Return what a perfect IMU reads at every frame.

    Args:
        poses: Agent-to-world in consecutive frames, shape [F, 7], float64; NaN where absent.
        mount: Sensor-to-agent pose, shape [7].
        dt: Time between frames [s].

    Returns:
        Specific force [m/s^2] and angular rate [rad/s] in the sensor frame, shape [F, 3] each; NaN where absent.
    """
    sensor = compose(np.concatenate([poses[..., :3], normalize(poses[..., 3:])], axis=-1), mount)
    motion = differentiate(sensor, dt)
    return rotate(conjugate(sensor[..., 3:]), motion.acceleration + GRAVITY_W), motion.body_rate


def imu_noise(
    config: ImuConfig, frames: Sequence[int], seed: int, scenario: str, agent: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return the accelerometer noise [m/s^2] and the gyroscope noise with bias [rad/s], shape [F, 3] each.

    Every frame owns fixed places of a counter-based generator keyed by (seed, scenario, agent, sensor), so its noise is
    the same whichever frames are asked for.

    Source: Philox4x64-10, J. Salmon et al., "Parallel random numbers: as easy as 1, 2, 3" (2011); normal deviates by
    G. Box and M. Muller (1958).
    """
    if len(frames) == 0:
        return np.zeros((0, 3)), np.zeros((0, 3))
    first, last = min(frames), max(frames)
    words = [seed, *(zlib.crc32(name.encode()) for name in (scenario, agent, config.name))]
    key = [words[0] << 32 | words[1], words[2] << 32 | words[3]]
    generator = np.random.Philox(key=np.array(key, dtype=np.uint64), counter=first * BLOCKS_PER_FRAME)
    bits = generator.random_raw((last - first + 1) * BLOCKS_PER_FRAME * 4).reshape(-1, 4, 2)[np.asarray(frames) - first]
    # 53-bit uniforms in (0, 1]: the logarithm never meets zero.
    uniform = ((bits >> np.uint64(11)).astype(np.float64) + 1.0) * 2.0**-53
    radius, angle = np.sqrt(-2.0 * np.log(uniform[..., 0])), 2.0 * np.pi * uniform[..., 1]
    normal = np.concatenate([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    return config.accel_noise_std * normal[:, :3], config.gyro_bias + config.gyro_noise_std * normal[:, 4:7]


def integrate_imu(
    accel: np.ndarray, gyro: np.ndarray, pose: np.ndarray, velocity: np.ndarray, dt: float = FRAME_DT
) -> tuple[np.ndarray, np.ndarray]:
    """Return the poses and velocities that follow from IMU samples and the state at the first of them.

    Rotation over the interval from k to k + 1 is exp(dt u_k) with u_k = (5 (w_k + w_(k+1)) - (w_(k-1) + w_(k+2))) / 8,
    which undoes to fourth order the averaging in w; the first and the last interval use the plain mean. Position and
    velocity follow velocity Verlet with a_k = R_k f_k - g z. Noise-free samples of one recording give its poses back.

    Args:
        accel: Specific force in the sensor frame [m/s^2], shape [F, 3].
        gyro: Angular rate in the sensor frame [rad/s], shape [F, 3].
        pose: Sensor-to-world at the first sample, shape [7].
        velocity: Velocity of the sensor at the first sample, world frame [m/s], shape [3]: that of `differentiate` for
            the sensor's poses, which is the agent's stored velocity where the sensor sits at the agent's origin.
        dt: Time between samples [s].

    Returns:
        Sensor-to-world poses, shape [F, 7], and velocities in the world frame [m/s], shape [F, 3].
    """
    count = len(gyro)
    mean_rate = 0.5 * (gyro[:-1] + gyro[1:])
    if count > 3:
        mean_rate[1:-1] = (5.0 * (gyro[1:-2] + gyro[2:-1]) - (gyro[:-3] + gyro[3:])) / 8.0
    step = quaternion_exp(dt * mean_rate)
    q = np.empty((count, 4))
    q[0] = normalize(pose[3:])
    for k in range(count - 1):
        q[k + 1] = multiply(q[k], step[k])
    q = normalize(q)
    acceleration = rotate(q, accel) - GRAVITY_W
    velocities = velocity + np.concatenate(
        [np.zeros((1, 3)), np.cumsum(0.5 * dt * (acceleration[:-1] + acceleration[1:]), axis=0)]
    )
    steps = dt * velocities[:-1] + 0.5 * dt**2 * acceleration[:-1]
    positions = pose[:3] + np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    return np.concatenate([positions, q], axis=1), velocities
