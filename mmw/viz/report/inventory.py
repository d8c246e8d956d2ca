"""Count shards, rows and bytes of a dataset by its markers, and check them quickly."""

import hashlib
import json
from collections import defaultdict
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mmw.config import Config
from mmw.core.constants import FRAME_RATE_HZ
from mmw.core.errors import InputError
from mmw.generation.provenance import stored_config
from mmw.generation.shards import shard_keys
from mmw.storage.file_checks import check_manifest
from mmw.storage.manifest import (
    CONFIG,
    DATASET,
    MANIFEST,
    frame_rates,
    named_markers,
    pending_scenarios,
    pending_shards,
    read_dataset,
    read_markers,
)
from mmw.storage.schemas import TABLES
from mmw.storage.shard_writer import MARKERS
from mmw.storage.store import store_of

LISTED = 8
"""Problems that the page names."""


@dataclass(frozen=True)
class Inventory:
    """A dataset by its markers. A file that no marker lists is not counted."""

    root: Path
    head: dict[str, Any]
    """`dataset.json`."""
    config: Config | None
    """Configuration of `config.yaml`; None if that is missing or cannot be read, see `notes`."""
    shards: list[dict[str, Any]]
    """Markers of shards, by scenario, weather and frame."""
    statics: list[dict[str, Any]]
    """Markers of the tables without frames."""
    planned: int | None
    """Shards of the configuration; None if it is not known."""
    pending: list[str]
    """Shards and scenarios that are not finished, by name."""
    notes: list[str] = field(default_factory=list)
    """Questions that could not be answered."""

    @property
    def scenarios(self) -> list[str]:
        """Scenarios that have a shard or static tables, in the order of the configuration."""
        present = {marker["scenario"] for marker in [*self.shards, *self.statics]}
        order = [scenario["name"] for scenario in self.head["config"].get("scenarios", [])]
        return [name for name in order if name in present] + sorted(present - set(order))

    def weathers(self, scenario: str) -> list[str]:
        """Return the weathers of which a scenario has a shard, in the order of the configuration."""
        present = {marker["weather"] for marker in self.shards if marker["scenario"] == scenario}
        order = list(self.head["config"].get("weathers", []))
        return [name for name in order if name in present] + sorted(present - set(order))

    def frames(self, scenario: str, weather: str | None = None) -> range:
        """Return the frames from the first to the last that a scenario has, in one weather or in any."""
        own = [
            marker for marker in self.shards
            if marker["scenario"] == scenario and weather in (None, marker["weather"])
        ]  # fmt: skip
        begin = min((marker["frame_begin"] for marker in own), default=0)
        return range(begin, max((marker["frame_end"] for marker in own), default=begin))

    def frame_rate_hz(self, scenario: str) -> int:
        """Return the frames a second of a scenario [Hz]."""
        return frame_rates(self.head).get(scenario, FRAME_RATE_HZ)

    def link_frames(self, scenario: str) -> range:
        """Return the frames of a scenario in which the channel samples; all of them if that is not known."""
        frames, rate_hz = self.frames(scenario), self.frame_rate_hz(scenario)
        if self.config is None:
            return frames
        period, first = (self.config.channel.period_frames(rate_hz), round(self.config.channel.phase_s * rate_hz))
        return range(frames.start + (first - frames.start) % period, frames.stop, period)

    def frame_count(self, scenario: str, weather: str) -> int:
        """Return the number of frames that a scenario has in a weather."""
        return sum(
            marker["frame_end"] - marker["frame_begin"] for marker in self.shards
            if marker["scenario"] == scenario and marker["weather"] == weather
        )  # fmt: skip

    def sizes(self, scenarios: Collection[str], *by: str) -> dict[tuple[str | None, ...], np.ndarray]:
        """Return files, rows and bytes of scenarios, shape [3] each, in the order of the schema's tables.

        Args:
            scenarios: Scenarios that count.
            by: Groups, some of `table`, `scenario` and `weather`, which is None for tables without frames.
        """
        order = {name: index for index, name in enumerate(TABLES)}
        markers = [marker for marker in [*self.shards, *self.statics] if marker["scenario"] in scenarios]
        files = [marker | file for marker in markers for file in marker["files"]]
        found: dict[tuple[str | None, ...], np.ndarray] = defaultdict(lambda: np.zeros(3, dtype=np.int64))
        for file in sorted(files, key=lambda one: (order.get(one["table"], len(order)), one["table"])):
            found[tuple(file[name] for name in by)] += (1, file["rows"], file["bytes"])
        return found


def take_inventory(root: Path) -> Inventory:
    """Return the inventory of a dataset.

    Raises:
        InputError: If the folder is no dataset.
    """
    head, markers, notes = read_dataset(root), read_markers(root), []
    unread = sum(1 for _ in (root / MARKERS).glob("*.json")) - len(markers)
    if unread:
        notes.append(f"{unread} markers in {MARKERS} cannot be read and do not count")
    order = {name: index for index, name in enumerate(head["config"].get("weathers", []))}
    shards = [marker for marker in markers if marker["weather"] is not None]
    shards.sort(key=lambda one: (one["scenario"], order.get(one["weather"], len(order)), one["frame_begin"]))
    config, planned, pending = None, None, []
    try:
        config = stored_config(root)
    except (InputError, OSError) as error:
        reason = "; ".join(error.problems) if isinstance(error, InputError) else str(error)
        notes.append(f"{CONFIG} cannot be read, so the pending work is not known ({' '.join(reason.split())})")
    if config is not None:
        keys = [key for scenario in config.scenarios for key in shard_keys(config, scenario)]
        planned = len(keys)
        pending = [str(key) for key in pending_shards(root, keys)]
        pending += [
            f"{name}: tables without frames" for name in pending_scenarios(root, [s.name for s in config.scenarios])
        ]
    statics = [marker for marker in markers if marker["weather"] is None]
    return Inventory(root, head, config, shards, statics, planned, pending, notes)


def quick_check(inventory: Inventory) -> tuple[list[str], list[str]]:
    """Return the checks made, and the problems found: existence, sizes, manifest, configuration; no data are read."""
    store, wrong = store_of(inventory.root), []
    listed = {file["path"]: file for marker in [*inventory.shards, *inventory.statics] for file in marker["files"]}
    sizes = store.sizes(listed)
    for path, file in sorted(listed.items()):
        if path not in sizes:
            wrong.append(f"{path}: is missing")
        elif sizes[path] != file["bytes"]:
            wrong.append(f"{path}: has {sizes[path]:,} bytes; its marker says {file['bytes']:,}")
    checked = [f"{len(listed):,} files that the markers list are there and as long as listed"]
    text = json.dumps(inventory.head["config"], sort_keys=True, separators=(",", ":"))
    if hashlib.sha256(text.encode()).hexdigest() != inventory.head["config_sha256"]:
        wrong.append(f"{DATASET}: its configuration does not have its config_sha256")
    checked.append(f"the configuration in {DATASET} has its hash")
    if store.sizes([MANIFEST]):
        wrong += [f"{finding.path}: {finding.text}" for finding in check_manifest(store, named_markers(store))]
        checked.append(f"{MANIFEST} lists the same files and hashes as the markers")
    return checked, wrong
