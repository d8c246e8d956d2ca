"""The channel against closed forms and laws: free space, two rays, reciprocity, symmetry, Doppler."""

from dataclasses import replace

import numpy as np
import pytest

from mmw.channel.links import Links, make_links
from mmw.channel.paths import PATH_LOS, PATH_SPECULAR, Paths
from mmw.channel.solver import solve_paths
from mmw.config import ChannelConfig
from mmw.constants import FRAME_DT, SPEED_OF_LIGHT, VACUUM_PERMITTIVITY
from mmw.materials import Material, RadioMaterial
from mmw.poses import pose_from_ypr, transform_points
from mmw.scene import Scene
from mmw.scene_arrays import SceneArrays
from tests.scenes import arrays_from_parts, box_model, ground_part, pose, street_canyon, wall_part

CARRIERS = (28e9, 4.9e9)


def channel(**changes) -> ChannelConfig:
    values = {
        "carriers_hz": CARRIERS,
        "candidates": "exhaustive",
        "antenna_position_m": {"cav": (0, 0, 0), "rsu": (0, 0, 0)},
    }
    return ChannelConfig(**{**values, **changes})


def solve(
    arrays: SceneArrays, config: ChannelConfig, device: str, frames: list[int] | None = None
) -> tuple[Links, Paths]:
    scene = Scene(arrays, device, 8)
    scene.load_batch(frames if frames is not None else list(arrays.frames))
    links = make_links(arrays, scene.batch_frames, config)
    return links, solve_paths(scene, links, config, arrays.materials)


def flat_ground(eps_r: float, sigma: float, rsu: tuple, cav: tuple) -> SceneArrays:
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
    assert np.isnan(paths.vertex).all() and paths.object_id[0] == paths.material_id[0] == paths.surface[0] == -1


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
        np.testing.assert_allclose(paths.vertex[1], [distance * 6.0 / 7.5, 0, 0], atol=1e-12)


def traffic(frame_count: int = 5) -> SceneArrays:
    """Two CAVs, a turning truck and a roadside unit in the canyon, at street speeds."""
    models = (box_model("sedan", material=3), box_model("truck", (8.0, 2.5, 3.5), (0.5, 0.0, 1.75), material=3))
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


ROOF = {"antenna_position_m": {"cav": (0.3, 0.2, 2.5), "rsu": (0.0, 0.0, 1.0)}}


def test_reciprocity(device: str) -> None:
    arrays, config = traffic(), channel(links=("v2i", "v2v"), **ROOF)
    scene = Scene(arrays, device, 8)
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


def test_mirror_symmetry(device: str) -> None:
    """Ends on the axis of a street with equal walls: left and right paths are mirror images."""
    north = wall_part("north", (-100.0, 10.0), (100.0, 10.0), 15.0)
    walls = [north, wall_part("south", (100.0, -10.0), (-100.0, -10.0), 15.0)]
    actors = [("rsu_1", "rsu", -1), ("cav_1", "cav", -1)]
    arrays = arrays_from_parts(walls, actors=actors, poses=np.array([[pose(0, 0, 6), pose(35, 0, 2)]]))
    _, paths = solve(arrays, channel(), device)
    assert paths.kind.tolist() == [PATH_LOS, PATH_SPECULAR, PATH_SPECULAR]
    left, right = paths.vertex[1:]
    np.testing.assert_allclose(left, right * [1, -1, 1], atol=1e-12)
    assert paths.tau[1] == pytest.approx(paths.tau[2], rel=1e-14)
    assert paths.phi_t[1] == pytest.approx(-paths.phi_t[2], rel=1e-12)
    np.testing.assert_allclose(paths.a["sunny"][1], paths.a["sunny"][2], rtol=1e-12)


def test_doppler_is_the_change_of_delay(device: str) -> None:
    """Every path that lives through three frames: f_D = -f d(tau)/dt, with moving and turning ends and reflectors."""
    links, paths = solve(traffic(5), channel(links=("v2i", "v2v"), **ROOF), device)
    delay = {}
    for i in range(len(paths)):
        link = paths.link[i]
        delay[int(links.frame[link]), int(links.tx_actor[link]), int(links.rx_actor[link]), int(paths.surface[i])] = i
    checked, on_truck = 0, 0
    for (frame, tx, rx, surface), i in delay.items():
        before, after = delay.get((frame - 1, tx, rx, surface)), delay.get((frame + 1, tx, rx, surface))
        if before is not None and after is not None:
            rate = (paths.tau[after] - paths.tau[before]) / (2 * FRAME_DT)
            np.testing.assert_allclose(
                paths.doppler_hz[i], -np.array(CARRIERS) * rate, atol=2e-3 * 28e9 / SPEED_OF_LIGHT
            )
            checked += 1
            on_truck += paths.object_id[i] >= 0 and paths.surface[i] >= 3
    assert checked > 20 and on_truck > 3
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
    np.testing.assert_allclose(paths.vertex[1], image + share * (rx - image), atol=1e-11)
    assert paths.tau[1] * SPEED_OF_LIGHT == pytest.approx(np.linalg.norm(rx - image), rel=1e-13)
    np.testing.assert_allclose(paths.normal[1], normal * np.sign((tx - corners[0]) @ normal), atol=1e-12)
    assert paths.object_id[1] == arrays.actors[0].object_id
