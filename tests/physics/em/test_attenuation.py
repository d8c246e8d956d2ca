"""Rain, fog and gas against ITU's own validation values, and what a path loses in a weather."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mmw.physics.em.attenuation import fog_attenuation, path_loss_db, rain_attenuation, rain_coefficients
from mmw.physics.em.gas_attenuation import OXYGEN, WATER_VAPOUR, gas_attenuation
from mmw.physics.weather.weather import PRESETS, Weather

REFERENCE = Path(__file__).parents[2] / "reference" / "weather"
V, H, CIRCULAR = np.pi / 2, 0.0, np.pi / 4


def columns(name: str) -> np.ndarray:
    """Return a reference table's numbers, shape [columns, rows]."""
    return np.genfromtxt(REFERENCE / name, delimiter=",", skip_header=1, encoding="utf-8").T


def test_rain_equals_itu_validation_values() -> None:
    elevation, ghz, rate, tilt, _, _, gamma = columns("itu_validation_p838_3.csv")
    value = rain_attenuation(rate, ghz * 1e9, np.radians(elevation), np.radians(tilt))
    assert len(gamma) > 50
    np.testing.assert_allclose(value, gamma, rtol=3e-9)


def test_rain_coefficients() -> None:
    ghz, *expected = columns("p838_3_k_alpha.csv")
    np.testing.assert_allclose(rain_coefficients(ghz * 1e9), expected, rtol=6e-7)  # the file has seven digits
    ghz, rate, *expected = columns("p838_3_specific_attenuation.csv")
    for tilt, gamma in zip((H, V, CIRCULAR), expected, strict=True):
        np.testing.assert_allclose(rain_attenuation(rate, ghz * 1e9, 0.0, tilt), gamma, rtol=6e-7)


def test_gas_equals_itu_validation_values() -> None:
    ghz, pressure, kelvin, vapour, oxygen, water, total = columns("itu_validation_p676_13_gamma.csv")
    assert len(ghz) > 300 and OXYGEN.shape == (7, 44) and WATER_VAPOUR.shape == (7, 35)
    for state in np.unique(np.stack([pressure, kelvin, vapour]), axis=1).T:
        rows = (pressure == state[0]) & (kelvin == state[1]) & (vapour == state[2])
        dry, wet = gas_attenuation(ghz[rows] * 1e9, state[0], state[1] - 273.15, state[2])
        np.testing.assert_allclose(dry, oxygen[rows], rtol=2e-14)
        np.testing.assert_allclose(wet, water[rows], rtol=2e-14)
        np.testing.assert_allclose(dry + wet, total[rows], rtol=2e-14)


def test_fog_coefficient() -> None:
    ghz, *expected = columns("p840_fog_kl.csv")
    for celsius, k_l in zip((-8.0, 0.0, 10.0, 20.0), expected, strict=True):
        np.testing.assert_allclose(fog_attenuation(1.0, ghz * 1e9, celsius), k_l, rtol=6e-7)
        np.testing.assert_allclose(fog_attenuation(0.3, ghz * 1e9, celsius), 0.3 * k_l, rtol=6e-7)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: rain_attenuation(5.0, [28e9, 0.9e9]), r"rain attenuation: no value at 0.9 GHz; ITU-R P.838-3 holds"),
        (lambda: fog_attenuation(0.1, 230e9, 10.0), r"fog attenuation: no value at 230 GHz; .* 1 to 200 GHz; choose"),
        (lambda: gas_attenuation(1001e9, 1013.0, 15.0, 7.5), r"gas attenuation: no value at 1001 GHz; ITU-R P.676-13"),
        (lambda: gas_attenuation(np.nan, 1013.0, 15.0, 7.5), r"gas attenuation: no value at nan GHz"),
        (lambda: path_loss_db(PRESETS["foggy"], [300e9], np.ones(1), np.zeros(1)), r"fog .* 300 GHz"),
    ],
)
def test_carriers_outside_the_range(call: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call()


def test_ends_of_the_range_belong_to_it() -> None:
    assert np.isfinite(rain_attenuation(5.0, [1e9, 1000e9])).all()
    assert np.isfinite(gas_attenuation([1e9, 1000e9], 1013.25, 15.0, 7.5)).all()
    assert np.isfinite(fog_attenuation(0.1, [1e9, 200e9], 10.0)).all()


def test_path_loss_of_200_m_in_heavy_shower_and_fog() -> None:
    """The values that a link engineer reads off the Recommendations: 25 mm/h and 0.41 g/m3 over 200 m."""
    length, level = np.array([200.0, 400.0]), np.zeros(2)
    rainy = path_loss_db(PRESETS["rainy"], [28e9, 4.9e9], length, level)
    np.testing.assert_allclose(rainy["rain_db"][0], [0.2 * 3.891, 0.2 * 0.0307], rtol=2e-3)
    np.testing.assert_allclose(rainy["gas_db"][0], [0.2 * 0.1298, 0.2 * 0.00951], rtol=2.5e-2)  # 1.2 % less dry air
    assert (rainy["fog_db"] == 0.0).all()
    foggy = path_loss_db(PRESETS["foggy"], [28e9, 4.9e9], length, level)
    np.testing.assert_allclose(foggy["fog_db"][0], [0.2 * 0.412 * 0.519, 0.2 * 0.412 * 0.0165], rtol=2e-3)
    assert (foggy["rain_db"] == 0.0).all()
    for loss in (*rainy.values(), *foggy.values()):
        assert loss.shape == (2, 2)
        np.testing.assert_allclose(loss[1], 2 * loss[0])


def test_path_loss_in_clear_air_is_gas_alone() -> None:
    sunny = path_loss_db(PRESETS["sunny"], [60e9], np.array([1000.0]), np.zeros(1))
    assert sunny["rain_db"] == sunny["fog_db"] == 0.0
    assert sunny["gas_db"][0, 0] == pytest.approx(14.78, rel=1e-2)  # the oxygen lines; 0.98 % less dry air


def test_polarisation_and_elevation() -> None:
    weather = Weather(rain_mm_h=25.0)
    angles = np.radians([0.0, 30.0, -30.0, 90.0])
    flat, up, down, zenith = path_loss_db(weather, [28e9], np.full(4, 1000.0), angles)["rain_db"][:, 0]
    assert flat == pytest.approx(0.196446 * 25**0.927669, rel=1e-5)
    assert up == down
    level = path_loss_db(weather, [28e9], np.full(4, 1000.0), angles, tilt=H)["rain_db"][:, 0]
    assert level[0] == pytest.approx(0.205091 * 25**0.967876, rel=1e-5)
    assert level[3] == zenith  # straight up there is no horizontal and vertical
    assert flat < up < zenith < level[0]


def test_no_paths() -> None:
    loss = path_loss_db(PRESETS["rainy"], [28e9, 4.9e9], np.zeros(0), np.zeros(0))
    assert {name: value.shape for name, value in loss.items()} == dict.fromkeys(("rain_db", "fog_db", "gas_db"), (0, 2))
