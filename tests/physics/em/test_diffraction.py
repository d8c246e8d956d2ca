"""Diffraction: wedges of meshes, points on edges by brute force, boundaries, exact wedges, knife edges."""

import numpy as np
import pytest
from scipy.special import fresnel, hankel2, wofz

from mmw.channel.path_solver.edge_table import find_wedges
from mmw.channel.path_solver.surface_table import make_surface_table
from mmw.channel.paths import PATH_DIFFRACTION, PATH_LOS, PATH_SPECULAR, PathSet
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.planar_surfaces import find_surfaces
from mmw.core.transforms import make_pose, rotate, transform_points
from mmw.physics.em.transition import transition
from mmw.physics.materials.material import RadioMaterial
from mmw.scene.mesh_edges import MeshEdges, find_edges
from mmw.scene.scene_data import SceneData
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.device_rays import loaded
from tests.fixtures.scenes import arrays_from_parts, box_mesh, box_model, ground_part, pose, wall_part
from tests.oracles import channel as oracle
from tests.oracles.channel import DIFFRACTION

CARRIER_HZ = 3.5e9
WAVE = 2 * np.pi * CARRIER_HZ / SPEED_OF_LIGHT
CONDUCTOR = RadioMaterial("itu", itu="itu_pec")
METAL = RadioMaterial("itu", itu="itu_metal")
CONCRETE = RadioMaterial("itu", itu="itu_concrete")
DIFFRACTED = oracle.channel(carriers_hz=(CARRIER_HZ,), diffraction=True, pattern="iso")


def with_surfaces(points: np.ndarray, faces: np.ndarray) -> tuple[MeshEdges, np.ndarray]:
    """Return the edges of a mesh of one object, and the surface of each face."""
    nothing = np.zeros(len(faces), dtype=np.int32)
    return find_edges(points, faces), find_surfaces(points, faces, nothing, nothing)


def edges_of(points: np.ndarray, faces: np.ndarray) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    """Return both ends of every wedge of a mesh, sorted."""
    begin, end = find_wedges(*with_surfaces(points, faces))[:2]
    return sorted(tuple(sorted(map(tuple, np.round([a, b], 6).tolist()))) for a, b in zip(begin, end, strict=True))


def split(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a mesh with every triangle cut into four, vertices not shared."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    corners = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return corners.reshape(-1, 3), np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)


def prism(outline: list[tuple[float, float]], low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """Return an upright prism; `outline` is counter-clockwise and its fan from the first corner covers it."""
    count = len(outline)
    points = np.array([(x, y, z) for z in (low, high) for x, y in outline])
    faces = [(count, count + k, count + k + 1) for k in range(1, count - 1)]
    faces += [(0, k + 1, k) for k in range(1, count - 1)]
    for k in range(count):
        j = (k + 1) % count
        faces += [(k, j, count + j), (k, count + j, count + k)]
    return points, np.array(faces, dtype=np.int32)


def test_wedges_of_a_box() -> None:
    points, faces = box_mesh((2.0, 3.0, 4.0), (1.0, 0.5, -2.0))
    edges = edges_of(points, faces)
    assert len(edges) == 12
    lengths = sorted(round(float(np.linalg.norm(np.subtract(*edge))), 9) for edge in edges)
    assert lengths == [2.0] * 4 + [3.0] * 4 + [4.0] * 4
    assert edges_of(*split(*split(points, faces))) == edges  # pieces of an edge are one edge
    assert edges_of(points[faces].reshape(-1, 3), np.arange(36, dtype=np.int32).reshape(-1, 3)) == edges
    assert edges_of(points, faces[:, ::-1]) == edges  # closed and inside out: it is turned
    assert edges_of(points, np.concatenate([faces[:6, ::-1], faces[6:]])) != edges  # faces that disagree are not
    n0, nn = find_wedges(*with_surfaces(points, faces))[2:4]
    assert np.abs(np.einsum("ex,ex->e", n0, nn)).max() < 1e-12


def test_wedges_of_an_l_shape() -> None:
    outline = [(0.0, 0.0), (4.0, 0.0), (4.0, 1.0), (1.0, 1.0), (1.0, 3.0), (0.0, 3.0)]
    edges = edges_of(*prism(outline, 0.0, 2.5))
    upright = [edge for edge in edges if edge[0][:2] == edge[1][:2]]
    assert len(edges) == 17 and len(upright) == 5 and (1.0, 1.0) not in {edge[0][:2] for edge in upright}


@pytest.mark.parametrize("inner", [1e-3, 0.02, 0.06, 1.0, 2.0, np.pi - 0.06])
def test_wedges_of_any_angle(inner: float) -> None:
    """From a knife to an almost flat roof."""
    outline = [(0.0, 0.0), (9 * np.cos(inner), 9 * np.sin(inner)), (9.0, 0.0)][::-1]
    upright = [edge for edge in edges_of(*prism(outline, -1.0, 1.0)) if edge[0][:2] == edge[1][:2] == (0.0, 0.0)]
    assert len(upright) == 1


def test_flat_edges_diffract_nothing() -> None:
    outline = [(0.0, 0.0), (-9.0, -9 * np.tan(0.04)), (0.0, -4.0), (9.0, 0.0)]
    upright = {edge[0][:2] for edge in edges_of(*prism(outline, -1.0, 1.0)) if edge[0][:2] == edge[1][:2]}
    assert upright == {(-9.0, round(-9 * np.tan(0.04), 6)), (0.0, -4.0), (9.0, 0.0)}


def test_transition_function() -> None:
    """Against scipy's Fresnel integrals, and its Faddeeva function for large arguments."""
    x = np.concatenate([[0.0], np.logspace(-12, 6, 400), np.linspace(5.9, 6.1, 50)])
    s, c = fresnel(np.sqrt(2 * x / np.pi))
    integral = np.sqrt(np.pi / 2) * ((0.5 - c) - 1j * (0.5 - s))
    near = x < 1e3
    np.testing.assert_allclose(
        transition(x)[near], (2j * np.sqrt(x) * np.exp(1j * x) * integral)[near], rtol=1e-10, atol=1e-14
    )
    z = np.sqrt(x) * np.exp(0.25j * np.pi)
    faddeeva = 1j * np.sqrt(np.pi * x) * np.exp(-0.25j * np.pi) * wofz(1j * z)
    np.testing.assert_allclose(transition(x), faddeeva, rtol=1e-12, atol=1e-15)
    assert transition(np.array([1e6]))[0] == pytest.approx(1.0, abs=1e-6)


def wedge_scene(inner: float, radio: RadioMaterial, tx: tuple, rx: list[tuple]) -> SceneData:
    """Return a wedge whose edge is the z axis; one face is y = 0, x > 0, the other lies `inner` [rad] below it."""
    outline = [(0.0, 0.0), (40 * np.cos(inner), -40 * np.sin(inner)), (40.0, 0.0)]
    points, faces = prism(outline, -30.0, 30.0)
    part = MeshPart("Buildings/wedge", points, faces, "wall", "building")
    return oracle.link_scene([part], tx, *rx, materials=oracle.radio_materials({"wall": radio}))


def around(distance: float, angle: float, z: float = 0.0) -> tuple[float, float, float]:
    """Return a place around the edge, `angle` [rad] from the face y = 0."""
    return distance * np.cos(angle), distance * np.sin(angle), z


def at_the_edge(paths: PathSet) -> np.ndarray:
    """Return which paths there would be if the wedge were endless: no others than over the edge x = y = 0."""
    return (paths.kind != PATH_DIFFRACTION) | (np.abs(paths.vertex[:, 0, :2]).max(axis=1) < 1e-6)


def field_at(paths: PathSet, link: int, dipole: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the sum of all field vectors at a receiver [3], and that of the line of sight, for a short dipole."""
    fields = {kind: np.zeros(3, complex) for kind in (PATH_LOS, PATH_SPECULAR, PATH_DIFFRACTION)}
    for p in np.nonzero((paths.link == link) & at_the_edge(paths))[0]:
        sent, received = (
            oracle.sphere_axes(np.array([np.sin(t) * np.cos(f), np.sin(t) * np.sin(f), np.cos(t)]))
            for t, f in ((paths.theta_t[p], paths.phi_t[p]), (paths.theta_r[p], paths.phi_r[p]))
        )
        phase = np.exp(-1j * WAVE * SPEED_OF_LIGHT * paths.tau[p])
        fields[int(paths.kind[p])] += (
            np.array(received).T @ paths.transfer["sunny"][p, 0] @ np.array(sent) @ dipole * phase
        )
    return sum(fields.values(), np.zeros(3)), fields[PATH_LOS]


DIPOLES = {"along": np.array([0.0, 0.0, 1.0]), "across": np.array([0.6, -0.8, 0.0])}


@pytest.mark.parametrize("dipole", sorted(DIPOLES))
@pytest.mark.parametrize("boundary", ["shadow", "reflection", "far face"])
@pytest.mark.parametrize("radio", [CONDUCTOR, METAL, CONCRETE], ids=["conductor", "metal", "concrete"])
@pytest.mark.parametrize("rise", [0.0, 3.0])
def test_field_is_continuous(rise: float, radio: RadioMaterial, boundary: str, dipole: str, device: str) -> None:
    """A path comes or goes at a boundary, the sum of all paths does not jump; also at oblique incidence.

    `shadow`: of the line of sight; `reflection`: of that at the near face; `far face`: of that at the other face, with
    both faces lit.
    """
    source = np.radians(130.0 if boundary == "far face" else 50.0)
    angle = {"shadow": np.pi + source, "reflection": np.pi - source, "far face": 2 * np.pi - source}[boundary]
    step = 2e-5
    rx = [around(4.0, angle + k * step, rise) for k in (-1, 1)]
    tx = around(5.0, source, 0.3)
    _, paths = oracle.solve(wedge_scene(np.pi / 2, radio, tx, rx), DIFFRACTED, device)
    (one, direct), (two, other_direct) = (field_at(paths, link, DIPOLES[dipole]) for link in (0, 1))
    scale = max(np.linalg.norm(direct), np.linalg.norm(other_direct))
    counts = [(paths.link == link)[(paths.kind != PATH_DIFFRACTION)].sum() for link in (0, 1)]
    assert abs(counts[0] - counts[1]) == 1
    turn = np.exp(1j * WAVE * np.diff([np.linalg.norm(np.subtract(p, tx)) for p in rx])[0])
    assert np.linalg.norm(two * turn - one) < 0.01 * scale


@pytest.mark.parametrize("dipole", sorted(DIPOLES))
@pytest.mark.parametrize("radio", [CONDUCTOR, CONCRETE], ids=["conductor", "concrete"])
def test_field_is_continuous_as_a_face_gets_dark(radio: RadioMaterial, dipole: str, device: str) -> None:
    """The source goes through the plane of the far face, which lights it or not at grazing angles."""
    totals, direct = [], np.zeros(3)
    rx = around(4.0, 1.5 * np.pi - 0.6, 1.0)
    for side in (-1, 1):
        tx = around(5.0, np.pi / 2 + side * 1e-5, 0.3)
        _, paths = oracle.solve(wedge_scene(np.pi / 2, radio, tx, [rx]), DIFFRACTED, device)
        total, direct = field_at(paths, 0, DIPOLES[dipole])
        totals.append(total * np.exp(1j * WAVE * np.linalg.norm(np.subtract(rx, tx))))
    assert np.linalg.norm(totals[1] - totals[0]) < 0.03 * np.linalg.norm(direct)


NEAR, FAR = 4.0, 5.0
"""Distances of receivers and source from the edge, in the comparisons with the series [m]."""


def series_errors(paths: PathSet, angles: np.ndarray, n: float, source: float, polarization: str) -> list[float]:
    """Return how far the paths, as waves of a line source, are from the exact series at each angle, over the direct."""
    keep, axis = at_the_edge(paths), 0 if polarization == "soft" else 1
    sign = 1.0 if polarization == "soft" else -1.0  # phi looks the other way at the far end
    errors = []
    for link, angle in enumerate(angles):
        total = 0.0
        for p in np.nonzero((paths.link == link) & keep)[0]:
            gain = sign * paths.transfer["sunny"][p, 0, axis, axis] * 2 * WAVE  # over lambda / (4 pi)
            length = paths.tau[p] * SPEED_OF_LIGHT
            if paths.kind[p] == PATH_DIFFRACTION:
                coefficient = gain * np.sqrt(FAR * NEAR * (FAR + NEAR))
                total += hankel2(0, WAVE * FAR) * coefficient * np.exp(-1j * WAVE * NEAR) / np.sqrt(NEAR)
            else:
                total += gain * length * hankel2(0, WAVE * length)
        exact = oracle.wedge_field(n, WAVE, NEAR, angle, FAR, source, soft=polarization == "soft")
        errors.append(abs(total - exact) / abs(hankel2(0, WAVE * (NEAR + FAR))))
    return errors


@pytest.mark.parametrize("polarization", ["soft", "hard"])
@pytest.mark.parametrize(("inner_deg", "source_deg"), [(4, 60), (30, 110), (60, 30), (90, 50), (90, 130), (120, 100)])
def test_conducting_wedge_against_eigenfunctions(
    inner_deg: float, source_deg: float, polarization: str, device: str
) -> None:
    """The solver's paths, as waves of a line source, against the exact series, all around the wedge."""
    n, source = 2 - inner_deg / 180, np.radians(source_deg)
    angles = np.linspace(0.03, n * np.pi - 0.03, 40)
    rx = [around(NEAR, angle) for angle in angles]
    _, paths = oracle.solve(wedge_scene(np.radians(inner_deg), CONDUCTOR, around(FAR, source), rx), DIFFRACTED, device)
    errors = series_errors(paths, angles, n, source, polarization)
    assert max(errors) < 0.005, f"{max(errors):.3f} at {np.degrees(angles[int(np.argmax(errors))]):.0f} degrees"


def test_knife_edge(device: str) -> None:
    """A thin wedge at small angles against Fresnel's knife edge. Source: ITU-R P.526-15, section 4.1."""
    distance, shifts = 12.0, np.linspace(-1.0, 1.0, 21) + 0.013
    rx = [(2 * shift, -distance, 0.0) for shift in shifts]
    arrays = wedge_scene(0.06, CONDUCTOR, (0.0, distance, 0.0), rx)
    _, paths = oracle.solve(arrays, DIFFRACTED, device)
    nu = shifts * np.sqrt(2 * WAVE / (2 * np.pi) * (2 / distance))
    s, c = fresnel(nu)
    knife = (1 + 1j) / 2 * ((0.5 - c) - 1j * (0.5 - s))
    for link in range(len(rx)):
        total, _ = field_at(paths, link, DIPOLES["along"])
        length = np.linalg.norm(np.subtract(rx[link], arrays.poses[0, 0, :3]))
        free = np.exp(-1j * WAVE * length) / (2 * WAVE * length)
        assert abs(abs(total[2] / free) - abs(knife[link])) < 0.03


def test_bodies_are_turned_one_by_one() -> None:
    one, other = box_mesh((2.0, 3.0, 4.0)), box_mesh((1.0, 1.0, 1.0), (10.0, 0.0, 0.0))
    together = np.concatenate([one[0], other[0]]), np.concatenate([one[1], other[1] + len(one[0])])
    edges = edges_of(*together)
    assert len(edges) == 24
    for turned in ([0], [1], [0, 1]):
        faces = together[1].copy()
        for body in turned:
            own = slice(12 * body, 12 * body + 12)
            faces[own] = faces[own, ::-1]
        assert edges_of(together[0], faces) == edges
        assert edges_of(*split(together[0] + 1e4, faces)) == edges_of(together[0] + 1e4, together[1])


def test_a_room_has_no_edge_inside_however_its_faces_look(device: str) -> None:
    """Corners of a room are concave; from outside the same box has its twelve edges."""
    found = {}
    for is_turned in (False, True):
        points, faces = box_mesh((8.0, 6.0, 3.0))
        room = MeshPart("room", points, faces[:, ::-1] if is_turned else faces, "wall", "building")
        ends = {"inside": ((-3, -2, 0), (3, 1.5, 0.5)), "outside": ((-9, -7, 0), (9, -7, 1))}
        for place, (tx, rx) in ends.items():
            arrays = oracle.link_scene([room], tx, rx, materials=oracle.radio_materials({"wall": METAL}))
            _, paths = oracle.solve(arrays, DIFFRACTED, device)
            bent = paths.kind == PATH_DIFFRACTION
            found[place, is_turned] = sorted(np.round(paths.tau[bent] * 1e12).tolist())
    assert found["inside", False] == found["inside", True] == []
    assert found["outside", False] == found["outside", True] != []


def test_edges_of_open_sheets() -> None:
    """A sheet has its outline, in whole edges however it is cut; a closed body has none but its own."""
    points, faces = np.array([[0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 3, 0.0]]), np.array([[0, 1, 2], [0, 2, 3]])
    for mesh in ((points, faces), split(points, faces)):
        begin, end, n0, nn, away, *_ = find_wedges(*with_surfaces(*mesh), sheets=True)
        assert sorted(np.round(np.linalg.norm(end - begin, axis=1), 9)) == [3.0, 3.0, 4.0, 4.0]
        np.testing.assert_allclose(n0, -nn)
        assert (np.einsum("ex,ex->e", away, 0.5 * (begin + end) - [2, 1.5, 0]) > 1.0).all()
        assert len(find_wedges(*with_surfaces(*mesh))[0]) == 0
        both = mesh[0], np.concatenate([mesh[1], mesh[1][:, ::-1]])  # back to back, as double-sided exports have them
        begin, end, n0, nn, away, *_ = find_wedges(*with_surfaces(*both))
        assert sorted(np.round(np.linalg.norm(end - begin, axis=1), 9)) == [3.0, 3.0, 4.0, 4.0]
        np.testing.assert_allclose(n0, -nn)
        assert (np.einsum("ex,ex->e", away, 0.5 * (begin + end) - [2, 1.5, 0]) > 1.0).all()
    box = box_mesh((2.0, 3.0, 4.0))
    assert len(find_wedges(*with_surfaces(*box), sheets=True)[0]) == 12


@pytest.mark.parametrize("polarization", ["soft", "hard"])
@pytest.mark.parametrize("source_deg", [35, 120])
@pytest.mark.parametrize("sides", [1, 2])
def test_conducting_sheet_against_eigenfunctions(sides: int, source_deg: float, polarization: str, device: str) -> None:
    """The edge of a conducting half-plane, all around it: the sheet lies in the half-plane of angle 0. With faces on
    both sides it is a wedge by itself."""
    angles, source = np.linspace(0.03, 2 * np.pi - 0.03, 40), np.radians(source_deg)
    corners = np.array([[0, 0, -300], [300, 0, -300], [300, 0, 300], [0, 0, 300.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]], dtype=np.int32)[: 2 * sides]
    sheet = MeshPart("sheet", corners, faces, "wall", "building")
    rx = (around(NEAR, angle) for angle in angles)
    arrays = oracle.link_scene([sheet], around(FAR, source), *rx, materials=oracle.radio_materials({"wall": CONDUCTOR}))
    _, paths = oracle.solve(arrays, DIFFRACTED.model_copy(update={"edge_diffraction": sides == 1}), device)
    assert max(series_errors(paths, angles, 2.0, source, polarization)) < 0.005


def test_lit_region_can_be_left_out(device: str) -> None:
    """Without it a diffracted path stands only where the edge hides the source."""
    source = np.radians(50.0)
    angles = np.radians([20.0, 100.0, 160.0, 225.0, 235.0, 265.0])
    arrays = wedge_scene(np.pi / 2, CONCRETE, around(5.0, source), [around(4.0, angle) for angle in angles])
    counts = {}
    for lit in (True, False):
        _, paths = oracle.solve(arrays, DIFFRACTED.model_copy(update={"diffraction_lit_region": lit}), device)
        own = at_the_edge(paths) & (paths.kind == PATH_DIFFRACTION)
        counts[lit] = np.bincount(paths.link[own], minlength=6).tolist()
        assert np.bincount(paths.link[paths.kind == PATH_LOS], minlength=6).tolist() == [1, 1, 1, 1, 0, 0]
    assert counts == {True: [1] * 6, False: [0, 0, 0, 0, 1, 1]}


def boxes(seed: int, radio: RadioMaterial, town: int) -> tuple[SceneData, tuple[oracle.ConvexEdge, ...]]:
    """Return boxes in any attitude, `town` of them in the town and one a vehicle, with three ends, and all edges.

    Without a box in the town there is ground and a wall in it.
    """
    rng = np.random.default_rng(seed)
    turn = rng.normal(size=(town + 1, 4))
    bodies = make_pose(rng.uniform(-3.5, 3.5, (town + 1, 3)), turn / np.linalg.norm(turn, axis=1, keepdims=True))
    sizes = rng.uniform(0.8, 3.0, (town + 1, 3))
    parts = [
        MeshPart(f"Buildings/box_{k}", transform_points(bodies[k], points), faces, "wall", "building")
        for k, (points, faces) in enumerate(box_mesh(size) for size in sizes[:town])
    ]
    if town == 0:
        parts = [ground_part(20.0, -5.0, "wall"), wall_part("wall", (-20.0, 6.0), (20.0, 6.0), 9.0, "wall")]
    model = box_model("van", sizes[town], (0.0, 0.0, 0.0))
    actors = [("veh_001", "vehicle", 0), ("rsu_1", "rsu", -1), ("cav_1", "cav", -1), ("cav_2", "cav", -1)]
    ends = [pose(*p) for p in rng.uniform([-6, -6, -4], [6, 5.5, 6], (3, 3))]
    materials = oracle.radio_materials({"wall": radio})
    poses = np.concatenate([bodies[town:], ends])[None]
    arrays, edges = arrays_from_parts(parts, [model], actors, poses, materials=materials), []
    for k in range(town + 1):
        surface = arrays.surface[12 * k : 12 * k + 12] if k < town else arrays.town_surface_count + model.surface
        for axis in range(3):
            for signs in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
                others = [(axis + 1) % 3, (axis + 2) % 3]
                ends, normal = np.zeros((2, 3)), np.zeros((2, 3))
                ends[:, axis] = -sizes[k, axis] / 2, sizes[k, axis] / 2
                for j, (other, sign) in enumerate(zip(others, signs, strict=True)):
                    ends[:, other], normal[j, other] = sign * sizes[k, other] / 2, sign
                own = tuple(int(surface[4 * o + (2 if s > 0 else 0)]) for o, s in zip(others, signs, strict=True))
                edges.append(oracle.ConvexEdge(transform_points(bodies[k], ends), rotate(bodies[k, 3:], normal), own))
    return arrays, tuple(edges)


@pytest.mark.parametrize(("town", "depth", "refraction"), [(2, 2, False), (1, 2, True), (0, 3, False)])
@pytest.mark.parametrize("seed", range(4))
def test_diffraction_against_brute_force(town: int, depth: int, refraction: bool, seed: int, device: str) -> None:
    """Every edge by golden section, alone and with reflections before and behind it, through walls or not."""
    radio = RadioMaterial("constant", relative_permittivity=4.0, conductivity=0.1, thickness=0.02)
    arrays, edges = boxes(seed, radio, town)
    config = oracle.channel(max_depth=depth, diffraction=True, refraction=refraction)
    scene = loaded(arrays, device, [0])
    table = make_surface_table(scene, wedges=True)
    pairs = [{a, b} for a, b in zip(table.wedges.surface_0.tolist(), table.wedges.surface_n.tolist(), strict=True)]
    assert sorted(map(sorted, pairs)) == sorted(sorted(edge.surface) for edge in edges)
    number = [next(k for k, edge in enumerate(edges) if set(edge.surface) == pair) for pair in pairs]
    links, paths = oracle.solve(arrays, config, device)
    slabs = frozenset(range(len(table)) if refraction else ())
    doubts = 0
    for link in range(len(links)):
        wanted = oracle.brute_force(arrays, 0, links.tx.position[link], links.rx.position[link], depth, slabs, edges)
        own = {
            tuple((k, number[s] if k == DIFFRACTION else s) for k, s in c): p
            for c, p in oracle.paths_by_interactions(paths, link).items()
        }
        both, doubtful = oracle.matched(own, wanted)
        for steps, p, path in both:
            np.testing.assert_allclose(paths.vertex[p, : len(steps)], path.point[1:-1], atol=1e-5)
            np.testing.assert_allclose(paths.tau[p] * SPEED_OF_LIGHT, path.length, rtol=1e-11)
        doubts += doubtful
    assert (paths.kind == PATH_DIFFRACTION).any() and doubts < 8


def test_launched_diffraction_is_a_subset(device: str, record_property) -> None:
    options = {"max_depth": 2, "diffraction": True, "samples_per_tx": 50_000}
    found, missed = np.sum(
        [oracle.launched_share(boxes(k, CONCRETE, 2)[0], device, **options) for k in range(8)], axis=0
    )
    record_property("share_missed", float(missed / found))
    assert found > 60 and missed <= 0.03 * found
