"""Warn of settings that are allowed and most likely not meant, one line each."""

from mmw.config import Config, ScenarioConfig
from mmw.config.sensor_spec import spec_of
from mmw.scene.scene_data import SceneData


def notes(arrays: SceneData, config: Config, scenario: ScenarioConfig) -> list[str]:
    """Return every note on a scenario."""
    lines = [*missing_links(arrays, config), *missing_carriers(arrays, config), *missing_samples(config, scenario)]
    if any(spec_of(sensor).needs_appearance for sensor in config.sensors):
        lines += arrays.look_notes
    return lines


def missing_links(arrays: SceneData, config: Config) -> list[str]:
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


def missing_carriers(arrays: SceneData, config: Config) -> list[str]:
    """Return one line for the sensors that no agent of the scenario carries; one without `on` is switched off."""
    roles = {actor.role for actor in arrays.actors}
    idle = [sensor for sensor in config.sensors if sensor.on and not roles.intersection(sensor.on)]
    if not idle:
        return []
    wanted = " or ".join(role.upper() for role in sorted({role for sensor in idle for role in sensor.on}))
    return [f"sensors: there is no {wanted} to carry {', '.join(sensor.name for sensor in idle)}: no rows of them"]


def missing_samples(config: Config, scenario: ScenarioConfig) -> list[str]:
    """Return one line for each receiver or camera whose samples all fall between the frames that are made."""
    frames = config.frames_of(scenario)
    return [
        f"sensors: {sensor.name} samples frames 0, {period}, {2 * period}, ...; none of "
        f"{frames.start} to {frames.stop - 1} is one: no rows of it"
        for sensor, period in ((sensor, sensor.period_frames) for sensor in config.sensors)
        if -(-frames.start // period) * period >= frames.stop
    ]
