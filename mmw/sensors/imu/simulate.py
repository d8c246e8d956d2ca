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
import warp as wp

from mmw.core.constants import FRAME_DT, GRAVITY
from mmw.core.remember import remembered
from mmw.core.transforms import multiply, normalize, quaternion_exp, rotate
from mmw.kernels.navigation import imu as kernels
from mmw.scene.scene_data import SceneData
from mmw.scene.views import Views
from mmw.sensors.imu.config import Imu
from mmw.sensors.imu.noise import biases, distortion, noise_std
from mmw.sensors.mounted_motion import agent_names, mounted_samples, mounted_sensors, sampled, view_grid
from mmw.sensors.samples import Samples
from mmw.sensors.sensor_input import SensorInput

GRAVITY_W = np.array([0.0, 0.0, GRAVITY])
"""Specific force at rest, world frame [m/s^2]."""

COLUMNS = 19
"""Numbers of a sample of the kernel: the six vectors of `ImuSample` in their order, and the compass."""

PERFECT = Imu(gyro_bias=0.0)
"""A sensor whose biases are zero."""


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
    lag = config.accel_lag_frames * arrays.pose_stride
    model = _model(config, arrays.rate_hz, lag)
    errors = _errors(arrays, views, config, seed, scenario)
    values = mounted_samples(
        kernels.imu_kernel, arrays, views, config, (seed, scenario), [*errors, model], COLUMNS, lag
    )
    return ImuSample(*(values[at : at + 3].T for at in range(0, COLUMNS - 1, 3)), compass=values[-1])


def _errors(arrays: SceneData, views: Views, config: Imu, seed: int, scenario: str) -> tuple[wp.array, wp.array]:
    """Return scale and alignment, and bias, of each view or of all: arguments of the kernel."""
    if config.mode == "carla":
        return _carla_errors(config)
    grid = view_grid(views)
    agents, place = agent_names(arrays, grid.actors), grid.place
    bias = biases(config, grid.frames, seed, scenario, agents, arrays.rate_hz)[place]
    return (
        wp.array(distortion(config, seed, scenario, agents)[place[0]], dtype=wp.mat33d, device="cpu"),
        wp.array(bias, dtype=wp.vec3d, device="cpu"),
    )


@remembered()
def _carla_errors(config: Imu) -> tuple[wp.array, wp.array]:
    """Return `_errors` of mode `carla`, the same for all views."""
    return (
        wp.array(distortion(config, 0, "", ("",)), dtype=wp.mat33d, device="cpu"),
        wp.array(biases(config, [0], 0, "", ("",))[0], dtype=wp.vec3d, device="cpu"),
    )


@remembered()
def _model(config: Imu, rate_hz: int, lag: int) -> kernels.ImuModel:
    model = kernels.ImuModel()
    model.accel_std, model.gyro_std = noise_std(config, rate_hz)
    model.gravity, model.lag, model.is_left_handed = GRAVITY, lag, config.handedness == "left"
    return model


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
    count = len(poses)
    mounted = mounted_sensors(np.zeros(count), np.tile(mount, (count, 1)), np.zeros((count, 2), dtype=np.uint32), dt)
    model = kernels.ImuModel()
    model.gravity, model.lag = GRAVITY, lag
    errors, rows = _carla_errors(PERFECT), np.arange(count)
    values = sampled(
        kernels.imu_kernel, poses[:, None], rows, (rows, 0 * rows), mounted, [*errors, model], COLUMNS, lag
    )
    return values[:3].T, values[3:6].T


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
