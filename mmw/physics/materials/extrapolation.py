"""Give named materials a permittivity at any carrier from 0.5 to 150 GHz, and say where it is not tabulated.

Inside a range of its name a material has the value of that row. Between two ranges relative permittivity and
conductivity run as powers of the frequency from the end of the one to the begin of the other. Beyond the first or the
last range a row of P.2040 goes on with its own exponents, and a model of soil or skin with the values at its end. The
ranges of P.2040 say where was measured and are no hard limits, except for its three grounds, which end at 10 GHz; so
all of this is stated, see `extrapolation_notes`. Outside 0.5 to 150 GHz there are only the ranges.

Source: ITU-R P.2040-4, section 3 and equations 28 and 29, on whose powers of the frequency this rests.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from mmw.core.constants import VACUUM_PERMITTIVITY
from mmw.core.errors import InputError
from mmw.physics.materials.itu_rows import PERMITTIVITY, PREFIX, PermittivityRow, power_law

CARRIERS_GHZ = (0.5, 150.0)
"""Carriers at which every named material has a permittivity [GHz]."""

AIR_MIN_HZ = 1e9
"""Lowest carrier of the Recommendations on air and rain; below it their losses are those here [Hz]."""


@dataclass(frozen=True)
class FoundRow:
    """The row that gives a material its permittivity at a carrier."""

    row: PermittivityRow
    note: str = ""
    """Said where no range of the material has the carrier, such as `extrapolated from 29.5 GHz ...`; else empty."""


def permittivity_row(name: str, carrier_hz: float, used_by: str = "") -> FoundRow:
    """Return the row of a named material that holds a carrier frequency, or what stands for it.

    Args:
        name: Name in the table, with or without the prefix `itu_`.
        carrier_hz: Carrier frequency [Hz].
        used_by: Name of the material, for the error message.

    Raises:
        InputError: If the name has no row at this frequency, and it is outside `CARRIERS_GHZ`.
    """
    rows = PERMITTIVITY[name.removeprefix(PREFIX)]
    for row in rows:
        if row.holds(carrier_hz):
            return FoundRow(row)
    ghz = carrier_hz / 1e9
    low, high = CARRIERS_GHZ
    if not low * (1 - 1e-12) <= ghz <= high * (1 + 1e-12):
        where = f"material {used_by or name!r}" + (f" ({name})" if used_by else "")
        ranges = ", ".join(f"{row.min_ghz:g}-{row.max_ghz:g} GHz" for row in rows)
        raise InputError(
            f"{where}: no permittivity at {ghz:g} GHz; its ranges are {ranges}, and beside them values "
            f"are inter- and extrapolated from {low:g} to {high:g} GHz; choose a carrier inside one of them, another "
            "material, or the model `constant`"
        )
    below = max((row for row in rows if row.max_ghz < ghz), key=lambda row: row.max_ghz, default=None)
    above = min((row for row in rows if row.min_ghz > ghz), key=lambda row: row.min_ghz, default=None)
    if below is not None and above is not None:
        law = _through(below.max_ghz, _parts(below, below.max_ghz), above.min_ghz, _parts(above, above.min_ghz))
        note = f"interpolated between {below.max_ghz:g} and {above.min_ghz:g} GHz, the ends of its rows"
        return FoundRow(PermittivityRow(below.max_ghz, above.min_ghz, law, f"{below.source}; {above.source}"), note)
    row = below or above or rows[0]
    edge, which = (row.max_ghz, "last") if below is not None else (row.min_ghz, "first")
    if row.is_power_law:
        law, how = row.at, f"the exponents of its {which} row"
    else:
        law, how = _through(edge, _parts(row, edge)), "the relative permittivity and conductivity there"
    note = f"extrapolated from {edge:g} GHz with {how}"
    return FoundRow(PermittivityRow(min(edge, ghz), max(edge, ghz), law, row.source), note)


def _parts(row: PermittivityRow, ghz: float) -> tuple[float, float]:
    """Return relative permittivity and conductivity [S/m] of a row at a frequency."""
    value = row.at(ghz * 1e9)
    return value.real, -value.imag * 2.0 * math.pi * ghz * 1e9 * VACUUM_PERMITTIVITY


def _through(
    ghz: float, parts: tuple[float, float], other_ghz: float = 0.0, others: tuple[float, float] | None = None
) -> Callable[[float], complex]:
    """Return the powers of the frequency through the values at two frequencies; constants for those at one."""
    factors = []
    for value, other in zip(parts, others or parts, strict=True):
        is_power = other != value and min(value, other) > 0.0
        exponent = math.log(other / value) / math.log(other_ghz / ghz) if is_power else 0.0
        factors += [value / ghz**exponent, exponent]
    a, b, c, d = factors
    return partial(power_law, a=a, b=b, c=c, d=d)
