"""Warn of settings that are allowed but probably unintended, one line each."""

from collections.abc import Iterator

from mmw.config import Config, ScenarioConfig
from mmw.config.sampling import Sampling
from mmw.config.sensor_spec import spec_of
from mmw.scene.scene_data import SceneData


def configuration_warnings(arrays: SceneData, config: Config, scenario: ScenarioConfig) -> Iterator[str]:
    """Yield all warnings about a scenario."""
    roles = [actor.role for actor in arrays.actors]
    cavs, rsus = roles.count("cav"), roles.count("rsu")
    links = config.channel.links if config.channel.enabled else ()
    if "v2i" in links and not (cavs and rsus):
        yield f"channel.links has v2i, but there are {cavs} CAVs and {rsus} RSUs: no such link"
    if "v2v" in links and cavs < 2:
        yield f"channel.links has v2v, but there is {cavs} CAV: no such link"
    idle = [sensor for sensor in config.sensors if sensor.on and not set(roles).intersection(sensor.on)]
    if idle:
        wanted = " or ".join(role.upper() for role in sorted({role for sensor in idle for role in sensor.on}))
        yield f"sensors: there is no {wanted} to carry {', '.join(sensor.name for sensor in idle)}: no rows of them"
    frames = config.frames_of(scenario)
    sampled: list[tuple[str, Sampling]] = [(f"sensors: {sensor.name}", sensor) for sensor in config.sensors]
    if config.channel.enabled:
        sampled.append(("channel", config.channel))
    for where, one in sampled:
        if not one.is_due(range(frames.start, frames.stop), arrays.rate_hz).any():
            period = one.period_frames(arrays.rate_hz)
            first = round(one.phase_s * arrays.rate_hz)
            yield (
                f"{where} samples frames {first}, {first + period}, {first + 2 * period}, ...; none of "
                f"{frames.start} to {frames.stop - 1} is one: no rows of it"
            )
    if any(spec_of(sensor).needs_appearance for sensor in config.sensors):
        yield from arrays.look_notes
