"""Fixtures of the tests of views of a scene, which only read them."""

import pytest

from mmw.channel import Paths, PathSolver
from mmw.channel.radio_map.radio_map import RadioMap
from mmw.scene import Scene
from tests.fixtures.street_scene import CARRIERS_HZ, street_radio_map, street_scene


@pytest.fixture(scope="session")
def street() -> Scene:
    return street_scene()


@pytest.fixture(scope="session")
def street_paths(street: Scene) -> Paths:
    return PathSolver(max_depth=2, candidates="exhaustive")(street, carriers_hz=CARRIERS_HZ)


@pytest.fixture(scope="session")
def street_map(street: Scene) -> RadioMap:
    return street_radio_map(street)
