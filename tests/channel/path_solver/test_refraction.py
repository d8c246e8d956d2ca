"""Waves through slabs: closed forms, windows, cars, the limit of the order, and panes on opaque walls."""

import numpy as np
import pytest

from mmw.channel.paths import PATH_TRANSMISSION, PathSet
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.transforms import pose_from_ypr, transform_points
from mmw.physics.materials.material import RadioMaterial
from mmw.scene.scene_data import SceneData
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.scenes import arrays_from_parts, box_model, pose, quad_part
from tests.oracles import channel as oracle
from tests.oracles.channel import TRANSMISSION

RADIO = {
    "glass": RadioMaterial("constant", relative_permittivity=6.3, conductivity=0.03, thickness=0.006),
    "board": RadioMaterial("constant", relative_permittivity=2.7, conductivity=0.02, thickness=0.0125),
    "brick": RadioMaterial("constant", relative_permittivity=3.9, conductivity=0.04),
    "copper": RadioMaterial("itu", itu="itu_pec", thickness=0.001),
}
MATERIALS = oracle.radio_materials(RADIO)
OPEN = oracle.channel(max_depth=2, refraction=True)


def wall(
    name: str, x: float, material: str, y: tuple[float, float] = (-60, 60), z: tuple[float, float] = (-60, 60)
) -> MeshPart:
    """Return an upright wall across the x axis."""
    corners = [(x, y[0], z[0]), (x, y[1], z[0]), (x, y[1], z[1]), (x, y[0], z[1])]
    return quad_part(f"Buildings/{name}", corners, material, "building")


def scene(parts: list[MeshPart], tx: tuple, rx: list[tuple]) -> SceneData:
    """Return parts, a post far from everything, a transmitter and receivers without bodies."""
    post = quad_part("Props/post", [(77, 900, 0), (77, 901, 0), (77, 901, 1), (77, 900, 1)], "brick", "static")
    return oracle.link_scene([*parts, post], tx, *rx, materials=MATERIALS)


def row(paths: PathSet, link: int, *steps: tuple[int, int]) -> int:
    """Return the one path of a link that has these (interaction, surface) in turn."""
    return oracle.paths_by_interactions(paths, link)[steps]


@pytest.mark.parametrize("names", [("glass",), ("board",), ("glass", "board")])
def test_through_slabs(names: tuple[str, ...], device: str) -> None:
    """T of every slab times free space, at any angle, in both polarizations; the delay is that of the straight line."""
    tx, rx = (-5.0, 0.3, 1.0), [(9.0, 0.31, 1.0), (6.0, 12.0, 1.0), (5.0, -14.0, 9.0), (1.5, 50.0, -20.0)]
    arrays = scene([wall(name, float(k), name) for k, name in enumerate(names)], tx, rx)
    _, paths = oracle.solve(arrays, OPEN, device)
    for link, end in enumerate(rx):
        p = row(paths, link, *((TRANSMISSION, k) for k in range(len(names))))
        length = np.linalg.norm(np.subtract(end, tx))
        assert paths.kind[p] == PATH_TRANSMISSION and paths.order[p] == len(names)
        assert paths.tau[p] * SPEED_OF_LIGHT == pytest.approx(length, rel=1e-15)
        np.testing.assert_allclose(paths.vertex[p, : len(names), 0], range(len(names)), atol=1e-12)
        np.testing.assert_allclose(paths.normal[p, : len(names)], [[-1, 0, 0]] * len(names), atol=1e-12)
        unit = np.subtract(end, tx) / length
        point = [tx, *(tx + (k - tx[0]) / unit[0] * unit for k in range(len(names))), end]
        path = oracle.OraclePath(np.array(point), np.array([[1.0, 0, 0]] * len(names)), True)
        for column, carrier in enumerate(paths.carriers_hz):
            expected = oracle.dyadic_transfer(path, [TRANSMISSION] * len(names), [RADIO[n] for n in names], carrier)
            free = SPEED_OF_LIGHT / carrier / (4 * np.pi * length)
            np.testing.assert_allclose(paths.transfer["sunny"][p, column], expected, atol=1e-12 * free)
            if end[2] == tx[2]:  # in the plane of incidence theta is TE and phi is TM
                t_te, t_tm = np.prod(
                    [
                        oracle.slab_coefficients(eta(n, carrier), abs(unit[0]), RADIO[n].thickness, carrier)[2:]
                        for n in names
                    ],
                    axis=0,
                )
                np.testing.assert_allclose(np.diag(paths.transfer["sunny"][p, column]), free * np.array([t_te, -t_tm]))


def eta(name: str, carrier_hz: float) -> complex:
    radio = RADIO[name]
    return radio.relative_permittivity - 1j * radio.conductivity / (2 * np.pi * carrier_hz * 8.8541878128e-12)


def test_window_in_an_opaque_wall(device: str) -> None:
    """The pane lets through, the bricks around it do not; nor does anything without `refraction`."""
    parts = [
        wall("below", 0.0, "brick", z=(-60, 1)),
        wall("above", 0.0, "brick", z=(2, 60)),
        wall("left", 0.0, "brick", y=(-60, -1), z=(1, 2)),
        wall("right", 0.0, "brick", y=(1, 60), z=(1, 2)),
        wall("window", 0.0, "glass", y=(-1, 1), z=(1, 2)),
    ]
    tx, rx = (-3.0, 0.2, 1.4), [(4.0, 0.0, 1.7), (4.0, 0.0, 3.7), (4.0, 5.0, 1.5), (1.0, -1.0, 1.1), (4.0, 0.0, -2.0)]
    for config in (OPEN, OPEN.model_copy(update={"candidates": "launch", "samples_per_tx": 2000})):
        links, paths = oracle.solve(scene(parts, tx, rx), config, device)
        assert paths.count.tolist() == [1, 0, 0, 1, 0]
        assert paths.interaction[:, 0].tolist() == [TRANSMISSION] * 2 and (paths.order == 1).all()
        assert {links.rx.position[k, 0] for k in paths.link} == {4.0, 1.0}
    _, paths = oracle.solve(scene(parts, tx, rx), oracle.channel(max_depth=2), device)
    assert len(paths) == 0


def test_conductor_stays_shut(device: str) -> None:
    """A conductor with a thickness is a slab that lets nothing through: its path has gain 0, or there is none."""
    _, paths = oracle.solve(scene([wall("wall", 0.0, "copper")], (-3.0, 0.2, 1.4), [(4.0, 0.0, 1.7)]), OPEN, device)
    assert np.abs(paths.a["sunny"]).max(initial=0.0) == 0.0


def test_through_a_closed_car(device: str) -> None:
    """In at one pane and out at another of a turned box: two transmissions at its sides, none at order 1."""
    body = pose_from_ypr([0.4, 0.1, 0.2], 0.5, 0.1, -0.2)
    model = box_model("car", (4.0, 1.8, 1.5), (0.0, 0.0, 0.75), material=0)
    tx, rx = np.array([-8.0, 1.0, 1.2]), np.array([7.0, -2.0, 0.7])
    actors = [("veh_001", "vehicle", 0), ("rsu_1", "rsu", -1), ("cav_1", "cav", -1)]
    arrays = arrays_from_parts([], [model], actors, np.array([[body, pose(*tx), pose(*rx)]]), materials=MATERIALS)
    assert oracle.solve(arrays, oracle.channel(max_depth=1, refraction=True, specular_reflection=False), device)[
        1
    ].count.tolist() == [0]
    _, paths = oracle.solve(arrays, oracle.channel(max_depth=2, refraction=True, specular_reflection=False), device)
    assert paths.interaction.tolist() == [[TRANSMISSION] * 2] and paths.kind.tolist() == [PATH_TRANSMISSION]
    corner, unit = transform_points(body, model.points), rx - tx
    hits = {}
    for side in range(6):
        a, b, c = corner[model.faces[2 * side]]
        normal = np.cross(b - a, c - a)
        hits[side] = float((a - tx) @ normal / (unit @ normal)), float(unit @ normal)
    enters = max(t for t, along in hits.values() if along < 0)
    leaves = min(t for t, along in hits.values() if along > 0)
    assert 0 < enters < leaves < 1
    np.testing.assert_allclose(paths.vertex[0], [tx + enters * unit, tx + leaves * unit], atol=1e-10)
    sides = [next(s for s, (t, _) in hits.items() if t == at) for at in (enters, leaves)]
    assert paths.surface[0].tolist() == [model.surface[2 * side] for side in sides]
    assert (paths.object_id[0] == arrays.actors[0].object_id).all()
    assert paths.tau[0] * SPEED_OF_LIGHT == pytest.approx(np.linalg.norm(unit), rel=1e-15)


def test_pane_that_stops_being_a_slab(device: str) -> None:
    """A surface is open if any weather makes it a slab; where it is none its paths have gain 0."""
    arrays = scene([wall("pane", 0.0, "glass")], (-6.0, 0.0, 3.0), [(5.0, 1.0, 2.0)])
    frozen = tuple(MATERIALS["brick"] if m.name == "glass" else m for m in arrays.materials["sunny"])
    arrays.materials["snowy"] = frozen
    _, paths = oracle.solve(arrays, OPEN, device)
    assert paths.kind.tolist() == [PATH_TRANSMISSION]
    assert np.abs(paths.a["snowy"]).max() == 0.0 < np.abs(paths.a["sunny"]).min()


@pytest.mark.parametrize("gap", [0.0, 0.0005, 0.002, 0.02])
@pytest.mark.parametrize("away", [20.0, 400.0])
@pytest.mark.parametrize("order", [("glass", "brick"), ("brick", "glass")])
def test_pane_on_an_opaque_wall(gap: float, away: float, order: tuple[str, str], device: str) -> None:
    """A pane in front of bricks, or on them, opens no way through the bricks, near or far, from either side."""
    place = {"glass": -gap, "brick": 0.0}
    parts = [wall(name, place[name], name) for name in order]
    for tx, rx in (((-away, 0.3, 1.0), (5.0, 0.1, 2.0)), ((away, 0.3, 1.0), (-5.0, 0.1, 2.0))):
        _, paths = oracle.solve(scene(parts, tx, [rx]), OPEN, device)
        assert paths.count.tolist() == [0], paths.interaction.tolist()


@pytest.mark.parametrize("gap", [0.004, 0.02])
@pytest.mark.parametrize("away", [20.0, 600.0])
def test_double_glazing(gap: float, away: float, device: str) -> None:
    """Two panes close behind each other are two, near or far."""
    arrays = scene([wall("one", 0.0, "glass"), wall("two", gap, "glass")], (-away, 0.3, 1.0), [(5.0, 0.1, 2.0)])
    _, paths = oracle.solve(arrays, OPEN, device)
    assert set(oracle.paths_by_interactions(paths, 0)) == {((TRANSMISSION, 0), (TRANSMISSION, 1))}
