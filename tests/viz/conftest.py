"""Fixtures of the tests of drawings: the small dataset, and a town of one ring road."""

from pathlib import Path

import pytest

from mmw.dataset import Dataset, open_dataset
from tests.fixtures.circuit import add_block, write_circuit
from tests.fixtures.small_dataset import small_dataset


@pytest.fixture(scope="session")
def data() -> Dataset:
    return open_dataset(small_dataset())


@pytest.fixture(scope="session")
def town(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("town") / "circuit.usda"
    stage = write_circuit(path)
    add_block(stage, "/World/Tower", (6, 6, 20), (45, 20, 9))
    stage.Save()
    return path
