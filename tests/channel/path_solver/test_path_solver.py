"""The paths of a scene's devices: bit for bit those of a run, and channels against closed forms and plain sums."""

import gc
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import psutil
import pytest
import warp as wp

import mmw
from mmw.channel.antennas.patterns import antenna_field
from mmw.channel.links import make_links
from mmw.channel.path_solver import path_solver as module
from mmw.channel.path_solver.solver import solve_paths
from mmw.config import ChannelConfig
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.errors import InputError
from mmw.core.transforms import quaternion_to_matrix
from mmw.physics.em.attenuation import rain_attenuation
from mmw.physics.em.vectors import unit_vector
from mmw.physics.weather.weather import PRESETS
from mmw.scene.scene import Scene
from mmw.scene.scene_data import SceneData
from tests.fixtures.antennas import antenna_at
from tests.fixtures.device_rays import loaded
from tests.fixtures.scenes import arrays_from_parts, box_part, two_cars
from tests.oracles.channel import driving, traffic
from tests.oracles.path_rows import path_rows, path_table

CARRIERS = (28e9, 4.9e9)


def open_space(**options) -> Scene:
    """Return a scene with one small box far away: nothing but lines of sight."""
    parts = [box_part("Props/stone", (1.0, 1.0, 1.0), (0.0, 0.0, -500.0), "concrete_facade", "static")]
    return Scene(arrays_from_parts(parts), {"sunny": PRESETS["sunny"]}, device="cpu", **options)


def street(frames: int = 4, frame: int = 1, device: str = "cpu") -> Scene:
    return Scene(two_cars(frames), {"sunny": PRESETS["sunny"]}, device=device, frame=frame, name="street")


def lines_of_sight(scene: Scene, **options) -> mmw.Paths:
    return mmw.PathSolver(max_depth=0, air_losses=False)(scene, **{"carriers_hz": 28e9, **options})


@pytest.mark.parametrize(
    ("settings", "antenna"),
    [
        ({"links": ("v2i", "v2v"), "max_depth": 2, "samples_per_tx": 20_000}, {}),
        ({"links": ("v2i",), "candidates": "exhaustive", "diffraction": True, "max_depth": 2}, {}),
        ({"links": ("v2v",), "candidates": "exhaustive", "diffuse_reflection": True}, {"pattern": "tr38901"}),
        ({"links": ("v2i",), "candidates": "exhaustive"}, {"polarization": "H", "pattern": "hw_dipole"}),
    ],
    ids=["launched", "diffracted", "diffuse", "horizontal"],
)
def test_rows_are_those_of_a_run_bit_for_bit(settings: dict, antenna: dict) -> None:
    weathers = {name: PRESETS[name] for name in ("sunny", "rainy")}
    data = traffic(driving(np.arange(5) * 0.01))
    data = arrays_with(data, weathers)
    config = ChannelConfig(carriers_hz=CARRIERS, antennas=antenna_at({"cav": (0.2, 0.1, 2.5)}, **antenna), **settings)
    frame = 2
    on_device = loaded(data, "cpu", [frame])
    links = make_links(data, [frame], config)
    found = solve_paths(on_device, links, config, data.materials, air=weathers)
    scene = Scene(data, weathers, device="cpu", frame=frame, name="s")
    scene.tx_array = scene.rx_array = mmw.PlanarArray(**antenna)
    senders = [role for kind, role in (("v2i", "rsu"), ("v2v", "cav")) if kind in config.links]
    for actor in data.actors:
        if actor.role in senders:
            place = config.antennas[0].mount_on(actor.role, actor.name).position_m
            scene.add(mmw.Transmitter(actor.name, place, actor=actor.name))
        if actor.role == "cav":
            scene.add(mmw.Receiver(actor.name, (0.2, 0.1, 2.5), actor=actor.name))
    names = ("max_depth", "candidates", "samples_per_tx", "diffraction", "diffuse_reflection")
    solver = mmw.PathSolver(**{name: getattr(config, name) for name in names})
    own = solver(scene, carriers_hz=CARRIERS, weathers=["sunny", "rainy"])
    agents = [actor.name for actor in data.actors]
    for weather, paths in own.items():
        columns = {"scenario": "s", "weather": weather, **path_rows(agents, links, found, weather)}
        expected = path_table(columns)
        table = paths.to_table()
        is_link = np.array(table["agent"].to_pylist()) != np.array(table["peer"].to_pylist())  # none to itself in a run
        rows = table.filter(is_link)  # which texts its dictionaries hold besides says nothing
        assert rows.schema.equals(expected.schema)
        for name in rows.schema.names:
            assert rows[name].to_pylist() == expected[name].to_pylist(), (weather, name)
        assert table.num_rows >= expected.num_rows > 8


def arrays_with(data: SceneData, weathers: dict) -> SceneData:
    return replace(data, materials=dict.fromkeys(weathers, data.materials["sunny"]))


def test_line_of_sight_in_closed_form() -> None:
    """Gain of two short dipoles side by side, delay, phase and Doppler shift of a receiver that drives away."""
    scene = open_space()
    scene.add(mmw.Transmitter("t", (1.0, 2.0, 3.0)))
    scene.add(mmw.Receiver("r", (31.0, 42.0, 3.0), velocity=(3.0, 4.0, 0.0)))
    paths = lines_of_sight(scene, carriers_hz=CARRIERS)
    distance, carriers = 50.0, np.array(CARRIERS)
    assert len(paths) == 1 and paths.kind.tolist() == ["los"] and paths.is_los.all() and paths.depth.tolist() == [0]
    assert paths.tau[0] == pytest.approx(distance / SPEED_OF_LIGHT, rel=1e-15)
    gain = 1.5 * SPEED_OF_LIGHT / carriers / (4 * np.pi * distance)
    np.testing.assert_allclose(np.abs(paths.a[0]), gain, rtol=1e-12)
    np.testing.assert_allclose(paths.doppler_hz[0], -carriers * 5.0 / SPEED_OF_LIGHT, rtol=1e-12)
    np.testing.assert_allclose(paths.gain_db[0], 20 * np.log10(gain), rtol=1e-12)
    frequencies = np.array([-1e6, 0.0, 3e6])
    h = paths.cfr(frequencies, carrier_hz=28e9, num_time_steps=3, sampling_frequency=1e3)
    times = np.arange(3) / 1e3
    phase = (28e9 + frequencies) * paths.tau[0] - paths.doppler_hz[0, 0] * times[:, None]
    np.testing.assert_allclose(h[0, 0, 0, 0], paths.a[0, 0] * np.exp(-2j * np.pi * phase), rtol=1e-9)
    assert paths.select(rx="r", tx="t").cfr([0.0], carrier_hz=4.9e9).shape == (1, 1, 1, 1, 1, 1)


def two_by_two(scene: Scene) -> Scene:
    scene.tx_array = mmw.PlanarArray(num_rows=2, num_cols=3, pattern="tr38901", polarization="cross")
    scene.rx_array = mmw.PlanarArray(num_cols=2, pattern="hw_dipole", polarization="V", orientation=(0.3, 0.1, -0.2))
    scene.add(mmw.Transmitter("a", (-10.0, 5.0, 6.0), orientation=(0.1, 0.0, 0.2, 1.0)))
    scene.add(mmw.Transmitter("b", (30.0, -4.0, 8.0), orientation=(0.0, 0.0, 1.0, 0.1)))
    scene.add(mmw.Receiver("x", (12.0, 1.0, 1.5), velocity=(-8.0, 1.0, 0.0)))
    scene.add(mmw.Receiver("y", (25.0, 5.0, 2.0), orientation=(0.0, 0.0, 0.3, 1.0)))
    scene.add(mmw.Receiver("z", (-60.0, 0.0, 2.0)))
    return scene


def plain_sum(scene: Scene, paths: mmw.Paths, frequency: float, time: float) -> np.ndarray:
    """Return H at 28 GHz plus a frequency, path after path and antenna after antenna, [R, N_r, T, N_t]."""
    column = paths.carriers_hz.tolist().index(28e9)
    ends = {}
    for kind, devices in (("rx", scene.receivers), ("tx", scene.transmitters)):
        ends[kind] = [(scene.array_of(device), scene.antenna_state(device)[1]) for device in devices.values()]
    counts = [len(ends["rx"]), ends["rx"][0][0].antenna_count, len(ends["tx"]), ends["tx"][0][0].antenna_count]
    h = np.zeros(counts, dtype=np.complex128)
    for p in range(len(paths)):
        fields = []
        for kind, index, theta, phi in (
            ("rx", paths.rx, paths.theta_r, paths.phi_r), ("tx", paths.tx, paths.theta_t, paths.phi_t)
        ):  # fmt: skip
            array, turn = ends[kind][index[p]]
            away = unit_vector(theta[p], phi[p])
            field = antenna_field(
                away[None], (turn @ array.rotation)[None], array.pattern, array.polarization, array.polarization_model
            )[0]
            offsets = array.element_positions(28e9) @ turn.T
            phase = np.exp(2j * np.pi * 28e9 / SPEED_OF_LIGHT * (offsets @ away))
            fields.append(np.repeat(field, array.element_count, axis=0) * phase[:, None])
        gain = fields[0] @ paths.transfer[p, column] @ fields[1].T
        turned = np.exp(2j * np.pi * (paths.doppler_hz[p, column] * time - (28e9 + frequency) * paths.tau[p]))
        h[paths.rx[p], :, paths.tx[p]] += gain * turned
    return h


def test_frequency_response_of_arrays_is_the_plain_sum() -> None:
    scene = two_by_two(street())
    paths = mmw.PathSolver(max_depth=2, samples_per_tx=20_000)(scene, carriers_hz=CARRIERS)
    assert set(zip(paths.rx.tolist(), paths.tx.tolist(), strict=True)) == {(r, t) for r in range(3) for t in range(2)}
    h = paths.cfr([-2e6, 5e6], carrier_hz=28e9, num_time_steps=2, sampling_frequency=500.0)
    assert h.shape == (3, 2, 2, 12, 2, 2)
    scale = np.abs(h).max()
    for step, frequency in ((0, 0), (1, 1), (0, 1)):
        expected = plain_sum(scene, paths, (-2e6, 5e6)[frequency], step / 500.0)
        np.testing.assert_allclose(h[..., step, frequency], expected, atol=1e-9 * scale)
    part = paths.select(rx=["y", "x"], tx="b").cfr([5e6], carrier_hz=28e9)
    np.testing.assert_allclose(part[:, :, 0, :, 0, 0], h[[1, 0], :, 1, :, 0, 1], atol=1e-12 * scale)
    shuffled = paths[np.random.default_rng(1).permutation(len(paths))].cfr([-2e6, 5e6], carrier_hz=28e9)
    np.testing.assert_allclose(shuffled[..., 0, :], h[..., 0, :], atol=1e-12 * scale)


def test_impulse_response_taps_and_grid_agree_with_the_frequency_response() -> None:
    scene = two_by_two(street())
    paths = mmw.PathSolver(max_depth=1, candidates="exhaustive")(scene)
    a, tau = paths.cir(num_time_steps=2, sampling_frequency=1e3)
    assert a.shape == (3, 2, 2, 12, tau.shape[2], 2) and (a[:, :, :, :, :, 0] != 0).any(axis=(1, 3)).sum() == len(paths)
    assert ((tau == -1) == (np.abs(a).max(axis=(1, 3, 5)) == 0)).all()
    frequencies = np.array([0.0, 4e6])
    turned = np.exp(-2j * np.pi * tau[:, None, :, None, :, None, None] * frequencies)
    h = paths.cfr(frequencies, num_time_steps=2, sampling_frequency=1e3)
    np.testing.assert_allclose((a[..., None] * turned).sum(axis=4), h, atol=1e-12 * np.abs(h).max())
    bandwidth = 200e6
    taps = paths.taps(bandwidth, l_min=-400, l_max=600)
    steps = np.exp(-2j * np.pi * np.arange(-400, 601) * 1e6 / bandwidth)
    middle = paths.cfr([1e6])[..., 0]
    np.testing.assert_allclose((taps * steps).sum(axis=-1), middle, atol=2e-3 * np.abs(middle).max())
    grid = paths.ofdm(12, 120e3, num_symbols=14)
    slot = paths.cfr((np.arange(12) - 6) * 120e3, num_time_steps=14, sampling_frequency=14 * 8 / 1e-3)
    np.testing.assert_allclose(grid, slot, rtol=1e-9, atol=1e-15)  # 8 slots of 14 symbols in 1 ms at 120 kHz
    normal = paths.cfr(frequencies, normalize=True, normalize_delays=True)
    np.testing.assert_allclose(np.mean(np.abs(normal) ** 2, axis=(1, 3, 4, 5)), 1.0)
    first = np.where(tau < 0, np.inf, tau).min(axis=2)
    assert (paths.cir(normalize_delays=True)[1].max(axis=2) <= tau.max(axis=2) - first + 1e-18).all()


def test_arrays_of_their_own() -> None:
    scene = two_by_two(street())
    scene.transmitters["b"].array = mmw.PlanarArray(num_rows=3, num_cols=2, pattern="iso", polarization="VH")
    paths = mmw.PathSolver(max_depth=1, candidates="exhaustive")(scene)
    np.testing.assert_allclose(paths.cfr([0.0])[..., 0, 0], plain_sum(scene, paths, 0.0, 0.0), atol=1e-15)
    first = (paths.tx == 1) & paths.is_los
    field = [
        antenna_field(
            unit_vector(theta, phi), turn, array.pattern, array.polarization, array.polarization_model
        )[:, 0]
        for array, turn, theta, phi in (
            (scene.rx_array, scene.antenna_states(list(scene.receivers.values())).rotation[paths.rx[first]]
             @ scene.rx_array.rotation, paths.theta_r[first], paths.phi_r[first]),
            (scene.transmitters["b"].array, scene.antenna_states([scene.transmitters["b"]]).rotation[[0] * first.sum()],
             paths.theta_t[first], paths.phi_t[first]),
        )
    ]  # fmt: skip
    expected = np.einsum("pi,pij,pj->p", field[0], paths.transfer[first, 0], field[1])
    np.testing.assert_allclose(paths.a[first, 0], expected, rtol=1e-12)
    scene.transmitters["b"].array = mmw.PlanarArray(num_cols=5)
    with pytest.raises(InputError, match=r"differ in their antennas \(a 12, b 5\); a tensor needs equal counts"):
        mmw.PathSolver(max_depth=0)(scene).cfr([0.0])


def test_paths_between_elements_are_spheres_near_an_array() -> None:
    """Each pair of elements has the delay and the gain of its own distance."""
    scene = open_space()
    scene.tx_array = mmw.PlanarArray(num_rows=2, num_cols=4, pattern="iso", polarization="VH", vertical_spacing=3.0)
    scene.rx_array = mmw.PlanarArray(num_cols=3, pattern="iso", polarization="V", horizontal_spacing=2.0)
    scene.add(mmw.Transmitter("t", (0.0, 0.0, 2.0)))
    scene.add(mmw.Receiver("r", (0.7, 0.2, 2.1)))
    exact = mmw.PathSolver(max_depth=0, synthetic_array=False, air_losses=False)(scene, carriers_hz=28e9)
    assert len(exact) == 3 * 8 and not exact.is_synthetic
    a, tau = exact.cir()
    assert a.shape == (1, 3, 1, 16, 1, 1) and tau.shape == (1, 3, 1, 16, 1)
    tx = scene.transmitters["t"].position + scene.tx_array.element_positions(28e9)
    rx = scene.receivers["r"].position + scene.rx_array.element_positions(28e9)
    distance = np.linalg.norm(rx[:, None] - tx[None], axis=-1)
    np.testing.assert_allclose(tau[0, :, 0, :, 0], distance / SPEED_OF_LIGHT, rtol=1e-12)
    expected = SPEED_OF_LIGHT / 28e9 / (4 * np.pi * distance) * np.exp(-2j * np.pi * 28e9 * distance / SPEED_OF_LIGHT)
    vertical = np.abs(a[0, :, 0, :8, 0, 0])
    np.testing.assert_allclose(vertical, np.abs(expected[:, :8]), rtol=2e-2)  # theta components differ by the tilt
    np.testing.assert_allclose(
        np.angle(a[0, :, 0, :8, 0, 0] / expected[:, :8]), np.angle(a[0, 0, 0, 0, 0, 0] / expected[0, 0]), atol=1e-6
    )
    assert np.abs(a[0, :, 0, 8:]).max() < 0.05 * vertical.max()
    scene.receivers["r"].position = (400.0, 30.0, 2.1)
    far = [mmw.PathSolver(max_depth=0, synthetic_array=mode)(scene).cfr([0.0, 1e6]) for mode in (True, False)]
    np.testing.assert_allclose(far[0], far[1], atol=2e-3 * np.abs(far[0]).max())
    with pytest.raises(InputError, match="synthetic_array = False with 2 carriers"):
        mmw.PathSolver(synthetic_array=False)(scene, carriers_hz=CARRIERS)
    with pytest.raises(InputError, match="to_table: paths between single elements"):
        exact.to_table()


@pytest.fixture
def traces(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[int]]:
    """Yield a list with one entry for each search for paths, and one for each table of surfaces."""
    calls: list[int] = []
    for name in ("trace_links", "make_surface_table"):
        function = getattr(module, name)
        monkeypatch.setattr(module, name, lambda *a, f=function, n=name, **k: calls.append(n) or f(*a, **k))
    yield calls


def test_what_has_not_changed_is_not_computed_again(traces: list[str]) -> None:
    scene = two_by_two(street())
    solver = mmw.PathSolver(max_depth=2, samples_per_tx=20_000)
    first = solver(scene)
    assert traces == ["make_surface_table", "trace_links"]
    scene.materials["asphalt"].set(relative_permittivity=12.0)
    changed = solver(scene)
    assert traces[2:] == [], "a permittivity needs no search"
    scene.tx_array = scene.rx_array = mmw.PlanarArray(pattern="iso")
    solver(scene, carriers_hz=CARRIERS)
    assert traces[2:] == [], "nor do antennas and carriers"
    scene.receivers["x"].position = (11.0, 1.0, 1.5)
    solver(scene)
    scene.actors["veh_001"].position = (0.0, 3.0, 0.0)
    solver(scene)
    assert traces[2:] == ["trace_links"] * 2, "the table of surfaces stays"
    scene.materials["asphalt"].set(thickness=0.1)
    solver(scene)
    assert traces[4:] == ["make_surface_table", "trace_links"], "a slab lets waves through"
    fresh = two_by_two(street())
    fresh.materials["asphalt"].set(relative_permittivity=12.0)
    assert solver(fresh).to_table().equals(changed.to_table())
    is_ground = (changed.material_ids == scene.materials["asphalt"].ids[0]).any(axis=1)
    assert is_ground.any() and (first.a[is_ground] != changed.a[is_ground]).any()
    np.testing.assert_array_equal(first.a[~is_ground], changed.a[~is_ground])


def test_moving_something_equals_loading_it_there() -> None:
    scene = two_by_two(street(frame=3))
    solver = mmw.PathSolver(max_depth=1, candidates="exhaustive")
    expected = solver(scene)
    other = two_by_two(street(frame=0))
    solver(other)
    for name in ("cav_1", "veh_001"):
        other.actors[name].pose = scene.actors[name].pose
        other.actors[name].velocity = scene.actors[name].velocity
    found = solver(other)
    np.testing.assert_array_equal(found.path_ids, expected.path_ids)
    np.testing.assert_allclose(found.a, expected.a, rtol=1e-9)
    np.testing.assert_allclose(found.doppler_hz, expected.doppler_hz, atol=1e-6)


def test_selecting_and_sorting() -> None:
    scene = two_by_two(street())
    paths = mmw.PathSolver(max_depth=2, samples_per_tx=20_000)(scene, carriers_hz=CARRIERS)
    some = paths.select(rx="y", kind=["los", "specular"])
    assert some.rx_names == ("y",) and some.tx_names == ("a", "b") and set(some.kind) <= {"los", "specular"}
    assert len(some) == (paths.rx == 1).sum()
    sorted_ = paths.sort_by_gain(4.9e9)
    assert (np.diff(sorted_.gain_db[:, 1]) <= 0).all() and len(sorted_[:3]) == 3 and len(paths[paths.is_los]) == 6
    strong = paths.select(min_gain_db=-100.0)
    assert (strong.gain_db.max(axis=1) >= -100).all() and 0 < len(strong) < len(paths)
    assert "paths of 3 receivers and 2 transmitters at 28, 4.9 GHz" in repr(paths)
    statistics = paths.at_carrier(28e9)
    assert statistics.link_count == 6 and len(statistics) == len(paths)


def test_rotated_devices_turn_their_patterns() -> None:
    scene = open_space()
    scene.add(mmw.Transmitter("t", (0, 0, 0), array=mmw.PlanarArray(pattern="tr38901")))
    scene.add(mmw.Receiver("r", (0, 100, 0), array=mmw.PlanarArray(pattern="iso")))
    away = np.abs(lines_of_sight(scene).a[0, 0])
    scene.transmitters["t"].look_at((0, 100, 0))
    made = mmw.Transmitter("u", (0, 0, 0), look_at=(0, 100, 0))
    assert (made.orientation == scene.transmitters["t"].orientation).all()
    toward = np.abs(lines_of_sight(scene).a[0, 0])
    assert 20 * np.log10(toward / away) == pytest.approx(12 * (90 / 65) ** 2, rel=1e-6)  # TR 38.901, table 7.3-1
    np.testing.assert_allclose(quaternion_to_matrix(scene.transmitters["t"].orientation)[:, 0], (0, 1, 0), atol=1e-12)


def test_tables_and_tensors_of_paths() -> None:
    scene = two_by_two(street())
    paths = mmw.PathSolver(max_depth=1, candidates="exhaustive")(scene, carriers_hz=CARRIERS).sort_by_gain(28e9)
    table = paths.to_pandas()
    assert len(table) == 2 * len(paths) and (table["gain_db"].to_numpy()[::2] == paths.gain_db[:, 0]).all()
    assert table["rx"].tolist()[::2] == [paths.rx_names[k] for k in paths.rx] and set(table["kind"]) == set(paths.kind)
    torch = pytest.importorskip("torch")
    tensors = paths.torch()
    assert tensors["a"].dtype == torch.complex128 and tensors["a"].data_ptr() == paths.a.ctypes.data


def test_impulse_responses_of_a_fixed_number_of_paths() -> None:
    """Give Sionna PHY's CIRDataset equal shapes, the strongest paths, padding of gain 0 and delay -1."""
    scene = two_by_two(street())
    solver = mmw.PathSolver(max_depth=1, candidates="exhaustive")
    a, tau = solver(scene).cir(num_paths=50)
    assert a.shape[4] == tau.shape[2] == 50 and (tau[..., 20:] == -1).all() and (a[:, :, :, :, 20:] == 0).all()
    generator = mmw.channel.CirGenerator(lambda: (solver(scene) for _ in range(3)), num_paths=2)
    assert generator.shape == (3, 2, 2, 12, 2, 1)
    found = list(generator())
    assert len(found) == 3 and all(a.dtype == np.complex64 and tau.shape == (3, 2, 2) for a, tau in found)
    paths = solver(scene)
    for r, t in np.ndindex(3, 2):
        own = (paths.rx == r) & (paths.tx == t)
        strongest = paths.tau[own][np.argmax(np.abs(paths.a[own, 0]))] - paths.tau[own].min()
        assert found[0][1][r, t, 0] == np.float32(strongest)
    with pytest.raises(InputError, match="`samples` gave no paths"):
        list(mmw.channel.CirGenerator(list, num_paths=2)())
    with pytest.raises(InputError, match="num_paths = 0"):
        mmw.channel.CirGenerator(list, num_paths=0)


def test_rain_weakens_each_transmitter_by_its_own_polarization() -> None:
    """Losses are those of ITU-R P.838 at the tilt of the first polarization, whatever other transmitters have."""
    parts = [box_part("Props/stone", (1.0, 1.0, 1.0), (0.0, 0.0, -500.0), "concrete_facade", "static")]
    scene = Scene(arrays_from_parts(parts, weathers=("rainy",)), {"rainy": PRESETS["rainy"]}, device="cpu")
    for name in ("V", "cross", "H"):
        scene.add(mmw.Transmitter(name, (0.0, 0.0, 0.0), array=mmw.PlanarArray(pattern="iso", polarization=name)))
    scene.add(mmw.Receiver("r", (500.0, 0.0, 0.0)))
    paths = mmw.PathSolver(max_depth=0)(scene, carriers_hz=28e9)
    tilt = np.array([np.pi / 2, np.pi / 4, 0.0])
    expected = 0.5 * rain_attenuation(PRESETS["rainy"].rain_mm_h, 28e9, 0.0, tilt)
    np.testing.assert_allclose(paths.rain_db[:, 0], expected, rtol=1e-12)
    assert expected[0] < expected[1] < expected[2]


@pytest.mark.slow
def test_a_thousand_scenes_leave_no_memory_behind(device: str) -> None:
    process, used = psutil.Process(), []
    for round_ in range(1000):
        scene = two_by_two(street(2, 0, device))
        mmw.PathSolver(max_depth=1, candidates="exhaustive")(scene).cfr([0.0])
        scene.receivers["x"].position = (11.0, 1.0, 1.5)
        mmw.PathSolver(max_depth=1, candidates="exhaustive")(scene)
        if round_ % 2:
            scene.close()
        del scene
        if round_ in (200, 999):
            gc.collect()
            on_device = wp.get_mempool_used_mem_current(device) if "cuda" in device else 0
            used.append(np.array([process.memory_info().rss, on_device]))
    grown = used[1] - used[0]
    assert (grown < (20e6, 1e5)).all(), f"{grown / 1e6} MB on host and device in 800 rounds"
