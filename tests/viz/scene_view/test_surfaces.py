"""Surfaces of a scene and the box that cuts them, against polygons cut corner by corner."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from mmw.core.errors import InputError
from mmw.core.mesh import TriangleMesh, separate
from mmw.scene import Scene
from mmw.viz.plots.style import CLASS_COLORS
from mmw.viz.scene_view.surfaces import EVERYTHING, ClipBox, faces_with_normals, group_meshes, scene_surfaces
from tests.fixtures.scenes import ABSENT, arrays_from_parts, box_part, two_cars


def cut_polygon(polygon: list[np.ndarray], axis: int, side: float, sign: float) -> list[np.ndarray]:
    """Return the part of a convex polygon where sign (x[axis] - side) <= 0, corner by corner."""
    found = []
    for here, following in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        a, b = sign * (here[axis] - side), sign * (following[axis] - side)
        if a <= 0.0:
            found.append(here)
        if a * b < 0.0:
            found.append(here + a / (a - b) * (following - here))
    return found


def area_of(polygon: list[np.ndarray]) -> float:
    turned = [np.cross(b - polygon[0], c - polygon[0]) for b, c in itertools.pairwise(polygon)]
    return 0.5 * float(np.linalg.norm(np.sum(turned, axis=0))) if turned else 0.0


@pytest.mark.parametrize(
    "clip",
    [(-1, -1, -1, 1, 1, 1), (-np.inf, -np.inf, -np.inf, np.inf, np.inf, 0.3), (0.2, -np.inf, -0.5, np.inf, 0.1, 2.0)],
)
def test_every_triangle_keeps_the_area_inside_the_box(clip: tuple[float, ...]) -> None:
    triangles = np.random.default_rng(1).uniform(-2.0, 2.0, (400, 3, 3))
    parts, face = ClipBox.of(None, clip).cut(triangles)
    assert (parts >= np.array(clip[:3]) - 1e-12).all() and (parts <= np.array(clip[3:]) + 1e-12).all()
    found = np.bincount(face, separate(parts).areas, minlength=len(triangles))
    for number, triangle in enumerate(triangles):
        polygon = list(triangle)
        for axis in range(3):
            polygon = cut_polygon(polygon, axis, clip[axis], -1.0)
            polygon = cut_polygon(polygon, axis, clip[axis + 3], 1.0)
        assert found[number] == pytest.approx(area_of(polygon), abs=1e-12)
    assert 0 < (found == 0.0).sum() < len(triangles)  # the box cuts some away and leaves some
    normals = separate(triangles).normals[face]
    assert (np.sum(normals * separate(parts).crosses, axis=1) > -1e-12).all()  # none is turned over


def test_further_columns_are_interpolated() -> None:
    rng = np.random.default_rng(2)
    triangles, slope = rng.uniform(-2.0, 2.0, (50, 3, 3)), rng.normal(size=(3, 2))
    parts, _ = ClipBox.of(0.1, None).cut(np.concatenate([triangles, triangles @ slope], axis=-1))
    np.testing.assert_allclose(parts[..., 3:], parts[..., :3] @ slope, atol=1e-12)


def test_triangles_that_touch_a_side_are_whole_or_gone() -> None:
    below = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 0, 1]]])  # its tip lies in the side z = 1
    above = below * (1, 1, -1) + (0, 0, 2)
    within = np.array([[[0.0, 0, 1], [1, 0, 1], [0, 1, 1]]])
    parts, face = ClipBox.of(1.0, None).cut(np.concatenate([below, above, within]))
    np.testing.assert_array_equal(face, [0, 2])
    np.testing.assert_array_equal(parts, np.concatenate([below, within]))


def test_without_a_box_nothing_changes() -> None:
    triangles = np.random.default_rng(0).normal(size=(5, 3, 6))
    parts, face = EVERYTHING.cut(triangles)
    np.testing.assert_array_equal(parts, triangles)
    np.testing.assert_array_equal(face, np.arange(5))


@pytest.mark.parametrize(
    ("clip_z_m", "clip", "message"),
    [
        (np.nan, None, r"clip_z_m = \(nan,\); 1 finite numbers"),
        (np.inf, None, r"clip_z_m = \(inf,\)"),
        (None, ("a", 0, 0, 1, 1, 1), "xmin"),
        (1.0, (0, 0, 0, 1, 1, 1), "both given"),
        (None, (0, 0, np.nan, 1, 1, 1), r"clip = \(0, 0, nan, 1, 1, 1\)"),
        (None, (0, 0, 0, 1, 1), "xmin"),
        (None, (0, 0, 2, 1, 1, 1), "each minimum below its maximum"),
    ],
)
def test_clips_that_are_no_box_are_refused(clip_z_m: float | None, clip: tuple | None, message: str) -> None:
    with pytest.raises(InputError, match=message):
        ClipBox.of(clip_z_m, clip)


def test_a_scene_has_its_surfaces_at_the_poses_of_the_frame() -> None:
    arrays = two_cars(3)
    town, actors = scene_surfaces(arrays, 2, arrays.materials["sunny"], EVERYTHING)
    assert {mesh.name for mesh in town} == {"asphalt", "marble_facade", "window_glass"}
    area = sum(TriangleMesh(mesh.points.astype(float), mesh.faces).areas.sum() for mesh in town)
    assert area == pytest.approx(TriangleMesh(arrays.points, arrays.faces).areas.sum(), rel=1e-5)
    assert list(actors) == ["cav_1", "veh_001"]  # the roadside unit has no shape
    (cav,), (van,) = actors["cav_1"], actors["veh_001"]
    np.testing.assert_allclose(
        [cav.points.min(axis=0), cav.points.max(axis=0)], [(-20.25, -3.9, 0), (-15.75, -2.1, 1.5)]
    )
    # The van has turned by 180 degrees about (18, 3); its middle is 0.3 m ahead of its origin.
    np.testing.assert_allclose(
        [van.points.min(axis=0), van.points.max(axis=0)], [(14.95, 2, 0), (20.45, 4, 2.4)], atol=1e-5
    )
    assert (np.sum(van.normals * (van.points - van.points.mean(axis=0)), axis=1) > 0.0).all()  # outward
    assert cav.color == van.color == (188, 188, 188)  # sRGB of 0.5


def test_an_absent_actor_has_no_surfaces() -> None:
    arrays = two_cars(1)
    poses = arrays.poses.copy()
    poses[0, 0] = ABSENT
    _, actors = scene_surfaces(replace(arrays, poses=poses), 0, arrays.materials["sunny"], EVERYTHING)
    assert list(actors) == ["veh_001"]


def test_colors_by_class() -> None:
    arrays = two_cars(1)
    town, actors = scene_surfaces(arrays, 0, arrays.materials["sunny"], EVERYTHING, "class")
    assert {mesh.name: mesh.color for mesh in town} == {name: CLASS_COLORS[name] for name in ("road", "building")}
    assert [mesh.color for mesh in actors["cav_1"]] == [CLASS_COLORS["car"]]
    with pytest.raises(InputError, match=r"color_by = 'taste'; one of material, class"):
        scene_surfaces(arrays, 0, arrays.materials["sunny"], EVERYTHING, "taste")  # pyright: ignore


def test_actors_outside_the_box_are_left_out(street: Scene) -> None:
    box = ClipBox.of(None, (0.0, -20.0, -1.0, 100.0, 20.0, 20.0))
    _, actors = scene_surfaces(street.arrays, 0, street.materials_by_id(), box)
    assert list(actors) == ["veh_001"]


def test_equal_vertices_are_joined() -> None:
    arrays = arrays_from_parts([box_part("Buildings/cube", (2, 2, 2), (0, 0, 0), "wood", "building")])
    (cube,) = group_meshes(faces_with_normals(arrays), arrays.material, [("wood", (1, 2, 3))])
    assert (len(cube.points), len(cube.faces)) == (24, 12)  # four corners with a normal of their own on each side
    np.testing.assert_allclose(np.abs(cube.points), 1.0)
    mesh = TriangleMesh(cube.points.astype(float), cube.faces)
    np.testing.assert_allclose(mesh.normals, cube.normals[cube.faces].mean(axis=1))
