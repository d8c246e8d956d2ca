"""Load a scene from a shipped town, a configuration, a USD stage, or a file of another tool."""

import logging
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd
from pydantic import ValidationError

from mmw.config import Config, ScenarioConfig, load_config
from mmw.config.foliage import FoliageModel
from mmw.config.material_map import MaterialEntry, merged_maps
from mmw.config.physics_presets import Physics
from mmw.core.choices import check_choice
from mmw.core.constants import FRAME_RATE_HZ
from mmw.core.errors import InputError
from mmw.core.frame_rate import check_frame_rate
from mmw.core.resources import shipped_towns, town_path
from mmw.core.temp_files import TemporaryFolder
from mmw.physics.weather.weather import PRESETS, Weather
from mmw.scene.prepare import margin_frames, prepare_scenario, read_scenario
from mmw.scene.reader import read_stage
from mmw.scene.scene import Scene
from mmw.scene.scene_data import SceneData
from mmw.usd.material_entries import unknown_entries
from mmw.usd.open_stage import open_stage, reads_usd
from mmw.worlds.importers.formats import IMPORTERS, read_scene
from mmw.worlds.importers.material_map import apply_material_map
from mmw.worlds.importers.mesh_cleanup import check_scene
from mmw.worlds.importers.write_asset import write_scene

LOGGER = logging.getLogger(__name__)

USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
CONFIG_SUFFIXES = (".yaml", ".yml")

MAX_FRAMES = 10_000
"""Frames of a stage that are read unless `frames` says which: 100 s at 100 Hz. Design value."""

CUSTOM = "custom"
"""Name of a weather that is given by its values alone."""

Weathers = str | Weather | Sequence[str] | Mapping[str, Weather]


def load_scene(
    source: str | Path | Config,
    *,
    scenario: str | None = None,
    frame: int | None = None,
    frames: range | None = None,
    rate_hz: int | None = None,
    weather: Weathers | None = None,
    materials: Mapping[str, Any] | None = None,
    actor_roles: Mapping[str, str] | None = None,
    foliage: FoliageModel | None = None,
    physics: Physics | None = None,
    base: str | Path = ".",
    device: str = "auto",
    **options: Any,
) -> Scene:
    """Load a scene, ready for rays, paths, radio maps and sensors.

    Args:
        source: Name of a shipped town, such as `town03`; a USD stage, animated or not; a Mitsuba or Sionna XML file, an
            OpenDRIVE or OpenStreetMap file, a glTF, OBJ, PLY, STL or OFF mesh; a configuration file or a `Config`.
        scenario: Scenario of a configuration; None for its first one.
        frame: Frame to begin with; None for the first one.
        frames: Frames of a stage to read; None for all of them. A configuration has its own.
        rate_hz: Frames a second of a stage or town, 100 by default. A configuration has its own.
        weather: Name of a preset (`sunny`, `rainy`, ...) or of a weather of the configuration; several; a `Weather`; or
            names with their values. None is the first weather of a configuration, otherwise `sunny`.
        materials: Glob of mesh prim path or material name, or `label:` and a class -> radio material such as
            `itu_concrete`, or properties as in `materials` of a configuration, whatever the source says; it comes
            before `materials` of a configuration.
        actor_roles: Of a stage: prim path -> one of `mmw.usd.actors.ROLES`.
        foliage: `hull`: crowns of trees are solid to sensors; `leaves`: they are leaves, which light passes between.
            None is what a configuration says, otherwise `hull`. Radio waves meet the hull in both.
        physics: Preset whose materials the shipped library has: beyond `paper`, the default, walls have a thickness and
            surfaces are rough. A configuration has its own, `channel.physics`.
        base: Folder that relative paths in a `Config` start from.
        device: Warp device: `auto`, `cpu` or `cuda:N`.
        options: Options of the importer of other formats, such as `up="y"` and `unit="cm"` (`mmw import --list`).

    Raises:
        InputError: If the source is unknown or broken, a mesh has no radio material, or a weather, a frame, a scenario
            or the device does not exist.

    Examples:
        >>> import mmw
        >>> scene = mmw.load_scene("town03", weather="rainy")
        >>> scene.add(mmw.Transmitter("bs", position=(13.5, -29.5, 10.0)))
        Transmitter('bs', position=(13.5, -29.5, 10.0))
    """
    is_config = isinstance(source, Config) or str(source).lower().endswith(CONFIG_SUFFIXES)
    given = (
        {"scenario": scenario}
        if not is_config
        else {"frames": frames, "rate_hz": rate_hz, "actor_roles": actor_roles, "physics": physics, **options}
    )
    if not is_config and not str(source).lower().endswith(USD_SUFFIXES):
        given["actor_roles"] = actor_roles
    if wrong := [name for name, value in given.items() if value is not None]:
        raise InputError(f"load_scene: {wrong[0]} = {given[wrong[0]]!r}: does not go with {source!r}; leave it out")
    if is_config:
        config = source if isinstance(source, Config) else load_config(source)
        config.check_single("a scene")
        if foliage is not None:
            config = config.model_copy(update={"foliage": check_choice("load_scene: foliage", foliage, FoliageModel)})
        base = Path(base) if isinstance(source, Config) else Path(source).parent
        return _from_config(config, base, scenario or "", frame, weather, materials, device)
    crowns = check_choice("load_scene: foliage", "hull" if foliage is None else foliage, FoliageModel)
    preset = check_choice("load_scene: physics", "paper" if physics is None else physics, Physics)
    rate = check_frame_rate(FRAME_RATE_HZ if rate_hz is None else rate_hz)
    weathers = _weathers("sunny" if weather is None else weather, {})
    entries, files = _entries(materials, weathers), None
    path, name = Path(source), Path(source).name.split(".")[0]
    is_town = str(source) in shipped_towns() and not path.is_file()
    if options and (is_town or str(source).lower().endswith(USD_SUFFIXES)):
        raise InputError(f"load_scene: {next(iter(options))}: a USD stage has no such option; leave it out")
    if is_town:
        path = town_path(str(source))
    elif not str(source).lower().endswith(USD_SUFFIXES):
        files = TemporaryFolder("mmw_scene_")
        path, entries = _imported(path, files.path, entries, options), {}
    variants = {key: values.variants(key) for key, values in weathers.items()}
    wanted = _stage_frames(path, frames, frame, rate)
    data = read_stage(
        path, wanted, variants, rate_hz=rate, roles=actor_roles, material_map=entries, physics=preset, foliage=crowns
    )
    _log_notes(data)
    return Scene(data, weathers, frame=frame, device=device, name=name, files=files)


def _from_config(
    config: Config,
    base: Path,
    name: str,
    frame: int | None,
    weather: Weathers | None,
    materials: Mapping[str, Any] | None,
    device: str,
) -> Scene:
    """Return a scenario of a configuration with its traffic, as `mmw run` traces it."""
    scenario = config.scenario(name)
    own = {key: air.weather(key) for key, air in config.air.items()}
    weathers = _weathers(config.weathers[0] if weather is None else weather, own)
    if materials is not None:
        merged = merged_maps(_entries(materials, {**own, **weathers}), scenario.materials)
        scenario = scenario.model_copy(update={"materials": merged})
    files = TemporaryFolder("mmw_scene_")
    stage = prepare_scenario(config, scenario, base, files.path)
    # Material ids count the materials of all weathers together: those of a run need all of its weathers.
    data = read_scenario(config, scenario, stage)
    if others := {key: values.variants(key) for key, values in weathers.items() if own.get(key) != values}:
        variants = {**config.variants, **others}
        data = read_stage(
            stage, _inner(config, scenario), variants, margin=margin_frames(config),
            rate_hz=config.frame_rate_of(scenario), roles=scenario.actor_roles,
            material_map=config.materials_of(scenario), physics=config.channel.physics, foliage=config.foliage,
        )  # fmt: skip
    _log_notes(data)
    first = config.frames_of(scenario).start if frame is None else frame
    return Scene(
        data, weathers, frame=first, device=device, name=scenario.name, seed=config.seed,
        scene_seed=config.scene_seed, files=files,
    )  # fmt: skip


def _inner(config: Config, scenario: ScenarioConfig) -> range:
    frames = config.frames_of(scenario)
    return range(frames.start, frames.stop)


def _weathers(weather: Weathers, own: Mapping[str, Weather]) -> dict[str, Weather]:
    """Return the values of the weathers that a user named.

    Raises:
        InputError: If there is none, or a name is neither a preset nor one of `own`.
    """
    if isinstance(weather, Weather):
        return {CUSTOM: weather}
    names = [weather] if isinstance(weather, str) else weather
    known = {**PRESETS, **own, **(weather if isinstance(weather, Mapping) else {})}
    for name in names:
        if not isinstance(known.get(name), Weather):
            listed = ", ".join(dict.fromkeys((*own, *PRESETS)))
            raise InputError(f"weather {name!r}: is not known; name one of {listed}, or give a mmw.Weather")
    if not len(names):
        raise InputError("weather: is empty; name one, such as sunny")
    return {name: known[name] for name in names}


def _entries(materials: Mapping[str, Any] | None, weathers: Collection[str]) -> dict[str, MaterialEntry]:
    """Return the entries of a material map.

    Raises:
        InputError: If a key, a radio material, a label or a weather is not known.
    """
    entries = {}
    for pattern, value in (materials or {}).items():
        where = f"materials[{pattern!r}]"
        try:
            entries[pattern] = MaterialEntry.model_validate(value)
        except ValidationError as error:
            problem = error.errors()[0]
            key = ".".join(map(str, problem["loc"]))
            raise InputError(f"{where}: {key}{': ' if key else ''}{problem['msg']}; correct it") from None
    if problems := unknown_entries("materials", entries, {**dict.fromkeys(weathers), **PRESETS}):
        raise InputError("\n  ".join(problems))
    return entries


def _log_notes(data: SceneData) -> None:
    for line in data.material_notes:
        LOGGER.warning(line)


def _imported(path: Path, folder: Path, entries: dict[str, MaterialEntry], options: dict[str, Any]) -> Path:
    """Write a file of another tool as a town asset into a folder, and return its USD file.

    Raises:
        InputError: If there is no such file or town, or it cannot be used.
    """
    if not path.is_file():
        known = ", ".join((*USD_SUFFIXES, *(s for name in IMPORTERS for s in IMPORTERS[name].suffixes)))
        raise InputError(
            f"load_scene: {str(path)!r}: no such file, and no shipped town; towns are {', '.join(shipped_towns())}; "
            f"files end in {', '.join(dict.fromkeys(known.split(', ')))}; name one"
        )
    scene = read_scene(path, **options)
    check_scene(str(path), scene)
    return write_scene(apply_material_map(str(path), scene, entries), folder, "scene")


@reads_usd
def _stage_frames(path: Path, frames: range | None, frame: int | None, rate_hz: int) -> range:
    """Return the frames of a stage that are to be read.

    Raises:
        InputError: If the stage is too long to read all of it.
    """
    if frames is not None:
        return frames
    stage = open_stage(path, Usd.Stage.LoadNone)
    if not stage.HasAuthoredTimeCodeRange():
        return range((frame or 0) + 1)
    span = (stage.GetEndTimeCode() - stage.GetStartTimeCode()) / stage.GetTimeCodesPerSecond()
    count = int(np.floor(span * rate_hz + 1e-6)) + 1
    if count > MAX_FRAMES:
        raise InputError(
            f"{path}: holds {count} frames; {MAX_FRAMES} are read at most; name some, such as frames=range(1000)"
        )
    return range(count)
