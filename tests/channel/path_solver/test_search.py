"""Arrays on the device are used again from search to search."""

import numpy as np
import pytest
import warp as wp

from mmw.channel.links import make_links
from mmw.channel.path_solver.search import SCRATCH_ARRAYS, SCRATCH_BYTES, Search
from mmw.channel.path_solver.solver import solve_paths
from mmw.channel.path_solver.surface_table import make_surface_table
from mmw.config import ChannelConfig
from mmw.core.transforms import conjugate, normalize, rotate
from tests.fixtures.antennas import antenna_at
from tests.fixtures.device_rays import loaded
from tests.oracles.channel import driving, traffic


@pytest.mark.parametrize(
    "settings",
    [{"candidates": "exhaustive"}, {"samples_per_tx": 5000}, {"samples_per_tx": 5000, "links": ("v2v",)}],
    ids=["exhaustive", "launched", "both ways"],
)
def test_a_step_allocates_nothing_on_the_device_after_the_first_ones(
    settings: dict, monkeypatch: pytest.MonkeyPatch, device: str
) -> None:
    data = traffic(driving(np.arange(8) * 0.01))
    config = ChannelConfig(max_depth=1, antennas=antenna_at({"cav": (0.2, 0.1, 2.5)}), **settings)
    scene = loaded(data, device, [0])
    table = make_surface_table(scene, **config.surface_options)
    made: list[int] = []
    construct = wp.array.__init__
    monkeypatch.setattr(
        wp.array, "__init__", lambda self, *args, **more: made.append(1) or construct(self, *args, **more)
    )
    for frame in range(8):
        scene.load_batch([frame])
        before = len(made)
        paths = solve_paths(scene, make_links(data, [frame], config), config, data.materials, table)
        count = len(made) - before
        assert len(paths) > 2 and (count == 0 or frame < 3), f"{count} arrays in frame {frame}"


def test_scratch_is_used_again_after_release_only(device: str) -> None:
    data = traffic(driving(np.arange(3) * 0.01))
    config = ChannelConfig(antennas=antenna_at({"cav": (0.2, 0.1, 2.5)}))
    scene = loaded(data, device, [0])
    table, links = make_surface_table(scene), make_links(data, [0], config)
    first = Search(scene, links, config, table)
    one, other = (first.scratch((7, 2), wp.int32) for _ in range(2))
    assert one.ptr != other.ptr and one.shape == (7, 2)
    first.release()
    second = Search(scene, links, config, table)
    assert second.scratch((7, 2), wp.int32) in (one, other) and second.scratch((7, 2), wp.float64) not in (one, other)
    large = second.scratch((SCRATCH_BYTES + 1,), wp.uint8)
    for _ in range(2 * SCRATCH_ARRAYS):
        second.scratch((3,), wp.int32)
    second.release()
    assert sum(map(len, table.scratch.values())) <= SCRATCH_ARRAYS + 2
    assert all(array is not large for arrays in table.scratch.values() for array in arrays)


def test_links_are_sorted_as_numpy_does(device: str) -> None:
    """Orders, sources and ends in the frames of instances have the bits of NumPy; so have the poses."""
    data = traffic(driving(np.arange(3) * 0.01))
    data.poses[1, 2] = np.nan  # an absent truck
    data.poses[..., 3:] *= 1.7
    config = ChannelConfig(antennas=antenna_at({"cav": (0.2, 0.1, 2.5)}))
    scene = loaded(data, device, [0, 1, 2])
    generator = np.random.default_rng(6)
    search = Search(scene, make_links(data, [0, 1, 2], config), config, make_surface_table(scene))
    batch_index = generator.integers(0, 3, 50).astype(np.int32)
    tx = generator.integers(-1, 2, (50, 3)).astype(np.float64)  # many at one place
    rx = 10.0 * generator.normal(size=(50, 3))
    links = search.sort(batch_index, tx, rx)
    order = np.lexsort((tx[:, 2], tx[:, 1], tx[:, 0], batch_index))
    np.testing.assert_array_equal(links.order, order)
    key = np.column_stack([batch_index, tx])[order]
    first = np.flatnonzero(np.append(True, (key[1:] != key[:-1]).any(axis=1)))
    np.testing.assert_array_equal(links.sources.first_link, np.append(first, 50))
    np.testing.assert_array_equal(links.sources.position, tx[order][first])
    np.testing.assert_array_equal(links.sources.batch_index, batch_index[order][first])
    place, count = links.sources.device[1].numpy()[: len(first)], len(first)
    np.testing.assert_array_equal(place, (tx[order][first] - scene.origin).astype(np.float32))
    np.testing.assert_array_equal(links.ends.source.numpy(), np.searchsorted(first, np.arange(50), side="right") - 1)
    pose = data.poses[[0, 1, 2]][:, scene.instance_actor]
    pose[..., 3:] = normalize(pose[..., 3:])
    np.testing.assert_array_equal(search.host_pose, pose)
    np.testing.assert_array_equal(search.pose.numpy(), pose)
    back = conjugate(pose[..., 3:])
    turn, shift = (values[batch_index[order]] for values in (back, -rotate(back, pose[..., :3])))
    for end, ends in ((tx, links.ends.tx), (rx, links.ends.rx)):
        local = rotate(turn, end[order][:, None]) + shift
        np.testing.assert_array_equal(ends.numpy(), np.concatenate([local, end[order][:, None]], axis=1))
    part = links.sources.part(3, count - 2)
    np.testing.assert_array_equal(part.device[3].numpy(), part.first_link)
    assert len(part) == count - 5 and len(part.device[0]) == count - 5
    search.release()
