"""Check that a dataset has all shards of its configuration, and a row for each expected key."""

import hashlib
import json
from pathlib import Path
from typing import Any

from mmw.config import Config
from mmw.config.input_paths import input_places
from mmw.core.errors import InputError
from mmw.core.licenses import SPDX_TAG
from mmw.generation.provenance import stored_config
from mmw.generation.shards import shard_keys
from mmw.generation.verification.stage_files import check_stages
from mmw.storage.dataset_card import CARD, CONFIG, LICENSE, NOTICE
from mmw.storage.finding import Finding, one_line
from mmw.storage.identity import config_differences
from mmw.storage.manifest import DATASET, MANIFEST, read_dataset, read_license
from mmw.storage.shard_writer import MARKERS, marker_path
from mmw.storage.store import Store


def read_plan(store: Store) -> tuple[Config | None, list[Finding]]:
    """Return the configuration of a dataset, or why it is not that of its data.

    A configuration that cannot be read, as one with a sensor of a package that is not installed, is a finding.

    Raises:
        InputError: If the folder is not a dataset.
    """
    head = read_dataset(store)
    try:
        config = stored_config(store)
    except InputError as error:
        return None, [Finding("config", CONFIG, f"{one_line(error)}; no rows were counted")]
    findings = _check_config(config, head)
    return (None if findings else config), findings  # counts of another configuration have no meaning


def check_plan(store: Store, config: Config) -> list[Finding]:
    """Return what a dataset lacks of its configuration: shards, static tables, stages, manifest and card.

    Files of shards that the configuration does not have are findings as well.
    """
    names = [scenario.name for scenario in config.scenarios]
    keys = [key for scenario in config.scenarios for key in shard_keys(config, scenario)]
    planned = {marker_path(key).as_posix(): key for key in [*names, *keys]}
    markers = {name for name in store.names(MARKERS) if name.endswith(".json")}
    missing = {name: key for name, key in planned.items() if name not in markers}
    findings = []
    for name, key in missing.items():
        what = f"static tables of {key} are" if isinstance(key, str) else f"shard {key} is"
        findings.append(Finding("missing", name, f"{what} not finished; run the same configuration again"))
    if all(isinstance(key, str) for key in missing.values()):
        findings += check_stages(store, config, read_dataset(store).get("inputs"))
        for name in (MANIFEST, CARD):
            if not store.sizes([name]):
                findings.append(Finding("missing", name, "the dataset is complete without it; run mmw finalize"))
        for name in (LICENSE, NOTICE):
            if not store.sizes([name]):
                cure = "run the same configuration again, which writes it"
                findings.append(Finding("missing", name, f"nobody can tell how the data may be used; {cure}"))
        if store.sizes([LICENSE]) and not read_license(store):
            line = f"names no license in a line {SPDX_TAG!r}; put it back, or run the same configuration again"
            findings.append(Finding("license", LICENSE, line))
    for name in sorted(markers - planned.keys()):
        findings.append(Finding("foreign", name, "the configuration has no such shard"))
    return findings


def _check_config(config: Config, head: dict[str, Any]) -> list[Finding]:
    text = json.dumps(head["config"], sort_keys=True, separators=(",", ":"))
    if hashlib.sha256(text.encode()).hexdigest() != head["config_sha256"]:
        return [Finding("config", DATASET, "its configuration does not have its config_sha256; the file was changed")]
    stored, current = json.loads(text), config.identity()
    before = {place.keys: place.value for place in input_places(stored, Config)}
    for place in list(input_places(current, Config)):  # absolute in `config.yaml`, as written in `dataset.json`
        if place.keys in before and Path(before[place.keys]).name == Path(place.value).name:
            place.replace(before[place.keys])
    differences = config_differences(stored, current)
    if differences:
        return [Finding("config", CONFIG, f"is not what made the data: {'; '.join(differences[:3])}")]
    recorded = {name for files in head.get("inputs", {}).values() for name in files}
    lacking = sorted(
        place.value
        for place in input_places(stored, Config)
        if place.is_declared and not any(name.partition("/")[0] == Path(place.value).name for name in recorded)
    )
    if "inputs" in head and lacking:
        return [Finding("inputs", DATASET, f"has no hash of {lacking[0]}, which the configuration names")]
    return []
