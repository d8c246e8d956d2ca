"""Curved surfaces of several materials against integrals over their parts in float64."""

from dataclasses import replace

import numpy as np

from mmw.channel.path_solver.curved_outlines import find_pieces
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.physics.em.interaction import SPECULAR
from mmw.physics.materials.material import RadioMaterial
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.scenes import tube
from tests.oracles import channel as oracle

CARRIERS = (4.9e9, 28e9)
MATERIALS = oracle.radio_materials(
    {"metal": RadioMaterial("itu", itu="itu_pec"), "glass": RadioMaterial("itu", itu="itu_glass")}
)
RADIUS = 2.0
SEAM = 0.2 + 0.25 * np.pi
"""Angle at which one material ends and the other begins [rad]."""


def panel(materials: tuple[str, str]) -> list[MeshPart]:
    """Return a quarter of a tube, of one material up to `SEAM` and of another one from there on."""
    whole = tube(RADIUS, 48, angle=0.5 * np.pi)
    is_first = np.arange(96) % 48 < 24
    parts = zip((is_first, ~is_first), materials, strict=True)
    return [replace(whole, faces=whole.faces[own], material=material) for own, material in parts]


def first_part(tx: np.ndarray, rx: np.ndarray, carrier: float) -> complex:
    """Return the share of the field of the whole tube that its part before `SEAM` reflects.

    By the integral of exp(-jk (s' + s)) over its circle, around the shortest way, with a smooth window.
    """
    turn = np.linspace(-0.75, 0.75, 400_001)

    def way(angle: np.ndarray) -> np.ndarray:
        at = RADIUS * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return np.linalg.norm(tx[:2] - at, axis=1) + np.linalg.norm(rx[:2] - at, axis=1)

    angle = SEAM + turn
    middle = angle[np.argmin(way(angle))]
    length = way(middle + turn)
    wave = np.exp(-2j * np.pi * carrier / SPEED_OF_LIGHT * (length - length.min())) * np.cos(np.pi * turn / 1.5) ** 2
    return complex(wave[middle + turn < SEAM].sum() / wave.sum())


def test_each_material_of_a_curved_panel_reflects_its_part(device: str) -> None:
    """The point of reflection passes a seam of metal and glass: the sum of both, each times its part, without a step.

    The coefficient of the material under the point alone would change by 5 dB at once.
    """
    tx = np.array([25.0 * np.cos(SEAM + 0.4), 25.0 * np.sin(SEAM + 0.4), 20.0])
    turn = SEAM - 0.4 + np.linspace(-0.2, 0.2, 41)
    rx = np.stack([25.0 * np.cos(turn), 25.0 * np.sin(turn), np.full(41, 20.0)], axis=1)
    config = oracle.channel(max_depth=1, finite_surfaces=True, pattern="iso", carriers_hz=CARRIERS)
    levels = []
    for materials in (("metal", "metal"), ("glass", "glass"), ("metal", "glass")):
        arrays = oracle.link_scene(panel(materials), tuple(tx), *(tuple(at) for at in rx), materials=MATERIALS)
        _, paths = oracle.solve(arrays, config, device)
        own = np.flatnonzero(paths.interaction[:, 0] == SPECULAR)
        assert paths.link[own].tolist() == list(range(41))
        levels.append(paths.a["sunny"][own])
        assert len(np.unique(paths.material_id[own])) == len(set(materials))
    for column, carrier in enumerate(CARRIERS):
        metal, glass, both = (level[:, column] for level in levels)
        assert np.abs(20 * np.log10(np.abs(metal / glass))).min() > 3.0
        part = np.array([first_part(tx, at, carrier) for at in rx])
        expected = metal * part + glass * (1.0 - part)
        assert np.abs((both - expected) / metal).max() < 0.045  # the wave of an edge that is too far away to count


def test_pieces_are_of_surfaces_with_several_materials() -> None:
    pieces = find_pieces(np.array([1, -1, 0, 1, 0, 1]), np.array([7, 7, 4, 5, 4, 7]))
    assert pieces.of_surface.tolist() == [1, -1, -1, 0, -1, 1]
    assert pieces.group.tolist() == [1, 1] and pieces.material.tolist() == [5, 7]
    assert len(find_pieces(np.array([-1]), np.array([3])).group) == 0
