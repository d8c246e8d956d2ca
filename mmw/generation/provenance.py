"""Record the provenance of a dataset: configuration, versions and hashes, which a resumed run must match."""

import functools
import platform
import subprocess
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from mmw import __version__
from mmw.config import Config
from mmw.config.load import load_config, to_yaml
from mmw.config.sensor_spec import SENSORS
from mmw.config.traffic_engine import engine_spec
from mmw.core.errors import InputError
from mmw.core.hashing import sha256
from mmw.scene.sources import is_town_file, scenario_source, trajectory_file
from mmw.storage.manifest import CONFIG, DATASET, read_dataset, read_markers
from mmw.storage.store import Root, store_of


def write_config(config: Config, base: Path, root: Root) -> None:
    """Write the resolved configuration, every default included, as `config.yaml` into the dataset.

    `python -m mmw.run --config <dataset>/config.yaml --out <other>` generates the same rows. Paths of stages, of
    trajectories and of towns that are not shipped are absolute in it. An existing file is not replaced.
    """
    store = store_of(root)
    if store.sizes([CONFIG]):
        return
    data = config.model_dump(mode="json")
    for written, scenario in zip(data["scenarios"], config.scenarios, strict=True):
        source = str(scenario_source(scenario, base).resolve())
        if scenario.stage is not None:
            written["stage"] = source
        elif is_town_file(scenario):
            written["town"] = source
        table = trajectory_file(scenario, base)
        if table is not None:
            written["traffic"]["trajectories"] = str(table.resolve())
    text = (
        "# The configuration that made this dataset, every default written out.\n"
        "# To make the same data again: python -m mmw.run --config THIS_FILE --out ANOTHER_FOLDER\n"
    )
    store.write_atomically(CONFIG, (text + to_yaml(Config.model_validate(data))).encode())


def stored_config(root: Root) -> Config:
    """Return the configuration that is stored in a dataset.

    Raises:
        InputError: If the root is no dataset, or has no configuration.
    """
    store = store_of(root)
    read_dataset(store)
    with store.local_copy(CONFIG) as folder:
        if not (folder / CONFIG).is_file():
            raise InputError(f"{store.location()}: has no {CONFIG}; run the configuration again, which writes it")
        return load_config(folder / CONFIG)


def check_continuation(root: Root, config: Config, now: Mapping[str, Any]) -> list[str]:
    """Compare the software, machine and files of a resumed run with those that began the dataset.

    Returns:
        One line for each difference: versions, machine, kind of BVH, town files.

    Raises:
        InputError: If a user's own stage has changed: its old and new frames would be mixed.
    """
    root = store_of(root)
    if not root.sizes([DATASET]):
        return []
    head = read_dataset(root)
    if head["config_sha256"] != config.sha256() or not read_markers(root):
        return []
    before, lines = head["versions"], []
    for scenario in config.scenarios:
        old, new = (made.get("sources", {}).get(scenario.name, {}) for made in (before, now))
        changed = sorted(name for name in old.keys() | new.keys() if old.get(name) != new.get(name))
        if changed and scenario.stage is not None:
            raise InputError(
                f"{root}: scenario {scenario.name!r}: {', '.join(changed)} changed since the dataset was begun; "
                "use --overwrite to make it again, or another --out"
            )
        lines += [f"{root}: {name} changed since; the dataset goes on with its own copy" for name in changed]
    old, new = ({**made, **made.get("packages", {})} for made in (before, now))
    if old.get("device") != new.get("device"):
        lines.append(
            f"{root}: begun on {old.get('device')}, goes on on {new.get('device')}: all rows are right, but the last "
            "bits may differ between the two (docs/concepts/determinism.md); for the same bits throughout, go on "
            "where it began"
        )
    if old.get("bvh", new["bvh"]) != new["bvh"]:  # older datasets do not say
        lines.append(
            f"{root}: begun with compute.bvh = {old['bvh']!r}, goes on with {new['bvh']!r}: last bits may differ "
            f"(docs/guides/running.md); for the same bits throughout, set compute.bvh={old['bvh']}"
        )
    for name in ("mmw", "git", *before.get("packages", {})):
        if old.get(name) != new.get(name):
            lines.append(f"{root}: begun with {name} {old.get(name)!r}, goes on with {new.get(name)!r}")
    return lines


def versions(config: Config, base: Path, machine: str) -> dict[str, Any]:
    """Return versions, revision, device, the hashes of towns, stages and trajectories, and the packages of sensors.

    `sensors` names the distribution of each type of sensor that is not mmw's, for readers that do not have it.

    Raises:
        InputError: If a file of the configuration does not exist.
    """
    packages = {}
    names = ["warp-lang", "numpy", "usd-core", "pyarrow", "pydantic", "trimesh", "pillow", "simplejpeg"]
    engines = [engine_spec(scenario.traffic.engine) for scenario in config.scenarios if scenario.traffic]
    names += sorted({engine.package for engine in engines if engine.package})
    for name in names:
        try:
            packages[name] = version(name)
        except PackageNotFoundError:
            packages[name] = "unknown"
    owners = {sensor.type: SENSORS.owner(sensor.type) for sensor in config.sensors}
    plugins = {type_: owner for type_, owner in sorted(owners.items()) if owner != "mmw"}
    sources, sha256_of = {}, functools.cache(sha256)  # scenarios share towns
    for scenario in config.scenarios:
        source = scenario_source(scenario, base)
        payload = source.parent / "geometry.usdc"
        files = (source, payload, trajectory_file(scenario, base))
        sources[scenario.name] = {path.name: sha256_of(path) for path in files if path is not None and path.is_file()}
    return {
        "mmw": __version__,
        "git": git_revision(),
        "python": platform.python_version(),
        "packages": packages,
        "device": machine,
        "bvh": config.compute.bvh,
        "sources": sources,
        **({"sensors": plugins} if plugins else {}),
    }


def git_revision() -> str:
    """Return the checkout's commit, with `+` if files differ from it; empty outside a checkout."""
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return ""

    def git(*arguments: str) -> str:
        result = subprocess.run(["git", "-C", str(root), *arguments], capture_output=True, text=True, check=False)
        return result.stdout.strip() if result.returncode == 0 else ""

    return git("rev-parse", "--short=12", "HEAD") + (
        "+" if git("status", "--porcelain", "--untracked-files=no") else ""
    )
