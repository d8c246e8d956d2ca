"""Check `model:` and `label:` keys against the vehicle models and the classes that there are."""

from collections.abc import Iterator
from difflib import get_close_matches
from pathlib import Path

from mmw.config import Config
from mmw.config.agent_keys import LABEL, MODEL
from mmw.scene.sources import scenario_source
from mmw.usd.actors import find_actors
from mmw.usd.open_stage import open_stage, usd_errors
from mmw.usd.semantics import CARLA_TAG
from mmw.usd.vehicle_catalog import load_bodies


def unknown_agent_keys(config: Config, base: Path) -> Iterator[str]:
    """Yield a line for each key that names a model or class that does not exist.

    Args:
        config: The configuration.
        base: Folder that relative paths start from.

    Raises:
        InputError: If a stage cannot be read.
    """
    keys = [(where, key) for where, key in config.agent_keys if key.startswith((MODEL, LABEL))]
    models = _models(config, base) if any(key.startswith(MODEL) for _, key in keys) else ()
    for where, key in keys:
        prefix, what, known = (MODEL, "model", models) if key.startswith(MODEL) else (LABEL, "class", tuple(CARLA_TAG))
        name = key.removeprefix(prefix)
        if name not in known:
            near = get_close_matches(name, known, n=1)
            cure = f"did you mean `{prefix}{near[0]}`?" if near else f"there are {', '.join(known)}"
            yield f"{where} names {key!r}, and there is no such {what}; {cure}"


def _models(config: Config, base: Path) -> tuple[str, ...]:
    """Return the models that actors of all scenarios may have."""
    found = dict.fromkeys(load_bodies()) if any(scenario.town for scenario in config.scenarios) else {}
    for scenario in config.scenarios:
        if scenario.stage is None:
            continue
        source = scenario_source(scenario, base)
        stage = open_stage(source)
        with usd_errors(source):
            found |= dict.fromkeys(actor.model_name for actor in find_actors(stage, scenario.actor_roles))
    return tuple(found)
