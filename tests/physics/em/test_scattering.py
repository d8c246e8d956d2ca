"""Diffuse scattering: patterns, power against integrals and Sionna RT, mirrors and slabs on the way, short segments."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmw.channel.paths import PATH_DIFFUSE, PATH_SPECULAR, PathSet
from mmw.core.constants import FRAME_DT, SPEED_OF_LIGHT
from mmw.core.transforms import invert, pose_from_ypr, transform_points
from mmw.physics.em.scattering import lobe_integral, scattering_pattern
from mmw.physics.em.vectors import unit_vector
from mmw.physics.materials.material import RadioMaterial
from mmw.physics.materials.permittivity import relative_permittivity
from mmw.scene.scene_data import SceneData
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.scenes import arrays_from_parts, arrays_from_ply, box_model, ground_part, pose, quad_part, wall_part
from tests.oracles import channel as oracle
from tests.oracles.channel import DIFFUSE, SPECULAR, TRANSMISSION
from tests.oracles.sionna import FOLDER, MANIFEST, read_case, used_material

CARRIER_HZ = 28e9
WAVELENGTH = SPEED_OF_LIGHT / CARRIER_HZ
LOBES = {
    "lambertian": {},
    "directive": {"scattering_pattern": "directive", "alpha_r": 6},
    "backscattering": {"scattering_pattern": "backscattering", "alpha_r": 5, "alpha_i": 9, "lobe_share": 0.6},
}
ALONE = oracle.channel(
    carriers_hz=(CARRIER_HZ,),
    diffuse_reflection=True,
    diffuse_samples=100_000,
    los=False,
    specular_reflection=False,
    pattern="iso",
)
TX, RX = np.array([-4.0, 2.0, 5.0]), np.array([6.0, -3.0, 4.0])
HALF = 12.0
"""Half of the side of the rough ground [m]."""


def rough(name: str = "lambertian", **changes) -> RadioMaterial:
    values = {"relative_permittivity": 4.0, "conductivity": 0.05, "scattering": 0.5, "xpd": 0.2}
    return RadioMaterial("constant", **{**values, **LOBES[name], **changes})


def scene(radio: dict[str, RadioMaterial], parts: list[MeshPart], tx=TX, rx=RX) -> SceneData:
    """Return parts with a transmitter and a receiver without bodies."""
    return oracle.link_scene(parts, tx, rx, materials=oracle.radio_materials(radio))


def ground() -> MeshPart:
    return ground_part(HALF, material="rough")


def power(paths: PathSet, *interactions: int) -> np.ndarray:
    """Return sum |transfer|^2 over the paths with these interactions, [receive, transmit] in (theta, phi)."""
    wanted = np.zeros(paths.interaction.shape[1], dtype=int)
    wanted[: len(interactions)] = interactions
    rows = (paths.interaction == wanted).all(axis=1)
    assert rows.sum() > 500
    return (np.abs(paths.transfer["sunny"][rows, 0]) ** 2).sum(axis=0)


def hemisphere(count: int = 48) -> tuple[np.ndarray, np.ndarray]:
    """Return directions and weights that integrate polynomials over the upper half of the sphere, [N, 3] and [N]."""
    node, weight = np.polynomial.legendre.leggauss(count)
    z, phi = (node + 1) / 2, np.arange(2 * count) * np.pi / count
    z, phi, weight = np.repeat(z, 2 * count), np.tile(phi, count), np.repeat(weight / 2, 2 * count) * np.pi / count
    across = np.sqrt(1 - z**2)
    return np.stack([across * np.cos(phi), across * np.sin(phi), z], axis=1), weight


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    name=st.sampled_from(sorted(LOBES)), alpha_r=st.integers(1, 30), alpha_i=st.integers(1, 30),
    share=st.floats(0, 1), incidence=st.floats(0, np.pi / 2 - 1e-3), azimuth=st.floats(-np.pi, np.pi),
)  # fmt: skip
def test_patterns_integrate_to_one(
    name: str, alpha_r: int, alpha_i: int, share: float, incidence: float, azimuth: float
) -> None:
    radio = rough(scattering_pattern=name, alpha_r=alpha_r, alpha_i=alpha_i, lobe_share=share)
    direction, weight = hemisphere()
    k_in = [np.sin(incidence) * np.cos(azimuth), np.sin(incidence) * np.sin(azimuth), -np.cos(incidence)]
    k_in, normal = np.broadcast_to(k_in, direction.shape), np.broadcast_to([0.0, 0.0, 1.0], direction.shape)
    value = scattering_pattern(radio, k_in, direction, normal)
    assert value.min() >= 0.0 and value @ weight == pytest.approx(1.0, rel=1e-9)
    assert scattering_pattern(radio, k_in, -direction, normal).max() == 0.0
    lobe = (0.5 * (1 + direction @ (k_in[0] * [1, 1, -1]))) ** alpha_r
    assert lobe_integral(alpha_r, np.array([np.cos(incidence)]))[0] == pytest.approx(lobe @ weight, rel=1e-9)


def patch_power(
    radio: RadioMaterial, tx: np.ndarray, rx: np.ndarray, count: int = 160
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the power that pieces of the ground scatter, whatever its polarization, and where they are.

    The integrand is (lambda / 4 pi)^2 S^2 Gamma^2 f_s cos(theta_i) / (r_1^2 r_2^2); the ground is z = 0.

    Source: V. Degli-Esposti et al., IEEE Trans. AP 55(1), 2007, equations 2 to 4.

    Returns:
        Power of the transmitter's theta and of its phi component, [N, 2]; pieces [N, 3]; cosine of incidence [N].
    """
    node, weight = np.polynomial.legendre.leggauss(count)
    x, y = (k.ravel() for k in np.meshgrid(node * HALF, node * HALF))
    area = (weight[:, None] * weight[None, :]).ravel() * HALF**2
    place = np.stack([x, y, np.zeros_like(x)], axis=1)
    one, two = place - tx, rx - place
    r_1, r_2 = np.linalg.norm(one, axis=1), np.linalg.norm(two, axis=1)
    k_in, k_out, cosine = one / r_1[:, None], two / r_2[:, None], -one[:, 2] / r_1
    if radio.scattering_pattern == "lambertian":
        density = k_out[:, 2] / np.pi
    else:
        share = radio.lobe_share if radio.scattering_pattern == "backscattering" else 1.0
        direction, solid = hemisphere(24)
        grid = np.linspace(0.0, 1.0, 400)

        def lobes(mirror: np.ndarray, source: np.ndarray, out: np.ndarray) -> np.ndarray:
            return (
                share * (0.5 * (1 + mirror @ out)) ** radio.alpha_r
                + (1 - share) * (0.5 * (1 - source @ out)) ** radio.alpha_i
            )

        directions = np.stack([np.sqrt(1 - grid**2), np.zeros(400), -grid], axis=1)
        whole = lobes(directions * [1, 1, -1], directions, direction.T) @ solid
        value = [lobes(unit * [1, 1, -1], unit, out) for unit, out in zip(k_in, k_out, strict=True)]
        density = np.array(value) / np.interp(cosine, grid, whole)
    r_te, r_tm, _, _ = oracle.slab_coefficients(
        relative_permittivity(radio, CARRIER_HZ), cosine, radio.thickness, CARRIER_HZ
    )
    common = (WAVELENGTH / (4 * np.pi) * radio.scattering / (r_1 * r_2)) ** 2 * density * cosine * area
    return np.stack([common * np.abs(r_tm) ** 2, common * np.abs(r_te) ** 2], axis=1), place, cosine


@pytest.mark.parametrize("name", sorted(LOBES))
def test_power_and_angles_against_the_integral(name: str, device: str) -> None:
    """Level ground: theta is TM and phi TE; power of each, and where it comes from."""
    radio = rough(name)
    _, paths = oracle.solve(scene({"rough": radio}, [ground()]), ALONE, device)
    pieces, place, _ = patch_power(radio, TX, RX)
    whole, kept = pieces.sum(axis=0), np.array([1 - radio.xpd, radio.xpd])
    expected = np.array([[whole[0] * kept[0], whole[1] * kept[1]], [whole[0] * kept[1], whole[1] * kept[0]]])
    np.testing.assert_allclose(power(paths, DIFFUSE), expected, rtol=0.02)
    arrival = unit_vector(paths.theta_r, paths.phi_r)
    for column in range(2):
        weight = (np.abs(paths.transfer["sunny"][:, 0, :, column]) ** 2).sum(axis=1)
        unit = (place - RX) / np.linalg.norm(place - RX, axis=1, keepdims=True)
        mean = (weight @ arrival / weight.sum(), pieces[:, column] @ unit / whole[column])
        np.testing.assert_allclose(mean[0], mean[1], atol=0.005)
        second = [
            np.einsum("n,ni,nj->ij", w, v, v) / w.sum() for w, v in ((weight, arrival), (pieces[:, column], unit))
        ]
        np.testing.assert_allclose(second[0], second[1], atol=0.01)
        for angle, axis in ((paths.theta_r, unit[:, 2]), (paths.phi_r, None)):
            wanted = np.arccos(axis) if axis is not None else np.arctan2(unit[:, 1], unit[:, 0])
            turned = [np.angle(w @ np.exp(1j * a)) for w, a in ((weight, angle), (pieces[:, column], wanted))]
            assert abs(np.angle(np.exp(1j * (turned[0] - turned[1])))) < 0.01
        delay = [
            w @ v / w.sum() for w, v in ((weight, paths.tau * SPEED_OF_LIGHT), (pieces[:, column], lengths(place)))
        ]
        assert delay[0] == pytest.approx(delay[1], abs=0.05)


def lengths(place: np.ndarray) -> np.ndarray:
    return np.linalg.norm(place - TX, axis=1) + np.linalg.norm(place - RX, axis=1)


CASES = [f"dif_{name}_f28" for name in sorted(LOBES)]


@pytest.mark.parametrize("name", CASES)
def test_sionna_diffuse_power(name: str, device: str, record_property) -> None:
    """Summed power of each pair of polarizations against Sionna RT with 10^5 and 10^6 rays."""
    config, used = MANIFEST[name]["config"], MANIFEST[name]["materials"]["m_g"]
    spec = config["scene"]["materials"]["m_g"]
    tx, rx = (config[end][0]["pos"] for end in ("tx", "rx"))
    arrays = arrays_from_ply(
        {"g": (FOLDER / config["scene"]["objects"][0]["ply"], used_material("m_g", used, spec))},
        actors=[("rsu_1", "rsu", -1), ("cav_1", "cav", -1)],
        poses=[[pose(*tx), pose(*rx)]],
    )
    _, paths = oracle.solve(arrays, ALONE, device)
    for rays, count, *wanted in read_case(name)["diffuse_power"]:
        share = power(paths, DIFFUSE).ravel() / wanted - 1
        record_property(f"share_of_{rays:.0f}_rays", share.tolist())
        assert np.abs(share).max() < 0.02
        assert len(paths) / 100_000 == pytest.approx(count / rays, rel=0.002)


def test_mirrors_before_and_behind_the_patch(device: str) -> None:
    """A conducting wall is a second transmitter, or a second receiver, behind it: power of the image."""
    wall = wall_part("wall", (-200.0, HALF + 1), (200.0, HALF + 1), 150.0, "mirror")
    radio = {"rough": rough(xpd=0.0), "mirror": RadioMaterial("itu", itu="itu_pec")}
    config = ALONE.model_copy(update={"specular_reflection": True, "max_depth": 2, "diffuse_samples": 400_000})
    _, paths = oracle.solve(scene(radio, [ground(), wall]), config, device)
    turned = np.array([0.0, 2 * (HALF + 1), 0.0])
    for steps, tx, rx in (
        ((DIFFUSE,), TX, RX),
        ((SPECULAR, DIFFUSE), turned + TX * [1, -1, 1], RX),
        ((DIFFUSE, SPECULAR), TX, turned + RX * [1, -1, 1]),
    ):
        expected = patch_power(radio["rough"], tx, rx)[0].sum(axis=0)
        np.testing.assert_allclose(power(paths, *steps).sum(axis=0), expected, rtol=0.02)
    rows = (paths.interaction == DIFFUSE).sum(axis=1)
    assert rows[paths.kind == PATH_DIFFUSE].tolist() == [1] * int((paths.kind == PATH_DIFFUSE).sum())


@pytest.mark.parametrize("behind", [True, False])
def test_slab_before_or_behind_the_patch(behind: bool, device: str) -> None:
    """A level pane above the ground weakens theta by T_TM and phi by T_TE of each ray, on either side of the patch."""
    pane = quad_part("Props/pane", [(-90, -90, 2), (90, -90, 2), (90, 90, 2), (-90, 90, 2)], "pane", "static")
    slab = RadioMaterial("constant", relative_permittivity=6.3, conductivity=0.03, thickness=0.005)
    radio = {"rough": rough(xpd=0.0), "pane": slab}
    low, high = (6.0, -3.0, 1.2), (-4.0, 2.0, 5.0)
    ends = (low, high) if behind else (high, low)
    config = ALONE.model_copy(update={"diffuse_samples": 5000})
    _, bare = oracle.solve(scene(radio, [ground()], *ends), config, device)
    _, paths = oracle.solve(
        scene(radio, [ground(), pane], *ends), config.model_copy(update={"max_depth": 2, "refraction": True}), device
    )
    steps = [DIFFUSE, TRANSMISSION] if behind else [TRANSMISSION, DIFFUSE]
    rows = np.nonzero((paths.interaction == steps).all(axis=1))[0]
    at = {tuple(vertex): p for p, vertex in enumerate(bare.vertex[:, 0].round(6).tolist())}
    partner = np.array([at[tuple(v)] for v in paths.vertex[rows, 0 if behind else 1].round(6).tolist()])
    assert len(rows) == len(bare) > 500
    angle = bare.theta_r[partner] if behind else bare.theta_t[partner]
    eta = relative_permittivity(slab, CARRIER_HZ)
    _, _, t_te, t_tm = oracle.slab_coefficients(eta, np.abs(np.cos(angle)), slab.thickness, CARRIER_HZ)
    factor = np.stack([t_tm, t_te], axis=1)
    straight, across = (p.transfer["sunny"][rows_of, 0] for p, rows_of in ((bare, partner), (paths, rows)))
    np.testing.assert_allclose(paths.tau[rows], bare.tau[partner], rtol=1e-12)
    size = np.abs(straight).max()
    if behind:
        np.testing.assert_allclose(across, factor[:, :, None] * straight, atol=1e-9 * size)
    else:  # Gamma is a magnitude: it keeps the phase of the slab
        np.testing.assert_allclose(across, straight * factor[:, None, :], atol=1e-9 * size)


def test_mirror_keeps_what_is_not_scattered(device: str) -> None:
    """The reflection of a rough surface is weaker by sqrt(1 - S^2), with or without its diffuse paths."""
    config = oracle.channel(carriers_hz=(CARRIER_HZ,), los=False)
    gains = []
    for scattering, diffuse in ((0.0, False), (0.5, False), (0.5, True)):
        arrays = scene({"rough": rough(scattering=scattering)}, [ground()])
        _, paths = oracle.solve(arrays, config.model_copy(update={"diffuse_reflection": diffuse}), device)
        gains.append(paths.a["sunny"][paths.kind == PATH_SPECULAR, 0].item())
    np.testing.assert_allclose(gains[1:], np.sqrt(0.75) * gains[0], rtol=1e-14)


def test_patch_scatters_to_its_lit_side_only(device: str) -> None:
    sheet, below = ground(), (6.0, -3.0, -4.0)
    for ends in ((TX, below), (below, TX)):
        assert len(oracle.solve(scene({"rough": rough()}, [sheet], *ends), ALONE, device)[1]) == 0
    dark = oracle.solve(scene({"rough": rough()}, [sheet], below, (0.0, 0.0, -2.0)), ALONE, device)[1]
    assert len(dark) > 1000 and (dark.normal[:, 0, 2] == -1.0).all()


def test_doppler_of_patches_on_a_moving_body(device: str) -> None:
    """The patch rides on its body: length to where it is a frame later and a frame before."""
    model = box_model("truck", (8.0, 2.5, 3.5), (0.5, 0.0, 1.75), material=0)
    actors = [("veh_001", "vehicle", 0), ("rsu_1", "rsu", -1), ("cav_1", "cav", -1)]
    body = [pose_from_ypr([3 + 0.02 * k, 6 - 0.03 * k, 0.0], 0.3 + 0.002 * k, 0.001 * k) for k in range(3)]
    ends = [[np.array(pose(-5, 0, 2)), np.array(pose(9 - 0.04 * k, 1, 1))] for k in range(3)]
    poses = np.array([[body[k], *ends[k]] for k in range(3)])
    arrays = arrays_from_parts([], [model], actors, poses, materials=oracle.radio_materials({"rough": rough()}))
    _, paths = oracle.solve(arrays, ALONE.model_copy(update={"diffuse_samples": 20_000}), device, [1])
    local = transform_points(invert(body[1]), paths.vertex[:, 0])
    length = []
    for k in (0, 2):
        place = transform_points(body[k], local)
        length.append(sum(np.linalg.norm(place - poses[k, end, :3], axis=1) for end in (1, 2)))
    assert len(paths) > 50
    np.testing.assert_allclose(paths.range_rate, (length[1] - length[0]) / (2 * FRAME_DT), atol=1e-3)


@pytest.mark.parametrize("height", [0.0, 0.005, 0.02])
@pytest.mark.parametrize("swapped", [False, True])
def test_antenna_near_rough_ground(swapped: bool, height: float, device: str) -> None:
    """Every segment is longer than 1 cm and every gain a number, also with an antenna that lies on the surface."""
    ends = (np.array([-4.0, 2.0, height]), RX)[:: -1 if swapped else 1]
    config = oracle.channel(carriers_hz=(CARRIER_HZ,), diffuse_reflection=True, diffuse_samples=5000, max_depth=2)
    _, paths = oracle.solve(scene({"rough": rough()}, [ground()], *ends), config, device)
    assert np.isfinite(paths.transfer["sunny"]).all() and np.isfinite(paths.theta_r).all()
    rows = paths.order == 1
    for end in ends:
        assert np.linalg.norm(paths.vertex[rows, 0] - end, axis=1).min(initial=1.0) > 0.01


def test_duplicate_reflection_among_diffuse_paths(device: str) -> None:
    """A sheet on a plate reflects once, also when rough patches fill the list of paths between the two."""
    far, lift = 1900.0, 5e-4
    corners = [(far - 9, -1, 0), (far + 9, -1, 0), (far + 9, 1, 0), (far - 9, 1, 0)]
    plate = quad_part("Roads/plate", corners, "asphalt", "road")
    sheet = quad_part("Props/sheet", [(x, 20 * y, lift) for x, y, _ in corners], "metal_pole", "static")
    roof = quad_part("Props/roof", [(x, 50 * y, 7.0) for x, y, _ in corners], "rough", "static")
    arrays = scene({"rough": rough()}, [plate, sheet, roof], (far - 9, 0, 6.0), (far + 9, 0, 1.6))
    counts = []
    for diffuse in (False, True):
        config = oracle.channel(carriers_hz=(CARRIER_HZ,), diffuse_reflection=diffuse, diffuse_samples=200_000)
        _, paths = oracle.solve(arrays, config, device)
        counts.append(int((paths.kind == PATH_SPECULAR).sum()))
    assert counts == [2, 2]


def test_patches_use_no_axis(device: str) -> None:
    """Turning the whole scene turns the paths' vectors and changes no power of all polarizations together."""
    turn = pose_from_ypr([0.0, 0.0, 0.0], 0.7, 0.0, 0.0)
    sums = []
    for frame in (None, turn):
        move = (lambda p: p) if frame is None else (lambda p: transform_points(turn, p))
        part = ground()
        part = MeshPart(part.path, move(part.points), part.faces, part.material, part.label)
        _, paths = oracle.solve(scene({"rough": rough("directive")}, [part], move(TX), move(RX)), ALONE, device)
        sums.append(power(paths, DIFFUSE))
    np.testing.assert_allclose(sums[1], sums[0], rtol=0.01)
