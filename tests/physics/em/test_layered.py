"""Stacks of layers and sheets: against all boundary conditions solved at once, one slab, closed forms, and energy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmw.physics.em.fresnel import reflection, transmission
from mmw.physics.em.layered import FREE_SPACE_OHM, StackLayer, stack_coefficients
from mmw.physics.em.surface_response import SurfaceResponse, material_response
from mmw.physics.materials.layers import Layer
from mmw.physics.materials.material import RadioMaterial
from mmw.physics.materials.permittivity import relative_permittivity
from tests.oracles.layers import Sheet, Slab, Solution, solve_stack

CARRIERS_HZ = (0.9e9, 4.9e9, 28e9, 77e9)
COSINES = np.cos(np.radians([0.0, 20.0, 45.0, 60.0, 75.0, 85.0, 89.0]))
GLASS = RadioMaterial("itu", itu="itu_glass")


def solutions(layers: list[StackLayer], cosine: float, carrier_hz: float) -> list[Solution]:
    """Return the oracle's TE and TM solutions."""
    stack = [
        Sheet(layer.sheet_resistance) if layer.sheet_resistance else Slab(layer.permittivity, layer.thickness)
        for layer in layers
    ]
    return [solve_stack(stack, cosine, carrier_hz, is_te=is_te) for is_te in (True, False)]


def glazing(coat_ohm: float = 0.0, carrier_hz: float = 28e9) -> list[StackLayer]:
    """Return 4 mm of glass, an optional coat on its inner side, 16 mm of air, 4 mm of glass."""
    pane = StackLayer(relative_permittivity(GLASS, carrier_hz), 0.004)
    coat = [StackLayer(sheet_resistance=coat_ohm)] if coat_ohm else []
    return [pane, *coat, StackLayer(1.0 + 0j, 0.016), pane]


def layer_strategy() -> st.SearchStrategy[StackLayer]:
    slab = st.builds(
        StackLayer,
        permittivity=st.builds(complex, st.floats(1.0, 12.0), st.floats(-4.0, 0.0)),
        thickness=st.floats(1e-4, 0.02),
    )
    return slab | st.builds(StackLayer, sheet_resistance=st.floats(1.0, 1e4))


@settings(max_examples=150, deadline=None, derandomize=True)
@given(
    layers=st.lists(layer_strategy(), min_size=1, max_size=5), is_open=st.booleans(),
    degrees=st.floats(0.0, 89.0), carrier_hz=st.sampled_from(CARRIERS_HZ),
)  # fmt: skip
def test_any_stack_fulfills_all_boundary_conditions_and_keeps_energy(
    layers: list[StackLayer], is_open: bool, degrees: float, carrier_hz: float
) -> None:
    layers = [*layers, StackLayer(3.0 - 0.2j, 0.01 if is_open else 0.0)]
    cosine = float(np.cos(np.radians(degrees)))
    found = stack_coefficients(layers, np.array([cosine]), carrier_hz)
    te, tm = solutions(layers, cosine, carrier_hz)
    for r, t, wanted in ((found.r_te, found.t_te, te), (found.r_tm, found.t_tm, tm)):
        np.testing.assert_allclose(r[0], wanted.reflected, atol=1e-9)
        power = abs(r[0]) ** 2
        assert power <= 1.0 + 1e-12
        if is_open:
            np.testing.assert_allclose(t[0], wanted.transmitted, atol=1e-9)
            np.testing.assert_allclose(power + abs(t[0]) ** 2 + wanted.absorbed, 1.0, atol=1e-8)
            np.testing.assert_allclose(wanted.gone, abs(t[0]) ** 2, atol=1e-9)
        else:
            assert t[0] == 0.0
            np.testing.assert_allclose(power + wanted.gone + wanted.absorbed, 1.0, atol=1e-8)


@pytest.mark.parametrize("carrier_hz", CARRIERS_HZ)
@pytest.mark.parametrize("thickness", [0.0, 1e-5, 0.006, 0.2])
@pytest.mark.parametrize("row", ["itu_glass", "itu_concrete", "itu_wood", "itu_metal", "itu_pec"])
def test_one_layer_is_the_slab_of_fresnel(row: str, thickness: float, carrier_hz: float) -> None:
    eta = relative_permittivity(RadioMaterial("itu", itu=row), carrier_hz)
    found = stack_coefficients([StackLayer(eta, thickness)], COSINES, carrier_hz)
    given = np.full(len(COSINES), eta), COSINES, np.full(len(COSINES), thickness), carrier_hz
    for own, wanted in zip(
        (found.r_te, found.r_tm, found.t_te, found.t_tm), (*reflection(*given), *transmission(*given)), strict=True
    ):
        np.testing.assert_allclose(own, wanted, atol=1e-12)


def test_a_divided_layer_is_the_whole_one_and_air_only_turns_the_phase() -> None:
    eta = 5.24 - 0.4j
    whole = stack_coefficients([StackLayer(eta, 0.03)], COSINES, 28e9)
    parts = stack_coefficients([StackLayer(eta, d) for d in (0.011, 0.0005, 0.0185)], COSINES, 28e9)
    air = stack_coefficients([StackLayer(thickness=0.02), StackLayer(eta, 0.03)], COSINES, 28e9)
    trip = np.exp(-2j * np.pi * 28e9 / 299_792_458.0 * 0.02 * COSINES)
    for name in ("r_te", "r_tm", "t_te", "t_tm"):
        np.testing.assert_allclose(getattr(parts, name), getattr(whole, name), atol=1e-12)
        turn = trip**2 if name.startswith("r") else trip
        np.testing.assert_allclose(getattr(air, name), getattr(whole, name) * turn, atol=1e-12)


@pytest.mark.parametrize("ohm", [1.0, 5.0, 188.365, 1e4])
def test_a_bare_sheet_has_the_closed_form(ohm: float) -> None:
    """T = 2 / (2 + g) at normal incidence, g over the admittance of the wave: cos for TM, 1 / cos for TE."""
    found = stack_coefficients([StackLayer(sheet_resistance=ohm), StackLayer(1.0 + 0j, 0.01)], COSINES, 4.9e9)
    g = FREE_SPACE_OHM / ohm
    np.testing.assert_allclose(np.abs(found.t_te), 2 / (2 + g / COSINES), rtol=1e-12)
    np.testing.assert_allclose(np.abs(found.t_tm), 2 / (2 + g * COSINES), rtol=1e-12)
    np.testing.assert_allclose(found.r_te, -(g / COSINES) / (2 + g / COSINES), rtol=1e-12)
    np.testing.assert_allclose(found.r_tm, (g * COSINES) / (2 + g * COSINES), rtol=1e-12)


def test_a_sheet_of_little_resistance_is_a_conductor_and_one_of_much_is_nothing() -> None:
    slab = StackLayer(6.3 - 0.1j, 0.004)
    mirror = stack_coefficients([StackLayer(sheet_resistance=1e-9), slab], COSINES, 28e9)
    np.testing.assert_allclose(mirror.r_te, -1.0, atol=1e-9)
    np.testing.assert_allclose(mirror.r_tm, 1.0, atol=1e-7)
    bare, coated = (
        stack_coefficients(layers, COSINES, 28e9) for layers in ([slab], [StackLayer(sheet_resistance=1e15), slab])
    )
    np.testing.assert_allclose(coated.r_te, bare.r_te, atol=1e-9)


def test_a_conductor_behind_layers_lets_nothing_through_and_takes_nothing() -> None:
    layers = [StackLayer(4.0 + 0j, 0.003), StackLayer(complex(1.0, -np.inf), 0.01)]
    found = stack_coefficients(layers, COSINES, 28e9)
    np.testing.assert_allclose(np.abs(found.r_te), 1.0, atol=1e-12)
    np.testing.assert_allclose(np.abs(found.r_tm), 1.0, atol=1e-12)
    assert not found.t_te.any() and not found.t_tm.any()


def test_thick_lossy_layers_stay_finite() -> None:
    found = stack_coefficients([StackLayer(5.0 - 3.0j, 2.0), StackLayer(3.0 - 1.0j, 5.0)], COSINES, 77e9)
    assert np.isfinite([found.r_te, found.r_tm]).all() and not np.abs(found.t_te).any()


def test_coated_glazing_is_far_tighter_than_plain() -> None:
    """A metal film of 5 ohm alone stops 31.8 dB; the panes beside it change that by a few dB."""
    frequencies = np.linspace(2e9, 30e9, 200)
    losses = {}
    for ohm in (0.0, 5.0):
        t = [stack_coefficients(glazing(ohm, f), np.ones(1), f).t_te[0] for f in frequencies]
        losses[ohm] = -10 * np.log10(np.mean(np.abs(t) ** 2))
    assert 1.0 < losses[0.0] < 4.0 and 25.0 < losses[5.0] < 35.0


def test_a_response_mixes_plain_and_layered_materials_row_by_row() -> None:
    plain = RadioMaterial("itu", itu="itu_concrete", thickness=0.2)
    layered = RadioMaterial("itu", itu="itu_glass", thickness=0.004, layers=("itu_glass 0.004", Layer.sheet(5.0)))
    radios = [plain, layered]
    eta = np.array([relative_permittivity(radio, 4.9e9) for radio in radios])
    response = SurfaceResponse(radios, eta, 4.9e9)
    ids = np.array([0, 1, 1, 0, 0, 1, 0])
    for both, one in (("reflection", reflection), ("transmission", transmission)):
        te, tm = getattr(response, both)(ids, COSINES)
        wanted = one(np.full(7, eta[0]), COSINES, np.full(7, 0.2), 4.9e9)
        alone = getattr(material_response(layered, 4.9e9), both)(np.zeros(7, int), COSINES)
        for found, slab, stack in zip((te, tm), wanted, alone, strict=True):
            np.testing.assert_array_equal(found, np.where(ids == 0, slab, stack))


@pytest.mark.parametrize("carrier_hz", CARRIERS_HZ)
def test_roughness_shares_the_reflected_power_between_mirror_and_diffuse(carrier_hz: float) -> None:
    radios = [
        RadioMaterial("itu", itu="itu_concrete", scattering=s, rms_height=h) for s in (0.0, 0.3) for h in (0.0, 1e-3)
    ]
    eta = np.array([relative_permittivity(radio, carrier_hz) for radio in radios])
    response = SurfaceResponse(radios, eta, carrier_hz)
    for index, radio in enumerate(radios):
        ids = np.full(len(COSINES), index)
        mirror, diffuse = response.specular_share(ids, COSINES), response.diffuse_share(ids, COSINES)
        np.testing.assert_allclose(mirror**2 + diffuse**2, 1.0, atol=1e-14)
        phase = 4 * np.pi * radio.rms_height * COSINES * carrier_hz / 299_792_458.0  # 2 k s cos, as in Rayleigh's test
        np.testing.assert_allclose(mirror, np.sqrt(1 - radio.scattering**2) * np.exp(-0.5 * phase**2), rtol=1e-13)
        if radio.rms_height == 0.0:
            assert (diffuse == radio.scattering).all()
        assert (np.diff(mirror) >= 0.0).all()  # the flatter the ray, the smoother the surface
