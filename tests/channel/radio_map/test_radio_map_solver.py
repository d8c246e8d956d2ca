"""The public solver of radio maps: surfaces, arrays and precoding of a scene's transmitters, and its messages."""

import numpy as np
import pytest

from mmw.channel import PlanarArray, RadioMapSolver, mesh_surface, plane_grid, road_grid
from mmw.channel.antennas.patterns import PatternTable, antenna_field
from mmw.channel.radio_map.radio_map import RadioMapConfig
from mmw.channel.radio_map.solver import solve_radio_map
from mmw.channel.radio_map.transmitters import Transmitters
from mmw.config import ChannelConfig
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.errors import InputError
from mmw.core.transforms import quaternion_from_ypr, quaternion_to_matrix
from mmw.physics.em.vectors import direction_angles
from mmw.physics.materials.material import RadioMaterial
from mmw.scene.radio_devices import Transmitter
from tests.fixtures.map_scenes import map_scene
from tests.fixtures.scenes import arrays_from_parts, box_model, box_part, ground_part, pose
from tests.oracles.channel import radio_materials
from tests.oracles.radio_map import CARRIER, UNIT, UPRIGHT, WAVELENGTH, cell_mean, check

AT, TURN = np.array([1.0, -2.0, 10.0]), quaternion_from_ypr(0.4, 0.9, -0.3)
FAST = RadioMapSolver(max_depth=0, air_losses=False)


def array_gain(array: PlanarArray, turn: np.ndarray, weight: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """Return |h^T p|^2 of both components in unit directions [P, 3]: a sum over all antennas, one by one."""
    rotation, total = quaternion_to_matrix(turn), np.zeros((len(ray), 2), dtype=complex)
    field = antenna_field(
        ray, np.tile(rotation @ array.rotation, (len(ray), 1, 1)), array.pattern, array.polarization,
        array.polarization_model,
    )  # fmt: skip
    for antenna, offset in enumerate(array.element_positions(CARRIER)):
        phase = np.exp(2j * np.pi * CARRIER / SPEED_OF_LIGHT * (ray @ (rotation @ offset)))
        total += weight[antenna] * phase[:, None] * field[:, antenna // array.element_count]
    return (np.abs(total) ** 2).sum(axis=1)


def free_space(array: PlanarArray, weight: np.ndarray, place: np.ndarray = AT, turn: np.ndarray = TURN):
    def gain(point: np.ndarray) -> np.ndarray:
        ray = point - place
        r = np.linalg.norm(ray, axis=1)
        return UNIT * array_gain(array, turn, weight, ray / r[:, None]) / r**2

    return gain


SECTOR = PatternTable(
    np.radians([0.0, 30, 50, 90, 100, 130, 180]), np.radians([-180.0, -90, -40, 0, 30, 90]),
    np.outer([0.1, 1, 2, 3, 2.5, 1, 0.2], [0.3, 0.8, 2.0, 3.0, 2.5, 0.9]) * np.exp(1j * np.arange(6)),
    0.4 * np.outer([1, 1, 1, 2, 1, 1, 1], [1j, 1, 0.5, 1, 1, 1]),
)  # fmt: skip


@pytest.mark.parametrize(
    "array",
    [
        PlanarArray(pattern="tr38901", polarization="V", orientation=(0.2, 0.6, 0.0)),
        PlanarArray(2, 2, pattern=SECTOR, polarization="cross", polarization_model="tr38901_1"),
        PlanarArray(1, 3, pattern=lambda theta, phi: (np.sin(theta) * np.exp(1j * phi), 0.5), polarization="VH"),
    ],
    ids=["tr38901", "table", "function"],
)
@pytest.mark.parametrize("orientation", [None, (0.1, 0.3, 0.2, 0.9)], ids=["level", "tilted"])
def test_plane_in_free_space(array: PlanarArray, orientation, device: str) -> None:
    """Friis with the pattern: gain = mean over the cell of (lambda / 4 pi r)^2 |h^T p|^2."""
    weight = np.exp(1j * np.arange(array.antenna_count)) * np.linspace(0.5, 1.5, array.antenna_count)
    scene = map_scene(arrays_from_parts([]), device, Transmitter("bs", AT, orientation=TURN, array=array))
    result = FAST(
        scene, center_m=(2.0, 1.0, 1.5), size_m=(30.0, 24.0), orientation=orientation, precoding={"bs": weight}
    )
    assert result.surface.grid_shape == (12, 15)
    check(result, cell_mean(result.surface, free_space(array, weight)))


def test_a_tilted_plane_is_the_points_it_says(device: str) -> None:
    scene = map_scene(arrays_from_parts([]), device, Transmitter("bs", AT))
    result = FAST(scene, center_m=(0, 3, 2), size_m=(8, 4), cell_size_m=1.0, orientation=UPRIGHT)
    grid = result.as_grid(result.cell_centers.T)
    np.testing.assert_allclose(grid[:, 1, 5], [0.0, 4.5, 1.5])
    np.testing.assert_allclose(result.rss_dbm, result.path_gain_db + 44.0)


def test_every_transmitter_has_its_own_array_power_and_weights(device: str) -> None:
    """A map of several transmitters is that of each alone, bit for bit, whatever arrays they share."""
    shared, own = PlanarArray(2, 2, pattern="tr38901"), PlanarArray(1, 3, pattern="dipole", polarization="VH")
    devices = [
        Transmitter("a", AT, orientation=TURN, array=own, power_dbm=30.0),
        Transmitter("b", (6.0, -2.0, 10.0)),
        Transmitter("c", (1.0, 7.0, 11.0), orientation=TURN, array=own),
        Transmitter("d", (1.0, 7.0, 11.0), orientation=TURN),
    ]
    weights = {"a": np.array([1, 2j, 3, -1, 0, 1j]), "d": np.array([0, 1, 1j, -1])}
    arrays, options = arrays_from_parts([ground_part()]), {"size_m": (20.0, 20.0), "center_m": (0.0, 0.0)}
    solver = RadioMapSolver(max_depth=2, samples_per_tx=50_000)
    result = solver(map_scene(arrays, device, *devices, array=shared), precoding=weights, **options)
    assert result.tx_names == ("a", "b", "c", "d")
    np.testing.assert_array_equal(result.transmitters.power_dbm, [30, 44, 44, 44])
    for row, tx in enumerate(devices):
        alone = solver(map_scene(arrays, device, tx, array=shared), precoding=weights.get(tx.name), **options)
        assert alone.path_gain.tobytes() == result.path_gain[row].tobytes()
        assert (alone.path_gain > 0).all()
    equal = solver(map_scene(arrays, device, devices[2]), precoding=np.full((1, 6), 6**-0.5), **options)
    np.testing.assert_allclose(equal.path_gain[0], result.path_gain[2], rtol=1e-12)
    double = solver(map_scene(arrays, device, devices[0]), precoding=2.0 * weights["a"], **options)
    np.testing.assert_allclose(double.path_gain[0], 4.0 * result.path_gain[0], rtol=1e-12)


def test_precoding_is_the_dense_sum_over_antennas(device: str) -> None:
    """A beam of 4 x 4 crossed elements: the map equals the sum over all 32 antennas, in the beam and off it."""
    array = PlanarArray(4, 4, pattern="tr38901", polarization="cross")
    ray = np.array([1.0, 0.2, -0.4]) / np.linalg.norm([1.0, 0.2, -0.4])
    weight = np.exp(-2j * np.pi / WAVELENGTH * (array.element_positions(CARRIER) @ ray)) / 32**0.5
    scene = map_scene(arrays_from_parts([]), device, Transmitter("bs", AT, array=array))
    result = RadioMapSolver(max_depth=0, points_per_cell=9, air_losses=False)(
        scene, precoding=weight, center_m=(20.0, 5.0), size_m=(30.0, 30.0)
    )
    gain = free_space(array, weight, turn=np.array([0, 0, 0, 1.0]))
    peak = array_gain(array, np.array([0, 0, 0, 1.0]), weight, ray[None])[0]
    assert peak > 50.0  # 16 elements of 8 dBi less the tilt; each polarization has half the power
    check(result, cell_mean(result.surface, gain, steps=3))


def test_mesh_is_the_plane_in_triangles(device: str) -> None:
    """With many points both triangles of a cell together have the power of the cell, up to the edges of shadows."""
    parts = [ground_part(), box_part("Buildings/house", (3, 3, 2), (6, 3, 1), "concrete_facade", "building")]
    scene = map_scene(arrays_from_parts(parts), device, Transmitter("bs", (3, 2, 6)), Transmitter("other", (-9, 2, 4)))
    plane = plane_grid((1.0, 2.0, 2.5), (20.0, 12.0), 2.0, (0.1, 0.0, 0.0, 1.0))
    solver = RadioMapSolver(max_depth=2, samples_per_tx=100_000, points_per_cell=144)
    whole, parts = solver(scene, surface=plane), solver(scene, surface=mesh_surface(plane.mesh.points, plane.faces))
    assert parts.path_gain.shape == (2, 2 * len(plane))
    power = (parts.path_gain * parts.cell_areas).reshape(2, -1, 2).sum(axis=2)
    off = np.abs(power / (whole.path_gain * whole.cell_areas) - 1.0)
    assert np.quantile(off, 0.9) < 1e-3 and off.max() < 0.1
    assert (parts.path_gain > 0).mean() > 0.9


def test_object_that_is_measured_on(device: str) -> None:
    """A roof of perfect conductor, 2 cm off: direct and reflected power; a car is measured where it is in the frame."""
    box = box_part("Buildings/house", (8.0, 6.0, 4.0), (20.0, 0.0, 2.0), "pec", "building")
    arrays = arrays_from_parts(
        [box], [box_model("car")], [("cav_1", "cav", 0)], [[pose(9.0, 0.0)], [pose(5.0, 2.0, yaw=0.5)]],
        materials=radio_materials({"pec": RadioMaterial("itu", itu="itu_pec")}),
    )  # fmt: skip
    scene = map_scene(arrays, device, Transmitter("bs", (20.0, 0.0, 12.0)), frame=1)
    solver = RadioMapSolver(max_depth=1, points_per_cell=400, air_losses=False)
    for name in ("house", "/World/Town/Buildings/house"):
        roof = solver(scene, surface=name)
        assert len(roof.cell_centers) == 12
        top = roof.cell_centers[:, 2] > 4.0
        np.testing.assert_allclose(roof.cell_centers[top, 2], 4.01)
        assert top.sum() == 2
        np.testing.assert_allclose(roof.cell_areas[top], 24.0)
        assert roof.path_gain[0, ~top].max() < 0.01 * roof.path_gain[0, top].min()  # walls, straight from above
    at = (np.arange(200) + 0.5) / 200
    x, y = np.meshgrid(16 + 8 * at, -3 + 6 * at)
    expected = np.mean([1 / ((x - 20) ** 2 + y**2 + height**2) for height in (7.98, 8.02)]) * 2 * UNIT
    assert roof.path_gain[0, top].mean() == pytest.approx(expected, rel=2e-3)
    far = solver(scene, surface="house", height_m=0.5)
    np.testing.assert_allclose(far.cell_centers[:, 2].max(), 4.5)
    car = solver(scene, surface="cav_1")
    assert len(car.surface) == 12
    np.testing.assert_allclose(car.cell_centers.mean(axis=0), [5.0, 2.0, 0.75], atol=1e-9)


def test_roads_and_defaults_are_the_functions_bit_for_bit(device: str) -> None:
    arrays = arrays_from_parts([ground_part(half=20.0)], weathers=("sunny", "rainy"))
    device_tx = Transmitter("bs", (3, 2, 6), orientation=TURN)
    scene = map_scene(arrays, device, device_tx)
    tx = Transmitters(
        ("bs",), np.array([[3.0, 2, 6]]), quaternion_to_matrix(device_tx.orientation)[None], np.array([44.0]),
        PlanarArray(pattern="iso"),
    )  # fmt: skip
    channel = ChannelConfig(carriers_hz=(3.5e9,), samples_per_tx=50_000, max_depth=1)
    solver, config = RadioMapSolver(max_depth=1, samples_per_tx=50_000), RadioMapConfig(channel)
    for options, surface in (
        ({"surface": "roads"}, road_grid(arrays, 2.0, 1.5)),
        ({"surface": "roads", "cell_size_m": 1.0, "height_m": 3.0, "size_m": (10.0, 8.0)},
         road_grid(arrays, 1.0, 3.0, within_m=(-2.0, -2.0, 8.0, 6.0))),
        ({}, plane_grid((0, 0, 1.5), (40.0, 40.0), 2.0)),
        ({"height_m": 4.0, "size_m": (8.0, 8.0), "center_m": (1.0, 2.0)}, plane_grid((1, 2, 4.0), (8.0, 8.0), 2.0)),
        ({"surface": plane_grid((1, 2, 4.0), (8.0, 8.0), 2.0)}, plane_grid((1, 2, 4.0), (8.0, 8.0), 2.0)),
    ):  # fmt: skip
        result = solver(scene, carrier_hz=3.5e9, weather="rainy", **options)
        air = scene.weathers["rainy"]
        same = solve_radio_map(scene.device_scene, 0, tx, surface, config, arrays.materials["rainy"], air)
        np.testing.assert_array_equal(result.surface.corners, surface.corners)
        assert result.path_gain.tobytes() == same.path_gain.tobytes()
        assert (result.path_gain > 0).all()
    assert result.config == config == RadioMapConfig(channel, 1, 1e6, 293.0)
    assert RadioMapSolver(channel)(scene, size_m=(8.0, 8.0)).config == config  # with the carrier of the settings


def test_mistakes_are_named() -> None:
    bs, array = Transmitter("bs", (3, 2, 6)), PlanarArray(2, 2)
    parts = [ground_part(), box_part("Buildings/house", (2, 2, 2), (9, 9, 1), "concrete_facade", "building")]
    arrays = arrays_from_parts(parts, actors=[("rsu_1", "rsu", -1)])
    scene, empty = map_scene(arrays, "cpu", bs, array=array), map_scene(arrays_from_parts([]), "cpu", bs)
    gone = map_scene(arrays_from_parts([], [box_model("c")], [("car", "cav", 0)], [[(np.nan,) * 7]]), "cpu", bs)
    plane, run = plane_grid((0, 0, 1.5), (4, 4), 1.0), RadioMapSolver(max_depth=0, samples_per_tx=1000)
    inside = map_scene(arrays, "cpu", Transmitter("in", (9.0, 9.0, 1.0)), array=array)
    for call, part in (
        (lambda: run(map_scene(arrays, "cpu"), surface=plane), "has no transmitter; a radio map needs one"),
        (lambda: run(scene, weather="hail"), "hail.*sunny"),
        (lambda: run(scene, surface="hause"), "surface = 'hause'.*did you mean house"),
        (lambda: run(scene, surface="rsu_1"), "'rsu_1' has no triangles"),
        (lambda: run(gone, surface="car"), "'car' is absent in frame 0"),
        (lambda: run(scene, surface=plane.corners), "surface is a ndarray"),  # pyright: ignore[reportArgumentType]
        (lambda: run(scene, surface=plane, height_m=2.0), "has its place already"),
        (lambda: run(scene, surface="house", size_m=(3, 3)), "size_m of surface 'house'; only a plane or roads"),
        (lambda: run(scene, surface="house", height_m=np.nan), "height_m = nan"),
        (lambda: run(scene, surface="roads", orientation=(0, 0, 0, 1)), "orientation of surface 'roads'; only a plane"),
        (lambda: run(scene, surface="roads", center_m=(0, 0, 1), size_m=(4, 4)), "height_m has it already"),
        (lambda: run(scene, center_m=(0, 0, 1), size_m=(4, 4), height_m=2.0), "height_m has it already"),
        (lambda: run(scene, center_m=(0, 0)), "center_m without size_m"),
        (lambda: run(scene, center_m=(0, np.nan), size_m=(4, 4)), r"center_m = \(0.0, nan\)"),
        (lambda: run(scene, center_m="here", size_m=(4, 4)), "center_m = 'here'"),
        (lambda: run(scene, orientation=(0, 0, 0, 1), size_m=(4, 4)), "orientation without a center"),
        (lambda: run(scene, size_m=(4, -4)), "size_m"),
        (lambda: run(scene, cell_size_m=0.0), "cell_size_m = 0"),
        (lambda: run(scene, cell_size_m=1e-4), "at most"),
        (lambda: run(empty), "give size_m"),
        (lambda: run(scene, surface=plane, carrier_hz=500e9), "no permittivity at 500 GHz"),
        (lambda: run(scene, surface=plane, bandwidth_hz=-1.0), "bandwidth_hz = -1"),
        (lambda: run(scene, surface=plane, precoding=np.ones(3)), r"'bs': precoding of shape \(3,\); 4 finite numbers"),
        (lambda: run(scene, surface=plane, precoding=np.ones((2, 4))), "precoding of 2 rows.*each of 1"),
        (lambda: run(scene, surface=plane, precoding={"bs": np.zeros(4)}), "not all 0"),
        (lambda: run(scene, surface=plane, precoding={"bs": [1, 1, 1, np.nan]}), "4 finite numbers"),
        (lambda: run(scene, surface=plane, precoding={"b": np.ones(4)}), "precoding of 'b'.*use bs"),
        (lambda: run(scene, surface=plane, precoding="mrt"), "precoding is no array"),
        (lambda: run(scene, surface=plane, carrier_hz=28.0), "carrier_hz = 28; .*hertz"),
        (
            lambda: run(inside, surface=plane),
            r"'in': position = .* is inside .*RadioMapSolver\(check_places=False",
        ),
        (lambda: RadioMapSolver(max_depth=9), "RadioMapSolver.*max_depth"),
        (lambda: RadioMapSolver(samples_per_tx=999), "samples_per_tx"),
        (lambda: RadioMapSolver(depth=2), "depth; there is no such option; use .*max_depth"),
        (lambda: RadioMapSolver(carriers_hz=(28e9,)), "carriers_hz; there is no such option"),
        (lambda: RadioMapSolver(points_per_cell=3), "points_per_cell = 3; the square"),
    ):
        with pytest.raises(InputError, match=part):
            call()


def test_angles_of_the_oracle() -> None:
    """The closed form above is the transmit pattern: of one element along its axes, by hand."""
    ray = np.array([[1.0, 0, 0], [0, 0, 1.0]])
    theta, phi = direction_angles(ray)
    field = SECTOR(theta, phi)
    gain = array_gain(PlanarArray(pattern=SECTOR), np.array([0, 0, 0, 1.0]), np.ones(1, dtype=complex), ray)
    np.testing.assert_allclose(gain, np.abs(field[0]) ** 2 + np.abs(field[1]) ** 2)
