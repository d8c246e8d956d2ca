"""Radio channel: links, paths, antennas, radio maps; and what users make of stored paths: arrays, CSI and beams.

The names below are loaded when they are first used, so that `import mmw.channel` stays light.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mmw.channel.antennas.array_response import apply_arrays, plane_wave_error, rotations_from_poses
    from mmw.channel.antennas.arrays import AntennaArray, PlanarArray, array_from_row, ula, upa
    from mmw.channel.antennas.directivity import pattern_directivity, radiated_power
    from mmw.channel.antennas.patterns import PatternTable, register_pattern
    from mmw.channel.antennas.per_element_links import per_element_links
    from mmw.channel.cir_generator import CirGenerator
    from mmw.channel.codebook import beam_gains, best_beams, dft_codebook, normalized_gain
    from mmw.channel.path_solver.path_solver import PathSolver
    from mmw.channel.path_table import LINK_COLUMNS, PATH_COLUMNS, CarrierPaths, rows_from_paths
    from mmw.channel.path_tracks import PathTracks, tracks_from_paths, tracks_from_table
    from mmw.channel.radio_map.measurement_surface import MeasurementSurface, mesh_surface, plane_grid, road_grid
    from mmw.channel.radio_map.radio_map import RadioMap
    from mmw.channel.radio_map.radio_map_solver import RadioMapSolver
    from mmw.channel.response import complex_gain, frequency_response, impulse_response, subcarrier_frequencies, taps
    from mmw.channel.scene_paths import Paths

_HOME = {
    "antennas.array_response": ("apply_arrays", "plane_wave_error", "rotations_from_poses"),
    "antennas.arrays": ("AntennaArray", "PlanarArray", "array_from_row", "ula", "upa"),
    "antennas.directivity": ("pattern_directivity", "radiated_power"),
    "antennas.patterns": ("PatternTable", "register_pattern"),
    "antennas.per_element_links": ("per_element_links",),
    "cir_generator": ("CirGenerator",),
    "codebook": ("beam_gains", "best_beams", "dft_codebook", "normalized_gain"),
    "path_solver.path_solver": ("PathSolver",),
    "path_table": ("LINK_COLUMNS", "PATH_COLUMNS", "CarrierPaths", "rows_from_paths"),
    "path_tracks": ("PathTracks", "tracks_from_paths", "tracks_from_table"),
    "radio_map.measurement_surface": ("MeasurementSurface", "mesh_surface", "plane_grid", "road_grid"),
    "radio_map.radio_map": ("RadioMap",),
    "radio_map.radio_map_solver": ("RadioMapSolver",),
    "response": ("complex_gain", "frequency_response", "impulse_response", "subcarrier_frequencies", "taps"),
    "scene_paths": ("Paths",),
}
"""Module -> public names that it defines."""

_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "LINK_COLUMNS", "PATH_COLUMNS", "AntennaArray", "CarrierPaths", "CirGenerator", "MeasurementSurface",
    "PathSolver", "PathTracks", "Paths", "PatternTable", "PlanarArray", "RadioMap", "RadioMapSolver", "apply_arrays",
    "array_from_row", "beam_gains", "best_beams", "complex_gain", "dft_codebook", "frequency_response",
    "impulse_response", "mesh_surface", "normalized_gain", "pattern_directivity", "per_element_links", "plane_grid",
    "plane_wave_error", "radiated_power", "register_pattern", "road_grid", "rotations_from_poses", "rows_from_paths",
    "subcarrier_frequencies", "taps", "tracks_from_paths", "tracks_from_table", "ula", "upa",
]  # fmt: skip


if not TYPE_CHECKING:  # checkers of types would take any name as there

    def __getattr__(name: str) -> Any:
        if name in _MODULE_OF:
            return getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
