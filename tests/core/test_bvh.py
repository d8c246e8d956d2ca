"""The tree: what it holds, how deep it gets, and what rays find that meet edges, corners and planes exactly."""

import numpy as np
import pytest
import warp as wp

from mmw.core.bvh import LEAF_FACES_CUDA, build_bvhs, build_tree
from mmw.core.bvh_kind import kind_to_build
from mmw.kernels.core import bvh as tree
from tests.fixtures.device_rays import grid, soup
from tests.fixtures.kernels import launched
from tests.oracles.tracing import triangle_hits

MISS = -1


@wp.kernel
def cast_kernel(
    trees: tree.Tree,
    root: int,
    origin: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    t_max: float,
    t_out: wp.array[float],
    face_out: wp.array[int],
    is_met_out: wp.array[wp.bool],
):
    """Walk one tree. Launch: dim=R."""
    i = wp.tid()
    found = tree.nearest_face(trees, root, origin[i], direction[i], t_max)
    t_out[i] = wp.cast(wp.uint32(found >> wp.uint64(32)), float)
    face_out[i] = int(wp.uint32(found & wp.uint64(0xFFFFFFFF))) - 1
    is_met_out[i] = tree.is_any_face(trees, root, origin[i], direction[i], t_max)


def cast(device: str, trees: tree.Tree, root: int, origin, direction, t_max: float = 1e4):
    """Return distances, faces and whether anything is met, of rays that broadcast."""
    origin, direction = np.broadcast_arrays(np.atleast_2d(origin), np.atleast_2d(direction))
    t, face, is_met = launched(cast_kernel, len(origin), [trees, root, origin, direction, t_max], device)
    np.testing.assert_array_equal(is_met, face >= 0)
    np.testing.assert_array_equal(t[face < 0], np.float32(t_max))
    return t, face


def one(device: str, corners) -> tree.Tree:
    return build_bvhs([np.asarray(corners, np.float32)], device)[0]


def leaves_below(nodes: np.ndarray, leaves: np.ndarray, leaf_faces: int) -> tuple[list[int], int]:
    """Return the faces of all leaves and the number of nodes on the longest way, having seen that boxes hold them."""
    faces, longest = [], 0
    todo = [(0, 1)]
    while todo:
        number, level = todo.pop()
        longest = max(longest, level)
        lower, upper = nodes[number, :3].T, nodes[number, 3:6].T
        for k, child in enumerate(nodes[number, tree.REFERENCE_ROW].view(np.int32)):
            if np.any(lower[k] > upper[k]):
                continue
            if child >= 0:
                below = nodes[child]
                is_used = np.all(below[:3] <= below[3:6], axis=0)
                assert np.all(below[:3, is_used].min(axis=1) >= lower[k])
                assert np.all(below[3:6, is_used].max(axis=1) <= upper[k])
                todo.append((int(child), level + 1))
            else:
                leaf, count = divmod(-1 - int(child), 8)
                assert 1 <= count <= leaf_faces
                points = leaves[leaf, :9, :count].reshape(3, 3, count)
                assert np.all(points.min(axis=(0, 2)) >= lower[k])
                assert np.all(points.max(axis=(0, 2)) <= upper[k])
                faces += leaves[leaf, 9, :count].view(np.int32).tolist()
    return faces, longest


LEAF_SIZES = pytest.mark.parametrize("leaf_faces", [LEAF_FACES_CUDA, int(tree.LEAF_FACES)])


@LEAF_SIZES
@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 17, 700])
def test_every_face_is_in_one_leaf_inside_of_its_boxes(count: int, leaf_faces: int) -> None:
    faces, _ = leaves_below(*build_tree(soup(count, count), leaf_faces), leaf_faces)
    assert sorted(faces) == list(range(count))


@LEAF_SIZES
def test_trees_stay_shallow_whatever_the_triangles(leaf_faces: int) -> None:
    # Ever smaller about one point: without a limit this tree has 33 nodes on its longest way.
    size = 2.0 ** np.repeat(np.arange(-60.0, 41.0), 5)
    nested = np.random.default_rng(0).uniform(1.0, 1.2, (len(size), 3, 3)) * size[:, None, None]
    for corners in (nested.astype(np.float32), np.repeat(soup(1, 1), 5000, axis=0), np.zeros((300, 3, 3), np.float32)):
        faces, longest = leaves_below(*build_tree(corners, leaf_faces), leaf_faces)
        assert sorted(faces) == list(range(len(corners)))
        assert longest <= int(tree.MAX_DEPTH)


@pytest.mark.parametrize("seed", range(3))
def test_rays_find_what_the_oracle_finds(device: str, seed: int) -> None:
    corners = soup(seed, 900)
    rng = np.random.default_rng(seed)
    origin = rng.uniform(-15.0, 15.0, (500, 3)).astype(np.float32)
    direction = rng.uniform(-8.0, 8.0, (500, 3)) - origin
    direction = (direction / np.linalg.norm(direction, axis=1, keepdims=True)).astype(np.float32)
    t, face = cast(device, one(device, corners), 0, origin, direction)
    ray, triangle, distance = triangle_hits(origin.astype(float), direction.astype(float), corners.astype(float))
    expected, second = np.full(500, np.inf), np.full(500, np.inf)
    number = np.full(500, MISS)
    for k in np.argsort(distance):
        if expected[ray[k]] == np.inf:
            expected[ray[k]], number[ray[k]] = distance[k], triangle[k]
        elif second[ray[k]] == np.inf:
            second[ray[k]] = distance[k]
    is_clear = (second == np.inf) | (second > expected + 1e-4)
    assert is_clear.sum() > 400 and (number >= 0).sum() > 200
    np.testing.assert_array_equal(face[is_clear], number[is_clear])
    np.testing.assert_allclose(t[face >= 0], expected[face >= 0], rtol=1e-5, atol=1e-5)


def plain_distances(origin: np.ndarray, direction: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the distance of every triangle on every ray, inf for a miss, shape [R, T], in the order of the walk.

    NumPy rounds every product and every sum to float32 and fuses none.
    """
    longest = np.argmax(np.abs(direction[:, ::-1]), axis=1)[:, None]  # of equal ones z before y; x comes before y below
    axis = 2 - longest
    is_x = (np.abs(direction[:, 0]) >= np.abs(direction[:, 1]))[:, None] & (axis != 2)
    axis = np.where(is_x, 0, axis)
    order = (axis + np.array([1, 2, 0])) % 3
    along, rows = np.take_along_axis(direction, order, axis=1), np.arange(len(corners))
    inverse = np.float32(1.0) / along[:, 2]
    local = (corners[None] - origin[:, None, None])[np.arange(len(origin))[:, None, None, None], rows[:, None, None],
                                                   np.arange(3)[:, None], order[:, None, None, :]]  # fmt: skip
    u, v = (local[..., k] + (-along[:, k] * inverse)[:, None, None] * local[..., 2] for k in (0, 1))
    a, b, g = ((u[..., i] * v[..., j] - v[..., i] * u[..., j]) for i, j in ((2, 1), (0, 2), (1, 0)))
    is_flat = (a == 0) | (b == 0) | (g == 0)
    x, y = u.astype(float), v.astype(float)
    a, b, g = (
        np.where(is_flat, (x[..., i] * y[..., j] - y[..., i] * x[..., j]).astype(np.float32), edge)
        for edge, (i, j) in zip((a, b, g), ((2, 1), (0, 2), (1, 0)), strict=True)
    )
    volume, w = a + b + g, inverse[:, None, None] * local[..., 2]
    sides = np.stack([a, b, g])
    is_met = ~((sides < 0).any(axis=0) & (sides > 0).any(axis=0)) & (volume != 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (a * w[..., 0] + b * w[..., 1] + g * w[..., 2]) / volume
    assert t.dtype == np.float32
    return np.where(is_met & (t >= 0), t, np.inf)


def test_distances_have_the_bits_of_plain_float32(device: str) -> None:
    """On every device: a product that is fused with a sum, as CUDA's compiler would, changes half of them."""
    corners = soup(7, 300, size=2.0)
    corners[:100, :, 2] = np.rint(corners[:100, :, 2])
    rng = np.random.default_rng(7)
    origin = rng.uniform(-15.0, 15.0, (400, 3)).astype(np.float32)
    direction = rng.uniform(-8.0, 8.0, (400, 3)) - origin
    direction = (direction / np.linalg.norm(direction, axis=1, keepdims=True)).astype(np.float32)
    origin[:50], direction[:50] = corners[:50, 0] - 5 * direction[:50], direction[:50]  # at corners
    direction[50:56] = np.concatenate([np.eye(3), -np.eye(3)])
    t, face = cast(device, one(device, corners), 0, origin, direction, np.inf)
    expected = plain_distances(origin, direction, corners)
    # Corners of single triangles are outlines: Warp's trees may pass what these rays just touch, or meet it.
    is_sure = np.arange(400) >= (50 if kind_to_build() == "warp" else 0)
    # Warp's trees are asked in files whose products CUDA's compiler may fuse with sums; those of the LiDAR forbid it.
    is_fused = kind_to_build() == "warp" and device != "cpu"
    np.testing.assert_allclose(t[is_sure], expected.min(axis=1)[is_sure], rtol=1e-5 if is_fused else 0.0)
    is_hit = (face >= 0) & is_sure
    assert is_hit.sum() > 200
    np.testing.assert_array_equal(face[is_hit], expected.argmin(axis=1)[is_hit])


def test_no_ray_passes_between_neighbours(device: str) -> None:
    corners = grid(24)
    rng = np.random.default_rng(2)
    inner = corners.reshape(-1, 3)
    inner = inner[np.all((inner[:, :2] > 0.5) & (inner[:, :2] < 23.5), axis=1)]
    ends = rng.permutation(np.unique(inner, axis=0))
    along = rng.uniform(0.0, 1.0, (len(corners), 1))
    on_edge = corners[:, 0] + along * (corners[:, 1] - corners[:, 0])
    on_edge = on_edge[np.all((on_edge[:, :2] > 0.5) & (on_edge[:, :2] < 23.5), axis=1)]
    target = np.concatenate([ends, on_edge]).astype(np.float32)
    for start in ((12.3, 11.1, 30.0), (-5.0, 40.0, 17.0), (12.0, 12.0, 8.0)):
        way = target.astype(np.float64) - start
        length = np.linalg.norm(way, axis=1)
        t, face = cast(device, one(device, corners), 0, start, (way / length[:, None]).astype(np.float32))
        assert np.all(face >= 0)
        assert np.all(t <= length + 1e-3)
    straight = np.concatenate([target[:, :2], np.full((len(target), 1), 9.0)], axis=1)
    assert np.all(cast(device, one(device, corners), 0, straight, (0.0, 0.0, -1.0))[1] >= 0)


def test_rays_along_axes_meet_flat_things(device: str) -> None:
    floor = grid(4) * (1.0, 1.0, 0.0)
    wall = floor[:, :, [2, 0, 1]] + (2.0, 0.0, 0.0)  # x = 2 over y and z of 0 to 4
    trees = one(device, np.concatenate([floor, wall]))
    t, face = cast(
        device, trees, 0, [(1.0, 1.0, 3.0), (0.5, 2.0, 1.0), (3.0, 0.5, 2.0)], [(0, 0, -1), (1, 0, 0), (-1, 0, 0)]
    )
    np.testing.assert_array_equal(t, [3.0, 1.5, 1.0])
    np.testing.assert_array_equal(face >= len(floor), [False, True, True])
    # In the plane of the floor, at the height of the wall's lower edge: the wall is met, the floor is not.
    t, face = cast(device, trees, 0, (0.5, 1.5, 0.0), (1.0, 0.0, 0.0))
    assert t == 1.5 and face >= len(floor)
    assert cast(device, trees, 0, (0.5, 1.5, 0.0), (0.0, 0.0, 1.0))[0] == 0.0  # starts on it


def test_the_lowest_of_equal_faces_is_found(device: str) -> None:
    corners = np.concatenate(
        [soup(3, 300) + np.array([0.0, 0.0, 40.0]), np.repeat(grid(1)[:1] - np.array([0.0, 0.0, 5.0]), 40, axis=0)]
    )
    order = np.random.default_rng(0).permutation(len(corners))
    first = np.flatnonzero(order >= 300).min()
    t, face = cast(device, one(device, corners[order]), 0, (0.7, 0.2, -9.0), (0.0, 0.0, 1.0))
    assert face == first and t > 3.0


def test_the_lowest_of_equal_faces_is_found_in_the_planes_of_the_axes(device: str) -> None:
    # Boxes end at the coordinate 0 here: a margin that is relative to it would be none.
    corners = (grid(6) * (1.0, 1.0, 0.0) - (3.0, 3.0, 0.0)).astype(np.float32)
    order = np.random.default_rng(4).permutation(len(corners))
    corners = corners[order]
    trees = one(device, corners)
    for x, y in [(0, 0), (0, 1), (-2, 0), (1, 1), (0, -2)]:
        around = [k for k, face in enumerate(corners) if (face == np.float32((x, y, 0.0))).all(axis=1).any()]
        for way in ((0.0, 0.0, -1.0), (-0.0, -0.0, -1.0)):
            t, face = cast(device, trees, 0, (x, y, 5.0), way)
            assert t == 5.0 and face == min(around)


def test_a_distance_does_not_depend_on_who_shares_the_leaf(device: str) -> None:
    corners = soup(6, 40, 8.0)
    rng = np.random.default_rng(6)
    weight = rng.dirichlet((1.0, 1.0, 1.0), 4000)
    target = np.einsum("rc,rcx->rx", weight, corners[rng.integers(0, 40, 4000)].astype(float))
    target[::2] = corners[rng.integers(0, 40, 2000), rng.integers(0, 3, 2000)]  # exactly corners, seen from the origin
    way = (target / np.linalg.norm(target, axis=1, keepdims=True)).astype(np.float32)
    t, face = cast(device, one(device, corners), 0, (0.0, 0.0, 0.0), way)
    for k in range(40):
        rays = face == k
        if rays.any():
            alone, _ = cast(device, one(device, corners[k : k + 1]), 0, (0.0, 0.0, 0.0), way[rays])
            np.testing.assert_array_equal(alone, t[rays])


def test_faces_without_area_are_passed(device: str) -> None:
    line = np.array([[(0, 0, 0), (1, 1, 0), (2, 2, 0)], [(1, 0, 0), (1, 0, 0), (1, 0, 0)]], np.float32)
    trees = one(device, np.concatenate([line, grid(2) - np.array([0.0, 0.0, 7.0])]))
    _, face = cast(device, trees, 0, [(1.0, 1.0, 5.0), (1.0, 0.01, 5.0)], (0.0, 0.0, -1.0))
    assert np.all(face >= 2)


def test_rays_end_and_start_where_they_should(device: str) -> None:
    trees = one(device, grid(2) * (1.0, 1.0, 0.0))
    above = (0.7, 0.4, 2.0)
    assert cast(device, trees, 0, above, (0.0, 0.0, -1.0), 2.0)[1] == MISS
    assert cast(device, trees, 0, above, (0.0, 0.0, -1.0), 2.0001)[1] >= 0
    assert cast(device, trees, 0, above, (0.0, 0.0, 1.0))[1] == MISS
    assert cast(device, trees, 0, above, (0.0, 0.0, -1.0), np.inf)[0] == 2.0


def test_trees_of_several_meshes_are_apart(device: str) -> None:
    meshes = [soup(k, 50 * k) + np.array([100.0 * k, 0.0, 0.0]) for k in range(1, 4)]
    trees, roots = build_bvhs(meshes, device)
    rng = np.random.default_rng(1)
    direction = rng.normal(size=(200, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    for k, (mesh, root) in enumerate(zip(meshes, roots, strict=True), start=1):
        for place in range(1, 4):
            origin = np.full((200, 3), (100.0 * place, 0.0, 0.0))
            t, face = cast(device, trees, int(root), origin, direction, 30.0)
            t_alone, face_alone = cast(device, one(device, mesh), 0, origin, direction, 30.0)
            np.testing.assert_array_equal(face, face_alone)
            np.testing.assert_array_equal(t, t_alone)
            assert (face >= 0).any() == (place == k)
