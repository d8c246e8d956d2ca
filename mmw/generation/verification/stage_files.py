"""Check that the USD stages of a dataset and the copies that they refer to are those that were traced."""

import hashlib
from collections.abc import Iterator
from pathlib import PurePosixPath

from mmw.config import Config
from mmw.core.temp_files import is_temporary
from mmw.scene.stage_digests import ASSETS, STAGES, parse_digests
from mmw.storage.finding import Finding
from mmw.storage.identity import Hashes
from mmw.storage.store import Store

CURE = "run the same configuration again"


def check_stages(root: Store, config: Config, inputs: Hashes | None) -> Iterator[Finding]:
    """Yield stages and assets that are missing, changed, of no scenario, or of other input files than the dataset."""
    known: set[str] = set()
    for scenario in config.scenarios:
        if scenario.stage is not None and not scenario.has_units:
            continue  # it is read where the user has it
        name = f"{STAGES}/{scenario.name}.json"
        stage = f"{STAGES}/{scenario.name}.{'usdc' if scenario.stage is None else 'usda'}"
        known |= {name, stage}
        digests = parse_digests(root.read(name))
        if digests is None:
            yield Finding("missing", name, f"the hashes of the stage are not there or cannot be read; {CURE}")
            continue
        made_from = digests.get("inputs")
        if inputs is not None and made_from != inputs.get(scenario.name, {}):
            yield Finding("inputs", name, f"the stage was made from other input files than the dataset; {CURE}")
        for file, digest in {stage: digests["sha256"], **digests["assets"]}.items():
            if file not in known or file == stage:
                known.add(file)
                yield from _check_file(root, file, digest)
    for name in (*root.names(STAGES), *root.names(ASSETS)):
        if name not in known and not is_temporary(PurePosixPath(name)):
            yield Finding("foreign", name, "no scenario of the configuration has this file; move it away")


def _check_file(root: Store, name: str, digest: str) -> Iterator[Finding]:
    data = root.read(name)
    if data is None:
        yield Finding("missing", name, f"a stage refers to it, but it does not exist; {CURE}")
    elif hashlib.sha256(data).hexdigest() != digest:
        yield Finding("sha256", name, "the content is not what was traced")
