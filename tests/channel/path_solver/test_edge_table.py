"""Wedges where bodies meet, against the union of boxes on a grid; small bends; sheets of one face and of two."""

from itertools import product

import numpy as np
import pytest

import mmw
from mmw.channel.path_solver.edge_table import find_wedges
from mmw.channel.paths import PATH_DIFFRACTION, PATH_LOS
from mmw.core.errors import InputError
from mmw.core.planar_surfaces import find_surfaces
from mmw.core.transforms import pose_from_ypr, transform_points
from mmw.physics.materials.material import RadioMaterial
from mmw.scene.mesh_edges import MeshEdges, find_edges
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.scenes import box_mesh
from tests.oracles import channel as oracle

Mesh = tuple[np.ndarray, np.ndarray]
CONCRETE = RadioMaterial("itu", itu="itu_concrete")


def prism(outline: list[tuple[float, float]], low: float, high: float) -> Mesh:
    """Return an upright prism over a convex outline, counter-clockwise."""
    count = len(outline)
    points = np.array([(x, y, z) for z in (low, high) for x, y in outline])
    faces = [(count, count + k, count + k + 1) for k in range(1, count - 1)]
    faces += [(0, k + 1, k) for k in range(1, count - 1)]
    for k in range(count):
        j = (k + 1) % count
        faces += [(k, j, count + j), (k, count + j, count + k)]
    return points, np.array(faces, dtype=np.int32)


def together(bodies: list[Mesh]) -> tuple[MeshEdges, np.ndarray]:
    """Return the edges of several objects in one mesh, and the surface of each face."""
    starts = np.cumsum([0, *(len(points) for points, _ in bodies)])
    points = np.concatenate([points for points, _ in bodies])
    faces = np.concatenate([faces + start for (_, faces), start in zip(bodies, starts, strict=False)])
    owner = np.repeat(np.arange(len(bodies)), [len(faces) for _, faces in bodies]).astype(np.int32)
    return find_edges(points, faces), find_surfaces(points, faces, owner, np.zeros_like(owner))


def wedges_of(bodies: list[Mesh], **options) -> list[tuple]:
    """Return every wedge as (lower end, higher end, normals), rounded and sorted."""
    begin, end, n0, nn, *_ = find_wedges(*together(bodies), **options)
    rows = []
    for a, b, one, other in zip(begin, end, n0, nn, strict=True):
        ends = sorted(tuple((np.round(v, 4) + 0.0).tolist()) for v in (a, b))
        normals = sorted(tuple((np.round(v, 4) + 0.0).tolist()) for v in (one, other))
        rows.append((*ends, *normals))
    return sorted(rows)


def upright(wedges: list[tuple], x: float, y: float) -> list[tuple[float, float, tuple, tuple]]:
    """Return the wedges on a vertical line: from, to, normals."""
    return [(a[2], b[2], *n) for a, b, *n in wedges if a[:2] == b[:2] == (x, y)]


HOUSE = [(-8.0, 0.0), (0.0, 0.0), (0.0, 9.0), (-8.0, 9.0)]
"""Outline of a house whose facade looks to -y."""


def neighbor(bend: float) -> list[tuple[float, float]]:
    """Return the outline of a house at the other side of the line x = y = 0, whose facade turns back by an angle."""
    c, s = np.cos(bend), np.sin(bend)
    return [(0.0, 0.0), (7 * c, 7 * s), (7 * c - 5 * s, 7 * s + 5 * c), (0.0, 9.0)]


@pytest.mark.parametrize(("left", "right"), [(10.0, 10.0), (10.0, 12.0), (12.0, 10.0)])
def test_flush_houses_have_no_edge_in_their_facade(left: float, right: float) -> None:
    wedges = wedges_of([prism(HOUSE, 0.0, left), prism(neighbor(0.0), 0.0, right)])
    found = upright(wedges, 0.0, 0.0)
    if left == right:
        assert found == []
    else:  # the own corner of the higher house: its facade and its wall above the other's roof
        side = (-1.0, 0.0, 0.0) if right > left else (1.0, 0.0, 0.0)
        assert found == [(10.0, 12.0, *sorted([side, (0.0, -1.0, 0.0)]))]


@pytest.mark.parametrize("split", [False, True])
@pytest.mark.parametrize("bend", [-0.5, -0.044, 0.0, 0.02, 0.044, 0.3, 1.2])
def test_the_wedge_of_a_bent_joint_is_between_the_exposed_walls(bend: float, split: bool) -> None:
    """Equal heights share vertices; a lower neighbor, or one that is cut, ends on the edge."""
    right = [prism(neighbor(bend), 0.0, 6.0), prism(neighbor(bend), 6.0, 10.0)] if split else [
        prism(neighbor(bend), 0.0, 10.0)
    ]  # fmt: skip
    facade, other = (0.0, -1.0, 0.0), tuple((np.round([np.sin(bend), -np.cos(bend), 0.0], 4) + 0.0).tolist())
    bodies = [prism(HOUSE, 0.0, 10.0), *right]
    found = upright(wedges_of(bodies), 0.0, 0.0)
    assert {wedge[2:] for wedge in found} == ({tuple(sorted([facade, other]))} if bend > 0.05 else set())
    assert sum(b - a for a, b, *_ in found) == pytest.approx(10.0 if bend > 0.05 else 0.0)
    small = upright(wedges_of(bodies, min_bend=0.03), 0.0, 0.0)
    assert sum(b - a for a, b, *_ in small) == pytest.approx(10.0 if bend > 0.03 else 0.0)


@pytest.mark.parametrize("bend", [0.044, 0.06])
def test_a_small_bend_is_a_wedge_if_the_limit_allows(bend: float) -> None:
    roof = [(0.0, 0.0), (9.0, 9 * np.tan(bend)), (9.0, 20.0), (-9.0, 20.0), (-9.0, 0.0)]
    for limit in (0.05, 0.044 - 1e-6, 0.1):
        assert len(upright(wedges_of([prism(roof, 0.0, 5.0)], min_bend=limit), 0.0, 0.0)) == (bend > limit)


def test_edges_on_another_surface_are_none() -> None:
    ground = prism([(-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0)], -1.0, 0.0)
    assert len(wedges_of([ground, box_mesh((4.0, 6.0, 3.0), (0.0, 0.0, 1.5))])) == 12 + 8
    assert len(wedges_of([ground, box_mesh((4.0, 6.0, 3.0), (0.0, 0.0, 1.6))])) == 12 + 12
    corner = wedges_of([ground, box_mesh((4.0, 6.0, 3.0), (50.0, 0.0, 1.5))])  # half of it in the air
    assert sum(np.linalg.norm(np.subtract(b, a)) for a, b, *_ in corner) == pytest.approx(
        (8 * 100 + 4 * 1 - 6) + (2 * (4 + 6) + 4 * 3 + 6 + 2 * 2)
    )


def random_boxes(seed: int, size: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return the box of each cell of a grid, -1 for the open, and low and high corners of all boxes."""
    rng = np.random.default_rng(seed)
    owner, boxes = np.full((size, size, size), -1), []
    for _ in range(60):
        low = rng.integers(0, size, 3)
        high = np.minimum(low + rng.integers(1, 4, 3), size)
        part = owner[low[0] : high[0], low[1] : high[1], low[2] : high[2]]
        if (part < 0).all():
            part[...] = len(boxes)
            boxes.append(np.array([low, high], dtype=float))
    return owner, boxes


def unit_edges(owner: np.ndarray) -> set[tuple]:
    """Return the unit edges of the grid with one full cell and three open ones around: (axis, low corner)."""
    full, found = np.pad(owner >= 0, 1), set()
    size = owner.shape[0]
    for axis in range(3):
        one, other = (k for k in range(3) if k != axis)
        for at in product(range(size + 1), repeat=3):
            if at[axis] == size:
                continue
            cells = []
            for i, j in product((0, 1), repeat=2):
                cell = list(at)
                cell[axis] += 1
                cell[one] += i
                cell[other] += j
                cells.append(bool(full[tuple(cell)]))
            if sum(cells) == 1:
                found.add((axis, *at))
    return found


@pytest.mark.parametrize("seed", range(6))
def test_joints_against_the_union_of_boxes(seed: int) -> None:
    """Boxes that touch at faces, edges and corners, of which each is an object; turned and 1 km off the origin too."""
    owner, boxes = random_boxes(seed, 6)
    wanted, frame = unit_edges(owner), pose_from_ypr([900.0, -700.0, 20.0], 0.7, 0.2, -0.1)
    bodies = [box_mesh(tuple(high - low), tuple(0.5 * (low + high))) for low, high in boxes]
    for moved in (False, True):
        meshes = [(transform_points(frame, points), faces) for points, faces in bodies] if moved else bodies
        begin, end, n0, nn, away, *_ = find_wedges(*together(meshes))
        if moved:
            turn = transform_points(frame, np.eye(3)) - transform_points(frame, np.zeros(3))
            begin, end = ((v - frame[:3]) @ turn.T for v in (begin, end))
            n0, nn, away = (v @ turn.T for v in (n0, nn, away))
        found: dict[tuple, int] = {}
        for a, b, one, other, out in zip(begin, end, n0, nn, away, strict=True):
            axis = int(np.argmax(np.abs(b - a)))
            low, high = np.minimum(a, b), np.maximum(a, b)
            np.testing.assert_allclose(np.round(low), low, atol=2e-3)
            np.testing.assert_allclose(np.round(high), high, atol=2e-3)
            assert abs(one @ other) < 1e-6 and out == pytest.approx((one + other) / np.sqrt(2), abs=1e-6)
            middle = 0.5 * (a + b)
            for side, is_full in ((out, False), (one - other, False), (other - one, False), (-out, True)):
                at = np.floor(middle + 0.5 * side / np.abs(side).max()).astype(int)
                inside = ((at >= 0) & (at < 6)).all()
                assert (inside and owner[tuple(np.clip(at, 0, 5))] >= 0) == is_full
            for step in range(round(high[axis] - low[axis])):
                key = (axis, *(np.round(low).astype(int) + step * np.eye(3, dtype=int)[axis]).tolist())
                found[key] = found.get(key, 0) + 1
        assert set(found) == wanted
        assert set(found.values()) == {1}, "a wedge is there twice"


def both_sides(mesh: Mesh) -> Mesh:
    points, faces = mesh
    return points, np.concatenate([faces, faces[:, ::-1]])


PLATE = np.array([[0, 0, 0], [4, 0, 0], [4, 0, 3], [0, 0, 3.0]]), np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
WING = np.array([[4, 0, 0], [6, 1, 0], [6, 1, 3], [4, 0, 3.0]]), np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)


@pytest.mark.parametrize(("bodies", "count"), [([PLATE], 4), ([PLATE, WING], 7)])
@pytest.mark.parametrize("turned", [(), (0,), (0, 1)])
def test_open_sheets_are_as_double_sided_ones(bodies: list[Mesh], count: int, turned: tuple[int, ...]) -> None:
    """Free edges of a half-plane, and a bend where two sheets meet, whichever way their faces look."""
    one = [(p, f[:, ::-1] if k in turned else f) for k, (p, f) in enumerate(bodies)]
    open_sheets = wedges_of(one, sheets=True)
    double = wedges_of([both_sides(mesh) for mesh in bodies])
    assert open_sheets == double and len(double) == count


def test_sheets_end_at_walls_and_on_the_ground() -> None:
    """A fence that stands on the ground and ends at a wall has its upper edge and one upright."""
    ground = prism([(-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0)], -1.0, 0.0)
    house = prism([(-9.0, -4.0), (0.0, -4.0), (0.0, 4.0), (-9.0, 4.0)], 0.0, 8.0)
    alone = wedges_of([ground, house])
    for wedges in (
        wedges_of([ground, house, PLATE], sheets=True),
        wedges_of([ground, house, both_sides(PLATE)]),
    ):
        assert sorted(set(wedges) - set(alone)) == sorted(
            [
                ((0.0, 0.0, 3.0), (4.0, 0.0, 3.0), (0.0, -1.0, 0.0), (0.0, 1.0, 0.0)),
                ((4.0, 0.0, 0.0), (4.0, 0.0, 3.0), (0.0, -1.0, 0.0), (0.0, 1.0, 0.0)),
            ]
        )
        assert set(alone) <= set(wedges)


def test_no_path_bends_at_the_joint_of_a_flat_facade(device: str) -> None:
    """Two flush houses of 10 m and 12 m: the same paths over edges as one house with a step in its roof."""
    tx, rx = (-6.0, -9.0, 2.0), (7.0, -6.0, 5.0)
    config = oracle.channel(carriers_hz=(3.5e9,), diffraction=True, pattern="iso")
    bodies = [prism(HOUSE, 0.0, 10.0), prism(neighbor(0.0), 0.0, 12.0)]
    found = {}
    for name, part in (("two", bodies), ("far", [bodies[0], (bodies[1][0] + [0.2, 0, 0], bodies[1][1])])):
        parts = [MeshPart(f"Buildings/house_{k}", *mesh, "wall", "building") for k, mesh in enumerate(part)]
        arrays = oracle.link_scene(parts, tx, rx, materials=oracle.radio_materials({"wall": CONCRETE}))
        _, paths = oracle.solve(arrays, config, device)
        assert (paths.kind == PATH_LOS).sum() == 1
        points = paths.vertex[paths.kind == PATH_DIFFRACTION, 0]
        found[name] = points[(np.abs(points[:, :2]) < 0.3).all(axis=1)]
    assert len(found["two"]) == 0 and len(found["far"]) > 0  # a gap between them has edges


@pytest.mark.parametrize(("limit", "count"), [(0.05, 0), (0.04, 1)])
def test_the_limit_of_bends_is_an_option(limit: float, count: int, device: str) -> None:
    """A facade that bends back by 0.044 rad, as in Munich, diffracts where the limit is lower."""
    roof = [(0.0, 0.0), (9.0, 9 * np.tan(0.044)), (9.0, 20.0), (-9.0, 20.0), (-9.0, 0.0)]
    house = MeshPart("Buildings/house", *prism(roof, 0.0, 9.0), "wall", "building")
    arrays = oracle.link_scene(
        [house], (-5.0, -6.0, 3.0), (6.0, -4.0, 4.0), materials=oracle.radio_materials({"wall": CONCRETE})
    )
    config = oracle.channel(
        carriers_hz=(3.5e9,), diffraction=True, diffraction_min_bend_rad=limit, specular_reflection=False
    )
    _, paths = oracle.solve(arrays, config, device)
    points = paths.vertex[paths.kind == PATH_DIFFRACTION, 0]
    assert (np.abs(points[:, :2]) < 1e-6).all(axis=1).sum() == count


@pytest.mark.parametrize("limit", [0.0, -0.1, 1.6, float("nan")])
def test_the_limit_of_bends_has_a_range(limit: float) -> None:
    with pytest.raises(InputError, match="diffraction_min_bend_rad"):
        mmw.PathSolver(diffraction=True, diffraction_min_bend_rad=limit)
