"""Begin the tests of every exporter: an export into a folder that the tests of a module share."""

from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from mmw.dataset.export.exporter import Selection, export
from tests.fixtures.export_data import dataset


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Return a function that exports a dataset, by default the real one with tilted sensors, and returns the folder."""

    def run(name: str, options: Mapping[str, str] | None = None, root: Path | None = None, **selection) -> Path:
        out = tmp_path_factory.mktemp(name) / "out"
        export(root or dataset().root, name, out, Selection(**selection), options)
        return out

    return run
