"""Radio channel: links, paths, antennas and materials; and what users make of stored paths: arrays, CSI and beams.

The names below are loaded when they are first used, so that `import mmw.channel` stays light.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mmw.channel.antennas.array_response import apply_arrays as apply_arrays
    from mmw.channel.antennas.array_response import plane_wave_error as plane_wave_error
    from mmw.channel.antennas.array_response import rotations_from_poses as rotations_from_poses
    from mmw.channel.antennas.arrays import PlanarArray as PlanarArray
    from mmw.channel.antennas.arrays import ula as ula
    from mmw.channel.antennas.arrays import upa as upa
    from mmw.channel.antennas.patterns import PatternTable as PatternTable
    from mmw.channel.antennas.per_element_links import per_element_links as per_element_links
    from mmw.channel.codebook import beam_gains as beam_gains
    from mmw.channel.codebook import best_beams as best_beams
    from mmw.channel.codebook import dft_codebook as dft_codebook
    from mmw.channel.codebook import normalized_gain as normalized_gain
    from mmw.channel.path_table import LINK_COLUMNS as LINK_COLUMNS
    from mmw.channel.path_table import PATH_COLUMNS as PATH_COLUMNS
    from mmw.channel.path_table import Paths as Paths
    from mmw.channel.path_table import rows_from_paths as rows_from_paths
    from mmw.channel.path_tracks import PathTracks as PathTracks
    from mmw.channel.path_tracks import tracks_from_paths as tracks_from_paths
    from mmw.channel.path_tracks import tracks_from_table as tracks_from_table
    from mmw.channel.response import complex_gain as complex_gain
    from mmw.channel.response import frequency_response as frequency_response
    from mmw.channel.response import impulse_response as impulse_response
    from mmw.channel.response import subcarrier_frequencies as subcarrier_frequencies
    from mmw.channel.response import taps as taps

_HOME = {
    "PatternTable": "antennas.patterns",
    **dict.fromkeys(("plane_wave_error", "rotations_from_poses", "apply_arrays"), "antennas.array_response"),
    **dict.fromkeys(("PlanarArray", "ula", "upa"), "antennas.arrays"),
    **dict.fromkeys(("beam_gains", "best_beams", "dft_codebook", "normalized_gain"), "codebook"),
    **dict.fromkeys(
        ("complex_gain", "frequency_response", "impulse_response", "subcarrier_frequencies", "taps"), "response"
    ),
    "per_element_links": "antennas.per_element_links",
    **dict.fromkeys(("LINK_COLUMNS", "PATH_COLUMNS", "Paths", "rows_from_paths"), "path_table"),
    **dict.fromkeys(("PathTracks", "tracks_from_paths", "tracks_from_table"), "path_tracks"),
}
"""Name -> module of this package that defines it."""


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME])
