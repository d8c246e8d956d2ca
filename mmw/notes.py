"""What a user should know before a run: settings that are allowed and most likely not meant. One line each."""

import numpy as np

from mmw.config import Config, DepthConfig, LidarConfig
from mmw.poses import transform_points
from mmw.scene_arrays import MODEL_NONE, SceneArrays


def notes(arrays: SceneArrays, config: Config) -> list[str]:
    """Return every note on a scenario."""
    return [*blind_mounts(arrays, config), *missing_links(arrays, config), *clear_air(config)]


def missing_links(arrays: SceneArrays, config: Config) -> list[str]:
    """Return one line for each configured kind of link that no agents are there for."""
    if not config.channel.enabled:
        return []
    cavs, rsus = ([a.name for a in arrays.actors if a.role == role] for role in ("cav", "rsu"))
    lines = []
    if "v2i" in config.channel.links and not (cavs and rsus):
        lines.append(f"channel.links has v2i, but there are {len(cavs)} CAVs and {len(rsus)} RSUs: no such link")
    if "v2v" in config.channel.links and len(cavs) < 2:
        lines.append(f"channel.links has v2v, but there is {len(cavs)} CAV: no such link")
    return lines


def clear_air(config: Config) -> list[str]:
    """Return what this version leaves out of bad weather: it changes the radio link, not optics."""
    wet = [weather for weather in config.weathers if weather != "sunny"]
    optical = [sensor.name for sensor in config.sensors if isinstance(sensor, LidarConfig | DepthConfig)]
    if not wet or not optical:
        return []
    return [f"{', '.join(optical)} see clear air in {', '.join(wet)}; in this version weather changes the radio only"]


def blind_mounts(arrays: SceneArrays, config: Config) -> list[str]:
    """Return one line for each sensor or antenna that sees nothing where it is: in its agent's body or underground.

    Inertial sensors belong into the body and are left out.
    """
    lines = []
    for index, actor in enumerate(arrays.actors):
        if actor.role not in ("cav", "rsu"):
            continue
        places = {
            s.name: s.mount_on(actor.role).position_m for s in config.sensors if actor.role in s.on and s.type != "imu"
        }
        if config.channel.enabled:
            places["antenna"] = config.channel.antenna_position_m[actor.role]
        if actor.role == "cav" and actor.model != MODEL_NONE:
            half, center = np.array(actor.size) / 2.0, np.array(actor.center)
            lines += [
                f"{actor.name} ({actor.size[2]:.1f} m high): {name} at {position} m is inside its body; raise the mount"
                for name, position in places.items()
                if (np.abs(np.array(position) - center) < half).all()
            ]
        pose = arrays.poses[0, index]
        if actor.role == "rsu" and np.isfinite(pose).all():
            lines += [
                f"{actor.name}: {name} is {depth:.1f} m below the ground; raise the unit's position_m"
                for name, position in places.items()
                if (depth := _depth_below(arrays, transform_points(pose, np.array(position)))) > 0.0
            ]
    return lines


def _depth_below(arrays: SceneArrays, position: np.ndarray) -> float:
    """Return how far a point lies below the lowest static surface over or under it [m]; 0 above it or beside all."""
    a, b, c = (arrays.points[arrays.faces[:, k]] for k in range(3))
    u, v, w = (b - a)[:, :2], (c - a)[:, :2], position[:2] - a[:, :2]
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    flat = np.where(area == 0.0, 1.0, area)  # upright triangles have no area seen from above
    s = (w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]) / flat
    t = (u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]) / flat
    over = np.flatnonzero((area != 0.0) & (s >= 0.0) & (t >= 0.0) & (s + t <= 1.0))
    heights = a[over, 2] + s[over] * (b - a)[over, 2] + t[over] * (c - a)[over, 2]
    return max(float(heights.min() - position[2]), 0.0) if len(over) else 0.0
