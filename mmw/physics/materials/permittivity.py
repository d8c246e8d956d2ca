"""Compute the permittivity of materials at carriers: of a named row, of constants, or of a function of frequency."""

import logging
from collections.abc import Iterable
from functools import cache
from numbers import Number

import numpy as np

from mmw.core.errors import InputError
from mmw.core.remember import remembered
from mmw.physics.materials.extrapolation import AIR_MIN_HZ, permittivity_row
from mmw.physics.materials.itu_rows import PERMITTIVITY, PREFIX, complex_permittivity
from mmw.physics.materials.material import Material, PermittivityFunction, RadioMaterial

LOGGER = logging.getLogger(__name__)

MAX_NAMES = 3
"""Materials that a note names."""


def relative_permittivity(radio: RadioMaterial, carrier_hz: float, used_by: str = "") -> complex:
    """Return the complex relative permittivity of a material, for e^{+jwt}; 1 - j inf for a perfect conductor.

    Args:
        radio: The material.
        carrier_hz: Carrier frequency [Hz].
        used_by: Name of the material, for error messages.

    Raises:
        InputError: If the carrier is outside 0.5 to 150 GHz and the ranges of a named row, or outside the range of a
            function, or if a function returns no permittivity of a passive material.

    Source: ITU-R P.2040-4, equations 9, 28 and 29; ITU-R P.527-6 for soils and water.

    Examples:
        >>> concrete = RadioMaterial("itu", itu="itu_concrete")
        >>> [f"{relative_permittivity(concrete, carrier):.2f}" for carrier in (3.5e9, 28e9)]
        ['5.24-0.63j', '5.24-0.40j']
    """
    if radio.permittivity is not None:
        return _of_function(radio.permittivity, radio.frequency_range_hz, carrier_hz, used_by)
    if radio.model == "constant":
        return complex_permittivity(radio.relative_permittivity, radio.conductivity, carrier_hz)
    return permittivity_row(radio.itu, carrier_hz, used_by).row.at(carrier_hz)


def layer_permittivities(radio: RadioMaterial, carrier_hz: float, used_by: str = "") -> list[complex]:
    """Return the complex relative permittivity of the layers in front of a material; 1 for conducting sheets.

    Args:
        radio: The material.
        carrier_hz: Carrier frequency [Hz].
        used_by: Name of the material, for error messages.

    Raises:
        InputError: If a row has no permittivity at the carrier, see `relative_permittivity`.
    """
    return [
        permittivity_row(layer.itu, carrier_hz, used_by).row.at(carrier_hz)
        if layer.itu
        else complex_permittivity(layer.relative_permittivity, layer.conductivity, carrier_hz)
        for layer in radio.layers
    ]


def _of_function(
    function: PermittivityFunction, range_hz: tuple[float, float] | None, carrier_hz: float, used_by: str
) -> complex:
    """Return what a function says at a carrier, checked."""
    where = f"material {used_by!r}" if used_by else "radio material"
    if range_hz is not None and not range_hz[0] <= carrier_hz <= range_hz[1]:
        low, high = (f"{end / 1e9:g}" for end in range_hz)
        raise InputError(
            f"{where}: no permittivity at {carrier_hz / 1e9:g} GHz; its frequency_range_hz is {low}-{high} GHz; "
            "choose a carrier inside it, or another material"
        )
    value = function(float(carrier_hz))
    if isinstance(value, tuple) and len(value) == 2:
        relative, conductivity = (_number(part) for part in value)
        is_real = relative.imag == conductivity.imag == 0.0
        eta = complex_permittivity(relative.real, conductivity.real if is_real else np.nan, carrier_hz)
    else:
        eta = _number(value)
    if not (np.isfinite(eta) and eta.real >= 1.0 and eta.imag <= 0.0):
        raise InputError(
            f"{where}: permittivity({carrier_hz:g} Hz) = {value!r}; a finite complex number with a real part of at "
            "least 1 and, for e^{+jwt}, an imaginary part of at most 0 is needed, or (relative permittivity, "
            "conductivity of at least 0 S/m); correct the function"
        )
    return eta


def _number(value: object) -> complex:
    """Return a number of Python or NumPy as it is, NaN for anything else."""
    array = np.asarray(value if isinstance(value, Number | np.ndarray) else np.nan)
    return complex(array) if array.ndim == 0 and array.dtype.kind in "iufc" else complex(np.nan)


def has_permittivity(radio: RadioMaterial, carrier_hz: float) -> bool:
    """Return whether a material has a permittivity at a carrier [Hz] by its own range, without extrapolation."""
    if radio.model == "itu":
        return any(row.holds(carrier_hz) for row in PERMITTIVITY[radio.itu.removeprefix(PREFIX)])
    low, high = radio.frequency_range_hz or (0.0, np.inf)
    return low <= carrier_hz <= high


def extrapolation_notes(
    materials: Iterable[Material], carriers_hz: Iterable[float], used: Iterable[int] | None = None
) -> list[str]:
    """Return a line for each row and carrier at which the permittivity is not tabulated, and for low carriers.

    Args:
        materials: Materials by id.
        carriers_hz: Carrier frequencies [Hz].
        used: Ids that some face has; None means all.
    """
    by_id, carriers = list(materials), list(carriers_hz)
    ids = range(len(by_id)) if used is None else sorted({int(i) for i in used})
    names: dict[tuple[str, float, str], dict[str, None]] = {}
    for radio, name in ((by_id[k].radio, by_id[k].name) for k in ids):
        for row in dict.fromkeys([radio.itu, *(layer.itu for layer in radio.layers)]):
            for carrier in carriers if row else ():
                if note := permittivity_row(row, carrier, name).note:
                    names.setdefault((row, carrier, note), {})[name] = None
    lines = [f"{_few(found)} ({row}) at {carrier / 1e9:g} GHz: {note}" for (row, carrier, note), found in names.items()]
    return lines + [
        f"air at {carrier / 1e9:g} GHz: losses of 1 GHz, where P.838, P.840 and P.676 begin"
        for carrier in carriers
        if carrier < AIR_MIN_HZ
    ]


def _few(names: Iterable[str]) -> str:
    """Return the first of some names, and how many more there are."""
    found = list(names)
    more = f" and {len(found) - MAX_NAMES} more" if len(found) > MAX_NAMES else ""
    return ", ".join(found[:MAX_NAMES]) + more


def log_extrapolations(
    materials: Iterable[Material], carriers_hz: Iterable[float], used: Iterable[int] | None = None
) -> None:
    """Log what `extrapolation_notes` says, each line once in a process."""
    for line in extrapolation_notes(materials, carriers_hz, used):
        _log_once(line)


@cache
def _log_once(line: str) -> None:
    LOGGER.warning(line)


def permittivity_table(
    materials: tuple[Material, ...], carriers_hz: Iterable[float], used: Iterable[int] | None = None
) -> np.ndarray:
    """Return the permittivity of every material at every carrier.

    Args:
        materials: Materials by id.
        carriers_hz: Carrier frequencies [Hz].
        used: Ids that some face has; the others stay NaN and need no data. None means all.

    Returns:
        Complex relative permittivity, shape [materials, carriers].

    Raises:
        InputError: If a used material has no permittivity at a carrier (see `relative_permittivity`).
    """
    carriers = tuple(float(carrier) for carrier in carriers_hz)
    table = np.full((len(materials), len(carriers)), np.nan + 0j, dtype=np.complex128)
    known = _known_rows(materials, carriers)
    for index in range(len(materials)) if used is None else sorted({int(i) for i in used}):
        if index not in known:
            radio, name = materials[index].radio, materials[index].name
            known[index] = [relative_permittivity(radio, carrier, name) for carrier in carriers]
        table[index] = known[index]
    return table


@remembered(size=64)
def _known_rows(materials: tuple[Material, ...], carriers_hz: tuple[float, ...]) -> dict[int, list[complex]]:
    """Return the permittivities by material that `permittivity_table` found so far; it fills them in."""
    return {}
