"""Decide whether a run may add shards to a dataset: software and machine must be those of the shards that are there."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from mmw.core.errors import InputError
from mmw.generation.software import RECORDED, packages_of, software_differences, software_of
from mmw.storage.identity import Hashes, changed_inputs, is_hashes, is_of
from mmw.storage.manifest import has_shards, read_dataset, read_markers
from mmw.storage.store import DATASET, Store

VERSIONS, MACHINE = "versions", "machine"
ACCEPTABLE = {VERSIONS: "with other versions", MACHINE: "on another kind of machine"}
"""Values of `--accept`: how a run may differ from the one that made the shards that are there."""


@dataclass(frozen=True)
class Makers:
    """Software and kinds of machine of a dataset: those that began it, and those that were accepted since."""

    before: Mapping[str, Any]
    """Result of `versions` of the run that began it."""
    software: tuple[str, ...]
    """Lines of `software_of`, that of the run that began it first."""
    machines: tuple[str, ...]
    """Kinds of machine."""

    @property
    def accepted(self) -> set[str]:
        """Keys of `ACCEPTABLE` of which earlier runs were told to accept several values."""
        several = {VERSIONS: self.software, MACHINE: self.machines}
        return {kind for kind, values in several.items() if len(values) > 1}


def makers_of(root: Store) -> Makers:
    """Return the software and the kinds of machine of a dataset.

    Shards that no run was told to accept, such as copies from another dataset, do not count; `mmw verify` reports them.
    """
    head = read_dataset(root)
    before = head["versions"]
    software, machines = [software_of(before)], [before.get("device")]
    for marker in read_markers(root):
        if is_of(marker, head):
            accepted = str(marker.get("accepted")).split()
            software += [marker.get("software")] if VERSIONS in accepted else []
            is_old = not marker.get("software")  # mmw 0.2 accepted any machine
            machines += [marker.get("device")] if MACHINE in accepted or is_old else []
    known = (tuple(dict.fromkeys(str(one) for one in some if one)) for some in (software, machines))
    return Makers(before, *known)


def is_outdated(root: Store, config_sha256: str, inputs: Hashes, now: Mapping[str, Any]) -> bool:
    """Return whether a dataset of this configuration has no shard yet, and was begun with something else than `now`.

    A run that shares the dataset with no other begins it anew then: it does not use stages that other software made.
    """
    if not root.sizes([DATASET]):
        return False
    head = read_dataset(root)
    is_same = head["config_sha256"] == config_sha256 and not changed_inputs(head, inputs)
    return is_same and not has_shards(root) and any(_differences(makers_of(root), now))


def check_continuation(
    root: Store, makers: Makers, now: Mapping[str, Any], accepted: Collection[str], *, has_work: bool, is_part: bool
) -> list[str]:
    """Compare the software and the machine of a run with those that began a dataset or made shards of it.

    Args:
        root: Dataset of the run's configuration and input files.
        makers: What it was made with.
        now: Result of `versions`.
        accepted: Keys of `ACCEPTABLE` that the user allows to differ.
        has_work: Whether the run is to make shards; otherwise nothing is mixed, and differences are only told.
        is_part: Whether other runs make other parts of the dataset.

    Returns:
        One line for each difference.

    Raises:
        InputError: If the run is to make shards, and a difference is not accepted.
    """
    lines = []
    for kind, text in _differences(makers, now):
        where = f"{root}: was made {ACCEPTABLE[kind]}: {text}"
        if not has_work:
            lines.append(f"{where}; it is complete, so nothing is mixed; --overwrite makes it again")
        elif kind in accepted:
            lines.append(f"{where}; accepted, and recorded in each new shard")
        else:
            anew = f"remove {root} to make it again" if is_part else "use --overwrite to make it again"
            raise InputError(
                f"{where}; its rows are not mixed with those of others (docs/guides/running.md); resume with what it "
                f"was made with, allow it by --accept {kind}, or {anew}"
            )
    old, new = ({**packages_of(made), "python": made.get("python")} for made in (makers.before, now))
    for name in (*RECORDED, "python") if has_work else ():
        if old.get(name) != new.get(name):
            lines.append(f"{root}: begun with {name} {old.get(name)}, resumed with {new.get(name)}; no value changes")
    return lines


def _differences(makers: Makers, now: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield what differs, a key of `ACCEPTABLE`, and how."""
    software = [software_differences(made, now["software"]) for made in makers.software]
    towns: list[str] = []
    if "software" in makers.before and is_hashes(known := makers.before.get("sources")):
        towns = changed_inputs({"inputs": known}, now["sources"])
    if all(software) or towns:
        yield VERSIONS, ", ".join(filter(None, [software[0], *towns]))
    if makers.machines and now["device"] not in makers.machines:
        text = "; ".join(makers.machines)
        yield MACHINE, f"{text} -> {now['device']}, between which last bits may differ (docs/concepts/determinism.md)"
