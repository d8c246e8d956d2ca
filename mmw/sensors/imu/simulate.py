"""Simulate an inertial measurement unit: specific force and angular rate from float64 poses, and the inverse.

A sample at frame k is the reading at the instant of frame k, in the sensor frame (x forward, y left, z up):

    specific force  f_k = R_k^-1 (a_k + g z)    rest on level ground reads (0, 0, +9.81)
    angular rate    w_k
    compass         heading of the sensor's x axis, clockwise from north

where a_k and w_k are the central differences of `mmw.core.kinematics`, taken of the mounted sensor, so lever arms
are exact. `integrate_imu` inverts them. The first and last frame of a recording rest on an extrapolated neighbor.

Two of CARLA's habits are options. `handedness: left` reports in its axes (x forward, y right, z up): forces become
(fx, -fy, fz), rates (-wx, wy, -wz). `accel_lag_frames: 1` is its late accelerometer, which turns the acceleration of
the frame before into the sensor as it stands now: R_k^-1 (a_(k-1) + g z). Where the agent has no pose on both sides
of the frame before, which is in its first two frames, it reads its own: an extrapolated neighbor would bring later
frames into a reading. The noise-free columns have no lag.

The readings do not depend on which frames are asked for, as long as the same recording is given. Errors are those of
`mmw.sensors.imu.noise`.

Source: sign and frame as CARLA 0.9.15 `sensor.other.imu`, in a right-handed frame.
"""

from dataclasses import dataclass

import numpy as np

from mmw.core.constants import FRAME_DT, GRAVITY
from mmw.core.geodesy import sensor_heading
from mmw.core.kinematics import Motion, differentiate
from mmw.core.transforms import compose, conjugate, multiply, normalize, quaternion_exp, rotate
from mmw.scene.scene_data import SceneData
from mmw.scene.views import Views, frame_rows
from mmw.sensors.imu.config import Imu
from mmw.sensors.imu.noise import imu_errors
from mmw.sensors.mounted_motion import mounted_motion, view_grid
from mmw.sensors.samples import Samples
from mmw.sensors.sensor_input import SensorInput

GRAVITY_W = np.array([0.0, 0.0, GRAVITY])
"""Specific force at rest, world frame [m/s^2]."""

LEFT_HANDED = np.array([[1.0, -1.0, 1.0], [-1.0, 1.0, -1.0]])
"""Factors of a force and of a rate from y left to y right: mirrored polar and axial vectors. Its own inverse."""


@dataclass(frozen=True)
class ImuSample(Samples):
    """IMU samples of A views, or the one of a single view, in the axes of `Imu.handedness`; float64."""

    accel: np.ndarray
    """Specific force as measured [m/s^2], shape [A, 3]."""
    gyro: np.ndarray
    """Angular rate as measured [rad/s], shape [A, 3]."""
    accel_true: np.ndarray
    """Specific force without errors and lag [m/s^2], shape [A, 3]."""
    gyro_true: np.ndarray
    """Angular rate without errors [rad/s], shape [A, 3]."""
    accel_bias: np.ndarray
    """Bias in the measured specific force [m/s^2], shape [A, 3]."""
    gyro_bias: np.ndarray
    """Bias in the measured angular rate [rad/s], shape [A, 3]."""
    compass: np.ndarray
    """True heading of the sensor's x axis, clockwise from north, 0 to 2 pi [rad], shape [A]."""


def simulate(data: SensorInput, config: Imu) -> dict[str, ImuSample]:
    """Return the samples of all views; they are the same in every weather."""
    samples = make_imu(data.scene.arrays, data.views, config, data.seed, data.scenario)
    return dict.fromkeys(data.weathers, samples)


def make_imu(arrays: SceneData, views: Views, config: Imu, seed: int, scenario: str) -> ImuSample:
    """Return the IMU samples of some views.

    The frames around those of the views are differentiated too, so give all batches the same recording.

    Raises:
        ValueError: If the scene does not cover a frame.
    """
    grid = view_grid(views)
    rows, lag = frame_rows(arrays, grid.frames), config.accel_lag_frames * arrays.pose_stride
    moved = mounted_motion(arrays, config, grid.actors, rows, lag)
    true = _by_agent(_readings(moved.pose, moved.motion), moved.at)
    late = _by_agent(_readings(moved.pose, moved.motion, lag), moved.at) if lag else true
    compass = sensor_heading(moved.pose[moved.at, :, 3:]).T
    if config.handedness == "left":
        true, late = (values * LEFT_HANDED[:, None, None] for values in (true, late))
    agents = [arrays.actors[index].name for index in grid.actors.tolist()]
    errors = imu_errors(config, grid.frames, seed, scenario, agents, arrays.rate_hz)
    distorted = np.sum(errors.distortion[:, :, None] * late[..., None, :], axis=-1)
    read = distorted + errors.bias + errors.noise
    samples = (values[:, *grid.place] for values in (read, true, errors.bias))
    return ImuSample(*(triad for pair in samples for triad in pair), compass[grid.place])


def _by_agent(readings: tuple[np.ndarray, np.ndarray], at: np.ndarray) -> np.ndarray:
    """Return some rows of readings [P, A, 3] as force and rate of each agent, shape [2, A, F, 3]."""
    return np.stack([values[at] for values in readings]).swapaxes(1, 2)


def measure(poses: np.ndarray, mount: np.ndarray, dt: float = FRAME_DT, lag: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return what a perfect IMU reads at every frame.

    Args:
        poses: Agent-to-world in consecutive frames, shape [F, 7], float64; NaN where absent.
        mount: Sensor-to-agent pose, shape [7].
        dt: Time between frames [s].
        lag: Rows by which the acceleration is late.

    Returns:
        Specific force [m/s^2] and angular rate [rad/s] in the sensor frame (y left), shape [F, 3] each; NaN where
        absent.
    """
    sensor = compose(np.concatenate([poses[..., :3], normalize(poses[..., 3:])], axis=-1), mount)
    return _readings(sensor, differentiate(sensor, dt), lag)


def _readings(sensor: np.ndarray, motion: Motion, lag: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return what `measure` does, of the poses of the sensor [F, ..., 7] and their derivatives."""
    acceleration = motion.acceleration
    if lag:
        is_there = np.asarray(np.isfinite(sensor).all(axis=-1))
        is_central, is_late = np.zeros_like(is_there), np.zeros_like(is_there)
        is_central[1:-1] = is_there[:-2] & is_there[1:-1] & is_there[2:]
        is_late[lag:] = is_there[lag:] & is_central[:-lag]
        before = np.concatenate([acceleration[:lag], acceleration[:-lag]])
        acceleration = np.where(is_late[..., None], before, acceleration)
    return rotate(conjugate(sensor[..., 3:]), acceleration + GRAVITY_W), motion.body_rate


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
