"""Large-scale parameters of TR 38.901 against values worked out by hand."""

import numpy as np
import pytest
import scipy.stats

from mmw.channel.tr38901 import NORMAL_DECILE, LogNormal, street_canyon


def test_street_canyon_at_9_ghz() -> None:
    """log10(1 + 9) = 1, so every line of the table is a sum of two numbers."""
    los, nlos = street_canyon(9e9, True, 20.0), street_canyon(9e9, False, 100.0, rx_height_m=1.5)
    assert (los.delay_spread_s.mean, los.delay_spread_s.std) == (pytest.approx(-7.38), 0.38)
    assert (nlos.delay_spread_s.mean, nlos.delay_spread_s.std) == (pytest.approx(-7.07), pytest.approx(0.44))
    assert los.azimuth_spread_departure_deg.mean == pytest.approx(1.16)
    assert nlos.azimuth_spread_departure_deg.mean == pytest.approx(1.30)
    assert los.azimuth_spread_arrival_deg.mean == pytest.approx(1.65)
    assert nlos.azimuth_spread_arrival_deg.mean == pytest.approx(1.73)
    assert los.zenith_spread_arrival_deg.mean == pytest.approx(0.63)
    assert nlos.zenith_spread_arrival_deg.mean == pytest.approx(0.88)
    assert los.zenith_spread_departure_deg.mean == pytest.approx(-14.8 * 0.02 + 0.085 + 0.83)
    assert nlos.zenith_spread_departure_deg.mean == pytest.approx(-0.11)
    assert los.k_factor_db == (9.0, 5.0) and nlos.k_factor_db is None


def test_carriers_below_2_ghz_are_as_2_ghz() -> None:
    assert street_canyon(0.9e9, True, 50.0) == street_canyon(2e9, True, 50.0) != street_canyon(3e9, True, 50.0)
    with pytest.raises(ValueError, match=r"carrier_hz = 1\.4e\+11.*0\.5 to 100 GHz"):
        street_canyon(140e9, True, 50.0)


def test_percentiles() -> None:
    assert scipy.stats.norm.ppf(0.9) == pytest.approx(NORMAL_DECILE, rel=1e-12)
    own = LogNormal(1.0, 0.3, 15.0)
    expected = [*(10 ** scipy.stats.norm.ppf([0.1, 0.5], 1.0, 0.3)), 15.0]
    np.testing.assert_allclose(own.percentiles, expected, rtol=1e-12)
