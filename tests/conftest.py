"""Fixtures for every test."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import warp as wp

from mmw.cli.run import main
from tests.fixtures.own_world import command, write_own_world

if TYPE_CHECKING:
    from pxr import Usd

    from mmw.traffic.roads.lane_graph import LaneGraph
    from mmw.worlds.towns.network import RoadNetwork

wp.config.log_level = wp.LOG_WARNING

DEVICES = ["cpu", *(["cuda:0"] if wp.get_cuda_device_count() else [])]


@pytest.fixture(scope="session", autouse=True)
def _log_files(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep the log files of commands that tests run out of the user's folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MMW_LOG_DIR", str(tmp_path_factory.mktemp("logs")))
        yield


@pytest.fixture(params=DEVICES)
def device(request: pytest.FixtureRequest) -> str:
    """Name of a Warp device: the CPU always, the first GPU where there is one."""
    return request.param


@pytest.fixture(scope="module")
def network(request: pytest.FixtureRequest) -> "RoadNetwork":
    """Return the roads of the shipped town that the test module calls NAME, from its description."""
    from tests.fixtures import town_checks

    return town_checks.network_of(request.module.NAME)


@pytest.fixture(scope="module")
def stage(request: pytest.FixtureRequest) -> "Usd.Stage":
    """Return the committed stage of that town."""
    from tests.fixtures import town_checks

    return town_checks.stage_of(request.module.NAME)


@pytest.fixture(scope="module")
def lanes(stage: "Usd.Stage") -> "LaneGraph":
    """Return its lanes, all of which are connected."""
    from tests.fixtures import town_checks

    return town_checks.assert_connected(stage)


@pytest.fixture
def own_world(tmp_path: Path) -> Path:
    """Write a small stage and its configuration into an empty folder."""
    return write_own_world(tmp_path)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write the same for a module, with its dataset `single`: ten frames, two a shard, two weathers, one process."""
    folder = write_own_world(tmp_path_factory.mktemp("world"))
    assert main(command(folder, "single", "--workers", "1")) == 0
    return folder
