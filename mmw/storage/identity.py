"""Compare what decides the rows of a dataset: its configuration and the content of its input files."""

import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

from mmw.core.errors import InputError
from mmw.storage.schemas import SCHEMA_VERSION
from mmw.storage.store import Store

Hashes = Mapping[str, Mapping[str, str]]
"""Scenario or section -> input file -> SHA-256, see `mmw.scene.input_files`."""

LISTED = 6
"""Differences that an error lists."""

CURE = "use --overwrite to replace the data, or another --out"


def check_same(
    store: Store, head: Mapping[str, Any], identity: Mapping[str, Any], config_sha256: str, inputs: Hashes | None
) -> None:
    """Check that a dataset has this schema, this configuration and these input files.

    Args:
        store: Dataset, for messages.
        head: Content of its `dataset.json`.
        identity: What decides the data, see `Config.identity`.
        config_sha256: Its hash.
        inputs: Hashes of the input files; not compared if absent.

    Raises:
        InputError: If one of them differs; the message lists the keys or files.
    """
    if head["schema_version"] != SCHEMA_VERSION:
        raise InputError(f"{store}: has schema {head['schema_version']}; this version writes {SCHEMA_VERSION}; {CURE}")
    if head["config_sha256"] != config_sha256:
        raise InputError(
            f"{store}: belongs to configuration {head['config_sha256'][:12]}, this one is {config_sha256[:12]}: "
            f"{_listed(config_differences(head['config'], identity))}; {CURE}"
        )
    if changes := changed_inputs(head, inputs):
        raise InputError(
            f"{store}: was made from other input files: {_listed(changes)}; put the old content back, {CURE}"
        )


def _listed(items: list[str]) -> str:
    return "; ".join(items[:LISTED]) + (f"; and {len(items) - LISTED} more" if len(items) > LISTED else "")


def inputs_sha256(inputs: Hashes) -> str:
    """Return the SHA-256 of the hashes of input files, as sorted compact JSON."""
    return hashlib.sha256(json.dumps(inputs, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def is_of(marker: Mapping[str, Any], head: Mapping[str, Any]) -> bool:
    """Return whether a marker is of the configuration and of the input files of a dataset."""
    return all(marker.get(name) == head.get(name) for name in ("config_sha256", "inputs_sha256"))


def is_hashes(value: Any) -> bool:
    """Return whether a value of a file has the shape of `Hashes`."""
    return isinstance(value, dict) and all(
        isinstance(files, dict) and all(isinstance(digest, str) for digest in files.values())
        for files in value.values()
    )


def changed_inputs(head: Mapping[str, Any], inputs: Hashes | None) -> list[str]:
    """Return one phrase for each input file whose content is not that which a dataset was begun with, sorted.

    Args:
        head: Content of `dataset.json`.
        inputs: Hashes of the input files now; nothing is compared if they are absent.
    """
    if inputs is None:
        return []
    lines = []
    before = head.get("inputs")
    if not isinstance(before, dict):  # mmw 0.2 recorded the files that scenarios name, among the versions
        kept = head["versions"].get("sources")
        before = kept if is_hashes(kept) else {}
        inputs = {
            name: {file: one for file, one in files.items() if file in before.get(name, {})}
            for name, files in inputs.items()
        }
        before = {name: {file: before[name][file] for file in files} for name, files in inputs.items() if files}
    for owner in sorted({*before, *inputs}):
        old, new = before.get(owner, {}), inputs.get(owner, {})
        for file in sorted({*old, *new}):
            if file not in old or file not in new:
                lines.append(f"{owner}: {file} is {'new' if file in new else 'not an input any more'}")
            elif old[file] != new[file]:
                lines.append(f"{owner}: {file} has changed")
    return lines


def mixtures(markers: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return one line if shards were made by several versions of the software, and one if on several machines."""
    markers, lines = list(markers), []
    for key, text in (
        ("software", "made by {} versions of the software, whose rows may differ"),
        ("device", "made on {} kinds of machine, between which last bits may differ"),
    ):
        counts = Counter(str(marker[key]) for marker in markers if marker.get(key))
        if len(counts) > 1:
            each = "; ".join(f"{made} ({count} markers)" for made, count in sorted(counts.items()))
            lines.append(f"{text.format(len(counts))}: {each}")
    return lines


def config_differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Return `key: old -> new` for every value in which two identities of configurations differ, sorted."""
    return sorted(_differences("", dict(old), json.loads(json.dumps(new))))


def _differences(where: str, old: Any, new: Any) -> list[str]:
    """Return `key: old -> new` for every leaf that differs, recursively."""
    if isinstance(old, dict) and isinstance(new, dict):
        keys = sorted(set(old) | set(new))
        return [text for key in keys for text in _differences(f"{where}.{key}", old.get(key), new.get(key))]
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        return [text for i in range(len(old)) for text in _differences(f"{where}.{i}", old[i], new[i])]
    return [] if old == new else [f"{where.lstrip('.')}: {_short(old)} -> {_short(new)}"]


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."
