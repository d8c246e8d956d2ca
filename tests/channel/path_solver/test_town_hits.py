"""Rays of transmitters at rest, whose hits of the town are kept, find what all rays find."""

import numpy as np
import pytest
import warp as wp

from mmw.channel.links import make_links
from mmw.channel.path_solver import town_hits
from mmw.channel.path_solver.candidates import launch_rays, prepare_town_hits
from mmw.channel.path_solver.search import Search
from mmw.channel.path_solver.solver import solve_paths
from mmw.channel.path_solver.surface_table import make_surface_table
from mmw.channel.path_solver.town_hits import KeptHits
from mmw.config import ChannelConfig
from mmw.kernels.channel.ray_launch import TownHits
from tests.fixtures.antennas import antenna_at
from tests.fixtures.device_rays import loaded
from tests.fixtures.path_sets import assert_same_paths
from tests.oracles.channel import driving, traffic

RAYS = 6000


@pytest.mark.parametrize("depth", [1, 2, 3])
@pytest.mark.parametrize("links", [("v2i",), ("v2i", "v2v")])
def test_kept_hits_change_no_path(depth: int, links: tuple[str, ...], device: str) -> None:
    """A truck that drives by takes rays away from the town, and reflects them."""
    data = traffic(driving(np.arange(9) * 0.05))
    config = ChannelConfig(
        antennas=antenna_at({"cav": (0.2, 0.1, 2.5)}), samples_per_tx=RAYS, max_depth=depth, links=links
    )
    scene = loaded(data, device, [0, 1])
    table = make_surface_table(scene)
    for frames in ([0], [1], [2, 3], [4], [5], [6, 7, 8][:2]):
        scene.load_batch(frames)
        made = make_links(data, frames, config)
        found = solve_paths(scene, made, config, data.materials, table)
        assert_same_paths(found, solve_paths(scene, made, config, data.materials, make_surface_table(scene)))
    kept = table.town_hits[RAYS, depth]
    search = Search(scene, made, config, table)
    rows = kept.rows([place.tobytes() for place in search.sources.origin])
    is_fixed = np.ptp(data.poses[:, :, :3], axis=0).max(axis=1) == 0.0
    assert is_fixed.any() and max(rows) >= 0, "the station rests"
    assert ("v2v" not in links) == (min(rows) >= 0), "cars do not"


@pytest.mark.parametrize("depth", [1, 2, 3])
def test_kept_hits_change_no_candidate(depth: int, device: str) -> None:
    data = traffic(driving(np.arange(9) * 0.05))
    config = ChannelConfig(samples_per_tx=RAYS, max_depth=depth, links=("v2i",))
    scene = loaded(data, device, [0])
    table = make_surface_table(scene)
    for frame in range(4):
        scene.load_batch([frame])
        links = make_links(data, [frame], config)
        found = []
        for own in (table, make_surface_table(scene)):
            search = Search(scene, links, config, own)
            is_kept = bool(prepare_town_hits(search))
            assert is_kept == (own is table and frame > 0)
            search.upload_links()
            keys = wp.zeros(2**16, dtype=wp.uint64, device=device)
            is_hit, _ = launch_rays(search, search.sources, RAYS, depth, keys if depth > 1 else None)
            found.append((is_hit.numpy()[: len(search.sources)].copy(), np.count_nonzero(keys.numpy())))
            search.release()
        np.testing.assert_array_equal(*(hit for hit, _ in found))
        assert found[0][1] == found[1][1]
        is_moving = table.owner[table.lead] >= 0
        assert found[0][0][:, is_moving].any() and found[0][0][:, ~is_moving].any()


def place(*numbers: float) -> np.ndarray:
    """Return places with these x [m], shape [n, 3]."""
    return np.array([[x, 1.0, 2.0] for x in numbers], dtype=np.float32)


class Filled:
    """Rows that were filled, with x of their place in all faces."""

    def __init__(self) -> None:
        self.places: list[list[float]] = []

    def __call__(self, origins: np.ndarray, hits: TownHits) -> None:
        assert not hits.is_filled
        self.places.append(origins[:, 0].tolist())
        for row, x in zip(hits.row.numpy(), origins[:, 0], strict=True):
            hits.face[int(row)].fill_(int(x))


def test_rows_are_filled_for_what_rests() -> None:
    kept, fill = KeptHits("cpu", threads=8, depth=2), Filled()
    assert kept.prepare(place(1), fill) == ()
    assert kept.prepare(place(1, 5), fill) == (0, -1)
    assert kept.prepare(place(6, 1), fill) == (-1, 0)
    assert kept.prepare(place(7, 7, 1), fill) == (1, 1, 0)  # one batch of two frames
    assert kept.prepare(place(8), fill) == ()
    assert fill.places == [[1.0], [7.0]]
    hits = kept.hits((1, 0))
    assert hits.is_filled and hits.row.numpy().tolist() == [1, 0]
    assert hits.face.numpy()[:, 0, 0].tolist() == [1, 7]
    assert kept.key(()) == () and kept.key((0, 1)) != kept.key((1, 0))


def test_arrays_that_are_replaced_change_the_key(monkeypatch: pytest.MonkeyPatch) -> None:
    """Records of launches hold no arrays: they must not be replayed on those that are gone."""
    monkeypatch.setattr(town_hits, "MAX_ROWS", 2)
    kept, fill, keys = KeptHits("cpu", threads=8, depth=1), Filled(), []
    for places in (place(1, 1), place(2, 2), place(1, 2), place(1, 2), place(1, 2)):
        rows = kept.prepare(places, fill)
        kept.hits(rows)
        keys.append(kept.key(rows))
    assert len(set(keys[:3])) == 3 and len(set(keys[3:])) == 1


def test_places_that_are_left_give_way(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(town_hits, "KEPT_BYTES", {"cpu": 2 * 8 * 8 * 2 + 1})
    kept, fill = KeptHits("cpu", threads=8, depth=2), Filled()
    for places, rows in (
        (place(1, 2, 3), ()),
        (place(1, 2, 3), (0, 1, -1)),
        (place(3, 2), (0, 1)),
        (place(3, 2, 1), (0, 1, -1)),
    ):
        assert kept.prepare(places, fill) == rows
    assert fill.places == [[1.0, 2.0], [3.0]]
    assert kept.hits((0, 1)).face.numpy()[:, 1, 3].tolist() == [3, 2]


def test_few_rays_are_not_kept(device: str) -> None:
    data = traffic(driving(np.arange(3) * 0.05))
    scene = loaded(data, device, [0])
    for settings in ({"samples_per_tx": 1000}, {"candidates": "exhaustive"}, {"max_depth": 0}):
        config = ChannelConfig(links=("v2i",), **settings)
        table = make_surface_table(scene)
        solve_paths(scene, make_links(data, [0], config), config, data.materials, table)
        assert not table.town_hits
