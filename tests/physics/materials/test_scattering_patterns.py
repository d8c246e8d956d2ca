"""Own scattering patterns: names, integrals over the hemisphere, and functions that are no densities."""

import pickle
import re
from dataclasses import replace

import numpy as np
import pytest
from pxr import Usd

from mmw.config.material_map import MaterialEntry
from mmw.physics.em.scattering import scattering_pattern
from mmw.physics.materials.material import RadioMaterial, file_values
from mmw.physics.materials.scattering_patterns import (
    LOBES,
    PATTERNS,
    ScatteringFunction,
    check_scattering_pattern,
    register_scattering_pattern,
    scattering_pattern_names,
)
from mmw.usd.material_entries import mapped_radio, unknown_names
from mmw.usd.material_library import MaterialSpec
from mmw.usd.materials import read_material, resolve_material
from mmw.worlds.materials.library import write_material
from tests.fixtures.radio_materials import lambertian


@pytest.fixture(autouse=True)
def forget(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forget the names that a test registers."""
    monkeypatch.setattr(PATTERNS, "_added", {})


def lobe(exponent: int, scale: float = 1.0) -> ScatteringFunction:
    """Return a lobe around the normal, normalized by its closed form: cos^n integrates to 2 pi / (n + 1)."""
    return lambda k_in, k_out, normal: (
        scale * (exponent + 1) / (2 * np.pi) * np.maximum(np.sum(k_out * normal, axis=1), 0.0) ** exponent
    )


def directions(count: int = 200) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return incoming, scattered and normal directions; a quarter of the scattered ones lie behind the surface."""
    rng = np.random.default_rng(2)
    k_in, k_out, normal = (v / np.linalg.norm(v, axis=1)[:, None] for v in rng.normal(size=(3, count, 3)))
    k_in *= -np.sign(np.sum(k_in * normal, axis=1))[:, None]
    k_out[count // 4 :] *= np.sign(np.sum(k_out * normal, axis=1))[count // 4 :, None]
    return k_in, k_out, normal


@pytest.mark.parametrize("exponent", [1, 2, 7, 100, 500])
def test_densities_of_closed_form_are_taken(exponent: int) -> None:
    radio = RadioMaterial("constant", scattering=0.3, scattering_pattern=lobe(exponent))
    k_in, k_out, normal = directions()
    cosine = np.maximum(np.sum(k_out * normal, axis=1), 0.0)
    expected = (exponent + 1) / (2 * np.pi) * cosine**exponent
    value = scattering_pattern(radio, k_in, k_out, normal)
    np.testing.assert_allclose(value, expected, rtol=1e-13)
    assert (value == 0.0).any() and (value > 0.0).any()


@pytest.mark.parametrize("name", LOBES)
def test_patterns_of_mmw_pass_as_functions(name: str) -> None:
    radio = RadioMaterial("constant", scattering_pattern=name, alpha_r=30, alpha_i=12, lobe_share=0.4)

    def own(k_in: np.ndarray, k_out: np.ndarray, normal: np.ndarray) -> np.ndarray:
        return scattering_pattern(radio, k_in, k_out, normal)

    other = RadioMaterial("constant", scattering_pattern=own)
    np.testing.assert_array_equal(scattering_pattern(other, *directions()), scattering_pattern(radio, *directions()))


def test_values_behind_the_surface_do_not_count() -> None:
    radio = RadioMaterial("constant", scattering_pattern=lambda k_in, k_out, normal: np.full(len(k_in), 0.5 / np.pi))
    value, (_, k_out, normal) = scattering_pattern(radio, *directions()), directions()
    np.testing.assert_array_equal(value > 0.0, np.sum(k_out * normal, axis=1) > 0.0)


def level_only(k_in: np.ndarray, k_out: np.ndarray, normal: np.ndarray) -> np.ndarray:
    return np.maximum(k_out[:, 2], 0.0) / np.pi


def steep_only(k_in: np.ndarray, k_out: np.ndarray, normal: np.ndarray) -> np.ndarray:
    return np.abs(np.sum(k_in * normal, axis=1)) * lambertian(k_in, k_out, normal)


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lobe(3, 1.05), r"over the hemisphere is 1\.05 at 0 degrees of incidence; 1 within 0\.01 is needed"),
        (lobe(3, 0.98), r"integral over the hemisphere is 0\.98 at 0 degrees"),
        (level_only, r"level_only: its integral over the hemisphere is 0\.8\d+ at 30 degrees"),
        (steep_only, r"steep_only: its integral over the hemisphere is 0\.866 at 30 degrees"),
        (lambda k_in, k_out, normal: -lambertian(k_in, k_out, normal), "returned -.*; finite densities of at least 0"),
        (lambda k_in, k_out, normal: np.full(len(k_in), np.nan), "returned nan; finite densities"),
        (lambda k_in, k_out, normal: np.full(len(k_in), np.inf), "returned inf; finite densities"),
        (lambda k_in, k_out, normal: 0.5 / np.pi, r"float64 of shape \(\) for \d+ directions; one real density"),
        (lambda k_in, k_out, normal: k_out, r"of shape \(\d+, 3\) for"),
        (lambda k_in, k_out, normal: 1j * k_out[:, 0], "returned complex128"),
        (lambda k_in, k_out, normal: None, r"returned object of shape \(\)"),
    ],
)  # fmt: skip
def test_functions_that_are_no_densities(function: ScatteringFunction, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        RadioMaterial("constant", scattering_pattern=function)
    with pytest.raises(ValueError, match="scattering pattern mine: "):
        register_scattering_pattern("mine", function)
    assert "mine" not in PATTERNS


def test_a_registered_name_is_a_pattern_everywhere() -> None:
    assert register_scattering_pattern("mine", lambertian) is lambertian
    assert scattering_pattern_names() == (*LOBES, "mine")
    radio = RadioMaterial("constant", scattering=0.3, scattering_pattern="mine")
    np.testing.assert_allclose(
        scattering_pattern(radio, *directions()),
        scattering_pattern(replace(radio, scattering_pattern="lambertian"), *directions()),
        rtol=1e-14,
    )
    assert not radio.holds_function and file_values(radio)["scattering_pattern"] == "mine"
    stage = Usd.Stage.CreateInMemory()
    prim = write_material(stage, "/Wall", MaterialSpec(radio, "brick", (0.5, 0.5, 0.5), 0.5)).GetPrim()
    assert read_material(stage, resolve_material("", prim)).radio.scattering_pattern == "mine"
    entry = MaterialEntry(radio="itu_brick", scattering=0.3, scattering_pattern="mine")
    assert unknown_names("map", entry) == []
    assert mapped_radio(entry, None) == RadioMaterial("itu", "itu_brick", scattering=0.3, scattering_pattern="mine")


def test_unknown_names_list_those_of_mmw_and_of_users() -> None:
    register_scattering_pattern("mine", lambertian)
    known = "one of lambertian, directive, backscattering, mine is needed"
    with pytest.raises(ValueError, match=re.escape(known)):
        RadioMaterial("constant", scattering_pattern="other")
    entry = MaterialEntry(radio="itu_brick", scattering_pattern="other")
    assert unknown_names("map", entry) == [
        "map: scattering_pattern = 'other' is unknown; use one of backscattering, directive, lambertian, mine"
    ]
    stage = Usd.Stage.CreateInMemory()
    prim = write_material(stage, "/Wall", MaterialSpec(RadioMaterial("constant"), "brick", (0.5,) * 3, 0.5)).GetPrim()
    prim.GetAttribute("mmw:radio:scatteringPattern").Set("other")
    with pytest.raises(ValueError, match=f"^/Wall: mmw:radio:scatteringPattern = 'other'; {re.escape(known)}"):
        read_material(stage, resolve_material("", prim))


@pytest.mark.parametrize(
    ("name", "message"),
    [("lambertian", "'lambertian': is one of mmw"), ("mine", r"'mine': is registered by register\(\) already")],
)
def test_taken_names(name: str, message: str) -> None:
    register_scattering_pattern("mine", lambertian)
    with pytest.raises(ValueError, match=message):
        register_scattering_pattern(name, lambertian)


def test_a_pattern_is_a_function() -> None:
    with pytest.raises(ValueError, match="is a float; a Callable is needed"):
        register_scattering_pattern("mine", 0.3)  # pyright: ignore[reportArgumentType]
    check_scattering_pattern("mine", lambertian)


def test_another_process_that_does_not_know_the_name_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    register_scattering_pattern("mine", lambertian)
    sent = pickle.dumps(RadioMaterial("constant", scattering=0.3, scattering_pattern="mine"))
    monkeypatch.setattr(PATTERNS, "_added", {})
    with pytest.raises(ValueError, match=r"mine: is not known in this process; known are lambertian, .*entry point"):
        scattering_pattern(pickle.loads(sent), *directions())


def test_usd_holds_no_function() -> None:
    radio = RadioMaterial("constant", scattering_pattern=lambertian)
    for own in (radio, RadioMaterial("function", permittivity=lambda f: 4.0)):
        with pytest.raises(ValueError, match="/Wall: its permittivity or scattering pattern is a function, which USD"):
            write_material(Usd.Stage.CreateInMemory(), "/Wall", MaterialSpec(own, "brick", (0.5, 0.5, 0.5), 0.5))
