"""Candidates that the device lists: too little room is noticed, and nothing is lost."""

from dataclasses import fields

import numpy as np
import pytest

from mmw.channel.links import make_links
from mmw.channel.path_solver import candidate_list
from mmw.channel.path_solver.solver import solve_paths
from mmw.channel.path_solver.surface_table import make_surface_table
from mmw.config import ChannelConfig
from tests.fixtures.antennas import antenna_at
from tests.fixtures.device_rays import loaded
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
    for field in fields(wanted):
        one, other = getattr(wanted, field.name), getattr(found, field.name)
        if isinstance(one, np.ndarray):
            np.testing.assert_array_equal(one, other, err_msg=field.name)
    for weather, transfer in wanted.transfer.items():
        np.testing.assert_array_equal(transfer, found.transfer[weather])
    rounds.clear()
    solve_paths(scene, links, config, data.materials, table)
    assert len(rounds) == 1, "the room that was enough is remembered"
