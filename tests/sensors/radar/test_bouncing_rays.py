"""Smooth bodies beside the closed forms of physical and geometric optics."""

from pathlib import Path

import numpy as np
import pytest

import mmw
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.errors import InputError
from mmw.core.resources import assets_dir
from mmw.physics.em.surface_response import material_response
from mmw.physics.materials.material import RadioMaterial
from mmw.sensors import radar_cross_section, smooth_cross_section
from mmw.validation.targets import ball, dihedral, plate, trihedral
from tests.fixtures.targets import load_target

SIDE = 0.15
"""Edge of the targets [m]: 5 to 38 wavelengths."""

CARRIERS = (10e9, 28e9, 76.5e9)


def in_decibels(found: float, expected: float) -> float:
    return float(10.0 * np.log10(found / expected))


@pytest.mark.parametrize("carrier_hz", CARRIERS)
@pytest.mark.parametrize("polarization", ["V", "H"])
def test_plate(tmp_path: Path, carrier_hz: float, polarization) -> None:
    """4 pi A^2 / lambda^2 cos^2(t) sinc^2(k a sin(t)): on axis and in the first side lobe.

    Edges are rounded to 1/8 of a wavelength, 2 % of the side at 10 GHz: 0.4 dB on axis, and a shift of the lobe.
    """
    scene, wavelength = load_target(tmp_path, plate(SIDE), "itu_pec"), SPEED_OF_LIGHT / carrier_hz
    lobe = float(np.arcsin(1.43 * wavelength / (2.0 * SIDE)))
    found = smooth_cross_section(
        scene, [0.0, lobe], carrier_hz=carrier_hz, polarization=polarization, max_bounces=1, tubes_per_wavelength=16
    )
    on_axis = 4.0 * np.pi * SIDE**4 / wavelength**2
    assert in_decibels(found[0], on_axis) == pytest.approx(0.0, abs=0.2)
    aslant = on_axis * np.cos(lobe) ** 2 * np.sinc(2.0 * SIDE * np.sin(lobe) / wavelength) ** 2
    assert in_decibels(found[1], aslant) == pytest.approx(0.0, abs=0.4)


@pytest.mark.parametrize("carrier_hz", CARRIERS)
@pytest.mark.parametrize("polarization", ["V", "H"])
@pytest.mark.parametrize(
    ("corner", "planes", "factor"), [(dihedral, 2, 8.0 * np.pi), (trihedral, 3, 4.0 * np.pi / 3.0)]
)
def test_corner_reflectors(tmp_path: Path, carrier_hz: float, polarization, corner, planes: int, factor: float) -> None:
    """Two squares 8 pi a^4 / lambda^2; three triangles 4 pi a^4 / 3 lambda^2, along their axes of symmetry.

    These count waves that return by all planes. Single echoes add up with them, in phase or out of it, and edges are
    rounded to 1/8 of a wavelength: 0.2 dB. Source: G. Ruck et al., Radar Cross Section Handbook, 1970, chapter 8.
    """
    scene, elevation = load_target(tmp_path, corner(SIDE), "itu_pec"), {2: 0.0, 3: np.arctan(np.sqrt(0.5))}[planes]
    single, found = (
        smooth_cross_section(
            scene, [np.pi / 4], elevation_rad=elevation, carrier_hz=carrier_hz, polarization=polarization, max_bounces=n
        )[0]
        for n in (1, planes)
    )
    expected = factor * SIDE**4 * (carrier_hz / SPEED_OF_LIGHT) ** 2
    swing = 20.0 * np.log10(1.0 + np.sqrt(single / expected))
    assert single < 0.01 * expected  # a corner is dark without all of its bounces
    assert in_decibels(found, expected) == pytest.approx(0.0, abs=swing + 0.2)


@pytest.mark.parametrize("polarization", ["V", "H"])
def test_plate_and_ball_between_two_ends(tmp_path: Path, polarization) -> None:
    """A plate as a mirror: 4 pi A^2 cos^2(t) / lambda^2; a ball reflects pi a^2 to every side but its shadow's."""
    flat, round_body = (tmp_path / name for name in ("flat", "round"))
    for folder in (flat, round_body):
        folder.mkdir()
    scene, half = load_target(flat, plate(SIDE), "itu_pec"), 0.5
    options = {"carrier_hz": 28e9, "polarization": polarization, "max_bounces": 1}
    found = smooth_cross_section(scene, [-half], bistatic_rad=2.0 * half, **options)[0]
    expected = 4.0 * np.pi * SIDE**4 * np.cos(half) ** 2 * (28e9 / SPEED_OF_LIGHT) ** 2
    assert in_decibels(found, expected) == pytest.approx(0.0, abs=0.2)
    scene = load_target(round_body, ball(SIDE, 6), "itu_pec")
    for angle in (0.7, 1.6):
        found = smooth_cross_section(scene, [0.3], bistatic_rad=angle, **options)[0]
        assert in_decibels(found, np.pi * SIDE**2) == pytest.approx(0.0, abs=0.5)


@pytest.mark.parametrize("carrier_hz", [10e9, 28e9])
def test_ball(tmp_path: Path, carrier_hz: float) -> None:
    """Pi a^2; the edge of the lit side of physical optics makes it swing by 1 / 2ka, 0.14 dB at ka = 31."""
    scene = load_target(tmp_path, ball(SIDE, 6), "itu_pec")
    found = smooth_cross_section(scene, [0.3], carrier_hz=carrier_hz, max_bounces=1)[0]
    assert in_decibels(found, np.pi * SIDE**2) == pytest.approx(0.0, abs=0.3)


def test_materials_reflect_as_in_the_channel(tmp_path: Path) -> None:
    """A plate seen along its normal has |Gamma|^2 of its material."""
    found = [
        smooth_cross_section(load_target(tmp_path, plate(SIDE), itu), [0.0], carrier_hz=28e9, max_bounces=1)[0]
        for itu in ("itu_pec", "itu_concrete")
    ]
    _, tm = material_response(RadioMaterial("itu", itu="itu_concrete"), 28e9).reflection(np.zeros(1, int), np.ones(1))
    assert found[1] / found[0] == pytest.approx(abs(tm[0]) ** 2, rel=1e-3)


def test_people_as_smooth_skin_have_the_mean_of_the_rough_radar() -> None:
    """At 10 GHz two models that share the mesh alone: phases and polarization here, slopes and powers there.

    Echoes of smooth bodies fluctuate from aspect to aspect; 90 aspects have a standard error of about 1 dB.
    """
    man = mmw.load_scene(assets_dir() / "pedestrians/man/man.usda", device="cpu")
    around = np.radians(np.arange(0.37, 360.0, 4.0))
    smooth = smooth_cross_section(man, around, carrier_hz=10e9, max_bounces=2, tubes_per_wavelength=4.0)
    rough = radar_cross_section(man, around, carrier_hz=10e9)
    assert smooth.std() > 0.5 * smooth.mean() > 0.0 and rough.std() < 0.3 * rough.mean()
    assert in_decibels(smooth.mean(), rough.mean()) == pytest.approx(0.0, abs=2.5)


def test_arguments_are_checked(tmp_path: Path) -> None:
    scene = load_target(tmp_path, plate(SIDE), "itu_pec")
    with pytest.raises(InputError, match="V or H"):
        smooth_cross_section(scene, [0.0], max_bounces=0)
    with pytest.raises(InputError, match="elevation between"):
        smooth_cross_section(scene, [0.0], elevation_rad=np.pi / 2.0)
    with pytest.raises(InputError, match="lower carrier_hz"):
        smooth_cross_section(scene, [0.0], carrier_hz=200e9, tubes_per_wavelength=200.0)
