"""Arrays from one trace against every pair of elements traced by itself, with reflections, and the cost of no paths."""

import numpy as np
import pytest

from mmw.channel import (
    apply_arrays,
    frequency_response,
    per_element_links,
    plane_wave_error,
    rows_from_paths,
    taps,
    ula,
    upa,
)
from mmw.channel.antennas.arrays import PlanarArray
from mmw.channel.links import Links, make_links
from mmw.channel.path_solver.solver import solve_paths
from mmw.channel.paths import PathSet
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.scene.device_scene import DeviceScene
from tests.fixtures.device_rays import loaded
from tests.fixtures.scenes import ground_part, wall_part
from tests.oracles.channel import channel, link_scene

CARRIER = 28e9
CONFIG = channel(carriers_hz=(CARRIER,), max_depth=2)


def street(device: str, rsu: tuple, cav: tuple) -> tuple[DeviceScene, Links]:
    parts = [ground_part(300.0), wall_part("wall", (-300.0, 20.0), (300.0, 20.0), 40.0)]
    scene = loaded(link_scene(parts, rsu, cav), device, [0])
    return scene, make_links(scene.arrays, [0], CONFIG)


def element_response(
    scene: DeviceScene, links: Links, tx_array: PlanarArray, rx_array: PlanarArray
) -> tuple[np.ndarray, np.ndarray, PathSet]:
    """Return path id [P], complex gain with carrier phase [P, N_r, N_t] of paths that all elements have, and paths."""
    expanded, _, rx_element, tx_element = per_element_links(links, tx_array, rx_array, CARRIER)
    paths = solve_paths(scene, expanded, CONFIG, scene.arrays.materials)
    gain = paths.a["sunny"][:, 0]  # of one element of either array
    gain = gain * np.exp(-2j * np.pi * CARRIER * paths.tau)
    ids = np.unique(paths.path_id)
    out = np.full((len(ids), rx_array.element_count, tx_array.element_count), np.nan + 0j)
    out[np.searchsorted(ids, paths.path_id), rx_element[paths.link], tx_element[paths.link]] = gain
    return ids, out, paths


@pytest.mark.parametrize(
    ("tx_array", "rx_array"),
    [(ula(256), ula(16)), (upa(8, 8, orientation=(0.3, -0.1, 0.2)), upa(2, 2, orientation=(2.0, 0.1, 0.0)))],
)
def test_synthesis_equals_element_tracing_within_the_plane_wave_error(
    tx_array: PlanarArray, rx_array: PlanarArray, device: str
) -> None:
    scene, links = street(device, (0.0, 0.0, 8.0, 0.4), (120.0, -9.0, 1.5, 2.0))
    ids, exact, traced = element_response(scene, links, tx_array, rx_array)
    centre = solve_paths(scene, links, CONFIG, scene.arrays.materials)
    rows = rows_from_paths(links, centre, "sunny", CARRIER)
    turns = links.tx.rotation, links.rx.rotation
    a = apply_arrays(rows, tx_array, rx_array, CARRIER, *turns, wavefront="plane")
    a = a * np.exp(-2j * np.pi * CARRIER * rows.tau)[:, None, None]
    assert len(centre) == 4 and traced.order.max() == 2
    np.testing.assert_array_equal(np.sort(centre.path_id), ids)
    bound = plane_wave_error(tx_array, rows.tau * SPEED_OF_LIGHT, CARRIER, rx_array)
    for p, own in enumerate(np.searchsorted(ids, centre.path_id)):
        turn = np.abs(np.angle(a[p] / exact[own]))
        assert turn.max() <= bound[p] + 1e-6
        assert turn.max() > 0.1 * bound[p]  # the arrays are large enough to feel the sphere
        np.testing.assert_allclose(np.abs(a[p]), np.abs(exact[own]), rtol=0.05)  # angles differ over the aperture


def test_no_path_at_all_is_a_channel_of_zeros(device: str) -> None:
    scene, links = street(device, (0.0, 30.0, 8.0), (50.0, -9.0, 1.5))  # behind the wall
    paths = solve_paths(scene, links, CONFIG, scene.arrays.materials)
    assert len(paths) == 0
    rows = rows_from_paths(links, paths, "sunny", CARRIER)
    a = apply_arrays(rows, ula(4), ula(2), CARRIER, links.tx.rotation, links.rx.rotation)
    np.testing.assert_array_equal(frequency_response(a, rows, [0.0, 1e6], CARRIER), np.zeros((1, 2, 4, 2)))
    np.testing.assert_array_equal(frequency_response(a, rows, [0.0], CARRIER, average=True), np.zeros((1, 2, 4)))
    np.testing.assert_array_equal(taps(a, rows, 1e8, 0, 3, CARRIER), np.zeros((1, 2, 4, 4)))


def test_rows_from_paths_need_weather_and_carrier(device: str) -> None:
    scene, links = street(device, (0.0, 0.0, 8.0), (50.0, -9.0, 1.5))
    paths = solve_paths(scene, links, CONFIG, scene.arrays.materials)
    with pytest.raises(ValueError, match="weather = 'snowy'; the paths have sunny"):
        rows_from_paths(links, paths, "snowy", CARRIER)
    with pytest.raises(ValueError, match=r"the paths have 2.8e\+10 Hz"):
        rows_from_paths(links, paths, "sunny", 1e9)
