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
from mmw.physics.materials.material import RadioMaterial
from mmw.scene.scene_data import SceneData
from tests.fixtures.antennas import antenna_at
from tests.fixtures.device_rays import loaded
from tests.fixtures.scenes import arrays_from_parts, box_model, ground_part, pose, quad_part, wall_part
from tests.oracles import channel as oracle
from tests.oracles.channel import DIFFRACTION

CARRIERS = (28e9, 4.9e9)


def flat_ground(eps_r: float, sigma: float, rsu: tuple, cav: tuple) -> SceneData:
    """Level ground of a constant material; the agents are poses without a body."""
    radio = RadioMaterial("constant", relative_permittivity=eps_r, conductivity=sigma)
    return oracle.link_scene([ground_part(300.0)], rsu, cav, materials=oracle.radio_materials({"asphalt": radio}))


def test_free_space(device: str) -> None:
    links, paths = oracle.solve(oracle.link_scene([], (0, 0, 9), (30, 40, 1.5, 1.0)), oracle.channel(), device)
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
        _, paths = oracle.solve(arrays, oracle.channel(polarization=polarization), device)
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


def deep_traffic(frame_count: int = 5, paint: int = 4) -> SceneData:
    """Return traffic with panes that let waves through, and cars that conduct perfectly; the truck is of panes."""
    arrays = oracle.traffic(oracle.driving(FRAME_DT * np.arange(frame_count)), paint)
    described = list(arrays.materials["sunny"])
    for index, change in ((2, {"thickness": 0.012}), (4, {"thickness": 0.006}), (3, {"itu": "itu_pec"})):
        described[index] = replace(described[index], radio=replace(described[index].radio, **change))
    return replace(arrays, materials={"sunny": tuple(described)})


DEEP = {"max_depth": 3, "refraction": True, "diffraction": True, "links": ("v2i", "v2v")}
ROOF = {"antennas": antenna_at({"cav": (0.3, 0.2, 2.5), "rsu": (0.0, 0.0, 1.0)})}


def both_directions(arrays: SceneData, frames: list[int], device: str) -> tuple[np.ndarray, np.ndarray, list[tuple]]:
    """Return transfers there and transposed transfers back of every deep path, [P, C, 2, 2], and its interactions."""
    config = oracle.channel(**DEEP, **ROOF)
    scene = loaded(arrays, device, frames)
    links = make_links(arrays, frames, config)
    swapped = replace(links, tx=links.rx, rx=links.tx, tx_actor=links.rx_actor, rx_actor=links.tx_actor)
    there, back = (solve_paths(scene, rows, config, arrays.materials) for rows in (links, swapped))
    pairs, hits = [], []
    for link in range(len(links)):
        forward, backward = oracle.paths_by_interactions(there, link), oracle.paths_by_interactions(back, link)
        assert forward.keys() == {steps[::-1] for steps in backward}
        for steps, p in forward.items():
            q, order = backward[steps[::-1]], len(steps)
            pairs.append((p, q))
            hits.append((steps, there.material_id[p, :order].tolist()))
            np.testing.assert_allclose(there.vertex[p, :order], back.vertex[q, :order][::-1], atol=1e-9)
    p, q = np.array(pairs).T
    np.testing.assert_allclose(there.tau[p], back.tau[q], rtol=1e-13)
    np.testing.assert_allclose(there.theta_t[p], back.theta_r[q], atol=1e-10)
    np.testing.assert_allclose(there.range_rate[p], back.range_rate[q], atol=1e-9)
    return there.transfer["sunny"][p], back.transfer["sunny"][q].swapaxes(2, 3), hits


def relative_error(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.abs(one - other).max(axis=(1, 2, 3)) / np.abs(one).max(axis=(1, 2, 3))


def test_reciprocity_of_deep_paths(device: str) -> None:
    """Swapped ends: the same paths, read backwards, with the transposed transfer."""
    there, back, hits = both_directions(deep_traffic(), [0, 3], device)
    straight = np.array([all(kind != DIFFRACTION for kind, _ in steps) for steps, _ in hits])
    assert straight.sum() > 80 and (~straight).sum() > 80
    assert relative_error(there, back)[straight].max() < 1e-8


def test_reciprocity_of_conducting_wedges(device: str) -> None:
    """The same for wedges of a perfect conductor, whatever the surfaces before or behind them."""
    there, back, hits = both_directions(deep_traffic(5, paint=3), [0, 3], device)
    diffracted = [any(k == DIFFRACTION and m == 3 for (k, _), m in zip(*row, strict=True)) for row in hits]
    assert sum(diffracted) > 100
    assert relative_error(there, back)[diffracted].max() < 1e-8


def test_doppler_is_the_change_of_delay(device: str) -> None:
    """Every path that lives through three frames: f_D = -f d(tau)/dt, with moving and turning ends and reflectors."""
    arrays = deep_traffic(5)
    links, paths = oracle.solve(arrays, oracle.channel(**DEEP, **ROOF), device)
    on_body = paths.object_id >= arrays.actors[0].object_id
    row_of = {(int(links.frame[paths.link[p]]), int(paths.path_id[p])): p for p in range(len(paths))}
    checked = np.zeros(4, dtype=int)
    moving, diffracted, through = 0, 0, 0
    for (frame, identity), p in row_of.items():
        before, after = row_of.get((frame - 1, identity)), row_of.get((frame + 1, identity))
        if before is not None and after is not None:
            rate = (paths.tau[after] - paths.tau[before]) / (2 * FRAME_DT)
            expected = -np.array(CARRIERS) * rate
            np.testing.assert_allclose(paths.doppler_hz[p], expected, atol=2e-3 * 28e9 / SPEED_OF_LIGHT)
            checked[paths.order[p]] += 1
            moving += on_body[p].sum() > 1
            diffracted += bool((on_body[p] & (paths.interaction[p] == DIFFRACTION)).any())
            through += paths.kind[p] == PATH_TRANSMISSION
    assert (checked > [5, 20, 50, 50]).all() and moving > 20 and diffracted > 20 and through > 5


def test_mirror_symmetry(device: str) -> None:
    """On the axis of the street, also over the road: every pair of walls has its mirror image."""
    north = wall_part("north", (-100.0, 10.0), (100.0, 10.0), 15.0)
    walls = [north, wall_part("south", (100.0, -10.0), (-100.0, -10.0), 15.0), ground_part(100.0)]
    _, paths = oracle.solve(oracle.link_scene(walls, (0, 0, 6), (35, 0, 2)), oracle.channel(max_depth=2), device)
    own, turned = oracle.paths_by_interactions(paths, 0), {0: 1, 1: 0, 2: 2}
    assert sum(len(steps) == 2 for steps in own) == 4  # both walls in turn, and road and wall: a corner has one order
    for steps, p in own.items():
        q = own[tuple((kind, turned[surface]) for kind, surface in steps)]
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
        radio = RadioMaterial("constant", relative_permittivity=eps_r, thickness=thickness)
        materials = oracle.radio_materials({"ground": radio})
        arrays = oracle.link_scene(ground, (0, 0, height), (across, 0, height), materials=materials)
        _, paths = oracle.solve(arrays, oracle.channel(polarization=polarization, pattern="iso"), device)
        assert paths.kind.tolist() == [PATH_LOS, PATH_SPECULAR]
        share = np.abs(paths.a["sunny"][1]) * 4 * np.pi * paths.tau[1] * np.array(CARRIERS)
        assert (share >= bound[0]).all() and (share <= bound[1]).all()


def test_no_path_gains(device: str) -> None:
    """No polarization comes out of any path stronger than through free space of the same length."""
    _, paths = oracle.solve(deep_traffic(2), oracle.channel(**DEEP, **ROOF), device)
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
    _, paths = oracle.solve(arrays, oracle.channel(max_depth=2), device)
    corners = dict(enumerate([facade, road]))
    side = model.faces[np.flatnonzero(model.surface == 3)[0]]
    corners[2 + 3] = transform_points(body, model.points[side])
    worst = Decimal(0)
    used = [
        steps for steps in oracle.paths_by_interactions(paths, 0) if all(surface in corners for _, surface in steps)
    ]
    assert {len(steps) for steps in used} == {0, 1, 2} and any(5 in dict(map(reversed, steps)) for steps in used)
    for steps in used:
        length = oracle.exact_length(np.array(tx), np.array(rx), [corners[surface] for _, surface in steps])
        tau = Decimal(float(paths.tau[oracle.paths_by_interactions(paths, 0)[steps]]))
        assert 1.6e-6 < tau < 2.2e-6
        error = abs(tau - length / Decimal(SPEED_OF_LIGHT)) * Decimal(2 * np.pi) * Decimal("28e9")
        worst = max(worst, error)
    record_property("phase_error_rad", float(worst))
    assert worst < Decimal("1e-8")
