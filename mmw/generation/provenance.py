"""Record the provenance of a dataset: its configuration, and the versions of what makes its rows."""

import platform
import subprocess
from pathlib import Path
from typing import Any

from mmw import __version__
from mmw.config import Config
from mmw.config.input_paths import input_places
from mmw.config.load import load_config, to_yaml
from mmw.config.sensor_spec import SENSORS
from mmw.core.errors import InputError
from mmw.core.licenses import license_file
from mmw.generation.software import own_software, software_of
from mmw.scene.input_files import hash_shipped_towns
from mmw.scene.sources import scenario_source, source_notices
from mmw.storage.dataset_card import CONFIG, LICENSE, NOTICE
from mmw.storage.manifest import read_dataset
from mmw.storage.store import Root, store_of


def write_config(config: Config, base: Path, root: Root) -> None:
    """Write the resolved configuration, every default included, as `config.yaml` into the dataset.

    `python -m mmw.run --config <dataset>/config.yaml --out <other>` generates the same rows. Paths of input files are
    absolute in it. An existing file is not replaced.
    """
    store = store_of(root)
    if store.sizes([CONFIG]):
        return
    data = config.model_dump(mode="json")
    for place in input_places(data, Config):
        path = base / place.value
        if place.is_declared or path.exists():
            place.replace(str(path.parent.resolve() / path.name))
    text = (
        "# The configuration that made this dataset, every default written out.\n"
        "# To make the same data again: python -m mmw.run --config THIS_FILE --out ANOTHER_FOLDER\n"
    )
    store.write_atomically(CONFIG, (text + to_yaml(Config.model_validate(data))).encode())


def write_license(config: Config, base: Path, root: Root) -> None:
    """Write `LICENSE` and `NOTICE` of the data into the dataset, in the place of other ones.

    Raises:
        InputError: If a stage or a town does not exist, or USD cannot read it.
    """
    store = store_of(root)
    lines = [f"Made with mmw {__version__} (multimodal-wireless, Apache-2.0)."]
    for scenario in config.scenarios:
        lines += [f"Scenario {scenario.name}: {line}" for line in source_notices(scenario_source(scenario, base))]
    lines += config.output.notices
    for name, text in (
        (LICENSE, license_file(config.output.license)),
        (NOTICE, "Notices of this dataset\n\n" + "".join(f"- {line}\n" for line in lines)),
    ):
        if store.read(name) != text.encode():
            store.write_atomically(name, text.encode())


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


def versions(config: Config, base: Path, machine: str) -> dict[str, Any]:
    """Return versions, revision, digest of the code, device, hashes of shipped towns, and the packages of sensors.

    `software` is one line of all that rows depend on, see `software_of`. `sensors` names the distribution of each type
    of sensor that is not mmw's, for readers that do not have it.

    Raises:
        InputError: If a file of the configuration does not exist.
    """
    own = own_software(config)
    owners = {sensor.type: SENSORS.owner(sensor.type) for sensor in config.sensors}
    plugins = {type_: owner for type_, owner in sorted(owners.items()) if owner != "mmw"}
    return {
        **own,
        "software": software_of(own),
        "git": git_revision(),
        "python": platform.python_version(),
        "device": machine,
        "sources": hash_shipped_towns(config, base),
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
