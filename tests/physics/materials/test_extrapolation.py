"""Every named material has a permittivity from 0.5 to 150 GHz, and says where it is not tabulated."""

import logging
import math
from dataclasses import replace

import numpy as np
import pytest

from mmw.core.constants import VACUUM_PERMITTIVITY
from mmw.physics.em.attenuation import path_loss_db
from mmw.physics.materials.extrapolation import permittivity_row
from mmw.physics.materials.itu_rows import PERMITTIVITY
from mmw.physics.materials.material import Material, RadioMaterial
from mmw.physics.materials.permittivity import extrapolation_notes, has_permittivity, log_extrapolations
from mmw.physics.weather.weather import PRESETS, Weather

CARRIERS_GHZ = (0.5, 1.0, 4.9, 10.0, 12.0, 15.0, 24.0, 26.0, 28.0, 39.0, 60.0, 77.0, 105.0, 140.0, 150.0)


def value(name: str, ghz: float) -> complex:
    return permittivity_row(name, ghz * 1e9).row.at(ghz * 1e9)


def asphalt() -> Material:
    return Material("asphalt", RadioMaterial("itu", itu="itu_very_dry_ground"), "asphalt", 0.17, (0.1, 0.1, 0.1))


@pytest.mark.parametrize("name", PERMITTIVITY)
def test_every_material_is_passive_at_every_carrier(name: str) -> None:
    for ghz in (*CARRIERS_GHZ, *np.geomspace(0.5, 150, 100)):
        found = permittivity_row(name, ghz * 1e9)
        eta = found.row.at(ghz * 1e9)
        assert eta.real >= 1 and eta.imag <= 0, ghz
        rows = PERMITTIVITY[name]
        is_inside = any(row.min_ghz <= ghz <= row.max_ghz for row in rows)
        assert bool(found.note) != is_inside, ghz
        if is_inside:
            assert eta == next(row for row in rows if row.min_ghz <= ghz <= row.max_ghz).at(ghz * 1e9)


@pytest.mark.parametrize("name", [name for name in PERMITTIVITY if name != "pec"])
def test_values_are_continuous_at_the_ends_of_the_rows(name: str) -> None:
    for row in PERMITTIVITY[name]:
        for end, side in ((row.min_ghz, 1 - 1e-6), (row.max_ghz, 1 + 1e-6)):
            if not 0.51 <= end <= 149 or not permittivity_row(name, end * side * 1e9).note:
                continue
            assert value(name, end * side) == pytest.approx(row.at(end * 1e9), rel=2e-5), end


def test_between_two_rows_both_parts_are_powers_of_the_frequency() -> None:
    """Halfway in log f, permittivity and conductivity are geometric means of those at the ends."""
    middle = math.sqrt(10.0 * 26.5)
    eta = value("very_dry_ground", middle)
    assert eta.real == pytest.approx(math.sqrt(3.0 * 2.5))
    sigma = -eta.imag * 2 * math.pi * middle * 1e9 * VACUUM_PERMITTIVITY
    assert sigma == pytest.approx(math.sqrt(0.00015 * 10**2.52 * 0.03))


def test_beyond_the_last_row_its_exponents_go_on() -> None:
    for ghz in (60.0, 140.0):
        eta = value("asphalt_concrete", ghz)
        assert eta.real == pytest.approx(4.83)
        assert -eta.imag * 2 * math.pi * ghz * 1e9 * VACUUM_PERMITTIVITY == pytest.approx(0.0108 * ghz**1.3969)
    assert permittivity_row("very_dry_ground", 140e9).note == (
        "extrapolated from 29.5 GHz with the exponents of its last row"
    )
    skin, end = value("skin", 150.0), value("skin", 100.0)  # a model, no powers: the values at its end
    assert skin.real == pytest.approx(end.real) and skin.imag == pytest.approx(end.imag * 100 / 150)


def test_one_line_for_each_material_and_carrier(caplog: pytest.LogCaptureFixture) -> None:
    wet = replace(asphalt(), radio=RadioMaterial("itu", itu="itu_wet_ground"))
    plain = replace(asphalt(), radio=RadioMaterial("constant", relative_permittivity=3.0))
    lines = extrapolation_notes([asphalt(), asphalt(), wet, plain], [28e9, 140e9])
    assert lines == [
        f"asphalt (itu_{row}) at 140 GHz: extrapolated from 29.5 GHz with the exponents of its last row"
        for row in ("very_dry_ground", "wet_ground")
    ]
    many = [replace(asphalt(), name=name) for name in "abcde"]
    assert extrapolation_notes(many, [140e9]) == [lines[0].replace("asphalt", "a, b, c and 2 more")]
    assert extrapolation_notes([asphalt(), wet], [28e9, 4.9e9]) == []
    assert extrapolation_notes([asphalt(), wet], [140e9], used=[]) == []
    unique = replace(asphalt(), name="asphalt of this test")
    with caplog.at_level(logging.WARNING, "mmw"):
        for _ in range(2):
            log_extrapolations([unique], [140e9])
    assert [record.getMessage() for record in caplog.records] == [
        lines[0].replace("asphalt", "asphalt of this test", 1)
    ]


def test_the_radar_takes_its_own_table_where_nothing_is_tabulated() -> None:
    assert not has_permittivity(asphalt().radio, 77e9)
    assert has_permittivity(asphalt().radio, 28e9)


def test_air_below_1_ghz_has_the_losses_of_1_ghz() -> None:
    length, elevation = np.array([1000.0]), np.zeros(1)
    for weather in PRESETS.values():
        low, at_1 = (path_loss_db(weather, [carrier], length, elevation) for carrier in (0.5e9, 1e9))
        for name, loss in low.items():
            assert loss == at_1[name] and 0 <= loss[0, 0] < 0.01
    assert extrapolation_notes([], [0.7e9]) == ["air at 0.7 GHz: losses of 1 GHz, where P.838, P.840 and P.676 begin"]
    with pytest.raises(ValueError, match=r"0\.4 GHz"):
        path_loss_db(Weather(rain_mm_h=10.0), [0.4e9], length, elevation)
