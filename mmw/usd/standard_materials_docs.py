"""Generate the page `docs/reference/standard-materials.md`: the materials beyond the paper's, sources, losses."""

from collections.abc import Mapping

import numpy as np

from mmw.physics.em.surface_response import material_response
from mmw.physics.materials.material import RadioMaterial
from mmw.usd.standard_materials import STANDARD, UNCHANGED, StandardMaterial

CARRIERS_HZ = (4.9e9, 28e9)
"""Carriers of the table of losses."""

BAND = 0.15
"""Half of the relative bandwidth over which losses are averaged, which smooths the resonances of panes [-]."""

TR38901_DB: Mapping[str, tuple[str, int, float, float]] = {
    "window_glass": ("standard multi-pane glass, 2 + 0.2 f", 1, 2.0, 0.2),
    "glass_facade": ("IRR glass, 23 + 0.3 f", 1, 23.0, 0.3),
    "concrete_facade": ("concrete, 5 + 4 f", 1, 5.0, 4.0),
    "wood": ("wood, 4.85 + 0.12 f", 2, 4.85, 0.12),
}
"""Material -> name in 3GPP TR 38.901, table 7.4.3-1, faces that a ray meets, a and b of the loss a + b f [dB, GHz]."""


def penetration_loss_db(radio: RadioMaterial, carrier_hz: float, degrees: float = 0.0) -> float:
    """Return the loss of a wave that goes through a material [dB], averaged over both polarizations and 30 % of band.

    Args:
        radio: The material.
        carrier_hz: Carrier frequency [Hz].
        degrees: Angle between ray and normal [deg].
    """
    cosine, index = np.array([np.cos(np.radians(degrees))]), np.zeros(1, dtype=np.int64)
    power = [
        np.mean([np.abs(t[0]) ** 2 for t in material_response(radio, float(hz)).transmission(index, cosine)])
        for hz in carrier_hz * np.linspace(1.0 - BAND, 1.0 + BAND, 201)
    ]
    mean = float(np.mean(power))
    return -10.0 * np.log10(mean) if mean > 0.0 else np.inf


def standard_materials_page() -> str:
    """Return the page as Markdown."""
    lines = [
        "# Materials beyond the paper",
        "",
        "Radio descriptions of the shipped library with `channel.physics: standard` or `full`; `paper` keeps those of "
        "the paper. They hold for materials of the library only, and `materials` of a configuration stands above them. "
        "LiDARs, cameras and radars do not change. Generated from `mmw/usd/standard_materials.py`. What the keys mean: "
        "[Own materials](../guides/materials.md).",
        "",
        "| material | dry | in wet weather | source |",
        "|---|---|---|---|",
    ]
    by_entry: dict[StandardMaterial, list[str]] = {}
    for name, entry in STANDARD.items():
        by_entry.setdefault(entry, []).append(name)
    for entry, names in by_entry.items():
        wet = radio_text(entry.wet) if entry.wet is not None else "as dry"
        lines.append(f"| {_names(names)} | {radio_text(entry.radio)} | {wet} | {entry.source} |")
    lines += ["", "As in the paper's set:", "", "| materials | reason |", "|---|---|"]
    by_reason: dict[str, list[str]] = {}
    for name, reason in UNCHANGED.items():
        by_reason.setdefault(reason, []).append(name)
    lines += [f"| {_names(names)} | {reason} |" for reason, names in by_reason.items()]
    lines += [
        "",
        "## Penetration losses",
        "",
        "At normal incidence, averaged over both polarizations and over 30 % of bandwidth around the carrier (which "
        "smooths the resonances of panes), beside 3GPP TR 38.901, table 7.4.3-1, f in GHz. Doors and planks are closed "
        "bodies with two faces. P.2040's concrete and wood have other slopes over frequency than TR 38.901, so no "
        "thickness fits at both carriers.",
        "",
        "| material | loss at 4.9 GHz | TR 38.901 | loss at 28 GHz | TR 38.901 | TR 38.901 calls it |",
        "|---|---|---|---|---|---|",
    ]
    for name, (text, faces, offset, slope) in TR38901_DB.items():
        cells = [
            f"{value:.1f} dB"
            for hz in CARRIERS_HZ
            for value in (faces * penetration_loss_db(STANDARD[name].radio, hz), offset + slope * hz / 1e9)
        ]
        lines.append(f"| `{name}`{', two faces' if faces > 1 else ''} | {' | '.join(cells)} | {text} |")
    others = [name for name in STANDARD if STANDARD[name].radio.transmits and name not in TR38901_DB]
    for name in others:
        own = [f"{penetration_loss_db(STANDARD[name].radio, hz):.1f} dB" for hz in CARRIERS_HZ]
        lines.append(f"| `{name}` | {own[0]} | | {own[1]} | | |")
    return "\n".join(lines) + "\n"


def radio_text(radio: RadioMaterial) -> str:
    """Return a material as words: layers from the outside in, then its substance and its surface."""
    own = f"{radio.itu or f'constant {radio.relative_permittivity:g} {radio.conductivity:g}'}"
    own += f" {radio.thickness:g}" if radio.thickness else " half-space"
    parts = [" / ".join(f"`{text}`" for text in (*(layer.text for layer in radio.layers), own))]
    if radio.scattering:
        parts.append(f"S {radio.scattering:g}")
    if radio.rms_height:
        parts.append(f"rms height {1e3 * radio.rms_height:g} mm")
    if radio.scatters:
        lobe = f" {radio.alpha_r}" if radio.scattering_pattern == "directive" else ""
        parts.append(f"{radio.scattering_pattern}{lobe}, xpd {radio.xpd:g}")
    return "; ".join(parts)


def _names(names: list[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)
