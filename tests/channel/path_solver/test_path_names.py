"""Names of paths over frames in which their points move on, and other paths come and go."""

import numpy as np
import pytest

from mmw.channel.path_solver.path_names import SECTION_M
from mmw.core.planar_surfaces import find_surfaces
from mmw.physics.em.interaction import SPECULAR, TRANSMISSION
from mmw.physics.materials.material import RadioMaterial
from mmw.scene.scene_data import Prototype
from tests.fixtures.scenes import arrays_from_parts, box_model, pose, quad_part
from tests.oracles import channel as oracle

MATERIALS = oracle.radio_materials(
    {
        "metal": RadioMaterial("itu", itu="itu_pec"),
        "glass": RadioMaterial("constant", relative_permittivity=6.3, conductivity=0.03, thickness=0.006),
    }
)


def body_with_humps(apart: float, radius: float) -> Prototype:
    """Return a sheet of 4.8 m x 0.8 m, in facets of 0.05 m, with humps of a radius, at half of their distance apart and
    that distance on from x = 0 in both directions [m]."""
    x, y = np.meshgrid(np.linspace(-2.4, 2.4, 97), [-0.4, 0.4], indexing="ij")
    rate = 2 * np.pi / apart
    points = np.stack([x, y, -np.cos(rate * x) / (radius * rate**2)], axis=-1).reshape(-1, 3)
    a = 2 * np.arange(96)
    faces = np.concatenate([np.stack([a, a + 2, a + 3], axis=1), np.stack([a, a + 3, a + 1], axis=1)]).astype(np.int32)
    ids = np.zeros(len(faces), dtype=np.int32)
    return Prototype("body", points, faces, ids, find_surfaces(points, faces, np.zeros_like(ids), ids))


@pytest.mark.parametrize("turn", [0.0, 2.0])
def test_what_hides_one_point_of_a_body_does_not_rename_the_other(turn: float, device: str) -> None:
    """A plate passes before one hump and then before the other: the path over each keeps its name while it is there."""
    ends = np.array([[0.5, -4.0, 15.0], [1.0, 4.0, 15.0]])
    body = pose(30.0, -20.0, 1.0, turn)
    rotation = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])

    def place(point: np.ndarray, yaw: float = turn) -> tuple[float, ...]:
        return pose(*(rotation @ point + body[:3]), yaw)

    humps = [np.array([x, 0.0, 0.076]) for x in (1.5, -1.5)]
    plates = [np.array([0.0, 0.0, -50.0]), *(0.5 * (ends[0] + hump) for hump in humps)]
    poses = [[place(ends[0]), place(ends[1]), body, place(plate)] for plate in plates]
    models = [body_with_humps(3.0, 3.0), box_model("plate", (0.6, 0.6, 0.01), (0.0, 0.0, 0.0))]
    actors = [("rsu_1", "rsu", -1), ("cav_1", "cav", -1), ("veh_1", "vehicle", 0), ("veh_2", "vehicle", 1)]
    arrays = arrays_from_parts([], models, actors, poses, materials=MATERIALS)
    config = oracle.channel(max_depth=1, finite_surfaces=True, pattern="iso")
    links, paths = oracle.solve(arrays, config, device)
    at = np.einsum("ij,nj->ni", rotation.T, np.nan_to_num(paths.vertex[:, 0]) - body[:3])
    is_own = (paths.interaction[:, 0] == SPECULAR) & (np.abs(at[:, 2]) < 0.1)
    names = []
    for hump in humps:
        rows = np.flatnonzero(is_own & (np.abs(at[:, 0] - hump[0]) < 0.5))
        names.append({int(links.frame[paths.link[row]]): int(paths.path_id[row]) for row in rows})
    assert list(names[0]) == [0, 2] and list(names[1]) == [0, 1]
    assert len(set(names[0].values())) == len(set(names[1].values())) == 1
    assert names[0][0] != names[1][0]
    assert abs(humps[0][0] - humps[1][0]) > SECTION_M


def test_each_of_several_points_of_a_body_has_its_own_name(device: str) -> None:
    """Humps at x = 0.6 m and -0.6 m are in one section, those 1.2 m farther out in the next ones."""
    body = pose(0.0, 0.0, 0.0)
    ends = pose(-0.1, -4.0, 40.0), pose(0.1, 4.0, 40.0)
    actors = [("rsu_1", "rsu", -1), ("cav_1", "cav", -1), ("veh_1", "vehicle", 0)]
    arrays = arrays_from_parts([], [body_with_humps(1.2, 1.5)], actors, [[*ends, body]], materials=MATERIALS)
    _, paths = oracle.solve(arrays, oracle.channel(max_depth=1, finite_surfaces=True, pattern="iso"), device)
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
