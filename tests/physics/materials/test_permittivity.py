"""Permittivities and reflection coefficients against values worked out by hand, and against laws."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from mmw.core.constants import SPEED_OF_LIGHT, VACUUM_PERMITTIVITY
from mmw.physics.em.fresnel import reflection, transmission
from mmw.physics.materials.itu_rows import PERMITTIVITY
from mmw.physics.materials.material import RadioMaterial
from mmw.physics.materials.permittivity import permittivity_table, relative_permittivity
from mmw.physics.materials.soil import Soil, bulk_density, soil_permittivity, water_permittivity
from tests.fixtures.scenes import material

ANGLES = np.radians(np.linspace(0.0, 89.9, 200))


def itu(name: str, carrier_hz: float) -> tuple[float, float]:
    value = relative_permittivity(RadioMaterial("itu", itu=name), carrier_hz)
    return value.real, -value.imag * 2 * np.pi * carrier_hz * VACUUM_PERMITTIVITY


def test_itu_values() -> None:
    assert itu("itu_concrete", 28e9) == pytest.approx((5.24, 0.0462 * 28**0.7822))
    assert itu("concrete", 4.9e9) == pytest.approx((5.24, 0.0462 * 4.9**0.7822))
    assert itu("itu_medium_dry_ground", 4.9e9) == pytest.approx((15 * 4.9**-0.1, 0.035 * 4.9**1.63))
    assert itu("itu_concrete", 140e9) == pytest.approx((5.17, 0.0145 * 140**1.09))
    assert itu("itu_marble", 60e9)[0] == pytest.approx(7.074)


@pytest.mark.parametrize(
    ("ground", "values"), [("very_dry", (2.5, 0.03)), ("medium_dry", (3.0, 0.4)), ("wet", (3.0, 2.5))]
)
def test_paper_grounds_at_28_ghz(ground: str, values: tuple[float, float]) -> None:
    assert itu(f"itu_{ground}_ground", 28e9) == pytest.approx(values)
    assert itu(f"itu_{ground}_grnd_28", 28e9) == pytest.approx(values)


def test_constant_material() -> None:
    radio = RadioMaterial("constant", relative_permittivity=2.5, conductivity=0.001)
    assert relative_permittivity(radio, 1e9) == pytest.approx(
        2.5 - 1j * 0.001 / (2 * np.pi * 1e9 * VACUUM_PERMITTIVITY)
    )


def test_frequency_outside_the_ranges() -> None:
    for carrier in (160e9, 0.4e9):
        with pytest.raises(
            ValueError, match=rf"'asphalt' \(itu_very_dry_ground\).* {carrier / 1e9:g} GHz; .*26.5-29.5 GHz"
        ):
            permittivity_table((material("asphalt"),), [28e9, carrier])
        assert np.isnan(permittivity_table((material("asphalt"),), [carrier], used=[])).all()


def test_every_row_has_a_range() -> None:
    for name, rows in PERMITTIVITY.items():
        for row in rows:
            assert 0 <= row.min_ghz < row.max_ghz and row.source
            if name != "pec":
                value = np.array([row.at(ghz * 1e9) for ghz in np.geomspace(row.min_ghz, row.max_ghz, 50)])
                assert (value.real >= 1).all() and (value.imag <= 0).all(), name


def test_perfect_conductor_reflects_everything_exactly() -> None:
    conductor = replace(material("asphalt"), radio=RadioMaterial("itu", itu="itu_pec"))
    table = permittivity_table((conductor, material("concrete_roof")), [4.9e9, 28e9])
    assert np.isinf(table[0]).all() and np.isfinite(table[1]).all()
    eta = np.full(200, table[0, 1])
    for thickness in (0.0, 0.1):
        te, tm = reflection(eta, np.cos(ANGLES), np.full(200, thickness), 28e9)
        assert (te == -1).all() and (tm == 1).all()
        assert all((t == 0).all() for t in transmission(eta, np.cos(ANGLES), np.full(200, thickness), 28e9))
    mixed = reflection(np.array([eta[0], 4.0 + 0j]), np.ones(2), np.zeros(2), 28e9)
    np.testing.assert_allclose(mixed, [[-1, -1 / 3], [1, 1 / 3]])
    assert relative_permittivity(RadioMaterial("itu", itu="itu_pec"), 1.0).imag == -np.inf  # at any frequency


@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_total_reflection(zero: float) -> None:
    """Beyond the critical angle of a rarer medium all comes back, late by the phase of the wave that dies out in it.

    Source: Born and Wolf, Principles of Optics, section 1.5.4; a thin layer of it lets some through.
    """
    cosine = np.cos(np.radians(np.linspace(30.5, 89.0, 50)))
    eta, carrier = np.full(50, complex(0.25, zero)), 28e9
    decay = np.sqrt(1.0 - cosine**2 - 0.25)
    te, tm = reflection(eta, cosine, np.zeros(50), carrier)
    np.testing.assert_allclose(te, np.exp(2j * np.arctan(decay / cosine)), atol=1e-12)
    np.testing.assert_allclose(tm, np.exp(2j * np.arctan(decay / (0.25 * cosine))), atol=1e-12)
    for thickness, bound in ((0.001, 1.0), (0.2, 1e-3)):
        for through, back in zip(
            transmission(eta, cosine, np.full(50, thickness), carrier),
            reflection(eta, cosine, np.full(50, thickness), carrier),
            strict=True,
        ):
            np.testing.assert_allclose(np.abs(through) ** 2 + np.abs(back) ** 2, 1.0, atol=1e-9)
            assert 0.0 < np.abs(through[10:40]).max() < bound


@pytest.mark.parametrize("thickness", [0.0, 0.003, 0.1, 10.0])
def test_no_surface_makes_power(thickness: float) -> None:
    rng = np.random.default_rng(1)
    eta = rng.uniform(1, 30, 200) - 1j * 10.0 ** rng.uniform(-6, 7, 200)
    given = eta, np.cos(ANGLES), np.full(200, thickness), 28e9
    with np.errstate(all="raise"):  # thick and conducting slabs must not underflow either
        for r, t in zip(reflection(*given), transmission(*given), strict=True):
            assert np.isfinite(r).all() and np.isfinite(t).all()
            assert (np.abs(r) ** 2 + np.abs(t) ** 2).max() <= 1 + 1e-12
            assert thickness or (t == 0).all()  # a half-space lets nothing through


def test_a_lossless_slab_keeps_the_power() -> None:
    rng = np.random.default_rng(3)
    given = rng.uniform(1, 30, 500) + 0j, rng.uniform(1e-3, 1, 500), 10.0 ** rng.uniform(-4, 1, 500), 28e9
    for r, t in zip(reflection(*given), transmission(*given), strict=True):
        np.testing.assert_allclose(np.abs(r) ** 2 + np.abs(t) ** 2, 1.0, atol=1e-12)
        np.testing.assert_allclose((r * t.conj()).real, 0.0, atol=1e-12)  # symmetric: in quadrature


def test_slabs_are_those_of_transmission_line_theory() -> None:
    """Two-port matrices of 1 to 3 layers of one material in a row: a symmetric, reciprocal two-port each way."""
    rng = np.random.default_rng(4)
    eta = rng.uniform(1, 10, 300) - 1j * 10.0 ** rng.uniform(-4, 1, 300)
    cosine, layers, carrier = rng.uniform(0.02, 1, 300), rng.uniform(1e-4, 3e-3, (3, 300)), 28e9
    inner = np.sqrt(eta - 1 + cosine**2)
    slab = eta, cosine, layers.sum(axis=0), carrier
    outside, inside = (cosine, 1 / cosine), (inner, eta / inner)  # admittances over that of free space, TE and TM
    for y0, y, r, t, sign in zip(outside, inside, reflection(*slab), transmission(*slab), (1, -1), strict=True):
        total = np.broadcast_to(np.eye(2, dtype=complex), (300, 2, 2))
        for d in layers:
            q = 2 * np.pi * d * carrier / SPEED_OF_LIGHT * inner
            total = total @ np.array([[np.cos(q), 1j * np.sin(q) / y], [1j * y * np.sin(q), np.cos(q)]]).transpose(
                2, 0, 1
            )
        (a, b), (c, d) = total.transpose(1, 2, 0)
        np.testing.assert_allclose(a * d - b * c, 1.0, atol=1e-9)
        below = a * y0 + b * y0**2 + c + d * y0
        np.testing.assert_allclose(r, sign * (a * y0 + b * y0**2 - c - d * y0) / below, atol=1e-12)
        np.testing.assert_allclose(t, 2 * y0 / below, atol=1e-12)


def test_reflection_limits() -> None:
    carrier, eta = 28e9, np.full(200, 5.0 - 0.5j)
    half = reflection(eta, np.cos(ANGLES), np.zeros(200), carrier)
    thick = reflection(eta, np.cos(ANGLES), np.full(200, 5.0), carrier)
    np.testing.assert_allclose(half, thick, atol=1e-12)  # nothing comes back from the far side of a lossy slab
    assert half[0][0] == pytest.approx(-half[1][0])
    wave = SPEED_OF_LIGHT / carrier
    window = reflection(np.array([4.0 + 0j]), np.ones(1), np.array([wave / 4]), carrier)  # half a wave inside
    assert abs(window[0][0]) < 1e-12
    quarter = reflection(np.array([4.0 + 0j]), np.ones(1), np.array([wave / 8]), carrier)
    assert quarter[0][0] == pytest.approx((1 - 4) / (1 + 4))
    conductor = reflection(np.full(200, 1 - 1e14j), np.cos(ANGLES), np.zeros(200), carrier)
    np.testing.assert_allclose(conductor[0], -1.0, atol=1e-6)
    np.testing.assert_allclose(conductor[1], 1.0, atol=1e-3)  # but for the last grazing angles


SOILS = {  # sand, clay [%], specific gravity, bulk density: the example soils of P.527
    "sandy_loam": (51.52, 13.42, 2.66, 1.6006), "loam": (41.96, 8.53, 2.70, 1.5781),
    "silty_loam": (30.63, 13.48, 2.59, 1.5750), "silty_clay": (5.02, 47.38, 2.56, 1.4758),
}  # fmt: skip


@pytest.mark.parametrize(
    ("soil", "eps_r", "sigma"),
    [
        ("sandy_loam", 15.281, 18.2),
        ("loam", 14.563, 16.998),
        ("silty_loam", 13.965, None),
        ("silty_clay", 12.861, 14.647),
    ],
)
def test_soil_of_p527(soil: str, eps_r: float, sigma: float | None) -> None:
    """The documented example of MATLAB's earthSurfacePermittivity (P.527): 28 GHz, 23 C, half the volume water."""
    value = itu(f"itu_wet_{soil}", 28e9)
    assert value[0] == pytest.approx(eps_r, abs=6e-4)
    assert sigma is None or value[1] == pytest.approx(sigma, abs=6e-4)


@pytest.mark.parametrize("moisture", [0.07, 0.2, 0.5])
@pytest.mark.parametrize("name", SOILS)
def test_soil_against_the_model_it_comes_from(name: str, moisture: float) -> None:
    """Dobson et al. 1985 with its own single-Debye water at 23 C, as in Ulaby and Long 2014, section 4-8."""
    sand, clay, solid, bulk = SOILS[name]
    for ghz in (10.0, 18.0, 28.0):
        static = 88.045 - 0.4147 * 23 + 6.295e-4 * 23**2 + 1.075e-5 * 23**3
        f_tau = ghz * (1.1109e-1 - 3.824e-3 * 23 + 6.938e-5 * 23**2 - 5.096e-7 * 23**3)
        sigma = -1.645 + 1.939 * bulk - 0.0225622 * sand + 0.01594 * clay
        real = 4.9 + (static - 4.9) / (1 + f_tau**2)
        loss = f_tau * (static - 4.9) / (1 + f_tau**2) + 17.975 * sigma / ghz * (solid - bulk) / (solid * moisture)
        grains = (1.01 + 0.44 * solid) ** 2 - 0.062
        beta = 1.2748 - 0.00519 * sand - 0.00152 * clay, 1.33797 - 0.00603 * sand - 0.00166 * clay
        eps_r = (1 + bulk / solid * (grains**0.65 - 1) + moisture ** beta[0] * real**0.65 - moisture) ** (1 / 0.65)
        value = soil_permittivity(ghz * 1e9, Soil(sand, clay, moisture, 23.0, solid, bulk))
        assert value.real == pytest.approx(eps_r, rel=0.03)
        assert -value.imag == pytest.approx(moisture ** (beta[1] / 0.65) * loss, rel=0.06)


def ellison_water(ghz: float, t: float, s: float) -> complex:
    """Return the permittivity of sea water of Ellison et al., as in Ulaby and Long 2014, code 4.2 (0 to 30 C)."""
    a = (0.46606917e-2, -0.26087876e-4, -0.63926782e-5, 6.3000075, 0.26242021e-2, -0.42984155e-2, 0.34414691e-4,
         0.17667420e-3, -0.20491560e-6, 0.58366888e3, 0.12634992e3, 0.69227972e-4, 0.38957681e-6, 0.30742330e3,
         0.12634992e3, 0.37245044e1, 0.92609781e-2, -0.26093754e-1)  # fmt: skip
    static = 87.85306 * np.exp(-0.00456992 * t - a[0] * s - a[1] * s**2 - a[2] * s * t)
    middle = a[3] * np.exp(-a[4] * t - a[5] * s - a[6] * s * t)
    tau_1, tau_2 = (a[7] + a[8] * s) * np.exp(a[9] / (t + a[10])), (a[11] + a[12] * s) * np.exp(a[13] / (t + a[14]))
    infinite = a[15] + a[16] * t + a[17] * s
    sigma = 2.903602 + 8.607e-2 * t + 4.738817e-4 * t**2 - 2.991e-6 * t**3 + 4.3041e-9 * t**4
    sigma *= s * (37.5109 + 5.45216 * s + 0.014409 * s**2) / (1004.75 + 182.283 * s + s**2)
    alpha = (6.9431 + 3.2841 * s - 0.099486 * s**2) / (84.85 + 69.024 * s + s**2), 49.843 - 0.2276 * s + 0.00198 * s**2
    sigma *= 1 + alpha[0] * (t - 15) / (t + alpha[1])
    wave = 2j * np.pi * ghz
    return (
        (static - middle) / (1 + wave * tau_1) + (middle - infinite) / (1 + wave * tau_2) + infinite
        - 17.9751j * sigma / ghz
    )  # fmt: skip


@pytest.mark.parametrize("celsius", [2.0, 10.0, 20.0, 28.0])
def test_water_against_another_model(celsius: float) -> None:
    for ghz in (1.4, 4.9, 28.0, 60.0, 100.0):
        fresh, expected = water_permittivity(ghz * 1e9, celsius), ellison_water(ghz, celsius, 0.0)
        assert (fresh.real, fresh.imag) == pytest.approx((expected.real, expected.imag), rel=0.055)
        if ghz < 30:  # the models of sea water part above
            sea, expected = water_permittivity(ghz * 1e9, celsius, 35.0), ellison_water(ghz, celsius, 35.0)
            assert (sea.real, sea.imag) == pytest.approx((expected.real, expected.imag), rel=0.065)
    assert water_permittivity(28e9, celsius, 1e-9) == pytest.approx(water_permittivity(28e9, celsius))


def test_sea_water_conducts_as_oceanography_says() -> None:
    low = water_permittivity(1e6, 15.0, 35.0)
    assert -low.imag * 1e6 / 17.975e9 == pytest.approx(4.2914, rel=2e-3)  # S/m at 15 C and 35 psu (PSS-78)


def test_bulk_density() -> None:
    assert bulk_density(51.52, 13.42) == pytest.approx(
        1.07256 + 0.078886 * np.log(51.52) + 0.038753 * np.log(13.42) + 0.032732 * np.log(35.06)
    )
    assert bulk_density(100.0, 0.0) == pytest.approx(1.07256 + 0.078886 * np.log(100))
    assert bulk_density(79.6, 0.4) == pytest.approx(bulk_density(79.92, 0.0), abs=1e-4)  # clay below 1 % is left out
    moist = Soil(51.52, 13.42, 0.3)
    assert soil_permittivity(28e9, moist) == soil_permittivity(
        28e9, Soil(51.52, 13.42, 0.3, bulk_density_g_cm3=bulk_density(51.52, 13.42))
    )


def test_wetter_soil_has_more_of_both() -> None:
    values = [soil_permittivity(28e9, Soil(51.52, 13.42, moisture)) for moisture in (0.02, 0.07, 0.2, 0.4)]
    assert np.all(np.diff([value.real for value in values]) > 0)
    assert np.all(np.diff([-value.imag for value in values]) > 0)
    assert 2 < values[0].real < 4  # dry soil


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: soil_permittivity(1.1e12, Soil(40, 20, 0.2)), r"soil: no value at 1100 GHz; ITU-R P.527-6 holds"),
        (lambda: soil_permittivity(0.1e9, Soil(5.0, 50.0, 0.02)), "5 % sand, 50 % clay, moisture 0.02 has no value at"),
        (lambda: Soil(70, 40, 0.2), "sand 70 %, clay 40 %; .* together at most 100"),
        (lambda: Soil(40, 20, 0.0), "moisture = 0; above 0 to 1"),
        (lambda: Soil(math.nan, 20, 0.2), "sand nan %"),
        (lambda: Soil(40, 20, 0.2, bulk_density_g_cm3=0.0), "bulk_density_g_cm3 = 0; a finite number above 0"),
        (lambda: water_permittivity(28e9, 50.0), "temperature_c = 50; .* from -4 to 40"),
        (lambda: water_permittivity(28e9, 20.0, 41.0), "salinity_g_kg = 41"),
        (
            lambda: relative_permittivity(RadioMaterial("itu", itu="itu_dry_silty_clay"), 0.1e9, "field"),
            r"material 'field' \(itu_dry_silty_clay\): no permittivity at 0.1 GHz; its ranges are 1.3-1000 GHz",
        ),
    ],
)
def test_ground_outside_its_model(call: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call()
