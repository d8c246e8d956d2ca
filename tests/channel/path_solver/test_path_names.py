"""Names of paths over frames in which their points move on, and other paths come and go."""

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import warp as wp

from mmw.channel.path_solver.path_names import path_names, tell_apart
from mmw.channel.paths import PathSet
from mmw.core.planar_surfaces import find_surfaces
from mmw.kernels.channel.path_names import NamedSurfaces
from mmw.physics.em.interaction import DIFFRACTION, DIFFUSE, SPECULAR, TRANSMISSION
from mmw.physics.materials.material import RadioMaterial
from mmw.scene.scene_data import Prototype
from tests.fixtures.scenes import arrays_from_parts, pose, quad_part
from tests.oracles import channel as oracle

MATERIALS = oracle.radio_materials(
    {
        "metal": RadioMaterial("itu", itu="itu_pec"),
        "glass": RadioMaterial("constant", relative_permittivity=6.3, conductivity=0.03, thickness=0.006),
    }
)


def body_of(profile: Callable[[np.ndarray], np.ndarray]) -> Prototype:
    """Return a sheet of 4.8 m x 0.8 m, in facets of 0.05 m, whose height follows from x [m]."""
    x, y = np.meshgrid(np.linspace(-2.4, 2.4, 97), [-0.4, 0.4], indexing="ij")
    points = np.stack([x, y, profile(x)], axis=-1).reshape(-1, 3)
    a = 2 * np.arange(96)
    faces = np.concatenate([np.stack([a, a + 2, a + 3], axis=1), np.stack([a, a + 3, a + 1], axis=1)]).astype(np.int32)
    ids = np.zeros(len(faces), dtype=np.int32)
    return Prototype("body", points, faces, ids, find_surfaces(points, faces, np.zeros_like(ids), ids))


def solved(body: Prototype, poses: list[list[tuple[float, ...]]], device: str) -> PathSet:
    """Return the paths of a link beside a body, with poses of its ends and of the body for each frame."""
    actors = [("rsu_1", "rsu", -1), ("cav_1", "cav", -1), ("veh_1", "vehicle", 0)]
    arrays = arrays_from_parts([], [body], actors, poses, materials=MATERIALS)
    return oracle.solve(arrays, oracle.channel(max_depth=1, finite_surfaces=True, pattern="iso"), device)[1]


def test_a_path_keeps_its_name_as_its_point_moves_along_a_body(device: str) -> None:
    """A ridge of 3 m radius tilts, so that its point of reflection moves from one end of the body to the other."""
    ends = pose(0.0, -4.0, 40.0), pose(0.0, 4.0, 40.0)
    tilts = np.linspace(-0.6, 0.6, 13)
    # quaternions about y: pose() turns about z alone
    poses = [[*ends, (0.0, 0.0, 0.0, 0.0, np.sin(t / 2), 0.0, np.cos(t / 2))] for t in tilts]
    paths = solved(body_of(lambda x: -(x**2) / 6.0), poses, device)
    own = np.flatnonzero(paths.interaction[:, 0] == SPECULAR)
    assert paths.link[own].tolist() == list(range(13)) and np.ptp(paths.vertex[own, 0, 0]) > 2.0
    assert len(np.unique(paths.path_id[own])) == 1


def test_each_of_several_points_of_a_body_has_its_own_name(device: str) -> None:
    """Four humps of one curved surface reflect."""
    rate = 2.0 * np.pi / 1.2
    poses = [[pose(-0.1, -4.0, 40.0), pose(0.1, 4.0, 40.0), pose(0.0, 0.0, 0.0)]]
    paths = solved(body_of(lambda x: -np.cos(rate * x) / (1.5 * rate**2)), poses, device)
    at = np.sort(paths.vertex[paths.interaction[:, 0] == SPECULAR, 0, 0])
    np.testing.assert_allclose(at, [-1.8, -0.6, 0.6, 1.8], atol=0.1)
    assert len(np.unique(paths.path_id)) == len(paths)


def test_a_path_keeps_its_name_from_pane_to_pane(device: str) -> None:
    """A window of two panes that meet at 10 degrees passes through the line of sight: one path all the time."""
    tilt = np.tan(np.radians(10.0))
    panes = [
        quad_part(
            "Buildings/house", [(x, y, -2.0), (0.0, 0.0, -2.0), (0.0, 0.0, 2.0), (x, y, 2.0)], "glass", "building"
        )
        for x, y in ((2.0 * tilt, -2.0), (0.0, 2.0))
    ]
    poses = [[pose(-10.0, y), pose(10.0, y)] for y in (-1.0, -0.2, 0.2, 1.0)]
    arrays = arrays_from_parts(
        panes, actors=[("rsu_1", "rsu", -1), ("cav_1", "cav", -1)], poses=poses, materials=MATERIALS
    )
    _, paths = oracle.solve(arrays, oracle.channel(max_depth=1, refraction=True, pattern="iso"), device)
    own = np.flatnonzero(paths.interaction[:, 0] == TRANSMISSION)
    assert paths.link[own].tolist() == [0, 1, 2, 3] and len(np.unique(paths.surface[own, 0])) == 2
    assert len(np.unique(paths.path_id[own])) == 1


def test_names_are_hashes_of_all_words_in_order() -> None:
    """SplitMix64's finaliser in Python's own integers; what is behind the last interaction does not count.

    Materials and bodies are those of the surfaces, and of the actors that carry them.
    """

    def mixed(value: int, word: int) -> int:
        z = ((value ^ (word % 2**64)) + 0x9E3779B97F4A7C15) % 2**64
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) % 2**64
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) % 2**64
        return z ^ (z >> 31)

    rng = np.random.default_rng(4)
    names = {name: rng.integers(0, 2**31 - 1, 9) for name in ("wall", "object_id", "line", "material_id")}
    names["face"], names["owner"] = rng.integers(0, 9, 9), rng.integers(-1, 4, 9)
    surfaces = NamedSurfaces()
    for name, values in names.items():
        setattr(surfaces, name, wp.array(values, dtype=wp.int32, device="cpu"))
    ends, link = rng.integers(0, 2**40, (2, 5)), rng.integers(0, 5, 30)
    kind = np.where(np.arange(3) < rng.integers(0, 4, 30)[:, None], rng.choice([1, 2, 4, 8], (30, 3)), 0)
    surface, ray = np.where(kind == 0, -1, rng.integers(0, 9, (30, 3))), rng.integers(-9, 9, 30)
    batch_index, actor = rng.integers(0, 3, 5), rng.permutation(7)[:4]
    links = SimpleNamespace(tx_number=ends[0], rx_number=ends[1], batch_index=batch_index)
    scene = SimpleNamespace(instance_actor=actor, arrays=SimpleNamespace(poses=np.zeros((3, 7, 7))))
    found = path_names(links, link, kind, surface, ray, SimpleNamespace(names_on_host=surfaces), scene)
    columns, ranks = {SPECULAR: "wall", TRANSMISSION: "object_id", DIFFRACTION: "line"}, [0, 1, 4, 2, 8]
    ids: list[int] = []
    expected = []
    for path in range(30):
        value = mixed(mixed(0, int(ends[0, link[path]])), int(ends[1, link[path]]))
        for step in np.flatnonzero(kind[path]):
            code, own = int(kind[path, step]), surface[path, step]
            value = mixed(mixed(value, code), int(ray[path] if code == DIFFUSE else names[columns[code]][own]))
            face = names["face"][own] if code == DIFFRACTION else own
            owner = names["owner"][face]
            body = 7 * batch_index[link[path]] + actor[owner] if owner >= 0 else -1
            met = found.object_id[path, step], found.material_id[path, step], found.body[path, step]
            assert met == (names["object_id"][face], names["material_id"][face], body)
        number = ids.count(value >> 1)  # lines of sight of one link have one name, and are numbered
        expected.append(mixed(value >> 1, number) >> 1 if number else value >> 1)
        ids.append(value >> 1)
    assert found.path_id.dtype == np.int64 and found.path_id.tolist() == ids and len(set(ids)) < 30
    assert tell_apart(found.path_id, link, np.arange(30.0)).tolist() == expected
    assert found.kind.dtype == np.int8
    for met in (found.object_id, found.material_id, found.body):
        assert (met[kind == 0] == -1).all() and met.dtype == np.int32
    highest = [max((ranks.index(code) for code in row if code), default=0) for row in kind.tolist()]
    assert found.kind.tolist() == highest
