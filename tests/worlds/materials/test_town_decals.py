"""Towns in the camera: crowns, their normals, and the texture coordinates of windows, signs and boards."""

import numpy as np
import pytest
from pxr import UsdGeom

from mmw.worlds.materials.town_decals import ROOMS, SHOPS, SIGN_CELLS, SIGNS
from mmw.worlds.materials.vehicle_decals import cell
from mmw.worlds.towns import primitives as solids
from mmw.worlds.towns import trees
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.picture_uv import picture_coordinates
from mmw.worlds.towns.props import PROPS, build_prop
from mmw.worlds.towns.smooth_normals import corner_normals, part_normals
from tests.fixtures import town_checks as checks
from tests.fixtures.meshes import volume


@pytest.mark.parametrize("frequency", [1, 2, 3, 4])
def test_sphere_is_closed_round_and_looks_outward(frequency: int) -> None:
    mesh = trees.sphere(frequency)
    assert len(mesh.faces) == 20 * frequency**2 and len(mesh.points) == 10 * frequency**2 + 2
    assert np.linalg.norm(mesh.points, axis=1) == pytest.approx(1.0)
    edges = {tuple(edge) for face in mesh.faces.tolist() for edge in zip(face, np.roll(face, -1).tolist(), strict=True)}
    assert len(edges) == 3 * len(mesh.faces) and all((b, a) in edges for a, b in edges)
    assert 0 < volume(mesh) < 4 / 3 * np.pi


@pytest.mark.parametrize("seed", range(6))
def test_crown_keeps_its_bounds_and_no_face_is_turned_in(seed: int) -> None:
    mesh = trees.crown(np.random.default_rng(seed), 1.6, 2.0, 7.0, 10, 3)
    assert np.hypot(*mesh.points[:, :2].T).max() == pytest.approx(1.6)
    assert [mesh.points[:, 2].min(), mesh.points[:, 2].max()] == pytest.approx([2.0, 7.0])
    assert volume(mesh) > 0.25 * np.pi * 1.6**2 * 5.0 * 2 / 3


def test_every_sign_of_a_prop_exists_and_differs_by_seed_in_trees() -> None:
    for kind in PROPS:
        for part in build_prop("p", kind, (0, 0, 0), 0.0, np.random.default_rng(0)):
            picture_coordinates(part)  # raises for a sign that does not exist
    tall = {build_prop("t", "oak", (0, 0, 0), 0.0, np.random.default_rng(k))[1].points[:, 2].max() for k in range(4)}
    assert len(tall) == 4


def test_normals_of_a_ball_are_its_radii_and_a_box_is_flat() -> None:
    ball = trees.sphere(4)
    normals = corner_normals(ball, 80.0)
    assert normals is not None
    assert np.abs(np.einsum("fcx,fcx->fc", normals, ball.points[ball.faces]) - 1.0).max() < 0.01
    cube = solids.box((1, 2, 3), (0, 0, 0))
    assert corner_normals(cube, 80.0) is None
    part = MeshPart("Props/x_001/crown", ball.points, ball.faces, "foliage", "vegetation")
    found = part_normals(part)
    assert found is not None and found.shape == ball.points.shape


def test_a_pole_is_round_and_its_end_is_flat() -> None:
    mesh = solids.lathe([(0.1, 0.0), (0.1, 3.0)], 5)
    normals = corner_normals(mesh, 75.0)
    assert normals is not None
    upward = np.abs(normals[..., 2])
    assert ((upward < 1e-6) | (upward > 1 - 1e-6)).all()
    side = normals[upward[:, 0] < 0.5]
    outward = mesh.points[mesh.faces[upward[:, 0] < 0.5]][..., :2] / 0.1
    assert side[..., :2] == pytest.approx(outward, abs=1e-3)


def front_of(part: MeshPart, toward: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points [K, 3] and coordinates [K, 2] of the corners of faces that look a way."""
    st = picture_coordinates(part)
    assert st is not None
    seen = part.mesh.normals @ toward > 0.99
    return part.mesh.corners[seen].reshape(-1, 3), st[seen].reshape(-1, 2)


@pytest.mark.parametrize("yaw", [0.0, 1.1, 4.0])
def test_signs_are_upright_and_not_mirrored(yaw: float) -> None:
    parts = build_prop("s", "stop_sign", (3, 4, 5), yaw, np.random.default_rng(0))
    part = next(part for part in parts if part.path.endswith("/stop"))
    toward = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    points, st = front_of(part, toward)
    right = np.array([-np.sin(yaw), np.cos(yaw), 0.0])  # of somebody who looks at the sign
    u0, v0, u1, v1 = cell(SIGNS.index("stop"), SIGN_CELLS)
    assert [*st.min(axis=0), *st.max(axis=0)] == pytest.approx([u0, v0, u1, v1])
    assert np.corrcoef(points @ right, st[:, 0])[0, 1] > 0.999
    assert np.corrcoef(points[:, 2], st[:, 1])[0, 1] > 0.999


def test_windows_show_whole_rooms_and_boards_one_name() -> None:
    across, heights = np.array([0.0, 0.2, 0.5, 1.0]), np.array([0.0, 1.0, 2.5])
    mesh = solids.wall_cells((0, 0), (10, 0), across, heights, np.array([[-1, -1, -1], [0, -1, 0]]))[0]
    st = picture_coordinates(MeshPart("Buildings/b/glass", mesh.points, mesh.faces, "window_glass", "building"))
    assert st is not None
    corners = mesh.points[mesh.faces]
    rooms = st * ROOMS
    for first, rooms_wide in ((0, 1), (2, 3)):  # windows of 2 and of 5 m
        own, points = rooms[first : first + 2].reshape(-1, 2), corners[first : first + 2].reshape(-1, 3)
        assert own == pytest.approx(np.round(own)) and np.ptp(own, axis=0).tolist() == [rooms_wide, 1]
        assert np.corrcoef(points[:, 0], own[:, 0])[0, 1] > 0.99 and np.corrcoef(points[:, 2], own[:, 1])[0, 1] > 0.99
    board = solids.box((6.0, 0.2, 0.5), (0, 0, 3))
    part = MeshPart("Buildings/b/sign", board.points, board.faces, "shop_sign", "building")
    points, found = front_of(part, np.array([0.0, -1.0, 0.0]))
    assert np.corrcoef(points[:, 0], found[:, 0])[0, 1] > 0.999
    assert np.ptp(found, axis=0) == pytest.approx([1.0, 1 / len(SHOPS)])
    with pytest.raises(ValueError, match="shows pictures on rectangles"):
        picture_coordinates(MeshPart("Buildings/b/glass", board.points, board.faces[:3], "window_glass", "building"))


def test_texture_wraps_around_a_round_pier_without_a_seam_and_a_square_one_is_a_wall() -> None:
    """Side by side faces of a round column meet at whole tiles; a meter of either kind is about one of texture."""
    for sides, radius in ((12, 0.7), (4, 0.7)):
        column = solids.place(solids.prism(solids.circle(radius, sides), -0.5, 8.0), (30.0, -70.0, 0.0), 0.3)
        part = MeshPart("Bridges/r/piers", column.points, column.faces, "concrete_structure", "bridge")
        st = picture_coordinates(part)
        assert st is not None and (part_normals(part) is not None) == (sides == 12)
        corners = column.points[column.faces]
        is_side = np.ptp(corners[:, :, 2], axis=1) > 1.0
        lengths = [np.linalg.norm(v - np.roll(v, 1, axis=1), axis=2)[is_side] for v in (corners, st)]
        assert lengths[1] == pytest.approx(lengths[0], rel=0.12 if sides == 12 else 1e-3)
        if sides == 12:
            for point in range(len(column.points)):
                at = st[is_side][(column.faces[is_side] == point)]
                tiles = (at[:, 0] - at[:1, 0]) / 4.0 if len(at) else np.zeros(0)
                assert tiles == pytest.approx(np.round(tiles), abs=1e-6)


def test_lights_of_facing_arms_show_green_and_the_others_red() -> None:
    stage = checks.stage_of("town10")
    lit: dict[str, set[int]] = {"signal_red": set(), "signal_green_lit": set()}
    for prim in stage.GetPrimAtPath("/Town/Props").GetChildren():
        if not prim.GetName().startswith("traffic_light"):
            continue
        bound = {child.GetRelationship("material:binding").GetTargets()[0].name for child in prim.GetChildren()}
        (lamp,) = bound & set(lit)
        assert ("signal_red_dark" in bound) == (lamp == "signal_green_lit") == ("signal_green" not in bound)
        case = np.array(UsdGeom.Mesh(prim.GetChild("heads")).GetPointsAttr().Get())
        post = np.array(UsdGeom.Mesh(prim.GetChild("post")).GetPointsAttr().Get())
        foot = post[post[:, 2] < 0.5][:, :2].mean(axis=0)
        if np.linalg.norm(foot - (-47.0, -19.0)) < 35.0:  # crossroad X; the arm reaches across its road
            reach = case[case[:, 2] > 5.0][:, :2].mean(axis=0) - foot
            lit[lamp].add(int(np.argmax(np.abs(reach))))
    assert len(lit["signal_red"]) == len(lit["signal_green_lit"]) == 1 and lit["signal_red"] != lit["signal_green_lit"]
