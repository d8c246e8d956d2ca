"""Measuring surfaces: grids on planes and over roads."""

import numpy as np
import pytest

from mmw.channel.radio_map.measurement_surface import MeasurementSurface, mesh_surface, plane_grid, road_grid
from mmw.core.errors import InputError
from tests.fixtures.scenes import arrays_from_parts, ground_part, quad_part, wall_part
from tests.oracles.radio_map import UPRIGHT


def test_plane_grid_has_whole_cells_about_its_middle() -> None:
    surface = plane_grid((1.0, 2.0, 3.0), (5.0, 4.0), 2.0)
    assert len(surface) == 3 * 2
    np.testing.assert_allclose(surface.center[:4], [[-1, 1, 3], [1, 1, 3], [3, 1, 3], [-1, 3, 3]])
    np.testing.assert_allclose(surface.area, 4.0)
    np.testing.assert_array_equal(surface.faces[:3], [[0, 1, 2], [0, 2, 3], [4, 5, 6]])
    turned = plane_grid((1.0, 2.0, 3.0), (5.0, 4.0), 2.0, UPRIGHT)
    assert surface.grid_shape == turned.grid_shape == (2, 3)
    np.testing.assert_allclose(turned.center[1], [1.0, 2.0, 2.0])
    np.testing.assert_allclose(turned.corners[..., 0], 1.0)
    np.testing.assert_allclose(turned.area, 4.0)


def test_road_grid_follows_a_slope_at_its_height() -> None:
    """A road of 10 % is followed 1.5 m above; only cells with their middle over it are there."""
    corners = [(-9.2, -3.9, -0.92), (9.2, -3.9, 0.92), (9.2, 3.9, 0.92), (-9.2, 3.9, -0.92)]
    arrays = arrays_from_parts([quad_part("Roads/slope", corners, cells=3), wall_part("w", (-9, 4), (9, 4), 8.0)])
    surface = road_grid(arrays, 2.0, 1.5)
    x, y, z = surface.center.T
    assert sorted(set(x.tolist())) == [-9, -7, -5, -3, -1, 1, 3, 5, 7, 9]
    assert sorted(set(y.tolist())) == [-3, -1, 1, 3]
    assert len(surface) == 40
    np.testing.assert_allclose(z, 0.1 * x + 1.5, atol=1e-9)
    np.testing.assert_allclose(surface.corners[..., 2], 0.1 * surface.corners[..., 0] + 1.5, atol=1e-9)
    np.testing.assert_allclose(surface.area, 4.0 * np.sqrt(1.01))


def test_road_grid_has_no_gaps_where_the_slope_changes() -> None:
    """Neighbors share their corners on a road that bends upwards between two cells' middles."""
    flat = quad_part("Roads/flat", [(-8, -4, 0), (0, -4, 0), (0, 4, 0), (-8, 4, 0)])
    ramp = quad_part("Roads/ramp", [(0, -4, 0), (8, -4, 1.6), (8, 4, 1.6), (0, 4, 0)])
    surface = road_grid(arrays_from_parts([flat, ramp]), 2.5, 1.0)
    corner = np.round(surface.corners.reshape(-1, 3), 9)
    assert len(np.unique(corner, axis=0)) == len(np.unique(corner[:, :2], axis=0))
    x = surface.center[:, 0]
    np.testing.assert_allclose(surface.center[x > 2.5, 2], 1.0 + 0.2 * x[x > 2.5], atol=1e-9)


def test_a_bridge_is_a_level_of_its_own_and_a_marking_is_not() -> None:
    road = ground_part(half=6.0)
    bridge = quad_part("Roads/bridge", [(-2, -6, 5), (2, -6, 5), (2, 6, 5), (-2, 6, 5)])
    marking = quad_part("Lines/line", [(-6, 3, 0.004), (6, 3, 0.004), (6, 6, 0.004), (-6, 6, 0.004)], label="road_line")
    surface = road_grid(arrays_from_parts([road, bridge, marking]), 1.0, 1.5)
    z, count = np.unique(np.round(surface.center[:, 2], 6), return_counts=True)
    np.testing.assert_allclose(z, [1.5, 1.502, 1.503, 1.504, 6.5], atol=1e-3)
    assert count.sum() == 12 * 12 + 4 * 12
    assert count[-1] == 4 * 12
    only = road_grid(arrays_from_parts([road, bridge, marking]), 1.0, 1.5, labels=["road"], within_m=(-6, -6, -3, 0))
    assert len(only) == 3 * 6
    np.testing.assert_allclose(only.center[:, 2], 1.5)


def test_impossible_grids_are_named() -> None:
    arrays = arrays_from_parts([wall_part("w", (-9, 4), (9, 4), 8.0)])
    for call, part in (
        (lambda: plane_grid((0, 0, 0), (4, 4), 0.0), "cell_size_m = 0"),
        (lambda: plane_grid((0, 0, 0), (4, 0), 1.0), "size_m"),
        (lambda: plane_grid((0, 0, 0), (1e5, 1e5), 1.0), "at most"),
        (lambda: road_grid(arrays, 2.0, 0.0), "height_m = 0"),
        (lambda: road_grid(arrays, 2.0, 1.5), "the scene has building"),
    ):
        with pytest.raises(ValueError, match=part):
            call()


def test_mesh_surface_has_a_cell_a_triangle() -> None:
    points = [[0, 0, 1], [4, 0, 1], [4, 2, 1], [0, 2, 4]]
    surface = mesh_surface(points, [[0, 1, 2], [0, 2, 3], [2, 1, 0]])
    assert len(surface) == 3 and surface.grid_shape is None
    np.testing.assert_allclose(surface.area, [4.0, 0.5 * np.linalg.norm(np.cross([4, 2, 0], [0, 2, 3])), 4.0])
    np.testing.assert_allclose(surface.center[0], [8 / 3, 2 / 3, 1.0])
    np.testing.assert_array_equal(surface.faces, np.arange(9).reshape(3, 3))
    np.testing.assert_array_equal(surface.cell_of_face, [0, 1, 2])
    moved = mesh_surface(points, [[0, 1, 2], [0, 2, 3], [2, 1, 0]], offset_m=0.25)
    np.testing.assert_allclose(moved.corners[0] - surface.corners[0], np.tile([0, 0, 0.25], (3, 1)))
    np.testing.assert_allclose(moved.corners[2] - surface.corners[2], np.tile([0, 0, -0.25], (3, 1)))
    np.testing.assert_array_equal(plane_grid((0, 0, 0), (2, 1), 1.0).cell_of_face, [0, 0, 1, 1])


def test_impossible_surfaces_are_named() -> None:
    flat = [[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]]
    quad = np.array([[[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]])
    for call, part in (
        (lambda: mesh_surface(flat, [[0, 1, 3], [0, 1, 2]]), "cell 1 has no area, as 1 in all"),
        (lambda: mesh_surface(flat, [[0, 1, 4]]), "faces name vertex 4; there are 4"),
        (lambda: mesh_surface(flat, [[0.0, 1.0, 3.0]]), r"faces of shape \(1, 3\); whole numbers"),
        (lambda: mesh_surface(flat, np.zeros((0, 3), int)), r"faces of shape \(0, 3\)"),
        (lambda: mesh_surface(np.zeros((4, 2)), [[0, 1, 3]]), r"points of shape \(4, 2\)"),
        (lambda: mesh_surface([*flat[:3], [0, np.nan, 0]], [[0, 1, 3]]), "points of shape"),
        (lambda: mesh_surface(flat, [[0, 1, 3]], offset_m=np.inf), "offset_m = inf"),
        (lambda: plane_grid((0, 0, np.nan), (4, 4), 1.0), r"center_m = \(0.0, 0.0, nan\)"),
        (lambda: plane_grid((0, 0), (4, 4), 1.0), "center_m"),
        (lambda: plane_grid((0, 0, 0), (4, np.inf), 1.0), "size_m"),
        (lambda: plane_grid((0, 0, 0), (4, 4), np.nan), "cell_size_m = nan"),
        (lambda: plane_grid((0, 0, 0), (4, 4), 1e-200), "at most"),
        (lambda: plane_grid((0, 0, 0), (4, 4), 1.0, (0, 0, 0, 0)), "orientation"),
        (lambda: MeasurementSurface(quad[:, :2]), r"corners of shape \(1, 2, 3\)"),
        (lambda: MeasurementSurface(quad, (2, 1)), "grid_shape"),
        (lambda: MeasurementSurface(np.where(quad > 0, np.inf, quad)), "cell 0 has corners that are not finite"),
    ):
        with pytest.raises(InputError, match=part):
            call()
