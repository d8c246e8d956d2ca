"""Names of paths over frames in which their points move on, and other paths come and go."""

from collections.abc import Callable

import numpy as np

from mmw.channel.paths import PathSet
from mmw.core.planar_surfaces import find_surfaces
from mmw.physics.em.interaction import SPECULAR, TRANSMISSION
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
