"""Waves through slabs: closed forms, windows, cars, the limit of the order, and panes on opaque walls."""

from itertools import pairwise

import numpy as np
import pytest

from mmw.channel.paths import PATH_LOS, PATH_SPECULAR, PATH_TRANSMISSION, PathSet
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.transforms import pose_from_ypr, transform_points
from mmw.physics.materials.material import Material, RadioMaterial
from mmw.scene.scene_data import SceneData
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.scenes import arrays_from_parts, box_model, ground_part, pose, quad_part
from tests.oracles.channel import (
    SPECULAR,
    TRANSMISSION,
    ChainPath,
    chains,
    channel,
    dyadic_transfer,
    slab_coefficients,
    solve,
)

RADIO = {
    "glass": RadioMaterial("constant", relative_permittivity=6.3, conductivity=0.03, thickness=0.006),
    "board": RadioMaterial("constant", relative_permittivity=2.7, conductivity=0.02, thickness=0.0125),
    "brick": RadioMaterial("constant", relative_permittivity=3.9, conductivity=0.04),
    "copper": RadioMaterial("itu", itu="itu_pec", thickness=0.001),
}
MATERIALS = {name: Material(name, radio, "none", 0.3, (0.5,) * 3) for name, radio in RADIO.items()}
OPEN = channel(max_depth=2, refraction=True)


def wall(
    name: str, x: float, material: str, y: tuple[float, float] = (-60, 60), z: tuple[float, float] = (-60, 60)
) -> MeshPart:
    """Return an upright wall across the x axis."""
    corners = [(x, y[0], z[0]), (x, y[1], z[0]), (x, y[1], z[1]), (x, y[0], z[1])]
    return quad_part(f"Buildings/{name}", corners, material, "building")


def scene(parts: list[MeshPart], tx: tuple, rx: list[tuple]) -> SceneData:
    """Return parts, a post far from everything, a transmitter and receivers without bodies."""
    post = quad_part("Props/post", [(77, 900, 0), (77, 901, 0), (77, 901, 1), (77, 900, 1)], "brick", "static")
    parts = [*parts, post]
    actors = [("rsu_1", "rsu", -1), *((f"cav_{k}", "cav", -1) for k in range(len(rx)))]
    return arrays_from_parts(parts, actors=actors, poses=np.array([[pose(*p) for p in (tx, *rx)]]), materials=MATERIALS)


def row(paths: PathSet, link: int, *steps: tuple[int, int]) -> int:
    """Return the one path of a link that meets these (interaction, surface) in turn."""
    return chains(paths, link)[steps]


@pytest.mark.parametrize("names", [("glass",), ("board",), ("glass", "board")])
def test_through_slabs(names: tuple[str, ...], device: str) -> None:
    """T of every slab times free space, at any angle, in both polarisations; the delay is that of the straight line."""
    tx, rx = (-5.0, 0.3, 1.0), [(9.0, 0.31, 1.0), (6.0, 12.0, 1.0), (5.0, -14.0, 9.0), (1.5, 50.0, -20.0)]
    arrays = scene([wall(name, float(k), name) for k, name in enumerate(names)], tx, rx)
    _, paths = solve(arrays, OPEN, device)
    for link, end in enumerate(rx):
        p = row(paths, link, *((TRANSMISSION, k) for k in range(len(names))))
        length = np.linalg.norm(np.subtract(end, tx))
        assert paths.kind[p] == PATH_TRANSMISSION and paths.order[p] == len(names)
        assert paths.tau[p] * SPEED_OF_LIGHT == pytest.approx(length, rel=1e-15)
        np.testing.assert_allclose(paths.vertex[p, : len(names), 0], range(len(names)), atol=1e-12)
        np.testing.assert_allclose(paths.normal[p, : len(names)], [[-1, 0, 0]] * len(names), atol=1e-12)
        way = np.subtract(end, tx) / length
        point = [tx, *(tx + (k - tx[0]) / way[0] * way for k in range(len(names))), end]
        path = ChainPath(np.array(point), np.array([[1.0, 0, 0]] * len(names)), True)
        for column, carrier in enumerate(paths.carriers_hz):
            expected = dyadic_transfer(path, [TRANSMISSION] * len(names), [RADIO[n] for n in names], carrier)
            free = SPEED_OF_LIGHT / carrier / (4 * np.pi * length)
            np.testing.assert_allclose(paths.transfer["sunny"][p, column], expected, atol=1e-12 * free)
            if end[2] == tx[2]:  # in the plane of incidence theta is TE and phi is TM
                t_te, t_tm = np.prod(
                    [slab_coefficients(eta(n, carrier), abs(way[0]), RADIO[n].thickness, carrier)[2:] for n in names],
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
    for config in (OPEN, OPEN.model_copy(update={"candidates": "launch", "rays": 2000})):
        links, paths = solve(scene(parts, tx, rx), config, device)
        assert paths.count.tolist() == [1, 0, 0, 1, 0]
        assert paths.interaction[:, 0].tolist() == [TRANSMISSION] * 2 and (paths.order == 1).all()
        assert {links.rx.position[k, 0] for k in paths.link} == {4.0, 1.0}
    _, paths = solve(scene(parts, tx, rx), channel(max_depth=2), device)
    assert len(paths) == 0


def test_conductor_stays_shut(device: str) -> None:
    """A conductor with a thickness is a slab that lets nothing through: its path has gain 0, or there is none."""
    _, paths = solve(scene([wall("wall", 0.0, "copper")], (-3.0, 0.2, 1.4), [(4.0, 0.0, 1.7)]), OPEN, device)
    assert np.abs(paths.a["sunny"]).max(initial=0.0) == 0.0


def test_through_a_closed_car(device: str) -> None:
    """In at one pane and out at another of a turned box: two transmissions at its sides, none at order 1."""
    body = pose_from_ypr([0.4, 0.1, 0.2], 0.5, 0.1, -0.2)
    model = box_model("car", (4.0, 1.8, 1.5), (0.0, 0.0, 0.75), material=0)
    tx, rx = np.array([-8.0, 1.0, 1.2]), np.array([7.0, -2.0, 0.7])
    actors = [("veh_001", "vehicle", 0), ("rsu_1", "rsu", -1), ("cav_1", "cav", -1)]
    arrays = arrays_from_parts([], [model], actors, np.array([[body, pose(*tx), pose(*rx)]]), materials=MATERIALS)
    assert solve(arrays, channel(max_depth=1, refraction=True, specular=False), device)[1].count.tolist() == [0]
    _, paths = solve(arrays, channel(max_depth=2, refraction=True, specular=False), device)
    assert paths.interaction.tolist() == [[TRANSMISSION] * 2] and paths.kind.tolist() == [PATH_TRANSMISSION]
    corner, way = transform_points(body, model.points), rx - tx
    hits = {}
    for side in range(6):
        a, b, c = corner[model.faces[2 * side]]
        normal = np.cross(b - a, c - a)
        hits[side] = float((a - tx) @ normal / (way @ normal)), float(way @ normal)
    enters = max(t for t, along in hits.values() if along < 0)
    leaves = min(t for t, along in hits.values() if along > 0)
    assert 0 < enters < leaves < 1
    np.testing.assert_allclose(paths.vertex[0], [tx + enters * way, tx + leaves * way], atol=1e-10)
    sides = [next(s for s, (t, _) in hits.items() if t == at) for at in (enters, leaves)]
    assert paths.surface[0].tolist() == [model.surface[2 * side] for side in sides]
    assert (paths.object_id[0] == arrays.actors[0].object_id).all()
    assert paths.tau[0] * SPEED_OF_LIGHT == pytest.approx(np.linalg.norm(way), rel=1e-15)


def test_reflection_through_a_slab(device: str) -> None:
    """The ground reflects what comes through a pane, before or behind it; the pane counts as an interaction."""
    parts, tx = [ground_part(100.0, material="brick"), wall("pane", 0.0, "glass")], (-6.0, 0.0, 3.0)
    for x, behind in ((12.0, True), (3.0, False)):
        rx = (x, 1.0, 4.0)
        for depth in (1, 2):
            _, paths = solve(scene(parts, tx, [rx]), channel(max_depth=depth, refraction=True), device)
            steps = [(TRANSMISSION, 1), (SPECULAR, 0)]
            wanted = {tuple(steps[:1])} | ({tuple(steps if behind else steps[::-1])} if depth == 2 else set())
            assert set(chains(paths, 0)) == wanted
        share = tx[2] / (tx[2] + rx[2])
        bounce = np.array([tx[0] + share * (x - tx[0]), share * rx[1], 0.0])
        assert (bounce[0] > 0) == behind
        ends = (tx, bounce) if bounce[0] > 0 else (bounce, rx)
        crossing = ends[0] - ends[0][0] / (ends[1][0] - ends[0][0]) * np.subtract(ends[1], ends[0])
        point = [tx, crossing, bounce, rx] if behind else [tx, bounce, crossing, rx]
        normal = np.array([[1.0, 0, 0], [0, 0, 1.0]][:: 1 if behind else -1])
        p = next(row for chain, row in chains(paths, 0).items() if len(chain) == 2)
        path, kinds = ChainPath(np.array(point), normal, True), [TRANSMISSION, SPECULAR][:: 1 if behind else -1]
        np.testing.assert_allclose(paths.vertex[p], path.point[1:-1], atol=1e-12)
        for column, carrier in enumerate(paths.carriers_hz):
            radio = [RADIO[name] for name in ("glass", "brick")][:: 1 if behind else -1]
            expected = dyadic_transfer(path, kinds, radio, carrier)
            np.testing.assert_allclose(paths.transfer["sunny"][p, column], expected, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("depth", [0, 1, 2, 3, 4])
@pytest.mark.parametrize("mode", ["launch", "exhaustive"])
def test_order_counts_slabs(mode: str, depth: int, device: str) -> None:
    """Three panes in a row: the line of sight needs order 3, a reflection at the k-th pane 2 k - 1."""
    parts = [wall(f"pane_{k}", float(k), "glass") for k in range(3)]
    arrays = scene(parts, (-2.0, 0.0, 1.0), [(6.0, 0.5, 1.0), (-2.0, 3.0, 1.0)])
    _, paths = solve(arrays, channel(max_depth=depth, refraction=True, candidates=mode, rays=1000), device)
    assert (tuple((TRANSMISSION, k) for k in range(3)) in chains(paths, 0)) == (depth >= 3)
    assert all(len(chain) <= depth for link in (0, 1) for chain in chains(paths, link))
    for k in range(3):
        way = [(TRANSMISSION, j) for j in range(k)]
        assert ((*way, (SPECULAR, k), *way[::-1]) in chains(paths, 1)) == (2 * k + 1 <= depth)


def test_refraction_changes_no_other_path(device: str) -> None:
    parts = [ground_part(100.0, material="brick"), wall("pane", 0.0, "glass", y=(-2, 2), z=(0, 4))]
    arrays = scene(parts, (-6.0, 0.0, 3.0), [(5.0, 1.0, 2.0), (5.0, 30.0, 2.0), (-3.0, 4.0, 2.0)])
    (_, shut), (_, let) = (solve(arrays, channel(max_depth=2, refraction=on), device) for on in (False, True))
    straight = ~(let.interaction == TRANSMISSION).any(axis=1)
    assert 0 < straight.sum() < len(let)
    assert PATH_LOS in shut.kind and PATH_SPECULAR in shut.kind
    for name in ("link", "path_id", "tau", "surface", "theta_r", "phi_t"):
        np.testing.assert_array_equal(getattr(let, name)[straight], getattr(shut, name))
    np.testing.assert_array_equal(let.transfer["sunny"][straight], shut.transfer["sunny"])


def test_pane_that_stops_being_a_slab(device: str) -> None:
    """A surface is open if any weather makes it a slab; where it is none its paths have gain 0."""
    arrays = scene([wall("pane", 0.0, "glass")], (-6.0, 0.0, 3.0), [(5.0, 1.0, 2.0)])
    frozen = tuple(MATERIALS["brick"] if m.name == "glass" else m for m in arrays.materials["sunny"])
    arrays.materials["snowy"] = frozen
    _, paths = solve(arrays, OPEN, device)
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
        _, paths = solve(scene(parts, tx, [rx]), OPEN, device)
        assert paths.count.tolist() == [0], paths.interaction.tolist()


@pytest.mark.parametrize("gap", [0.004, 0.02])
@pytest.mark.parametrize("away", [20.0, 600.0])
def test_double_glazing(gap: float, away: float, device: str) -> None:
    """Two panes close behind each other are two, near or far."""
    arrays = scene([wall("one", 0.0, "glass"), wall("two", gap, "glass")], (-away, 0.3, 1.0), [(5.0, 0.1, 2.0)])
    _, paths = solve(arrays, OPEN, device)
    assert set(chains(paths, 0)) == {((TRANSMISSION, 0), (TRANSMISSION, 1))}


def test_interactions_stand_in_order(device: str) -> None:
    """Interactions stand in the order in which the wave meets them, and legs add up to the delay."""
    parts = [wall(f"pane_{k}", x, "board") for k, x in enumerate((3.0, 0.0, 1.5))]
    ends = (-2.0, 0.0, 1.0), (7.0, 1.0, 2.0)
    config = channel(max_depth=4, refraction=True)
    _, paths = solve(scene([*parts, ground_part(60.0, material="brick")], ends[0], [ends[1]]), config, device)
    assert {(TRANSMISSION, 1), (TRANSMISSION, 2), (TRANSMISSION, 0), (SPECULAR, 3)} in map(set, chains(paths, 0))
    for p in range(len(paths)):
        at = [ends[0], *paths.vertex[p, : paths.order[p]], ends[1]]
        legs = [np.linalg.norm(np.subtract(b, a)) for a, b in pairwise(at)]
        assert sum(legs) == pytest.approx(paths.tau[p] * SPEED_OF_LIGHT, rel=1e-12) and min(legs) > 0
