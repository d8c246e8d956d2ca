"""Share the stages of a sweep: datasets with the same traffic and town copy the stage of the first of them."""

import json
import shutil
from typing import Any

from mmw.config import Config, ScenarioConfig
from mmw.scene.prepare import scenario_drivers
from mmw.scene.stage_digests import STAGES, parse_digests
from mmw.storage.atomic_files import write_bytes_atomically
from mmw.storage.manifest import read_dataset
from mmw.storage.store import Store


class SharedStages:
    """Stages that datasets of a sweep have made, by what decides them."""

    def __init__(self) -> None:
        """Begin without any."""
        self._roots: dict[str, Store] = {}
        self.copied = 0
        """Stages that were copied."""

    def share(self, config: Config, root: Store) -> None:
        """Copy the stages that an earlier dataset has into one that has not, before its scenarios are prepared.

        Datasets in a bucket make their own.

        Args:
            config: Configuration of the dataset.
            root: The dataset, begun already.
        """
        if type(root) is not Store:
            return
        head = read_dataset(root)
        made_by = [head["versions"].get(key) for key in ("software", "sources")]
        for scenario in config.scenarios:
            if scenario.stage is None:
                key = json.dumps([stage_identity(config, scenario), head.get("inputs"), made_by], sort_keys=True)
                origin = self._roots.setdefault(key, root)
                if origin is not root:
                    self.copied += _copy(origin, root, f"{STAGES}/{scenario.name}")


def stage_identity(config: Config, scenario: ScenarioConfig) -> dict[str, Any]:
    """Return what decides the bytes of a scenario's stage, see `mmw.scene.prepare.prepare_scenario`."""
    own = scenario.model_dump(mode="json", exclude={"frames", "description"})
    frames, weather = config.frames_of(scenario), config.weathers[0]
    return {
        "scenario": own,
        "frames": [frames.stop, config.frame_rate_of(scenario)],
        "seed": config.seed,
        "scene_seed": config.seed_of_scene,
        "vary": config.vary.model_dump(mode="json", exclude={"weather"}) if config.vary else None,
        "sensors": [sensor.model_dump(mode="json") for sensor in config.sensors],
        "variants": config.variants[weather],
        "drivers": list(scenario_drivers(config, scenario.traffic)),
        "antennas": [one.model_dump(mode="json") for one in config.channel.antennas if config.channel.enabled],
    }


def _copy(origin: Store, root: Store, name: str) -> int:
    """Copy a stage, the files that it refers to, and last its hashes; return whether there was one."""
    digests = origin.read(f"{name}.json")
    made = parse_digests(digests)
    if made is None or digests is None or root.read(f"{name}.json") is not None:
        return 0
    files = [f"{name}.usdc", *made["assets"]]
    if len(origin.sizes(files)) < len(files):
        return 0
    for file in files:
        target = root.folder / file
        if not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(origin.folder / file, target)
    write_bytes_atomically(root.folder / f"{name}.json", digests)
    return 1
