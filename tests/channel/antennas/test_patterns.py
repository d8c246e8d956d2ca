"""Tables, functions and slants as element patterns, against closed forms."""

from pathlib import Path

import numpy as np
import pytest

from mmw.channel import PatternTable, PlanarArray, apply_arrays, register_pattern
from mmw.channel.antennas.patterns import PATTERNS, antenna_field, pattern_components, tr38901
from mmw.physics.em.vectors import direction_angles, unit_vector
from tests.fixtures.path_tables import CARRIER, random_turns, sight
from tests.oracles import path_fields


def directions(count: int, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return np.arccos(rng.uniform(-1, 1, count)), rng.uniform(-np.pi, np.pi, count)


def dipole_table(step_deg: float, **extra: np.ndarray) -> PatternTable:
    theta = np.radians(np.arange(0, 180 + step_deg / 2, step_deg))
    phi = np.radians(np.arange(0, 360, 30.0))
    return PatternTable(theta, phi, np.repeat(np.sqrt(1.5) * np.sin(theta)[:, None], len(phi), axis=1), **extra)


def test_table_sampled_from_a_dipole_is_a_dipole() -> None:
    theta, phi = directions(500)
    expected = np.sqrt(1.5) * np.sin(theta)
    for step, bound in ((2.0, 1.6e-4 * np.sqrt(1.5)), (0.25, 2.4e-6 * np.sqrt(1.5))):
        value, cross = dipole_table(step)(theta, phi)
        assert np.abs(value - expected).max() < bound  # step^2 / 8 times the largest second derivative
        assert np.array_equal(cross, np.zeros(500))
    rng = np.random.default_rng(0)
    away = rng.normal(size=(50, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    turns = random_turns(rng, 50)
    table = antenna_field(away, turns, dipole_table(0.25), "cross")
    np.testing.assert_allclose(table, antenna_field(away, turns, "dipole", "cross"), atol=3e-6)


def test_table_is_exact_on_its_grid_linear_between_and_periodic() -> None:
    rng = np.random.default_rng(1)
    theta, phi = np.linspace(0, np.pi, 19), np.linspace(-np.pi, np.pi, 24, endpoint=False) + 0.1
    values = rng.normal(size=(2, 19, 24)) + 1j * rng.normal(size=(2, 19, 24))
    table = PatternTable(theta, phi, values[0], values[1])
    grid = np.meshgrid(theta, phi, indexing="ij")
    for turn in (0.0, 2 * np.pi, -6 * np.pi):
        for got, expected in zip(table(grid[0], grid[1] + turn), values, strict=True):
            np.testing.assert_allclose(got, expected, atol=1e-12)
    step = phi[1] - phi[0]
    seam = table(np.array([theta[4]]), np.array([phi[-1] + 0.25 * step]))[0]
    assert seam == pytest.approx(0.75 * values[0, 4, -1] + 0.25 * values[0, 4, 0])
    middle = table(np.array([0.5 * (theta[4] + theta[5])]), np.array([phi[7] + 0.5 * step]))[1]
    assert middle == pytest.approx(values[1, 4:6, 7:9].mean())
    closed = PatternTable(theta, np.append(phi, phi[0] + 2 * np.pi), np.hstack([values[0], values[0][:, :1]]))
    assert np.array_equal(closed.c_theta, table.c_theta) and np.array_equal(closed.phi, table.phi)


def test_table_of_one_azimuth_is_round() -> None:
    theta = np.linspace(0, np.pi, 91)
    table = PatternTable(theta, np.zeros(1), np.sin(theta)[:, None])
    one, other = (table(np.array([1.0]), np.array([phi]))[0] for phi in (-3.0, 2.0))
    assert one == pytest.approx(other, rel=1e-14) and one == pytest.approx(np.sin(1.0), rel=1e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"theta": np.linspace(0.1, np.pi, 5)}, "theta has 5 values from 0.1 to 3.14159; it must increase from 0 to"),
        ({"phi": np.array([0.0, 1.0, 2.0, 3.0])}, "phi leaves 3.28 rad of the turn empty"),
        ({"phi": np.array([0.0, 2.0, 1.0, 4.0])}, "phi has 4 values; it must increase"),
        ({"c_theta": np.ones((4, 5))}, r"c_theta \(4, 5\).*values need shape"),
        ({"c_phi": np.full((5, 4), np.nan)}, "c_phi holds values that are not finite"),
    ],
)
def test_table_errors(change: dict, message: str) -> None:
    good = {"theta": np.linspace(0, np.pi, 5), "phi": np.linspace(0, 1.5 * np.pi, 4), "c_theta": np.ones((5, 4))}
    PatternTable(**good)
    with pytest.raises(ValueError, match=message):
        PatternTable(**{**good, **change})


def test_table_files(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    theta, phi = np.radians(np.arange(0, 181, 20.0)), np.radians(np.arange(0, 360, 40.0))
    values = rng.normal(size=(2, 10, 9)) + 1j * rng.normal(size=(2, 10, 9))
    np.savez(tmp_path / "p.npz", theta=theta, phi=phi, c_theta=values[0], c_phi=values[1])
    lines = [
        f"{t},{p},{c.real!r},{c.imag!r},{x.real!r},{x.imag!r}".replace("np.float64(", "").replace(")", "")
        for i, t in enumerate(range(0, 181, 20))
        for j, p in enumerate(range(0, 360, 40))
        for c, x in [(values[0, i, j], values[1, i, j])]
    ]
    rng.shuffle(lines)
    header = "theta_deg,phi_deg,c_theta_re,c_theta_im,c_phi_re,c_phi_im"
    (tmp_path / "p.csv").write_text("\n".join([header, *lines]) + "\n")
    for name in ("p.npz", "p.csv"):
        table = PatternTable.read(tmp_path / name)
        for got, expected in ((table.theta, theta), (table.phi, phi), (table.c_theta, values[0])):
            np.testing.assert_allclose(got, expected, rtol=1e-15)
        assert np.array_equal(np.asarray(table.c_phi), values[1])

    def broken(rows: list[str], head: str = header) -> str:
        (tmp_path / "bad.csv").write_text("\n".join([head, *rows]))
        with pytest.raises(ValueError) as caught:
            PatternTable.read(tmp_path / "bad.csv")
        assert "bad.csv" in str(caught.value)
        return str(caught.value)

    assert "row 4: ['x', '0', '1', '0', '0', '0']; every cell needs a number" in broken(
        [*lines[:2], "x,0,1,0,0,0", *lines[2:]]
    )
    assert "row 92: direction" in broken([*lines, lines[5]])
    assert "has no row; give the full grid" in broken(lines[1:])
    assert "row 3: " in broken([lines[0], "0,0,nan,0,0,0"])
    assert "row 1: columns ['c_theta_re'] are missing" in broken(lines, "theta,phi,gain")
    assert "theta has 0 values" in broken([])
    with pytest.raises(ValueError, match=r"p\.txt: a pattern table is a \.csv or \.npz"):
        PatternTable.read(tmp_path / "p.txt")
    np.savez(tmp_path / "bad.npz", theta=theta)
    with pytest.raises(ValueError, match=r"bad\.npz: arrays \['phi', 'c_theta'\] are missing"):
        PatternTable.read(tmp_path / "bad.npz")


def test_functions_as_patterns() -> None:
    rng = np.random.default_rng(5)
    away = rng.normal(size=(40, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    turns = random_turns(rng, 40)

    def own_dipole(theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
        return np.sqrt(1.5) * np.sin(theta)

    for polarization in ("V", "H", "cross"):
        for model in ("tr38901_1", "tr38901_2"):
            args = (polarization, model)
            np.testing.assert_allclose(
                antenna_field(away, turns, own_dipole, *args), antenna_field(away, turns, "dipole", *args), atol=1e-15
            )
    number = antenna_field(away, turns, lambda theta, phi: 2j, "V")
    np.testing.assert_allclose(number, 2j * antenna_field(away, turns, "iso", "V"))
    both = antenna_field(away, turns, lambda theta, phi: (np.cos(phi), np.sin(theta)), 0.3)
    theta_part = antenna_field(away, turns, lambda theta, phi: np.cos(phi), 0.3)
    phi_part = antenna_field(away, turns, lambda theta, phi: np.sin(theta), 0.3 + np.pi / 2)
    np.testing.assert_allclose(both, theta_part + phi_part, atol=1e-14)
    assert np.sum(both**2) == pytest.approx(np.sum(theta_part**2) + np.sum(phi_part**2))
    with pytest.raises(ValueError, match=r"returned shape \(3,\) for angles of shape \(40,\)"):
        antenna_field(away, turns, lambda theta, phi: np.ones(3), "V")
    with pytest.raises(ValueError, match="not finite"):
        pattern_components(lambda theta, phi: theta * np.nan, *directions(4))
    with pytest.raises(ValueError, match="returned 3 arrays"):
        pattern_components(lambda theta, phi: (theta, theta, theta), *directions(4))


@pytest.mark.parametrize("model", ["tr38901_1", "tr38901_2"])
def test_slants(model: str) -> None:
    theta, phi = directions(60)
    away = unit_vector(theta, phi)
    turns = np.broadcast_to(np.eye(3), (60, 3, 3))
    named = antenna_field(away, turns, "tr38901", "cross", model)
    np.testing.assert_array_equal(named, antenna_field(away, turns, "tr38901", (-np.pi / 4, np.pi / 4), model))
    field = antenna_field(away, turns, "tr38901", (0.2, 1.0, -2.0), model)
    assert field.shape == (60, 3, 2)
    power = tr38901(theta, phi) ** 2
    np.testing.assert_allclose(np.sum(field**2, axis=2), np.repeat(power[:, None], 3, axis=1), rtol=1e-9)
    np.testing.assert_array_equal(field[:, 1:2], antenna_field(away, turns, "tr38901", 1.0, model))
    if model == "tr38901_2":
        np.testing.assert_allclose(np.arctan2(field[:, 0, 1], field[:, 0, 0]), 0.2)
    with pytest.raises(ValueError, match="'Z'; use one of V, H, VH, cross"):
        antenna_field(away, turns, "iso", "Z", model)
    with pytest.raises(ValueError, match="finite"):
        antenna_field(away, turns, "iso", (np.inf,), model)
    with pytest.raises(ValueError, match="'horn'; known patterns are iso"):
        pattern_components("horn", theta, phi)


@pytest.fixture
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forget the names that a test registers."""
    monkeypatch.setattr(PATTERNS, "_added", {})


def own_dipole(theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    return np.sqrt(1.5) * np.abs(np.sin(theta))


@pytest.mark.usefixtures("registered")
@pytest.mark.parametrize(("pattern", "atol"), [(own_dipole, 0.0), (dipole_table(0.25), 6e-6)])
def test_a_registered_pattern_is_that_of_mmw_it_repeats(pattern: PatternTable, atol: float) -> None:
    """In arrays, with any polarization: bit for bit as a function, to its grid as a table."""
    assert register_pattern("mine", pattern) is pattern
    rng = np.random.default_rng(8)
    paths = sight(rng.normal(0, 5, (20, 3)), rng.normal(0, 50, (20, 3)))
    turns = [random_turns(rng, 20) for _ in range(2)]
    for options in ({"polarization": "cross"}, {"polarization": "H", "polarization_model": "tr38901_1"}):
        own, given = (PlanarArray(2, 3, pattern=name, **options) for name in ("mine", "dipole"))
        a, b = (apply_arrays(paths, array, array, CARRIER, *turns) for array in (own, given))
        np.testing.assert_allclose(a, b, rtol=0.0, atol=atol * np.abs(paths.transfer).max())


@pytest.mark.usefixtures("registered")
@pytest.mark.parametrize(
    ("name", "pattern", "message"),
    [
        ("dipole", own_dipole, "antenna pattern 'dipole': is registered by mmw already; choose another name"),
        ("taken", own_dipole, r"'taken': is registered by register\(\) already"),
        ("mine", "dipole", "is a str; a Callable is needed"),
        ("mine", lambda theta, phi: theta / 0.0 * 0.0, "pattern mine: returned values that are not finite"),
        ("mine", lambda theta, phi: theta[:3], r"pattern mine: returned shape \(3,\) for angles of shape \(\d+,\)"),
        ("mine", lambda theta, phi: (theta, theta, theta), "pattern mine: returned 3 arrays"),
        ("mine", lambda theta, phi: None, "pattern mine: returned values that are not finite; return a number"),
        ("mine", lambda theta, phi: np.full(theta.shape, "1"), "return a number in any direction"),
        ("mine", lambda theta, phi: np.where(theta == 0.0, np.inf, 1.0), "not finite"),
    ],
)
def test_patterns_that_cannot_be_registered(name: str, pattern: PatternTable, message: str) -> None:
    register_pattern("taken", own_dipole)
    with np.errstate(all="ignore"), pytest.raises(ValueError, match=message):
        register_pattern(name, pattern)
    assert "mine" not in PATTERNS


@pytest.mark.usefixtures("registered")
def test_unknown_names_list_those_of_mmw_and_of_users() -> None:
    register_pattern("mine", own_dipole)
    with pytest.raises(ValueError, match="'other'; one of iso, dipole, hw_dipole, tr38901, mine, a table or"):
        PlanarArray(pattern="other")


@pytest.mark.parametrize("model", ["tr38901_1", "tr38901_2"])
@pytest.mark.parametrize("has_phase", [False, True])
def test_fields_of_turned_antennas_against_numpy(model: str, has_phase: bool) -> None:
    """The same sums of products in float64 as the kernels': they differ by some units of the last place."""
    rng = np.random.default_rng(8)
    away, turns = unit_vector(*directions(80)), random_turns(rng, 80)
    away[0], turns[0] = [0.0, 0.0, 1.0], np.eye(3)
    phase = 1j if has_phase else 1.0

    def pattern(theta: np.ndarray, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return 1.0 + np.sin(theta) * np.cos(phi), phase * np.cos(theta)

    local = np.einsum("pij,pi->pj", turns, away)
    amplitude = np.stack(pattern(*direction_angles(local)), axis=1)
    slants = (0.3, -1.2, np.pi / 2)
    expected = path_fields.antenna_field(away, turns, amplitude, slants, model)
    found = antenna_field(away, turns, pattern, slants, model)
    assert np.iscomplexobj(found) is has_phase
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12)


def test_patterns_of_mmw_against_numpy() -> None:
    """The same formulas in float64; amplitudes are of size 1."""
    theta, phi = directions(200)
    theta[:4], phi[:4] = [0.0, np.pi, np.pi / 2, 1e-10], [0.0, 1.0, -np.pi, np.pi]
    beam, sine = np.radians(65.0), np.sin(theta)
    loss = [np.minimum(12.0 * (angle / beam) ** 2, 30.0) for angle in (theta - np.pi / 2, phi)]
    half_wave = np.where(np.abs(sine) < 1e-9, 0.0, np.cos(np.pi / 2 * np.cos(theta)) / np.maximum(sine, 1e-9))
    expected = {
        "iso": np.ones(200),
        "dipole": np.sqrt(1.5) * np.abs(sine),
        "hw_dipole": np.sqrt(1.643) * np.abs(half_wave),
        "tr38901": 10.0 ** ((8.0 - np.minimum(sum(loss), 30.0)) / 20.0),
    }
    turns = random_turns(np.random.default_rng(1), 200)
    away = np.einsum("pij,pj->pi", turns, unit_vector(theta, phi))
    for name, values in expected.items():
        found, across = pattern_components(name, theta, phi)
        np.testing.assert_allclose(found, values, rtol=0.0, atol=1e-12)
        assert (across == 0.0).all()
        named, own = (antenna_field(away, turns, pattern, (0.4, 2.0)) for pattern in (name, PATTERNS[name]))
        np.testing.assert_array_equal(named, own)  # in one kernel or in two
    assert tr38901(np.full((2, 3), 1.0), 0.5).shape == (2, 3) and float(PATTERNS["dipole"](np.pi / 2, 0.0)) > 1.2
