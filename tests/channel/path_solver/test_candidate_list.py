"""Candidates that the device lists: too little room is noticed, and nothing is lost."""

import numpy as np
import pytest
import warp as wp

from mmw.channel.links import make_links
from mmw.channel.path_solver import candidate_filter, candidate_list
from mmw.channel.path_solver.search import Search
from mmw.channel.path_solver.solver import solve_paths
from mmw.channel.path_solver.surface_table import make_surface_table
from mmw.channel.path_solver.workspace import MAX_KEPT_LINKS
from mmw.config import ChannelConfig
from tests.fixtures.antennas import antenna_at
from tests.fixtures.device_rays import loaded
from tests.fixtures.path_sets import assert_same_paths
from tests.oracles.channel import driving, traffic


@pytest.mark.parametrize(
    "settings",
    [
        {"candidates": "exhaustive", "max_depth": 1},
        {"samples_per_tx": 5000, "max_depth": 2},
        {"samples_per_tx": 5000, "max_depth": 2, "links": ("v2v",)},
        {"samples_per_tx": 5000, "max_depth": 2, "los": False},
    ],
    ids=["exhaustive", "launched", "both ways", "without sights"],
)
def test_a_search_with_too_little_room_is_done_again(
    settings: dict, monkeypatch: pytest.MonkeyPatch, device: str
) -> None:
    data = traffic(driving(np.arange(4) * 0.01))
    config = ChannelConfig(antennas=antenna_at({"cav": (0.2, 0.1, 2.5)}), **settings)
    scene = loaded(data, device, [0, 1, 2])
    links = make_links(data, [0, 1, 2], config)
    wanted = solve_paths(scene, links, config, data.materials, make_surface_table(scene))
    rounds: list[int] = []
    find = candidate_list._refine
    monkeypatch.setattr(candidate_list, "_refine", lambda *given: rounds.append(1) or find(*given))
    monkeypatch.setattr(candidate_list, "FIRST_ROOM", {"candidates": (1, 2), "paths": (1, 1)})
    monkeypatch.setattr(candidate_list, "padded_count", lambda count: max(count, 1))
    table = make_surface_table(scene)
    found = solve_paths(scene, links, config, data.materials, table)
    assert len(rounds) > 1 and len(wanted) > len(links)
    assert_same_paths(wanted, found)
    rounds.clear()
    solve_paths(scene, links, config, data.materials, table)
    assert len(rounds) == 1, "the room that was enough is remembered"


@pytest.mark.parametrize("spread", [1, 4])
@pytest.mark.parametrize(
    "settings",
    [
        {"samples_per_tx": 5000, "max_depth": 3, "refraction": True},
        {"samples_per_tx": 5000, "max_depth": 3, "diffraction": True, "links": ("v2v",)},
    ],
    ids=["slabs", "wedges"],
)
def test_segments_side_by_side_find_the_same_paths(
    settings: dict, spread: int, monkeypatch: pytest.MonkeyPatch, device: str
) -> None:
    """A device with room has a thread for each segment of a candidate, others take them one after the other."""
    data = traffic(driving(np.arange(4) * 0.01))
    config = ChannelConfig(antennas=antenna_at({"cav": (0.2, 0.1, 2.5)}), **settings)
    scene = loaded(data, device, [0, 1])
    links = make_links(data, [0, 1], config)
    table = make_surface_table(scene, **config.surface_options)
    wanted = solve_paths(scene, links, config, data.materials, table)
    monkeypatch.setattr(candidate_list, "thread_spread", lambda device, count: spread)
    found = solve_paths(scene, links, config, data.materials, table)
    assert wanted.order.max() > 1
    assert_same_paths(wanted, found)


@pytest.mark.parametrize(
    "settings",
    [
        {"candidates": "exhaustive", "max_depth": 1},
        {"candidates": "exhaustive", "max_depth": 2},
        {"samples_per_tx": 5000, "max_depth": 1},
        {"samples_per_tx": 5000, "max_depth": 3, "refraction": True},
        {"max_depth": 0},
    ],
    ids=["exhaustive", "pairs of planes", "launched", "three surfaces", "sights"],
)
def test_recorded_launches_find_what_direct_ones_find(
    settings: dict, monkeypatch: pytest.MonkeyPatch, device: str
) -> None:
    """Batches of one and of two frames are recorded each, on the CPU as on GPUs; a new table has no record."""
    monkeypatch.setattr(candidate_filter, "prefers_records", lambda device: True)
    data = traffic(driving(np.arange(12) * 0.05))
    data.poses[6:, 2] = np.nan  # the truck leaves
    config = ChannelConfig(antennas=antenna_at({"cav": (0.2, 0.1, 2.5)}), **settings)
    scene = loaded(data, device, [0, 1])
    table = make_surface_table(scene)
    replayed: list[int] = []
    replay = wp.capture_launch
    monkeypatch.setattr(wp, "capture_launch", lambda graph: replayed.append(1) or replay(graph))
    for frame in range(11):
        frames = [frame, frame + 1][: 1 + frame % 2]
        scene.load_batch(frames)
        links = make_links(data, frames, config)
        before = len(replayed)
        found = solve_paths(scene, links, config, data.materials, table)
        first = 2 if "samples_per_tx" in settings else 1  # hits of the town are known from the second launch on
        assert len(replayed) - before == (frame > first), "the first launches of a shape are direct ones"
        wanted = solve_paths(scene, links, config, data.materials, make_surface_table(scene))
        assert_same_paths(found, wanted)
        assert len(found) >= len(links)


def test_recorded_launches_with_too_little_room_are_done_again(monkeypatch: pytest.MonkeyPatch, device: str) -> None:
    """The room that more paths need is made, and recorded for the next steps."""
    monkeypatch.setattr(candidate_filter, "prefers_records", lambda device: True)
    data = traffic(driving(np.arange(12) * 0.05))
    config = ChannelConfig(antennas=antenna_at({"cav": (0.2, 0.1, 2.5)}), samples_per_tx=5000, max_depth=2)
    scene = loaded(data, device, [0])
    monkeypatch.setattr(candidate_list, "padded_count", lambda count: max(count, 1))
    table = make_surface_table(scene)
    name = f"{{}} of a link at depth {config.max_depth}"
    for frame in range(9):
        scene.load_batch([frame])
        if frame % 3 == 0:
            table.sizes.update({name.format("candidates"): 1, name.format("paths"): 1})
        links = make_links(data, [frame], config)
        found = solve_paths(scene, links, config, data.materials, table)
        assert table.sizes[name.format("paths")] > 1
        assert_same_paths(found, solve_paths(scene, links, config, data.materials, make_surface_table(scene)))


def test_workspaces_are_for_few_links(device: str) -> None:
    """Memory of many links is not kept, and no two searches share what one has."""
    data = traffic(driving(np.arange(40) * 0.01))
    config = ChannelConfig(antennas=antenna_at({"cav": (0.2, 0.1, 2.5)}), candidates="exhaustive", max_depth=1)
    scene = loaded(data, device, range(40))
    table = make_surface_table(scene)
    many, few = make_links(data, range(40), config), make_links(data, [0, 1], config)
    assert len(many) > MAX_KEPT_LINKS >= len(few)
    Search(scene, many, config, table).release()
    assert not table.workspaces
    one, other = Search(scene, few, config, table), Search(scene, few, config, table)
    assert one.pose.ptr != other.pose.ptr
    pointers = {one.pose.ptr, other.pose.ptr}
    one.release()
    other.release()
    assert Search(scene, few, config, table).pose.ptr in pointers
