"""Coefficients of whole paths with materials of users: functions of frequency, own patterns, absorbers."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from mmw.channel.paths import PATH_DIFFRACTION, PATH_DIFFUSE, PATH_LOS, PATH_SPECULAR, PATH_TRANSMISSION, PathSet
from mmw.physics.materials.itu_rows import PERMITTIVITY
from mmw.physics.materials.material import RadioMaterial
from mmw.physics.materials.permittivity import relative_permittivity
from tests.fixtures.radio_materials import lambertian
from tests.fixtures.scenes import box_part, ground_part, quad_part, wall_part
from tests.oracles import channel as oracle

CONCRETE = RadioMaterial("itu", itu="itu_concrete")
PANE = RadioMaterial("itu", itu="itu_glass", thickness=0.006)
ROUGH = RadioMaterial("itu", itu="itu_brick", scattering=0.4, xpd=0.1)
CARRIERS_HZ = (4.9e9, 28e9)


def solve(device: str, ground: RadioMaterial, wall: RadioMaterial, pane: RadioMaterial, **changes) -> PathSet:
    """Return all kinds of paths between a mast and two vehicles before a wall, beside a tower and through a pane."""
    parts = [
        ground_part(40.0, material="ground"),
        wall_part("wall", (-40.0, 12.0), (40.0, 12.0), 20.0, "wall"),
        box_part("Buildings/tower", (4.0, 4.0, 8.0), (0.0, 4.0, 4.0), "wall", "building"),
        quad_part("Props/pane", [(8, -6, 0), (8, 6, 0), (8, 6, 4), (8, -6, 4)], "pane", "static"),
    ]
    radio = oracle.radio_materials({"ground": ground, "wall": wall, "pane": pane})
    scene = oracle.link_scene(parts, (-15, 0, 6), (15, 2, 1.5), (5, -8, 2), materials=radio)
    config = oracle.channel(
        carriers_hz=CARRIERS_HZ, max_depth=2, diffraction=True, refraction=True, diffuse_reflection=True,
        diffuse_samples=2000,
    ).model_copy(update=changes)  # fmt: skip
    return oracle.solve(scene, config, device)[1]


def as_function(radio: RadioMaterial) -> RadioMaterial:
    """Return a material that says itself what its row says."""
    rows = PERMITTIVITY[radio.itu.removeprefix("itu_")]
    return replace(radio, model="function", itu="", permittivity=rows[0].at, frequency_range_hz=(1e9, 40e9))


def as_pair(radio: RadioMaterial) -> RadioMaterial:
    """Return a material that says eps_r and sigma of its row."""

    def pair(frequency_hz: float) -> tuple[float, float]:
        value = relative_permittivity(radio, frequency_hz)
        return value.real, -value.imag * 2 * np.pi * frequency_hz * 8.854_187_8188e-12

    return replace(radio, model="function", itu="", permittivity=pair)


@pytest.mark.parametrize(("make", "tolerance"), [(as_function, 0.0), (as_pair, 1e-12)])
def test_a_function_that_repeats_a_row_gives_its_coefficients(
    make: Callable[[RadioMaterial], RadioMaterial], tolerance: float, device: str
) -> None:
    """Reflections, slabs, wedges and rough surfaces, at both carriers: bit for bit where the function is the row."""
    row = solve(device, CONCRETE, ROUGH, PANE)
    own = solve(device, *(make(radio) for radio in (CONCRETE, ROUGH, PANE)))
    kinds = {PATH_LOS, PATH_SPECULAR, PATH_TRANSMISSION, PATH_DIFFRACTION, PATH_DIFFUSE}
    assert set(row.kind.tolist()) == kinds and len(row) > 500
    np.testing.assert_array_equal(own.path_id, row.path_id)
    for given, wanted in ((own.transfer["sunny"], row.transfer["sunny"]), (own.a["sunny"], row.a["sunny"])):
        np.testing.assert_allclose(given, wanted, rtol=tolerance, atol=tolerance * np.abs(wanted).max())
    assert (np.abs(row.a["sunny"][:, 0] - row.a["sunny"][:, 1]) > 0).any()


def test_an_own_pattern_that_repeats_lambert_gives_its_coefficients(device: str) -> None:
    own = solve(device, CONCRETE, replace(ROUGH, scattering_pattern=lambertian), PANE)
    wanted = solve(device, CONCRETE, ROUGH, PANE)
    assert (wanted.kind == PATH_DIFFUSE).sum() > 300
    np.testing.assert_array_equal(own.path_id, wanted.path_id)
    np.testing.assert_allclose(own.a["sunny"], wanted.a["sunny"], rtol=1e-14)
    other = solve(device, CONCRETE, replace(ROUGH, scattering_pattern="directive"), PANE)
    rough = wanted.kind == PATH_DIFFUSE
    assert (
        np.abs(other.a["sunny"][rough] - wanted.a["sunny"][rough]).max() > 0.1 * np.abs(wanted.a["sunny"][rough]).max()
    )


def test_an_absorber_leaves_paths_of_gain_zero(device: str) -> None:
    """Paths are those of any wall; what it would reflect has gain 0 exactly; all that do not meet it stay."""
    wall = solve(device, CONCRETE, ROUGH, PANE, diffuse_reflection=False)
    bare = solve(device, CONCRETE, RadioMaterial.absorber(), PANE, diffuse_reflection=False)
    np.testing.assert_array_equal(bare.path_id, wall.path_id)
    is_wall = (bare.material_id == 1) & (bare.interaction == oracle.SPECULAR)
    mirrored = is_wall.any(axis=1)
    touches = ((bare.material_id == 1) & (bare.interaction != 0)).any(axis=1)
    assert mirrored.sum() >= 4 and (np.abs(wall.a["sunny"][mirrored]) > 0).any()
    assert (bare.a["sunny"][mirrored] == 0.0).all() and (bare.transfer["sunny"][mirrored] == 0.0).all()
    assert (~touches).sum() >= 4 and PATH_LOS in bare.kind[~touches]
    np.testing.assert_array_equal(bare.a["sunny"][~touches], wall.a["sunny"][~touches])


def test_an_edge_of_an_absorber_is_that_of_an_opaque_screen(device: str) -> None:
    """Its faces reflect nothing, so both polarizations diffract alike; at a conductor they do not."""
    soft = solve(device, CONCRETE, RadioMaterial.absorber(), PANE, max_depth=1, diffuse_reflection=False)
    hard = solve(device, CONCRETE, RadioMaterial("itu", itu="itu_pec"), PANE, max_depth=1, diffuse_reflection=False)
    edge = soft.kind == PATH_DIFFRACTION
    assert edge.sum() >= 2
    singular = np.linalg.svd(soft.transfer["sunny"][edge], compute_uv=False)
    np.testing.assert_allclose(singular[..., 0], singular[..., 1], rtol=1e-12)
    assert (singular > 0).all()
    split = np.linalg.svd(hard.transfer["sunny"][edge], compute_uv=False)
    assert (split[..., 0] > 1.01 * split[..., 1]).all()


def test_an_absorber_scatters_nothing(device: str) -> None:
    dull = replace(RadioMaterial.absorber(), scattering=0.5)
    paths = solve(device, CONCRETE, dull, PANE)
    rough = ((paths.material_id == 1) & (paths.interaction == oracle.DIFFUSE)).any(axis=1)
    assert rough.sum() > 300 and (paths.a["sunny"][rough] == 0.0).all()


def test_a_carrier_outside_a_function_names_weather_material_and_range(device: str) -> None:
    narrow = replace(as_function(ROUGH), frequency_range_hz=(20e9, 40e9))
    with pytest.raises(
        ValueError,
        match=r"channel\.carriers_hz, weather sunny: material 'wall': no permittivity at 4\.9 GHz; its "
        "frequency_range_hz is 20-40 GHz; choose a carrier inside it",
    ):
        solve(device, CONCRETE, narrow, PANE)


def test_a_wall_in_two_layers_has_the_coefficients_of_one(device: str) -> None:
    """Reflections, transmissions, wedges and rough surfaces all take layers, by one function."""
    whole = solve(device, CONCRETE, replace(ROUGH, thickness=0.1), PANE)
    halves = replace(ROUGH, thickness=0.06, layers=("itu_brick 0.03", "itu_brick 0.01"))
    parts = solve(device, CONCRETE, halves, replace(PANE, thickness=0.002, layers=("itu_glass 0.004",)))
    kinds = {PATH_LOS, PATH_SPECULAR, PATH_TRANSMISSION, PATH_DIFFRACTION, PATH_DIFFUSE}
    assert set(whole.kind.tolist()) == kinds
    np.testing.assert_array_equal(parts.path_id, whole.path_id)
    scale = np.abs(whole.a["sunny"]).max(axis=1, keepdims=True)
    np.testing.assert_array_less(np.abs(parts.a["sunny"] - whole.a["sunny"]) / scale, 1e-9)
    coated = solve(device, CONCRETE, ROUGH, replace(PANE, layers=("sheet 5",)))
    through, plain = coated.kind == PATH_TRANSMISSION, solve(device, CONCRETE, ROUGH, PANE)
    loss = np.abs(plain.a["sunny"][through]) / np.abs(coated.a["sunny"][through])
    assert through.any() and (loss > 10.0).all()  # a metal film of 5 ohm: at least 20 dB


def test_a_rough_surface_weakens_its_mirror_and_scatters(device: str) -> None:
    """The reflection at the ground falls by exp(-8 (pi s cos / lambda)^2); diffuse paths appear without any S."""
    smooth = solve(device, CONCRETE, CONCRETE, PANE, diffraction=False, max_depth=1)
    rough = solve(device, replace(CONCRETE, rms_height=0.001), CONCRETE, PANE, diffraction=False, max_depth=1)
    assert (smooth.kind == PATH_DIFFUSE).sum() == 0 and (rough.kind == PATH_DIFFUSE).sum() > 100
    own = {int(path): row for row, path in enumerate(rough.path_id)}
    is_down = (smooth.kind == PATH_SPECULAR) & (np.abs(smooth.vertex[:, 0, 2]) < 1e-6)
    assert is_down.any()
    for row in np.nonzero(is_down)[0]:
        ends = np.array([[-15, 0, 6], [15, 2, 1.5], [5, -8, 2]], dtype=float)
        tx, rx = ends[0], ends[1 + int(smooth.link[row])]
        cosine = (tx[2] + rx[2]) / np.linalg.norm(rx * [1, 1, -1] - tx)
        for column, carrier in enumerate(CARRIERS_HZ):
            kept = np.exp(-8 * (np.pi * 0.001 * cosine * carrier / 299_792_458.0) ** 2)
            ratio = np.abs(rough.a["sunny"][own[int(smooth.path_id[row])], column] / smooth.a["sunny"][row, column])
            np.testing.assert_allclose(ratio, kept, rtol=1e-6)
