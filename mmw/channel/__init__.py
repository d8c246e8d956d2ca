"""Radio channel: links, paths, antennas and materials; and what users make of stored paths: arrays, CSI and beams.

The names below are loaded when they are first used, so that `import mmw.channel` stays light.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mmw.channel.antennas.array_response import apply_arrays, plane_wave_error, rotations_from_poses
    from mmw.channel.antennas.arrays import AntennaArray, PlanarArray, ula, upa
    from mmw.channel.antennas.directivity import pattern_directivity, radiated_power
    from mmw.channel.antennas.patterns import PatternTable, register_pattern
    from mmw.channel.antennas.per_element_links import per_element_links
    from mmw.channel.codebook import beam_gains, best_beams, dft_codebook, normalized_gain
    from mmw.channel.path_table import LINK_COLUMNS, PATH_COLUMNS, CarrierPaths, rows_from_paths
    from mmw.channel.path_tracks import PathTracks, tracks_from_paths, tracks_from_table
    from mmw.channel.response import complex_gain, frequency_response, impulse_response, subcarrier_frequencies, taps

__all__ = [
    "LINK_COLUMNS",
    "PATH_COLUMNS",
    "AntennaArray",
    "CarrierPaths",
    "PathTracks",
    "PatternTable",
    "PlanarArray",
    "apply_arrays",
    "beam_gains",
    "best_beams",
    "complex_gain",
    "dft_codebook",
    "frequency_response",
    "impulse_response",
    "normalized_gain",
    "pattern_directivity",
    "per_element_links",
    "plane_wave_error",
    "radiated_power",
    "register_pattern",
    "rotations_from_poses",
    "rows_from_paths",
    "subcarrier_frequencies",
    "taps",
    "tracks_from_paths",
    "tracks_from_table",
    "ula",
    "upa",
]  # fmt: skip

_MODULES = (
    "antennas.patterns", "antennas.arrays", "codebook", "path_table", "antennas.array_response", "response",
    "path_tracks", "antennas.per_element_links", "antennas.directivity",
)  # fmt: skip
"""Modules that define them; each is imported only if none before it has the name."""


def __getattr__(name: str) -> Any:
    for module in _MODULES if name in __all__ else ():
        names = vars(import_module(f"{__name__}.{module}"))
        if name in names:
            return names[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
