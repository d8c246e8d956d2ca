"""Links that are tested in blocks have the paths that they have when each is tested by itself."""

import numpy as np
import pytest

import mmw
from mmw.channel.path_solver import link_blocks
from mmw.channel.path_solver.search import Sources
from mmw.physics.weather.weather import Weather
from tests.oracles.channel import driving, traffic

PLACES = np.random.default_rng(3).uniform([-35.0, -12.0, 0.2], [35.0, 12.0, 9.0], (700, 3))
COLUMNS = ("rx", "tx", "interaction_types", "surface_ids", "vertices", "tau", "a")


def paths_to(places: np.ndarray, device: str, **options) -> mmw.Paths:
    """Return the paths of two transmitters among a car and a turned truck."""
    arrays = traffic(driving(np.array([0.4])))
    scene = mmw.Scene(arrays, {name: Weather() for name in arrays.materials}, device=device)
    for name, place in (("bs", (0.0, -9.0, 5.0)), ("other", (-25.0, 4.0, 7.0))):
        scene.add(mmw.Transmitter(name, position=place))
    for number, place in enumerate(places):
        scene.add(mmw.Receiver(f"rx_{number}", position=place))
    return mmw.PathSolver(check_places=False, **options)(scene)


@pytest.mark.parametrize(
    "options",
    [
        {"max_depth": 3, "samples_per_tx": 20_000},
        {"max_depth": 2, "candidates": "exhaustive"},
        {"max_depth": 1, "samples_per_tx": 20_000},
    ],
    ids=["launch", "exhaustive", "single"],
)
@pytest.mark.parametrize("in_order", [True, False])
def test_blocks_change_no_bit(options: dict, in_order: bool, device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    places = PLACES[np.lexsort(PLACES.T // 5.0)] if in_order else PLACES
    found = {}
    for many in (1, 10**9):
        monkeypatch.setattr(link_blocks, "MANY_LINKS", many)
        found[many] = paths_to(places, device, **options)
    assert len(found[1]) > 1000
    for name in COLUMNS:
        assert getattr(found[1], name).tobytes() == getattr(found[10**9], name).tobytes(), name


def test_few_links_are_not_in_blocks() -> None:
    """Blocks cost a pass over all receivers: they begin where a source has many."""
    first = np.array([0, 3, 3 + link_blocks.MANY_LINKS - 1], dtype=np.int32)
    sources = Sources(np.zeros(2, dtype=np.int32), np.zeros((2, 3)), np.zeros((2, 3), dtype=np.float32), first, ())
    assert link_blocks.make_link_blocks(None, sources) is None  # pyright: ignore[reportArgumentType]
