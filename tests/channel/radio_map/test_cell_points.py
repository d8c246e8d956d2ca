"""Points of cells: one in the middle, several on a regular division, and their order in space."""

import numpy as np
import pytest

from mmw.channel import mesh_surface, plane_grid
from mmw.channel.radio_map.cell_points import find_cells, grid_in_cells


def surfaces():
    plane = plane_grid((3.0, -2.0, 1.0), (6.0, 4.0), 2.0, (0.1, 0.2, 0.3, 0.9))
    return {"plane": plane, "mesh": mesh_surface(plane.mesh.points, plane.faces)}


@pytest.mark.parametrize("count", [1, 4, 9, 100])
@pytest.mark.parametrize("name", ["plane", "mesh"])
def test_points_divide_a_cell_evenly(name: str, count: int) -> None:
    surface = surfaces()[name]
    points = grid_in_cells(surface, count)
    assert points.shape == (len(surface) * count, 3)
    np.testing.assert_array_equal(find_cells(surface, points, 0.01), np.repeat(np.arange(len(surface)), count))
    np.testing.assert_allclose(points.reshape(len(surface), count, 3).mean(axis=1), surface.center, atol=1e-12)
    first = points[:count]
    apart = np.linalg.norm(first[:, None] - first, axis=2) + 1e9 * np.eye(count)
    assert apart.min() > 0.5 * np.sqrt(surface.area[0] / count)


def test_the_mean_over_points_is_that_over_the_area() -> None:
    """Of a square function: over a triangle and over a square, where integrals are known."""
    square = plane_grid((0.0, 0.0, 0.0), (1.0, 1.0), 1.0)
    corner = mesh_surface([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    assert (grid_in_cells(square, 10_000)[:, 0] ** 2).mean() == pytest.approx(1 / 12, rel=2e-4)
    assert (grid_in_cells(corner, 10_000)[:, 0] ** 2).mean() == pytest.approx(1 / 6, rel=2e-4)
