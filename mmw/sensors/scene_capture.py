"""Capture one frame of a scene with any registered sensor: its samples as arrays, by the code that runs use.

A sensor rides on an actor, or is at free poses in the world. A free pose is that of an agent without geometry, which is
added to the actors around the frame and moves at constant velocity; so every sensor works there without a change.
Random numbers of an actor's sensor are those of a run. Those of a free pose are named after the pose, so that they do
not depend on which poses are captured together.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from mmw.config import SensorConfig
from mmw.config.sensor_spec import SENSORS, SensorSpec
from mmw.core.choices import check_choice
from mmw.core.errors import InputError
from mmw.core.kinematics import REACH_FRAMES, Motion, differentiate
from mmw.core.registry import load_reference
from mmw.core.transforms import make_pose, normalize
from mmw.physics.weather.weather import Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.enclosing_objects import enclosing_objects
from mmw.scene.scene_data import MODEL_NONE, Actor, SceneData
from mmw.scene.views import Views, actor_views
from mmw.sensors.mount_checks import inside_words
from mmw.sensors.samples import Output, is_array
from mmw.sensors.sensor_input import SensorInput

MARGIN_FRAMES = REACH_FRAMES + 1
"""Frames on either side of the captured one in which a free pose moves: derivatives, of an IMU's late accelerometer
too, depend on no others."""

FREE = "free"
"""Role of the agents at free poses; sensors have no mount for it."""


class CaptureContext(Protocol):
    """The scene that is captured."""

    @property
    def device_scene(self) -> DeviceScene:
        """Scene with `frame` loaded at batch index 0."""
        ...

    @property
    def frame(self) -> int:
        """The frame."""
        ...

    @property
    def weathers(self) -> Mapping[str, Weather]:
        """Weathers by name that the scene was read for; the first is the default."""
        ...

    @property
    def seed(self) -> int:
        """Seed of random numbers."""
        ...

    @property
    def name(self) -> str:
        """Name that random numbers depend on."""
        ...

    @property
    def cache(self) -> dict[Any, Any]:
        """Store of sensors, see `SensorInput.cached`; cleared when geometry, materials or weathers change."""
        ...


@dataclass(frozen=True)
class _Carriers:
    """Actors that carry the sensors."""

    scene: DeviceScene
    motion: Motion
    actors: np.ndarray
    """Their indices in the scene, shape [K]."""
    is_one: bool
    """True if one was asked for, not a list."""


def capture(
    context: CaptureContext,
    sensor: SensorConfig | Sequence[SensorConfig],
    *,
    pose: ArrayLike | None = None,
    actor: str | Sequence[str] | None = None,
    velocity: ArrayLike = (0.0, 0.0, 0.0),
    weather: str | Sequence[str] | None = None,
    output: Output = "numpy",
) -> Any:
    """Return the samples of sensors in one frame of a scene.

    `on` and `rate_hz` of a sensor do not matter: any actor carries it, and it samples in any frame. On an actor it has
    the actor's mount (`SensorConfig.mount_on`), and the samples are those of a run's rows bit for bit.

    Args:
        context: The scene.
        sensor: The sensor; the result for a list of sensors is a list.
        pose: Sensor in the world (x, y, z, qx, qy, qz, qw) [m], shape [7]; or K of them, which are traced together,
            shape [K, 7]: the result is a list of K.
        actor: Name of the actor that carries the sensor, instead of `pose`; the result for a list of names is a list.
        velocity: Velocity of the poses in the world [m/s], shape [3] or [K, 3].
        weather: Name of a weather, the scene's first if absent; the result for a list of names is a dictionary of
            weathers, which are evaluated on the same rays.
        output: `warp` leaves arrays on the scene's device.

    Returns:
        The sample of one view, as `view` of the samples that `SensorSpec.simulate` makes gives it (`PointCloud`,
        `RgbImage`, ...); samples without `view` are returned whole. Lists nest in this order: sensors, weathers,
        poses or actors.

    Raises:
        InputError: If an argument cannot be used, an actor is absent in the frame, or a sensor that needs a clear view
            is inside a body.
    """
    is_list = isinstance(sensor, Sequence) and not isinstance(sensor, str)
    sensors = list(sensor) if is_list else [sensor]
    specs = [_checked(one, output) for one in sensors]
    wanted = next(iter(context.weathers)) if weather is None else weather
    names = [wanted] if isinstance(wanted, str) else list(wanted)
    if unknown := [name for name in names if name not in context.weathers]:
        raise InputError(f"weather {unknown[0]!r}: the scene has {', '.join(context.weathers)}; name one of them")
    _load_sweep(
        context.device_scene, max((spec.sweep_s(one) for spec, one in zip(specs, sensors, strict=True)), default=0)
    )
    carriers = _carriers(context, pose, actor, velocity)
    results = []
    for one, spec in zip(sensors, specs, strict=True):
        by_weather = _capture(context, one, spec, carriers, names, output)
        results.append(by_weather[wanted] if isinstance(wanted, str) else by_weather)
    return results if is_list else results[0]


def _checked(sensor: SensorConfig, output: Output) -> SensorSpec:
    """Return the kind of a sensor that can be captured."""
    if not isinstance(sensor, SensorConfig):
        raise InputError(
            f"sensor = {sensor!r}: is a {type(sensor).__name__}; a sensor is needed, such as mmw.sensors.Lidar()"
        )
    if sensor.type not in SENSORS:
        raise InputError(
            f"sensor {sensor.name!r}: no type {sensor.type!r} is registered, but {', '.join(SENSORS)}; call "
            "mmw.register_sensor(SPEC), or install the package that provides it"
        )
    check_choice("output", output, Output)
    spec = SENSORS[sensor.type]
    if output == "warp" and not spec.warp_output:
        raise InputError(
            f"sensor {sensor.name!r}: a sensor of type {sensor.type!r} makes its arrays on the host; use "
            "output='numpy', and torch.from_numpy for tensors"
        )
    return spec


def _load_sweep(scene: DeviceScene, sweep_s: float) -> None:
    """Have instances traced where they were within a sweep before the frame."""
    if scene.sweep_s < sweep_s:
        scene.sweep_s = sweep_s
        scene.load_batch(scene.batch_frames)


def _capture(
    context: CaptureContext,
    sensor: SensorConfig,
    spec: SensorSpec,
    carriers: _Carriers,
    weathers: Sequence[str],
    output: Output,
) -> dict[str, Any]:
    """Return weather -> the samples of one sensor."""
    scene = carriers.scene
    views = actor_views(scene.arrays, [context.frame], sensor, carriers.actors)
    if len(views) == 0 or not weathers:
        return {name: [] for name in weathers}
    if spec.needs_clear_view:
        _check_clear_view(scene, sensor, views)
    air = {name: context.weathers[name] for name in weathers}
    data = SensorInput(
        scene.optical, carriers.motion, views, air, context.seed, context.name, output=output, cache=context.cache,
        radio_scene=scene,
    )  # fmt: skip
    samples = load_reference(spec.simulate)(data, sensor)
    return {name: _views_of(samples[name], len(views), carriers.is_one) for name in weathers}


def _views_of(samples: Any, count: int, is_one: bool) -> Any:
    view = None if is_array(samples) else getattr(samples, "view", None)
    if view is None:
        return samples
    return view(0) if is_one else [view(index) for index in range(count)]


def _check_clear_view(scene: DeviceScene, sensor: SensorConfig, views: Views) -> None:
    around = enclosing_objects(scene, views.pose[:, :3])
    for row in np.flatnonzero(around >= 0):
        actor = scene.arrays.actors[views.actor[row]]
        x, y, z = views.pose[row, :3]
        is_free = actor.role == FREE
        place = (f"pose {row}" if len(views) > 1 else "pose") if is_free else actor.name
        raise InputError(
            f"{place}: {sensor.name} at ({x:g}, {y:g}, {z:g}) m in the world "
            f"{inside_words(scene.arrays, int(around[row]), actor.object_id, int(views.frame[row]))}; "
            f"move {'the pose' if is_free else 'its mount'}"
        )


def _carriers(
    context: CaptureContext, pose: ArrayLike | None, actor: str | Sequence[str] | None, velocity: ArrayLike
) -> _Carriers:
    """Return the actors of a capture, free ones for poses."""
    if (pose is None) == (actor is None):
        raise InputError(f"{'neither' if pose is None else 'both'} of pose and actor: a capture needs one; give one")
    scene = context.device_scene
    if pose is not None:
        poses, is_one = _poses(pose)
        return _free(scene, context, poses, _velocities(velocity, len(poses)), is_one)
    if np.any(np.asarray(velocity) != 0):
        raise InputError(f"velocity = {velocity}: actor {actor!r} has its own; leave velocity out, or give a pose")
    names = [actor] if isinstance(actor, str) else list(actor or ())
    actors = np.array([_actor(scene.arrays, name, context.frame) for name in names], dtype=np.int32)
    return _Carriers(scene, _motion(scene, context), actors, isinstance(actor, str))


def _actor(arrays: SceneData, name: str, frame: int) -> int:
    """Return the index of an actor that is there in a frame."""
    names = [actor.name for actor in arrays.actors]
    if name not in names:
        raise InputError(f"actor {name!r}: the scene has {', '.join(names) or 'no actor'}; name one, or give a pose")
    index = names.index(name)
    if not np.isfinite(arrays.poses[arrays.frame_row(frame), index]).all():
        rows = np.flatnonzero(np.isfinite(arrays.frame_poses[:, index]).all(axis=1))
        stay = (
            f"frames {arrays.frames[rows[0]]} to {arrays.frames[rows[-1]]} have it" if len(rows) else "no frame has it"
        )
        raise InputError(f"actor {name!r}: is absent in frame {frame}; {stay}; choose another frame or actor")
    return index


def _motion(scene: DeviceScene, context: CaptureContext) -> Motion:
    """Return the derivatives of all actors, which are kept while the poses stay."""
    arrays, motion = context.cache.get("motion", (None, None))
    if arrays is not scene.arrays or motion is None:
        motion = differentiate(scene.arrays.poses, scene.arrays.pose_dt)
        context.cache["motion"] = scene.arrays, motion
    return motion


def _numbers(name: str, value: ArrayLike, needs: str) -> np.ndarray:
    try:
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} = {value!r}: {needs}; correct it") from error


def _poses(pose: ArrayLike) -> tuple[np.ndarray, bool]:
    """Return poses with unit quaternions, shape [K, 7], and whether one was given, not a list."""
    needs = "x, y, z, qx, qy, qz, qw of the sensor in the world are needed, shape [7], or [K, 7] for K poses"
    values = _numbers("pose", pose, needs)
    if values.ndim not in (1, 2) or values.shape[-1] != 7:
        raise InputError(f"pose: has shape {values.shape}; {needs}; correct it")
    rows = values.reshape(-1, 7)
    for row in rows:
        if not np.isfinite(row).all():
            raise InputError(f"pose = {_text(row)}: finite numbers are needed; correct it")
        if not np.linalg.norm(row[3:]) > 0.0:
            raise InputError(f"pose = {_text(row)}: the quaternion is zero; (0, 0, 0, 1) turns nothing; correct it")
    return make_pose(rows[:, :3], normalize(rows[:, 3:])), values.ndim == 1


def _velocities(velocity: ArrayLike, count: int) -> np.ndarray:
    """Return the velocity of each pose [m/s], shape [count, 3]."""
    needs = f"finite numbers are needed, shape [3], or [{count}, 3] for {count} poses"
    values = _numbers("velocity", velocity, needs)
    if values.shape not in ((3,), (count, 3)) or not np.isfinite(values).all():
        raise InputError(f"velocity = {_text(values)}: {needs}; correct it")
    return np.broadcast_to(values, (count, 3))


def _text(values: np.ndarray) -> str:
    return str(values.tolist()).replace("[", "(").replace("]", ")")


def _free(
    scene: DeviceScene, context: CaptureContext, poses: np.ndarray, velocity: np.ndarray, is_one: bool
) -> _Carriers:
    """Return agents without geometry at poses of the frame, [K, 7], which move at a velocity [m/s], [K, 3]."""
    arrays, base = scene.arrays, _motion(scene, context)
    at, stride, copies = arrays.frames.index(context.frame), arrays.pose_stride, 1
    frames = arrays.frames[max(at - MARGIN_FRAMES, 0) : at + MARGIN_FRAMES + 1]
    part = slice(arrays.frame_row(frames[0]), arrays.frame_row(frames[-1]) + 1)
    if len(arrays.frames) == 1:  # a velocity needs neighbors; everything else is at rest in them
        frames = range(context.frame - 1, context.frame + 2)
        copies = arrays.pose_rows(len(frames))

    def extended(recorded: np.ndarray, own: np.ndarray) -> np.ndarray:
        return np.concatenate([np.repeat(recorded[part], copies, axis=0), own], axis=1)

    rows = np.arange(arrays.pose_rows(len(frames))) - frames.index(context.frame) * stride
    track = np.repeat(poses[None], len(rows), axis=0)
    track[..., :3] += velocity * (rows[:, None, None] * arrays.pose_dt)
    motion = differentiate(track, arrays.pose_dt)
    named = [f"pose {(row + 0.0).tobytes().hex()}" for row in poses]  # + 0.0: no -0.0, which is the same place
    agents = [Actor(name, FREE, "", MODEL_NONE, -1, (0.0,) * 3, (0.0,) * 3, "static") for name in named]
    others = replace(arrays, actors=(*arrays.actors, *agents), frames=frames, poses=extended(arrays.poses, track))
    derivatives = (
        extended(getattr(base, name), getattr(motion, name))
        for name in ("velocity", "acceleration", "body_rate", "world_rate")
    )
    actors = np.arange(len(arrays.actors), len(others.actors), dtype=np.int32)
    return _Carriers(scene.with_agents(others), Motion(*derivatives), actors, is_one)
