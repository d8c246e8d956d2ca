"""Warn of settings that are allowed but probably unintended, one line each: above all of what finds nothing here."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.config import Config, ScenarioConfig
from mmw.config.agent_keys import AGENT_ROLES, AgentIdentity
from mmw.config.sampling import Sampling
from mmw.config.sensor_spec import spec_of
from mmw.physics.materials.permittivity import extrapolation_notes
from mmw.scene.foliage import foliage_faces
from mmw.scene.scene_data import SceneData


def configuration_warnings(arrays: SceneData, config: Config, scenario: ScenarioConfig) -> Iterator[str]:
    """Yield all warnings about a scenario."""
    agents = [actor.identity for actor in arrays.actors]
    if config.channel.enabled:
        yield from _link_warnings(agents, config)
    idle = [one for one in config.sensors if one.on and not any(one.is_on(*agent) for agent in agents)]
    if idle:
        wanted = _carriers(key for sensor in idle for key in sensor.on)
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
    yield from arrays.material_notes
    if config.foliage == "leaves" and not foliage_faces(arrays).any():
        yield "foliage = leaves finds nothing: no material of the static world has the medium foliage"
    if config.channel.enabled:
        yield from _channel_warnings(arrays, config)
    if any(spec_of(sensor).needs_appearance for sensor in config.sensors):
        yield from arrays.look_notes


def _link_warnings(agents: Sequence[AgentIdentity], config: Config) -> Iterator[str]:
    """Yield warnings of antennas that nobody carries and of rules without a link."""
    channel = config.channel
    for antenna in channel.antennas:
        if antenna.on and not any(antenna.is_on(*agent) for agent in agents):
            yield f"channel.antennas: there is no {_carriers(antenna.on)} to carry {antenna.name}: no links of it"
    ends = channel.link_ends(agents)
    roles = Counter(role for role, *_ in agents if role in AGENT_ROLES)
    there = (
        ", ".join(f"{count} {role.upper()}{'s' if count > 1 else ''}" for role, count in roles.items()) or "no agents"
    )
    for kind, rule in enumerate(channel.link_rules):
        if not any(end.kind == kind for end in ends):
            yield f"channel.links has {rule.name}, but the scenario has {there}: no such link"


def _carriers(keys: Iterable[str]) -> str:
    return " or ".join(key.upper() if key in AGENT_ROLES else key for key in sorted(set(keys)))


def surface_warnings(surfaces: SurfaceTable | None) -> Iterator[str]:
    """Yield warnings if diffraction has no edge, or foliage no volume; only a scene on a device knows them."""
    if surfaces is not None and surfaces.has_wedges and not len(surfaces.wedges):
        yield "channel.diffraction finds nothing: no two surfaces of the scene meet at a convex edge"
    if surfaces is not None and surfaces.foliage is not None and surfaces.foliage.open_faces:
        yield (
            f"channel.foliage: {surfaces.foliage.open_faces} faces of foliage close no volume: waves pass them without "
            "loss; close their meshes"
        )


def _channel_warnings(arrays: SceneData, config: Config) -> Iterator[str]:
    """Yield warnings of interactions that nothing in the scene has, and of values that no table has."""
    channel = config.channel
    used = np.unique(np.concatenate([arrays.material, *(model.material for model in arrays.models)]))
    radios = [by_id[k].radio for by_id in arrays.materials.values() for k in used.tolist()]
    has_foliage = channel.foliage and any(radio.medium == "foliage" for radio in radios)  # which scatters
    for switch, field, has, cure in (
        ("diffuse_reflection", "scatters", "a scattering coefficient", "scattering: 0.3"),
        ("refraction", "transmits", "a thickness", "thickness: 0.2"),
    ):
        has_any = any(getattr(radio, field) for radio in radios) or (has_foliage and field == "scatters")
        if getattr(channel, switch) and not has_any:
            yield (
                f"channel.{switch} finds nothing: no material of the scene has {has}; give one, such as "
                f"materials={{'label:building': {{{cure}}}}}"
            )
    if channel.foliage and not has_foliage:
        yield "channel.foliage finds nothing: no material of the scene has the medium foliage"
    if channel.edge_diffraction and not channel.diffraction:
        yield "channel.edge_diffraction finds nothing: channel.diffraction is false"
    switches = ("specular_reflection", "refraction", "diffraction", "diffuse_reflection")
    if channel.max_depth == 0 and any(getattr(channel, name) for name in switches[1:]):
        listed = ", ".join(name for name in switches[1:] if getattr(channel, name))
        yield f"channel.max_depth = 0 leaves the line of sight alone: {listed} finds nothing"
    if not (channel.los or any(getattr(channel, name) for name in switches)):
        yield "channel: los and all interactions are switched off: no paths"
    by_weather = (extrapolation_notes(by_id, channel.carriers_hz, used) for by_id in arrays.materials.values())
    yield from dict.fromkeys(line for lines in by_weather for line in lines)  # most are those of every weather
