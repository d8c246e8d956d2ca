"""Radio materials: wrong values, permittivities as functions, absorbers, and what files hold of them."""

import pickle
import re
from collections.abc import Callable
from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mmw.config import ChannelConfig
from mmw.core.constants import VACUUM_PERMITTIVITY
from mmw.physics import materials
from mmw.physics.em.fresnel import reflection, transmission
from mmw.physics.materials.itu_rows import PERMITTIVITY, RADIO_ROWS
from mmw.physics.materials.material import FILE_FIELDS, Material, RadioMaterial, file_values
from mmw.physics.materials.permittivity import has_permittivity, permittivity_table, relative_permittivity
from mmw.physics.weather.weather import Weather
from mmw.scene.rows import static_rows
from mmw.sensors.radar.reflectivity import reflectivity_table
from tests.fixtures.radio_materials import WRONG_RADIO, lambertian
from tests.fixtures.scenes import arrays_from_parts, ground_part

RANGE_NEEDED = "(lowest, highest) above 0 Hz, for model function, or None"


def plain(frequency_hz: float) -> complex:
    return 4.0 - 0.5j


def named(radio: RadioMaterial) -> Material:
    return Material("paint", radio, "none", 0.3, (0.5, 0.5, 0.5))


def lossy(low: float, high: float) -> RadioMaterial:
    """Return concrete as a function of frequency, in a range [Hz]."""
    return RadioMaterial(
        "function", permittivity=lambda f: (5.24, 0.0462 * (f / 1e9) ** 0.7822), frequency_range_hz=(low, high)
    )


@pytest.mark.parametrize(
    ("changes", "needed"),
    [
        *WRONG_RADIO,
        ({"alpha_r": 2.5}, "a whole number from 1 to 1000"),
        ({"scattering_pattern": ["lambertian"]}, "one of lambertian, directive, backscattering"),
        ({"model": "measured"}, "itu, constant or function"),
        ({"model": "function", "permittivity": None}, "a function of the frequency"),
        ({"model": "function", "permittivity": 4 - 1j}, "a function of the frequency"),
        ({"permittivity": plain}, "model function, for a function,"),
        *(
            ({"model": "function", "permittivity": plain, "frequency_range_hz": value}, RANGE_NEEDED)
            for value in ((30e9, 3e9), (0.0, 1e9), (1e9,), (1e9, np.inf), (np.nan, 1e9), 28e9)
        ),
        ({"frequency_range_hz": (1e9, 2e9)}, RANGE_NEEDED),
    ],
)  # fmt: skip
def test_a_wrong_radio_material_is_refused(changes: dict, needed: str) -> None:
    name, value = list(changes.items())[-1]
    message = f"radio material: {name} = {value!r}; {needed} is needed; correct it"
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        RadioMaterial(**{"model": "constant", **changes})


def test_rows_have_both_names() -> None:
    assert set(RADIO_ROWS) == {f"itu_{name}" for name in PERMITTIVITY}
    for row in RADIO_ROWS:
        given = (RadioMaterial("itu", itu=name) for name in (row, row.removeprefix("itu_")))
        carrier = next(r for r in PERMITTIVITY[row.removeprefix("itu_")]).max_ghz * 1e9
        carrier = carrier if np.isfinite(carrier) else 28e9
        one, other = (relative_permittivity(radio, carrier) for radio in given)
        assert one == other


@pytest.mark.parametrize("carrier_hz", [1e9, 28e9, 100e9])
def test_a_function_is_its_formula(carrier_hz: float) -> None:
    """Both forms of a result, against the numbers; and a row of the table, bit for bit."""
    sigma = 0.0462 * (carrier_hz / 1e9) ** 0.7822
    pair = relative_permittivity(lossy(1e9, 100e9), carrier_hz)
    whole = relative_permittivity(
        RadioMaterial("function", permittivity=lambda f: 5.24 - 1j * sigma / (2 * np.pi * f * VACUUM_PERMITTIVITY)),
        carrier_hz,
    )
    assert pair == relative_permittivity(RadioMaterial("itu", itu="itu_concrete"), carrier_hz)
    assert whole == pytest.approx(pair, rel=1e-15) and whole.imag < 0
    for kind in (np.complex64, np.complex128, np.array):  # numbers of NumPy, too
        radio = RadioMaterial("function", permittivity=lambda f, kind=kind: kind(4 - 0.5j))
        assert relative_permittivity(radio, carrier_hz) == 4 - 0.5j


def test_a_function_is_called_with_one_carrier_at_a_time() -> None:
    asked = []

    def remembered(frequency_hz: float) -> complex:
        asked.append(frequency_hz)
        return complex(2.0 + frequency_hz / 1e10, 0.0)

    table = permittivity_table((named(RadioMaterial("function", permittivity=remembered)),), np.array([1e10, 3e10]))
    assert asked == [1e10, 3e10] and all(type(value) is float for value in asked)
    np.testing.assert_array_equal(table, [[3.0, 5.0]])


@pytest.mark.parametrize(
    "value",
    [
        0.5, -4.0, 4 + 0.1j, complex(np.nan), complex(3, np.nan), np.inf, complex(1, -np.inf), (4.0, -1.0), (0.5, 1.0),
        (4.0, np.nan), (4.0, 1.0, 2.0), (4 - 1j, 1.0), "4", ("4", "1"), None, np.ones(2), [4.0, [1.0]], True,
    ],
)  # fmt: skip
def test_a_function_that_is_no_permittivity_is_told_with_material_frequency_and_value(value: object) -> None:
    radio = RadioMaterial("function", permittivity=lambda f: value)
    message = rf"material 'paint': permittivity\(2\.8e\+10 Hz\) = {re.escape(repr(value))}; .*; correct the function"
    with pytest.raises(ValueError, match=f"^{message}$"):
        permittivity_table((named(radio),), [28e9])


def test_a_carrier_outside_the_range_of_a_function() -> None:
    radio = lossy(3e9, 30e9)
    for carrier in (3e9, 30e9):
        assert relative_permittivity(radio, carrier).real == 5.24 and has_permittivity(radio, carrier)
    for carrier in (2.99e9, 77e9):
        assert not has_permittivity(radio, carrier)
        message = (
            f"material 'paint': no permittivity at {carrier / 1e9:g} GHz; its frequency_range_hz is 3-30 GHz; choose"
        )
        with pytest.raises(ValueError, match=message):
            relative_permittivity(radio, carrier, "paint")
    assert replace(radio, frequency_range_hz=[3e9, 30e9]) == radio  # hashable: materials are keys
    assert len({radio, replace(radio, thickness=0.1), replace(radio)}) == 2


def test_radar_sees_a_function_where_it_holds_and_its_table_elsewhere() -> None:
    same, air = RadioMaterial("itu", itu="itu_concrete"), Weather()
    given = [lossy(1e9, 100e9), same, lossy(1e9, 30e9), RadioMaterial("constant", relative_permittivity=5.24)]
    rows = [reflectivity_table([replace(named(radio), nonvisual_base="concrete")], air, 77e9)[0] for radio in given]
    np.testing.assert_array_equal(rows[0], rows[1])
    assert rows[2][0] != rows[1][0] != rows[3][0]
    assert reflectivity_table([named(RadioMaterial.absorber())], air, 77e9)[0][[0, 2]].tolist() == [0.0, 0.0]


def test_an_absorber_reflects_exactly_nothing_and_lets_nothing_through() -> None:
    cosine = np.concatenate([np.cos(np.linspace(0.0, np.pi / 2, 2001)), 10.0 ** -np.arange(1.0, 17.0), [0.0, 1.0]])
    for radio in (RadioMaterial.absorber(), RadioMaterial("itu", itu="itu_vacuum")):
        eta = np.full(len(cosine), relative_permittivity(radio, 28e9))
        given = eta, cosine, np.full(len(cosine), radio.thickness), 28e9
        for coefficient in (*reflection(*given), *transmission(*given)):
            assert (coefficient == 0.0).all()
    almost = reflection(np.full(len(cosine), 1.0 + 1e-6 + 0j), cosine, np.zeros(len(cosine)), 28e9)
    assert (np.abs(almost[0][:-2]) > 0.0).all()


def test_a_slab_of_vacuum_only_turns_the_phase() -> None:
    cosine, thickness, carrier = np.array([1.0, 0.5, 0.1]), np.full(3, 0.123), 28e9
    te, tm = transmission(np.ones(3, complex), cosine, thickness, carrier)
    expected = np.exp(-2j * np.pi * thickness * cosine * carrier / 299792458.0)
    np.testing.assert_allclose([te, tm], [expected] * 2, atol=1e-12)


def test_files_hold_numbers_and_names() -> None:
    names = [field.name for field in fields(RadioMaterial)]
    assert list(FILE_FIELDS) == [name for name in names if name not in ("permittivity", "frequency_range_hz")]
    plain_values = file_values(RadioMaterial("itu", itu="itu_glass", thickness=0.01, scattering=0.3))
    assert plain_values == {
        "model": "itu", "itu": "itu_glass", "relative_permittivity": 1.0, "conductivity": 0.0, "thickness": 0.01,
        "scattering": 0.3, "xpd": 0.0, "scattering_pattern": "lambertian", "alpha_r": 4, "alpha_i": 4,
        "lobe_share": 1.0, "rms_height": 0.0, "layers": [], "medium": "solid",
    }  # fmt: skip
    own = RadioMaterial("function", permittivity=plain, thickness=0.2, scattering=0.3, scattering_pattern=lambertian)
    assert own.holds_function and not RadioMaterial("itu", itu="itu_glass").holds_function
    scene = arrays_from_parts([ground_part(material="paint")], materials={"paint": named(own)})
    config: Any = SimpleNamespace(weathers=("sunny",), sensors=(), channel=ChannelConfig())
    rows = static_rows(scene, config)["materials"]
    assert {name: rows[name] for name in FILE_FIELDS} == {
        "model": ["function"], "itu": [None], "relative_permittivity": [1.0], "conductivity": [0.0],
        "thickness": [0.2], "scattering": [0.3], "xpd": [0.0], "scattering_pattern": ["function"], "alpha_r": [4],
        "alpha_i": [4], "lobe_share": [1.0], "rms_height": [0.0], "layers": [[]], "medium": ["solid"],
    }  # fmt: skip


def test_a_function_goes_to_another_process_by_its_name_only() -> None:
    own = RadioMaterial("function", permittivity=plain, scattering=0.3, scattering_pattern=lambertian)
    assert pickle.loads(pickle.dumps(own)) == own
    with pytest.raises((pickle.PicklingError, AttributeError)):
        pickle.dumps(replace(own, permittivity=lambda f: 4.0))


@pytest.mark.parametrize("name", materials.__all__)
def test_public_names(name: str) -> None:
    assert getattr(materials, name) is not None and name in dir(materials)
    missing: Callable = lambda: materials.gold  # noqa: E731
    with pytest.raises(AttributeError, match="has no attribute 'gold'"):
        missing()
