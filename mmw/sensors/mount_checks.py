"""Check that every sensor and antenna is in the open: one inside a vehicle, a building or the ground sees nothing."""

import numpy as np

from mmw.config import Config
from mmw.config.agent_keys import AGENT_ROLES
from mmw.config.sensor_spec import spec_of
from mmw.core.errors import InputError
from mmw.core.transforms import make_pose, normalize, transform_points
from mmw.scene.device_scene import DeviceScene
from mmw.scene.enclosing_objects import enclosing_objects
from mmw.scene.foliage import foliage_faces
from mmw.scene.scene_data import SceneData
from mmw.usd.actors import FIXED_ROLES


def check_mounts(scene: DeviceScene, config: Config) -> None:
    """Check each sensor and antenna at the first frame in which its agent is there.

    Args:
        scene: Town and vehicles; another batch is loaded afterwards.
        config: Sensors and antennas.

    Raises:
        InputError: With one line for each sensor that is inside something; an antenna may be inside foliage that waves
            pass.
    """
    arrays, problems = scene.arrays, []
    passable = np.unique(arrays.object_id[foliage_faces(arrays)]) if config.channel.foliage else ()
    poses = arrays.frame_poses
    for index, actor in enumerate(arrays.actors):
        is_here = np.isfinite(poses[:, index]).all(axis=1)
        if actor.role not in AGENT_ROLES or not is_here.any():
            continue
        places = {
            sensor.name: sensor.mount_on(*actor.identity).position_m
            for sensor in config.sensors
            if sensor.is_on(*actor.identity) and spec_of(sensor).needs_clear_view
        }
        if config.channel.enabled:
            for antenna in config.channel.antennas:
                if antenna.is_on(*actor.identity):
                    places[antenna.name] = antenna.mount_on(*actor.identity).position_m
        if not places:
            continue
        row = int(np.argmax(is_here))
        scene.load_batch([arrays.frames[row]])
        pose = make_pose(poses[row, index, :3], normalize(poses[row, index, 3:]))
        around = enclosing_objects(scene, transform_points(pose, np.array(list(places.values()))))
        at = ", ".join(f"{part:.1f}" for part in pose[:3])
        kind = f", a {actor.model_name or actor.label}," if actor.model >= 0 else ""
        for (name, position), object_id in zip(places.items(), around, strict=True):
            if object_id >= 0 and not (name in config.channel.antenna_names and object_id in passable):
                inside = inside_words(arrays, object_id, actor.object_id, arrays.frames[row])
                cure = f"raise or move {'the unit or ' if actor.role in FIXED_ROLES else ''}its mount"
                if object_id == actor.object_id:
                    cure += f", as in mount: {{{actor.name}: {{position_m: [0, 0, 1], relative_to: roof}}}}"
                whole = f"the agent{kind} is at ({at}) m in the world"
                problems.append(f"{actor.name}: {name} at {position} m {inside}; {whole}; {cure}")
    if problems:
        raise InputError("\n  ".join(problems))


def inside_words(arrays: SceneData, object_id: int, own: int, frame: int) -> str:
    """Return the words for a sensor of actor `own`, an object id, that is inside an object in a frame."""
    what = arrays.objects[object_id]
    where = "its own body" if object_id == own else f"{what.prim_path} ({what.label})"
    return f"is inside {where} in frame {frame}; it would see nothing else"
