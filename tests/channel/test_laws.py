"""The channel against closed forms and laws: free space, two rays, reciprocity, symmetry, energy, Doppler, phase."""

from dataclasses import replace
from decimal import Decimal

import numpy as np
import pytest

from mmw.channel.links import make_links
from mmw.channel.path_solver.solver import solve_paths
from mmw.channel.paths import PATH_LOS, PATH_SPECULAR, PATH_TRANSMISSION
from mmw.core.constants import FRAME_DT, SPEED_OF_LIGHT, VACUUM_PERMITTIVITY
from mmw.core.transforms import pose_from_ypr, transform_points
from mmw.physics.materials.material import Material, RadioMaterial
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData
from tests.fixtures.scenes import arrays_from_parts, box_model, ground_part, pose, quad_part, street_canyon, wall_part
from tests.oracles.channel import DIFFRACTION, SPECULAR, chains, channel, exact_length, solve

CARRIERS = (28e9, 4.9e9)


def flat_ground(eps_r: float, sigma: float, rsu: tuple, cav: tuple) -> SceneData:
    """Level ground of a constant material; the agents are poses without a body."""
    radio = RadioMaterial("constant", relative_permittivity=eps_r, conductivity=sigma)
    materials = {"asphalt": Material("asphalt", radio, "asphalt", 0.2, (0.5,) * 3)}
    actors = [("rsu_1", "rsu", -1), ("cav_1", "cav", -1)]
    return arrays_from_parts(
        [ground_part(300.0)], actors=actors, poses=np.array([[pose(*rsu), pose(*cav)]]), materials=materials
    )


def test_free_space(device: str) -> None:
    arrays = arrays_from_parts(
        [],
        actors=[("rsu_1", "rsu", -1), ("cav_1", "cav", -1)],
        poses=np.array([[pose(0, 0, 9), pose(30, 40, 1.5, 1.0)]]),
    )
    links, paths = solve(arrays, channel(), device)
    distance = np.sqrt(50**2 + 7.5**2)
    assert paths.kind.tolist() == [PATH_LOS]
    assert paths.count.tolist() == [1] and len(links) == 1
    sine = 50 / distance
    expected = SPEED_OF_LIGHT / np.array(CARRIERS) / (4 * np.pi * distance) * 1.5 * sine**2
    np.testing.assert_allclose(paths.a["sunny"][0], expected, rtol=1e-12)
    assert paths.tau[0] == pytest.approx(distance / SPEED_OF_LIGHT, rel=1e-14)
    assert (paths.theta_t[0], paths.phi_t[0]) == pytest.approx((np.pi / 2 + np.arctan(7.5 / 50), np.arctan2(40, 30)))
    assert (paths.theta_r[0], paths.phi_r[0]) == pytest.approx((np.pi / 2 - np.arctan(7.5 / 50), np.arctan2(-40, -30)))
    assert np.isnan(paths.vertex).all() and paths.interaction[0, 0] == paths.order[0] == 0
    assert paths.object_id[0, 0] == paths.material_id[0, 0] == paths.surface[0, 0] == -1


@pytest.mark.parametrize(("eps_r", "sigma"), [(1.0, 1e12), (4.0, 0.0), (3.0, 2.5), (5.24, 0.6)])
@pytest.mark.parametrize("polarization", ["V", "H"])
def test_two_rays_over_ground(eps_r: float, sigma: float, polarization: str, device: str) -> None:
    """The two-ray formula with plane-earth coefficients, Source: ITU-R P.2040-4 eq. 37 in grazing angles."""
    for distance in (3.0, 20.0, 250.0):
        arrays = flat_ground(eps_r, sigma, (0, 0, 6.0), (distance, 0, 1.5))
        _, paths = solve(arrays, channel(polarization=polarization), device)
        assert paths.kind.tolist() == [PATH_LOS, PATH_SPECULAR]
        for column, carrier in enumerate(CARRIERS):
            eta = eps_r - 1j * sigma / (2 * np.pi * carrier * VACUUM_PERMITTIVITY)
            direct, bounced = np.hypot(distance, 4.5), np.hypot(distance, 7.5)
            sin_g, cos_g = 7.5 / bounced, distance / bounced
            root = np.sqrt(eta - cos_g**2)
            if polarization == "V":
                coefficient, sign = (eta * sin_g - root) / (eta * sin_g + root), 1.0
            else:
                coefficient, sign = (sin_g - root) / (sin_g + root), -1.0  # the azimuth axes of the ends are opposite
            wave = SPEED_OF_LIGHT / carrier
            gain = 1.5 * np.array([distance / direct, distance / bounced]) ** 2  # both poles of a short dipole
            expected = sign * wave / (4 * np.pi) * gain * np.array([1.0, coefficient]) / np.array([direct, bounced])
            np.testing.assert_allclose(paths.a["sunny"][:, column], expected, rtol=1e-9)
            total = (paths.a["sunny"][:, column] * np.exp(-2j * np.pi * carrier * paths.tau)).sum()
            closed = (expected * np.exp(-2j * np.pi / wave * np.array([direct, bounced]))).sum()
            assert abs(total - closed) < 1e-6 * np.abs(expected).max()
        np.testing.assert_allclose(paths.vertex[1, 0], [distance * 6.0 / 7.5, 0, 0], atol=1e-12)


def traffic(frame_count: int = 5, paint: int = 3) -> SceneData:
    """Two CAVs, a turning truck and a roadside unit in the canyon, at street speeds; material of the truck: `paint`."""
    models = (box_model("sedan", material=3), box_model("truck", (8.0, 2.5, 3.5), (0.5, 0.0, 1.75), material=paint))
    actors = [("cav_1", "cav", 0), ("cav_2", "cav", 0), ("veh_001", "vehicle", 1), ("rsu_1", "rsu", -1)]
    rows = []
    for k in range(frame_count):
        t = k * FRAME_DT
        rows.append(
            [
                pose_from_ypr([-20 + 12 * t, -3 + 0.5 * t, 0.02 * t], 0.05 + 0.3 * t, 0.01, 0.02 * t),
                pose_from_ypr([15 - 9 * t, 3.0, 0.0], np.pi - 0.2 * t),
                pose_from_ypr([-2 + 5 * t, 6.5 - t, 0.0], 0.15 + 0.6 * t),
                np.array(pose(0.0, -9.0, 5.0)),
            ]
        )
    return street_canyon(models, actors, np.array(rows))


def deep_traffic(frame_count: int = 5, paint: int = 4) -> SceneData:
    """The same with panes that let waves through, and cars that conduct perfectly; the truck is of panes."""
    arrays = traffic(frame_count, paint)
    described = list(arrays.materials["sunny"])
    for index, change in ((2, {"thickness": 0.012}), (4, {"thickness": 0.006}), (3, {"itu": "itu_pec"})):
        described[index] = replace(described[index], radio=replace(described[index].radio, **change))
    return replace(arrays, materials={"sunny": tuple(described)})


DEEP = {"max_depth": 3, "refraction": True, "diffraction": True, "links": ("v2i", "v2v")}
ROOF = {"antenna_position_m": {"cav": (0.3, 0.2, 2.5), "rsu": (0.0, 0.0, 1.0)}}


def test_reciprocity(device: str) -> None:
    arrays, config = traffic(), channel(links=("v2i", "v2v"), **ROOF)
    scene = DeviceScene(arrays, device, 8)
    scene.load_batch([0, 3])
    links = make_links(arrays, scene.batch_frames, config)
    swapped = replace(links, tx=links.rx, rx=links.tx, tx_actor=links.rx_actor, rx_actor=links.tx_actor)
    there, back = (solve_paths(scene, rows, config, arrays.materials) for rows in (links, swapped))
    assert (there.kind == PATH_SPECULAR).sum() > 10
    for name in ("link", "surface", "object_id", "material_id"):
        np.testing.assert_array_equal(getattr(there, name), getattr(back, name))
    np.testing.assert_allclose(there.tau, back.tau, rtol=1e-14)
    np.testing.assert_allclose(there.theta_t, back.theta_r, atol=1e-14)
    np.testing.assert_allclose(there.range_rate, back.range_rate, atol=1e-10)
    np.testing.assert_allclose(there.a["sunny"], back.a["sunny"], rtol=1e-9, atol=1e-18)
    transposed = there.transfer["sunny"].swapaxes(2, 3)
    np.testing.assert_allclose(transposed, back.transfer["sunny"], rtol=1e-9, atol=1e-16)


def both_ways(arrays: SceneData, frames: list[int], device: str) -> tuple[np.ndarray, np.ndarray, list[tuple]]:
    """Return transfers there and transposed transfers back of every deep path, [P, C, 2, 2], and what each meets."""
    config = channel(**DEEP, **ROOF)
    scene = DeviceScene(arrays, device, len(frames))
    scene.load_batch(frames)
    links = make_links(arrays, frames, config)
    swapped = replace(links, tx=links.rx, rx=links.tx, tx_actor=links.rx_actor, rx_actor=links.tx_actor)
    there, back = (solve_paths(scene, rows, config, arrays.materials) for rows in (links, swapped))
    pairs, met = [], []
    for link in range(len(links)):
        forward, backward = chains(there, link), chains(back, link)
        assert forward.keys() == {chain[::-1] for chain in backward}
        for chain, p in forward.items():
            q, order = backward[chain[::-1]], len(chain)
            pairs.append((p, q))
            met.append((chain, there.material_id[p, :order].tolist()))
            np.testing.assert_allclose(there.vertex[p, :order], back.vertex[q, :order][::-1], atol=1e-9)
    p, q = np.array(pairs).T
    np.testing.assert_allclose(there.tau[p], back.tau[q], rtol=1e-13)
    np.testing.assert_allclose(there.theta_t[p], back.theta_r[q], atol=1e-10)
    np.testing.assert_allclose(there.range_rate[p], back.range_rate[q], atol=1e-9)
    return there.transfer["sunny"][p], back.transfer["sunny"][q].swapaxes(2, 3), met


def relative_error(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.abs(one - other).max(axis=(1, 2, 3)) / np.abs(one).max(axis=(1, 2, 3))


def test_reciprocity_of_chains(device: str) -> None:
    """Swapped ends: the same paths, read backwards, with the transposed transfer."""
    there, back, met = both_ways(deep_traffic(), [0, 3], device)
    straight = np.array([all(kind != DIFFRACTION for kind, _ in chain) for chain, _ in met])
    assert straight.sum() > 80 and (~straight).sum() > 80
    assert relative_error(there, back)[straight].max() < 1e-8


def test_reciprocity_of_conducting_wedges(device: str) -> None:
    """The same for wedges of a perfect conductor, whatever the surfaces before or behind them."""
    there, back, met = both_ways(deep_traffic(5, paint=3), [0, 3], device)
    bent = [any(k == DIFFRACTION and m == 3 for (k, _), m in zip(*row, strict=True)) for row in met]
    assert sum(bent) > 100
    assert relative_error(there, back)[bent].max() < 1e-8


def test_mirror_symmetry(device: str) -> None:
    """Ends on the axis of a street with equal walls: left and right paths are mirror images."""
    north = wall_part("north", (-100.0, 10.0), (100.0, 10.0), 15.0)
    walls = [north, wall_part("south", (100.0, -10.0), (-100.0, -10.0), 15.0)]
    actors = [("rsu_1", "rsu", -1), ("cav_1", "cav", -1)]
    arrays = arrays_from_parts(walls, actors=actors, poses=np.array([[pose(0, 0, 6), pose(35, 0, 2)]]))
    _, paths = solve(arrays, channel(), device)
    assert paths.kind.tolist() == [PATH_LOS, PATH_SPECULAR, PATH_SPECULAR]
    left, right = paths.vertex[1:, 0]
    np.testing.assert_allclose(left, right * [1, -1, 1], atol=1e-12)
    assert paths.tau[1] == pytest.approx(paths.tau[2], rel=1e-14)
    assert paths.phi_t[1] == pytest.approx(-paths.phi_t[2], rel=1e-12)
    np.testing.assert_allclose(paths.a["sunny"][1], paths.a["sunny"][2], rtol=1e-12)


def test_doppler_is_the_change_of_delay(device: str) -> None:
    """Every path that lives through three frames: f_D = -f d(tau)/dt, with moving and turning ends and reflectors."""
    arrays = deep_traffic(5)
    links, paths = solve(arrays, channel(**DEEP, **ROOF), device)
    on_body = paths.object_id >= arrays.actors[0].object_id
    row_of = {(int(links.frame[paths.link[p]]), int(paths.path_id[p])): p for p in range(len(paths))}
    checked = np.zeros(4, dtype=int)
    moving, bent, through = 0, 0, 0
    for (frame, identity), p in row_of.items():
        before, after = row_of.get((frame - 1, identity)), row_of.get((frame + 1, identity))
        if before is not None and after is not None:
            rate = (paths.tau[after] - paths.tau[before]) / (2 * FRAME_DT)
            expected = -np.array(CARRIERS) * rate
            np.testing.assert_allclose(paths.doppler_hz[p], expected, atol=2e-3 * 28e9 / SPEED_OF_LIGHT)
            checked[paths.order[p]] += 1
            moving += on_body[p].sum() > 1
            bent += bool((on_body[p] & (paths.interaction[p] == DIFFRACTION)).any())
            through += paths.kind[p] == PATH_TRANSMISSION
    assert (checked > [5, 20, 50, 50]).all() and moving > 20 and bent > 20 and through > 5


def test_doppler_sign(device: str) -> None:
    """What comes nearer sounds higher: ends, a reflecting van and a diffracting corner of it."""
    models = (box_model("van", (4.0, 2.0, 3.0), (0.0, 0.0, 1.5), material=0),)
    actors = [("veh_001", "vehicle", 0), ("rsu_1", "rsu", -1), ("cav_1", "cav", -1)]
    for speed in (20.0, -20.0):
        still = pose(0.0, 1.0, 1.0), pose(0.0, -1.5, 1.2)
        rows = [[pose(12.0 - speed * k * FRAME_DT, 0.0), *still] for k in range(3)]
        _, paths = solve(arrays_from_parts([], models, actors, np.array(rows)), channel(diffraction=True), device, [1])
        assert sorted(set(paths.interaction[paths.order > 0, 0].tolist())) == [SPECULAR, DIFFRACTION]
        assert (np.sign(paths.doppler_hz[paths.order == 1]) == np.sign(speed)).all()
        assert (paths.doppler_hz[paths.kind == PATH_LOS] == 0.0).all()
    links, paths = solve(traffic(3), channel(links=("v2v",), **ROOF), device, [1])
    approaching = (links.tx_actor[paths.link] == 0) & (links.rx_actor[paths.link] == 1) & (paths.kind == PATH_LOS)
    assert (paths.doppler_hz[approaching] > 0).all() and approaching.any()


def test_reflection_at_a_posed_vehicle(device: str) -> None:
    """The side of a turned and tilted truck, against the image method written out here."""
    body = pose_from_ypr([4.0, 6.0, 0.3], 0.1, 0.02, -0.03)
    models = (box_model("truck", (8.0, 2.5, 3.5), (0.5, 0.0, 1.75), material=0),)
    actors = [("truck", "vehicle", 0), ("rsu_1", "rsu", -1), ("cav_1", "cav", -1)]
    tx, rx = np.array([-6.0, -5.0, 3.0]), np.array([16.0, -3.0, 1.0])
    poses = np.array([[body, pose(*tx), pose(*rx)]])
    arrays = arrays_from_parts([], models, actors, poses, materials=["car_paint_red"])
    _, paths = solve(arrays, channel(), device)
    assert paths.kind.tolist() == [PATH_LOS, PATH_SPECULAR]
    corners = transform_points(body, [[-3.5, -1.25, 0], [4.5, -1.25, 0], [4.5, -1.25, 3.5]])
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    normal /= np.linalg.norm(normal)
    image = tx - 2 * ((tx - corners[0]) @ normal) * normal
    share = ((corners[0] - image) @ normal) / ((rx - image) @ normal)
    np.testing.assert_allclose(paths.vertex[1, 0], image + share * (rx - image), atol=1e-11)
    assert paths.tau[1] * SPEED_OF_LIGHT == pytest.approx(np.linalg.norm(rx - image), rel=1e-13)
    np.testing.assert_allclose(paths.normal[1, 0], normal * np.sign((tx - corners[0]) @ normal), atol=1e-12)
    assert paths.object_id[1, 0] == arrays.actors[0].object_id


def described(name: str, eps_r: float, sigma: float = 0.0, thickness: float = 0.0) -> dict[str, Material]:
    radio = RadioMaterial("constant", relative_permittivity=eps_r, conductivity=sigma, thickness=thickness)
    return {name: Material(name, radio, "none", 0.3, (0.5,) * 3)}


def test_mirror_symmetry_of_two_reflections(device: str) -> None:
    """On the axis of the street, also over the road: every pair of walls has its mirror image."""
    north = wall_part("north", (-100.0, 10.0), (100.0, 10.0), 15.0)
    walls = [north, wall_part("south", (100.0, -10.0), (-100.0, -10.0), 15.0), ground_part(100.0)]
    actors = [("rsu_1", "rsu", -1), ("cav_1", "cav", -1)]
    arrays = arrays_from_parts(walls, actors=actors, poses=np.array([[pose(0, 0, 6), pose(35, 0, 2)]]))
    _, paths = solve(arrays, channel(max_depth=2), device)
    own, turned = chains(paths, 0), {0: 1, 1: 0, 2: 2}
    assert sum(len(chain) == 2 for chain in own) == 4  # both walls in turn, and road and wall: a corner has one order
    for chain, p in own.items():
        q = own[tuple((kind, turned[surface]) for kind, surface in chain)]
        np.testing.assert_allclose(paths.vertex[p], paths.vertex[q] * [1, -1, 1], atol=1e-12)
        np.testing.assert_allclose(paths.tau[p], paths.tau[q], rtol=1e-14)
        np.testing.assert_allclose(np.sin(paths.phi_r[p]), -np.sin(paths.phi_r[q]), atol=1e-12)
        np.testing.assert_allclose(paths.a["sunny"][p], paths.a["sunny"][q], rtol=1e-12)


@pytest.mark.parametrize("thickness", [0.0, 0.013])
def test_brewster(thickness: float, device: str) -> None:
    """At tan(theta) = sqrt(eps_r) ground of no loss reflects nothing of a vertical wave, as half-space and as slab."""
    eps_r, height = 4.0, 3.0
    across = 2 * height * np.sqrt(eps_r)
    for polarization, bound in (("V", (0.0, 1e-12)), ("H", (0.1, 1.0))):
        ground = [ground_part(50.0, material="ground")]
        ends = np.array([[pose(0, 0, height), pose(across, 0, height)]])
        actors = [("rsu_1", "rsu", -1), ("cav_1", "cav", -1)]
        arrays = arrays_from_parts(
            ground, actors=actors, poses=ends, materials=described("ground", eps_r, thickness=thickness)
        )
        _, paths = solve(arrays, channel(polarization=polarization, pattern="iso"), device)
        assert paths.kind.tolist() == [PATH_LOS, PATH_SPECULAR]
        share = np.abs(paths.a["sunny"][1]) * 4 * np.pi * paths.tau[1] * np.array(CARRIERS)
        assert (share >= bound[0]).all() and (share <= bound[1]).all()


@pytest.mark.parametrize(("eps_r", "thickness"), [(2.0, 0.004), (6.3, 0.011), (9.0, 0.2)])
def test_slab_without_loss_keeps_the_energy(eps_r: float, thickness: float, device: str) -> None:
    """|R|^2 + |T|^2 = 1, from a reflected path and one through the slab at the same angle."""
    wall = quad_part("Buildings/wall", [(0, -90, -90), (0, 90, -90), (0, 90, 90), (0, -90, 90)], "pane", "building")
    for across in (0.0, 3.0, 20.0, 60.0):
        ends = [pose(-4, 0, 1), pose(-4, across + 1e-3, 1), pose(4, across + 1e-3, 1)]
        actors = [("rsu_1", "rsu", -1), ("cav_1", "cav", -1), ("cav_2", "cav", -1)]
        materials = described("pane", eps_r, thickness=thickness)
        arrays = arrays_from_parts([wall], actors=actors, poses=np.array([ends]), materials=materials)
        _, paths = solve(arrays, channel(refraction=True, los=True), device)
        used = [np.nonzero((paths.link == k) & (paths.order == 1))[0].item() for k in (0, 1)]
        assert paths.kind[used].tolist() == [PATH_SPECULAR, PATH_TRANSMISSION]
        assert paths.tau[used[0]] == pytest.approx(paths.tau[used[1]], rel=1e-14)
        share = paths.transfer["sunny"][used] * (4 * np.pi * paths.tau[used[0]] * np.array(CARRIERS))[:, None, None]
        power = np.abs(share) ** 2
        np.testing.assert_allclose(power[..., 0, 0].sum(axis=0), 1.0, rtol=1e-12)  # TE
        np.testing.assert_allclose(power[..., 1, 1].sum(axis=0), 1.0, rtol=1e-12)  # TM
        assert power[..., 0, 1].max() < 1e-20 and power[..., 1, 0].max() < 1e-20


def test_no_path_gains(device: str) -> None:
    """No polarisation comes out of any chain stronger than through free space of the same length."""
    _, paths = solve(deep_traffic(2), channel(**DEEP, **ROOF), device)
    free = 1.0 / (4 * np.pi * paths.tau[:, None] * np.array(CARRIERS))
    gain = np.linalg.norm(paths.transfer["sunny"], ord=2, axis=(2, 3)) / free
    assert len(gain) > 300 and gain.max() <= 1.0 + 1e-12
    np.testing.assert_allclose(gain[paths.kind == PATH_LOS], 1.0, rtol=1e-12)


def test_phase_at_500_m(device: str, record_property) -> None:
    """2 pi f tau at 28 GHz against 60 digits: line of sight, one and two reflections, also at a posed body."""
    facade = np.array([(-300.0, 31.7, -60.0), (300.0, 44.1, -60.0), (300.0, 45.3, 90.0)])
    road = np.array([(-300.0, -200.0, -7.9), (300.0, -200.0, -6.2), (300.0, 200.0, -8.8)])
    parts = [
        quad_part(f"Buildings/{name}", [*c, c[0] + c[2] - c[1]], "concrete_facade", "building")
        for name, c in (("facade", facade), ("road", road))
    ]
    body = pose_from_ypr([20.1, -60.3, 2.7], 0.07, 0.03, -0.05)
    model = box_model("truck", (150.0, 4.0, 80.0), (0.0, 0.0, 10.0))
    tx, rx = (-246.3, 1.25, 9.875), (251.7, -3.4, 1.62)
    actors = [("veh_001", "vehicle", 0), ("rsu_1", "rsu", -1), ("cav_1", "cav", -1)]
    arrays = arrays_from_parts(parts, [model], actors, np.array([[body, pose(*tx), pose(*rx)]]))
    _, paths = solve(arrays, channel(max_depth=2), device)
    corners = dict(enumerate([facade, road]))
    side = model.faces[np.flatnonzero(model.surface == 3)[0]]
    corners[2 + 3] = transform_points(body, model.points[side])
    worst = Decimal(0)
    used = [chain for chain in chains(paths, 0) if all(surface in corners for _, surface in chain)]
    assert {len(chain) for chain in used} == {0, 1, 2} and any(5 in dict(map(reversed, chain)) for chain in used)
    for chain in used:
        length = exact_length(np.array(tx), np.array(rx), [corners[surface] for _, surface in chain])
        tau = Decimal(float(paths.tau[chains(paths, 0)[chain]]))
        assert 1.6e-6 < tau < 2.2e-6
        error = abs(tau - length / Decimal(SPEED_OF_LIGHT)) * Decimal(2 * np.pi) * Decimal("28e9")
        worst = max(worst, error)
    record_property("phase_error_rad", float(worst))
    assert worst < Decimal("1e-8")
