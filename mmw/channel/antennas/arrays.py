"""Describe planar antenna arrays: positions, orientation and order of their elements.

Source: element positions and counting as in Sionna RT 2.2 (`PlanarArray`).
"""

from dataclasses import dataclass
from typing import Any, get_args

import numpy as np

from mmw.channel.antennas.patterns import Pattern, PatternName, Polarization, PolarizationModel, slant_angles
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.errors import InputError
from mmw.core.transforms import normalize, quaternion_from_ypr, quaternion_to_matrix


@dataclass(frozen=True)
class PlanarArray:
    """A uniform planar array of equal elements; a single antenna by default.

    Local frame of the array: x is the boresight, elements lie in the y-z plane around the origin, which is the phase
    center. Column j of N is at y = d_h (j - (N - 1) / 2), row i of M at z = d_v ((M - 1) / 2 - i): columns run along
    +y, rows downward. A linear array has one row and lies along y.

    Element e = j M + i: column by column, each from its top. Antenna n = p M N + e: all elements of the first
    polarization, then all of the second.

    Raises:
        InputError: If a count is below 1, a spacing is not above 0, or orientation, pattern or polarization is not one.

    Examples:
        >>> panel = PlanarArray(num_rows=4, num_cols=8, pattern="tr38901", polarization="cross")
        >>> panel.element_count, panel.antenna_count
        (32, 64)
    """

    num_rows: int = 1
    """Elements in a column, M."""
    num_cols: int = 1
    """Elements in a row, N."""
    vertical_spacing: float = 0.5
    """Distance between rows, in wavelengths of the requested carrier."""
    horizontal_spacing: float = 0.5
    """Distance between columns, in wavelengths of the requested carrier."""
    vertical_spacing_m: float | None = None
    """Distance between rows [m], the same at every carrier; used instead of `vertical_spacing` if given."""
    horizontal_spacing_m: float | None = None
    """Distance between columns [m], the same at every carrier; used instead of `horizontal_spacing` if given."""
    pattern: Pattern = "dipole"
    """Element pattern: a name, a `PatternTable` or a function, in the array's frame."""
    polarization: Polarization = "V"
    """Polarization name, or slant angles [rad]."""
    polarization_model: PolarizationModel = "tr38901_2"
    """Polarization model of a slant (see `mmw.channel.antennas.patterns.polarization_components`)."""
    orientation: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0)
    """Array to agent: a quaternion (x, y, z, w), or yaw, pitch, roll [rad]."""

    def __post_init__(self) -> None:
        for name in ("num_rows", "num_cols"):
            count = getattr(self, name)
            if not (np.isfinite(count) and int(count) == count and count >= 1):
                raise InputError(f"antenna array: {name} = {count}; a whole number from 1 on is needed; correct it")
        for name in ("vertical_spacing", "horizontal_spacing", "vertical_spacing_m", "horizontal_spacing_m"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise InputError(f"antenna array: {name} = {value}; a spacing is above 0")
        if len(self.orientation) not in (3, 4) or not np.isfinite(self.orientation).all():
            raise InputError(
                f"antenna array: orientation = {self.orientation}; give a quaternion (x, y, z, w) or yaw, pitch, roll"
            )
        if len(self.orientation) == 4 and not any(self.orientation):
            raise InputError(
                "antenna array: orientation = 0, 0, 0, 0; a rotation is needed; give (0, 0, 0, 1) for none"
            )
        if isinstance(self.pattern, str) and self.pattern not in get_args(PatternName):
            names = ", ".join(get_args(PatternName))
            raise InputError(
                f"antenna array: pattern = {self.pattern!r}; one of {names}, a table or a function is needed"
            )
        if self.polarization_model not in get_args(PolarizationModel):
            names = " or ".join(get_args(PolarizationModel))
            raise InputError(
                f"antenna array: polarization_model = {self.polarization_model!r}; {names} is needed; choose one"
            )
        slant_angles(self.polarization)

    @property
    def element_count(self) -> int:
        """Number of elements, each with all polarizations: M N."""
        return self.num_rows * self.num_cols

    @property
    def polarization_count(self) -> int:
        """Number of polarizations of each element."""
        return len(slant_angles(self.polarization))

    @property
    def antenna_count(self) -> int:
        """Number of antennas (ports): elements times polarizations."""
        return self.element_count * self.polarization_count

    @property
    def rotation(self) -> np.ndarray:
        """Array-to-agent rotation, shape [3, 3]."""
        if len(self.orientation) == 3:
            return quaternion_to_matrix(quaternion_from_ypr(*self.orientation))
        return quaternion_to_matrix(normalize(self.orientation))

    def spacing_m(self, carrier_hz: float) -> tuple[float, float]:
        """Return the distance between rows and the one between columns at a carrier [m]."""
        wavelength = SPEED_OF_LIGHT / carrier_hz
        return (
            self.vertical_spacing * wavelength if self.vertical_spacing_m is None else self.vertical_spacing_m,
            self.horizontal_spacing * wavelength if self.horizontal_spacing_m is None else self.horizontal_spacing_m,
        )

    def element_positions(self, carrier_hz: float) -> np.ndarray:
        """Return the antennas' offsets from the phase center [m], the agent's axes, shape [antennas, 3].

        Antennas of one element and different polarizations are at one place. Without an orientation the agent's axes
        are the array's, and the offsets are Sionna RT's.
        """
        vertical, horizontal = self.spacing_m(carrier_hz)
        row = np.tile(np.arange(self.num_rows), self.num_cols)
        column = np.repeat(np.arange(self.num_cols), self.num_rows)
        local = np.zeros((self.element_count, 3))
        local[:, 1] = horizontal * (column - (self.num_cols - 1) / 2)
        local[:, 2] = vertical * ((self.num_rows - 1) / 2 - row)
        return np.tile(local @ self.rotation.T, (self.polarization_count, 1))

    def aperture_m(self, carrier_hz: float) -> float:
        """Return the largest distance between two elements, the aperture D [m]."""
        vertical, horizontal = self.spacing_m(carrier_hz)
        return float(np.hypot(vertical * (self.num_rows - 1), horizontal * (self.num_cols - 1)))


def ula(count: int, **options: Any) -> PlanarArray:
    """Return a uniform linear array along the agent's y axis; `options` are the fields of `PlanarArray`.

    Examples:
        >>> ula(64, pattern="iso").aperture_m(28e9) > 0.3
        True
    """
    return PlanarArray(num_rows=1, num_cols=count, **options)


def upa(num_rows: int, num_cols: int, **options: Any) -> PlanarArray:
    """Return a uniform planar array across the agent's x axis; `options` are the fields of `PlanarArray`.

    Examples:
        >>> upa(4, 8).element_positions(28e9).shape
        (32, 3)
    """
    return PlanarArray(num_rows=num_rows, num_cols=num_cols, **options)
