"""Radio maps against Sionna RT, closed forms and image sources."""

import json

import numpy as np
import pytest

from mmw.channel.antennas.arrays import PlanarArray
from mmw.channel.antennas.patterns import SLANTS, antenna_field
from mmw.channel.radio_map.measurement_surface import plane_grid
from mmw.channel.radio_map.radio_map import RadioMap, RadioMapConfig
from mmw.channel.radio_map.solver import precoded_field, solve_radio_map
from mmw.channel.radio_map.transmitters import Transmitters, actor_transmitters
from mmw.config import ChannelConfig
from mmw.core.constants import SPEED_OF_LIGHT, VACUUM_PERMITTIVITY
from mmw.core.transforms import quaternion_from_ypr, quaternion_to_matrix
from mmw.physics.em.vectors import direction_angles, spherical_basis
from mmw.physics.materials.material import RadioMaterial
from tests.fixtures.antennas import antenna_at
from tests.fixtures.device_rays import loaded
from tests.fixtures.scenes import (
    arrays_from_parts,
    arrays_from_ply,
    box_model,
    box_part,
    ground_part,
    pose,
    quad_part,
    wall_part,
)
from tests.oracles.channel import radio_materials
from tests.oracles.radio_map import (
    CARRIER,
    UNIT,
    UPRIGHT,
    cell_mean,
    check,
    coefficients,
    constant,
    isotropic,
    trace,
)
from tests.oracles.sionna import FOLDER, read_case, used_material

CASES = json.loads((FOLDER / "radio_maps.json").read_text())["cases"]


def sionna_map(name: str, device: str) -> tuple[RadioMap, np.ndarray, np.ndarray]:
    """Return our map of a reference case with 25 points a cell, and Sionna's gain [T, C] and cell centers [C, 3]."""
    case, reference = CASES[name], read_case(name)
    config, solver = case["config"], case["config"]["solver"]
    used = {key: used_material(key, values, {}) for key, values in case["materials"].items()}
    files = {item["name"]: (FOLDER / item["ply"], used[item["material"]]) for item in config["scene"]["objects"]}
    turn = np.array([tx.get("ori", [0, 0, 0]) for tx in config["tx"]], dtype=float)
    tx = Transmitters(
        ("tx0", "tx1"), np.array([tx["pos"] for tx in config["tx"]], dtype=float),
        quaternion_to_matrix(quaternion_from_ypr(*turn.T)), np.full(2, 44.0),
    )  # fmt: skip
    result = trace(
        arrays_from_ply(files), device, tx, plane_grid(solver["center"], solver["size"], solver["cell_size"][0]),
        carriers_hz=(config["frequency"],), max_depth=solver["max_depth"], points_per_cell=25,
    )  # fmt: skip
    return result, reference["path_gain"].reshape(2, -1).astype(float), reference["cell_centers"].reshape(-1, 3)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] if "_d3_" in name else []) for name in sorted(CASES)]
)
def test_sionna_rm_ssc(name: str, device: str) -> None:
    """Block means of 10 m x 10 m against Sionna's map of 2e7 rays.

    Of Sionna's rays each block has a noise: `noise` is the standard deviation that independent rays would give, with
    |E|^2 <= 1.5 of the dipole and cos(theta) of the direct ray. Our map has none, but points miss where in a cell a
    shadow ends: a row of points is 1/25 of a block, and the shadows of walls run along rows, so that a block may be off
    by some rows of its brightest cell. Over the whole map that averages out, and so does noise: sums of all power, and
    of what only reflections bring (depth 3 less depth 0, a quarter to a half of all), agree within 0.05 dB.
    """
    result, expected, centers = sionna_map(name, device)
    gain, surface = result.path_gain, result.surface
    np.testing.assert_allclose(surface.center, centers)
    assert ((gain > 0) != (expected > 0)).mean() < 0.02  # coverage: the edges of shadows take more rays
    assert 10 * np.log10(gain.sum(axis=1) / expected.sum(axis=1)) == pytest.approx([0, 0], abs=0.05)

    def blocks(values: np.ndarray) -> np.ndarray:
        return values.reshape(-1, 10, 5, 16, 5).mean(axis=(2, 4))

    ray = surface.center - result.transmitters.position[:, None]
    slope = blocks(np.abs(ray[..., 2]) / np.linalg.norm(ray, axis=2))
    wavelength, theirs = SPEED_OF_LIGHT / result.config.carrier_hz, CASES[name]["config"]["solver"]["samples_per_tx"]
    share = (wavelength / (4 * np.pi)) ** 2 * 4 * np.pi / (25 * surface.area[0]) * 1.5 / slope
    noise = np.sqrt(share * blocks(expected) / theirs)
    largest = expected.reshape(-1, 10, 5, 16, 5).max(axis=(2, 4))
    assert (np.abs(blocks(gain) - blocks(expected)) <= noise + 3.0 / 25.0 * largest).all()
    if result.config.channel.max_depth:
        direct, expected_direct, _ = sionna_map(name.replace("_d3_", "_d0_"), device)
        reflected = (gain - direct.path_gain).sum(axis=1) / (expected - expected_direct).sum(axis=1)
        assert 10 * np.log10(reflected) == pytest.approx([0, 0], abs=0.05)


@pytest.mark.parametrize(
    ("pattern", "polarization", "model"),
    [
        ("iso", "V", "tr38901_2"), ("dipole", "V", "tr38901_2"), ("hw_dipole", "H", "tr38901_2"),
        ("tr38901", "cross", "tr38901_1"), ("tr38901", "VH", "tr38901_2"),
    ],
)  # fmt: skip
def test_free_space_plane(pattern: str, polarization: str, model: str, device: str) -> None:
    """Gain = mean of (lambda / 4 pi r)^2 |h^T p|^2 over the cell, for a turned array of four elements."""
    offset = np.array([[0.0, 0.5 * (j - 0.5), 0.7 * (0.5 - i)] for j in range(2) for i in range(2)])
    count = 4 * len(SLANTS[polarization])
    precoding = np.exp(1j * np.arange(count)) * np.linspace(0.5, 1.5, count)
    agent, turn = quaternion_to_matrix(quaternion_from_ypr(0.4, 0.9, -0.3)), (0.2, -0.1, 0.5)
    rotation = agent @ quaternion_to_matrix(quaternion_from_ypr(*turn))
    array = PlanarArray(
        2, 2, 0.7, 0.5, pattern=pattern, polarization=polarization, polarization_model=model, orientation=turn
    )
    tx = Transmitters(
        ("tx",), np.array([[1.0, -2.0, 10.0]]), agent[None], np.array([44.0]), array, precoding[None],
    )  # fmt: skip
    surface = plane_grid((0.0, 0.0, 1.5), (40.0, 30.0), 2.0)
    result = trace(arrays_from_parts([]), device, tx, surface, max_depth=0)

    def gain(point: np.ndarray) -> np.ndarray:
        ray = point - tx.position
        r = np.linalg.norm(ray, axis=1)
        ray = ray / r[:, None]
        field = antenna_field(ray, np.tile(rotation, (len(ray), 1, 1)), pattern, polarization, model)
        phase = np.exp(2j * np.pi * (ray @ rotation) @ offset.T)
        total = np.einsum("psx,se,pe->px", field, precoding.reshape(-1, 4), phase)
        return UNIT * (np.abs(total) ** 2).sum(axis=1) / r**2

    check(result, cell_mean(surface, gain))


@pytest.mark.parametrize(("polarization", "thickness"), [("V", 0.0), ("H", 0.0), ("V", 0.03), ("H", 10.0)])
def test_two_rays_over_ground(polarization: str, thickness: float, device: str) -> None:
    """Direct ray and reflection add as powers; an isotropic V (H) antenna over level ground sends TM (TE)."""
    ground = constant("ground", 2.5, 0.03 if thickness < 1 else 1e-3, thickness, scattering=0.4)
    arrays = arrays_from_parts([ground_part(half=300.0, material="ground")], materials={"ground": ground})
    tx, surface = isotropic([0, 0, 6], polarization=polarization), plane_grid((20.0, 0.0, 3.0), (60.0, 20.0), 2.0)
    result = trace(arrays, device, tx, surface, max_depth=3)
    eta = 2.5 - 1j * ground.radio.conductivity / (2 * np.pi * CARRIER * VACUUM_PERMITTIVITY)

    def gain(point: np.ndarray) -> np.ndarray:
        across = point[:, 0] ** 2 + point[:, 1] ** 2
        direct, image = across + 9.0, across + 81.0
        reflection = coefficients(eta, 9.0 / np.sqrt(image), thickness)[polarization][0]
        return UNIT * (1 / direct + (1 - 0.4**2) * np.abs(reflection) ** 2 / image)

    check(result, cell_mean(surface, gain))


def test_images_of_a_lossless_room(device: str) -> None:
    """In a closed box of perfect conductor nothing is lost: the map is the sum over all image sources, depth 4."""
    size, place, depth = np.array([10.0, 8.0, 6.0]), np.array([3.0, 5.5, 4.0]), 4
    room = box_part("Buildings/room", size, size / 2, "pec", "building")
    surface = plane_grid((4.93, 3.91, 1.5), (7.7, 5.9), 1.3)  # off the waves that pass a corner within 1 cm
    arrays = arrays_from_parts([room], materials=radio_materials({"pec": RadioMaterial("itu", itu="itu_pec")}))
    result = trace(arrays, device, isotropic(list(place)), surface, max_depth=depth, candidates="exhaustive")
    number = np.array(np.meshgrid(*[np.arange(-depth, depth + 1)] * 3)).reshape(3, -1).T
    number = number[np.abs(number).sum(axis=1) <= depth]
    images = number * size + np.where(number % 2 == 0, place, size - place)

    def gain(point: np.ndarray) -> np.ndarray:
        return UNIT * (1 / ((point[:, None] - images) ** 2).sum(axis=2)).sum(axis=1)

    check(result, cell_mean(surface, gain))
    reflected, both = (
        trace(
            arrays, device, isotropic(list(place)), surface, max_depth=3, refraction=refraction, samples_per_tx=20_000
        )
        for refraction in (False, True)
    )
    assert (
        both.path_gain.tobytes() == reflected.path_gain.tobytes()
    )  # nothing passes a conductor, no segment counts twice


def test_transmission_and_reflection_of_a_slab(device: str) -> None:
    """Behind a lossless slab T, mirrored in front of it R, by closed form; together they are all the power."""
    slab, grid = constant("slab", 4.0, 0.0, 0.05), (12.0, 8.0)
    corners = [(10, -300, -300), (10, 300, -300), (10, 300, 300), (10, -300, 300)]
    arrays = arrays_from_parts([quad_part("Buildings/wall", corners, "slab", "building")], materials={"slab": slab})
    behind, before = (plane_grid((x, 1.0, 2.0), grid, 1.0, UPRIGHT) for x in (14.0, 6.0))
    tx = isotropic([0, 0, 0])
    reached = {
        refraction: [trace(arrays, device, tx, s, max_depth=1, refraction=refraction) for s in (behind, before)]
        for refraction in (True, False)
    }
    assert (reached[False][0].path_gain == 0).all()
    assert reached[False][1].path_gain.tobytes() == reached[True][1].path_gain.tobytes()

    def passed(point: np.ndarray) -> np.ndarray:
        r = np.linalg.norm(point, axis=1)
        ray = point / r[:, None]
        theta_hat, _ = spherical_basis(*direction_angles(ray))
        te = np.cross(ray, [1.0, 0.0, 0.0])
        te /= np.linalg.norm(te, axis=1)[:, None]
        share = (te * theta_hat).sum(axis=1) ** 2
        pair = coefficients(4.0, ray[:, 0], 0.05)
        return UNIT * (share * np.abs(pair["H"][1]) ** 2 + (1 - share) * np.abs(pair["V"][1]) ** 2) / r**2

    expected = cell_mean(behind, passed)
    check(reached[True][0], expected)

    def free(point: np.ndarray) -> np.ndarray:
        return UNIT / (point**2).sum(axis=1)

    reflected = reached[True][1].path_gain[0] - cell_mean(before, free)
    assert reflected.sum() == pytest.approx((cell_mean(behind, free) - expected).sum(), rel=1e-9)


def test_vacuum_walls_change_nothing(device: str) -> None:
    """Two walls of vacuum are crossed as if they were not there, and no segment is counted twice."""
    corners = [[(x, -50, -50), (x, 50, -50), (x, 50, 50), (x, -50, 50)] for x in (3.0, 5.0)]
    walls = [quad_part(f"Buildings/wall_{i}", c, "vacuum", "building") for i, c in enumerate(corners)]
    arrays = arrays_from_parts(walls, materials={"vacuum": constant("vacuum", 1.0, 0.0, 0.1)})
    surface, tx = plane_grid((4.0, 0.0, -2.0), (20.0, 8.0), 1.0), isotropic([0, 0, 0])
    crossed = trace(arrays, device, tx, surface, max_depth=3, refraction=True).path_gain
    clear = trace(arrays_from_parts([]), device, tx, surface, max_depth=0).path_gain
    np.testing.assert_allclose(crossed, clear, rtol=1e-9)
    once = trace(arrays, device, tx, surface, max_depth=1, refraction=True).path_gain[0]
    assert (once[surface.center[:, 0] > 5.5] == 0).all()


def test_same_bytes_for_every_portion(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    arrays = arrays_from_parts([ground_part(), wall_part("wall", (-30.0, 20.0), (30.0, 20.0), 10.0)])
    scene = loaded(arrays, device, [0])
    tx, surface = isotropic([0, 0, 5], [9, 3, 4]), plane_grid((0, 0, 1.5), (60, 30), 1.0)
    channel = ChannelConfig(carriers_hz=(CARRIER,), samples_per_tx=50_000, max_depth=2, refraction=True)
    config, maps = RadioMapConfig(channel), []
    for count in (2**16, 701, 100):
        monkeypatch.setattr("mmw.channel.radio_map.solver.LINKS_AT_ONCE", count)
        maps.append(solve_radio_map(scene, 0, tx, surface, config, arrays.materials["sunny"]).path_gain)
    assert len({values.tobytes() for values in maps}) == 1
    assert (maps[0] > 0).mean() > 0.9
    alone = solve_radio_map(scene, 0, isotropic([9, 3, 4]), surface, config, arrays.materials["sunny"]).path_gain
    assert alone.tobytes() == maps[0][1].tobytes()


def test_a_vehicle_blocks_only_its_own_frame(device: str) -> None:
    poses = np.array([[pose(6.0, 0.0)], [pose(6.0, 30.0)]])
    arrays = arrays_from_parts([], [box_model("car")], [("car", "vehicle", 0)], poses)
    scene = loaded(arrays, device, [0, 1])
    tx, surface = isotropic([0, 0, 1]), plane_grid((12.0, 0.0, 0.8), (4.0, 2.0), 1.0)
    config = RadioMapConfig(ChannelConfig(carriers_hz=(CARRIER,), max_depth=0))
    maps = [
        solve_radio_map(scene, batch_index, tx, surface, config, arrays.materials["sunny"]).path_gain
        for batch_index in (0, 1)
    ]
    assert (maps[0] == 0).all()
    assert (maps[1] > 0).all()
    with pytest.raises(ValueError, match="batch_index 2"):
        solve_radio_map(scene, 2, tx, surface, config, arrays.materials["sunny"])


def test_what_cannot_be_traced_is_named() -> None:
    arrays = arrays_from_parts([ground_part()], actors=[("rsu_1", "rsu", -1)])
    surface = plane_grid((0, 0, 1.5), (4, 4), 1.0)
    for config, part in (
        ({"carriers_hz": (500e9,)}, "no permittivity at 500 GHz"),
        ({"points_per_cell": 2}, "points_per_cell = 2; the square of a whole number"),
        ({"points_per_cell": 4.0}, "points_per_cell = 4.0"),
        ({"points_per_cell": 0}, "points_per_cell = 0"),
    ):
        with pytest.raises(ValueError, match=part):
            trace(arrays, "cpu", isotropic([0, 0, 5]), surface, **config)
    scene = loaded(arrays, "cpu", [0])
    for noise in ({"bandwidth_hz": 0.0}, {"temperature_k": -1.0}):
        config = RadioMapConfig(ChannelConfig(), **noise)
        with pytest.raises(ValueError, match=f"{next(iter(noise))} = "):
            solve_radio_map(scene, 0, isotropic([0, 0, 5]), surface, config, arrays.materials["sunny"])
    with pytest.raises(ValueError, match="role 'cav'"):
        actor_transmitters(arrays, 0, roles=("cav",))
    found = actor_transmitters(arrays, 0, antennas=antenna_at({"rsu": (0.0, 0.0, 3.0)}))
    assert found.names == ("rsu_1",)
    np.testing.assert_allclose(found.position, [[0, 0, 3]])


def test_the_field_of_an_array_does_not_depend_on_portions(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    array, weights = PlanarArray(3, 2, polarization="cross", orientation=(0.2, 0.1, 0.0)), np.exp(1j * np.arange(12))
    ray = rng.normal(size=(100, 3))
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    whole = precoded_field(array, np.eye(3), weights, ray, CARRIER)
    monkeypatch.setattr("mmw.channel.radio_map.solver.PHASES_AT_ONCE", 60)
    np.testing.assert_array_equal(precoded_field(array, np.eye(3), weights, ray, CARRIER), whole)
    assert whole.shape == (100, 2) and np.iscomplexobj(whole)


def test_cells_near_a_wide_array_have_spherical_waves(device: str) -> None:
    """Against the sum over all elements of 1 x 256 at 15 to 25 m in free space, weighted for the far field ahead."""
    array = PlanarArray(1, 256, pattern="iso")
    tx = Transmitters(("wide",), np.array([[0.0, 0.0, 5.0]]), np.eye(3)[None], np.full(1, 44.0), array)
    surface = plane_grid((20.0, 0.0, 5.0), (10.0, 4.0), 1.0)
    found = trace(arrays_from_parts([ground_part(1.0, -50.0)]), device, tx, surface, max_depth=0)
    places = tx.position + array.local_positions(CARRIER)
    distance = np.linalg.norm(surface.center[:, None] - places, axis=2)
    field = (np.exp(-2j * np.pi * CARRIER / SPEED_OF_LIGHT * distance) / distance).sum(axis=1) / 16.0
    check(found, UNIT * np.abs(field) ** 2, rtol=1e-4)
