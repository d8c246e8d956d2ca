"""Describe antenna arrays: positions, orientation and order of their elements.

Source: element positions and counting of planar ones as in Sionna RT 2.2 (`PlanarArray`).
"""

import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike

from mmw.channel.antennas.patterns import PATTERNS, Pattern, Polarization, PolarizationModel, slant_angles
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.errors import InputError
from mmw.core.transforms import normalize, quaternion_from_ypr, quaternion_to_matrix


@dataclass(frozen=True, kw_only=True)
class ElementArray(ABC):
    """Equal elements at several places: what planar arrays and those of any other shape share.

    Antenna n = p E + e: all E elements of the first polarization, then all of the second.
    """

    pattern: Pattern = "dipole"
    """Element pattern: a name, a `PatternTable` or a function, in the array's frame."""
    polarization: Polarization = "V"
    """Polarization name, or slant angles [rad]."""
    polarization_model: PolarizationModel = "tr38901_2"
    """Polarization model of a slant (see `mmw.channel.antennas.patterns.antenna_field`)."""
    orientation: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0)
    """Array to agent: a quaternion (x, y, z, w), or yaw, pitch, roll [rad]."""

    def __post_init__(self) -> None:
        if len(self.orientation) not in (3, 4) or not np.isfinite(self.orientation).all():
            raise InputError(
                f"antenna array: orientation = {self.orientation}; give a quaternion (x, y, z, w) or yaw, pitch, roll"
            )
        if len(self.orientation) == 4 and not any(self.orientation):
            raise InputError(
                "antenna array: orientation = 0, 0, 0, 0; a rotation is needed; give (0, 0, 0, 1) for none"
            )
        if not (self.pattern in PATTERNS if isinstance(self.pattern, str) else callable(self.pattern)):
            raise InputError(
                f"antenna array: pattern = {self.pattern!r}; one of {', '.join(PATTERNS)}, a table or a function is "
                "needed"
            )
        if self.polarization_model not in get_args(PolarizationModel):
            names = " or ".join(get_args(PolarizationModel))
            raise InputError(
                f"antenna array: polarization_model = {self.polarization_model!r}; {names} is needed; choose one"
            )
        slant_angles(self.polarization)

    @property
    @abstractmethod
    def element_count(self) -> int:
        """Number of elements, each with all polarizations."""

    @abstractmethod
    def local_positions(self, carrier_hz: float) -> np.ndarray:
        """Return the elements' offsets from the phase center [m], the array's axes, shape [elements, 3]."""

    @abstractmethod
    def aperture_m(self, carrier_hz: float) -> float:
        """Return the largest distance between two elements, the aperture D [m]."""

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

    def element_positions(self, carrier_hz: float) -> np.ndarray:
        """Return the antennas' offsets from the phase center [m], the agent's axes, shape [antennas, 3].

        Antennas of one element and different polarizations are at one place. Without an orientation the agent's axes
        are the array's, and the offsets of a planar array are Sionna RT's.
        """
        return np.tile(self.local_positions(carrier_hz) @ self.rotation.T, (self.polarization_count, 1))


@dataclass(frozen=True)
class PlanarArray(ElementArray):
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

    def __post_init__(self) -> None:
        for name in ("num_rows", "num_cols"):
            count = getattr(self, name)
            if not (np.isfinite(count) and int(count) == count and count >= 1):
                raise InputError(f"antenna array: {name} = {count}; a whole number from 1 on is needed; correct it")
        for name in ("vertical_spacing", "horizontal_spacing", "vertical_spacing_m", "horizontal_spacing_m"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise InputError(f"antenna array: {name} = {value}; a spacing is above 0")
        super().__post_init__()

    @property
    def element_count(self) -> int:
        return self.num_rows * self.num_cols

    def spacing_m(self, carrier_hz: float) -> tuple[float, float]:
        """Return the distance between rows and the one between columns at a carrier [m]."""
        wavelength = SPEED_OF_LIGHT / carrier_hz
        return (
            self.vertical_spacing * wavelength if self.vertical_spacing_m is None else self.vertical_spacing_m,
            self.horizontal_spacing * wavelength if self.horizontal_spacing_m is None else self.horizontal_spacing_m,
        )

    def local_positions(self, carrier_hz: float) -> np.ndarray:
        vertical, horizontal = self.spacing_m(carrier_hz)
        row = np.tile(np.arange(self.num_rows), self.num_cols)
        column = np.repeat(np.arange(self.num_cols), self.num_rows)
        local = np.zeros((self.element_count, 3))
        local[:, 1] = horizontal * (column - (self.num_cols - 1) / 2)
        local[:, 2] = vertical * ((self.num_rows - 1) / 2 - row)
        return local

    def aperture_m(self, carrier_hz: float) -> float:
        vertical, horizontal = self.spacing_m(carrier_hz)
        return float(np.hypot(vertical * (self.num_rows - 1), horizontal * (self.num_cols - 1)))


@dataclass(frozen=True)
class AntennaArray(ElementArray):
    """An array of equal elements at any places: circular, cylindrical, sparse, measured.

    Element e is row e of the positions; antennas count as in `ElementArray`. The origin of the array's frame is the
    phase center, which every link is traced between.

    Raises:
        InputError: If there is no element, positions are not finite or given twice, or orientation, pattern or
            polarization is not one.
    """

    positions: ArrayLike | None = None
    """Offsets of the elements from the phase center, in wavelengths of the requested carrier, array's axes, shape
    [elements, 3]; kept as tuples of numbers."""
    positions_m: ArrayLike | None = None
    """The same in meters, which hold at every carrier; one of the two is given."""

    def __post_init__(self) -> None:
        if (self.positions is None) == (self.positions_m is None):
            raise InputError(
                "antenna array: positions and positions_m are both given or both missing; give one: wavelengths or m"
            )
        name = "positions" if self.positions_m is None else "positions_m"
        try:
            places = np.asarray(getattr(self, name), dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError(f"antenna array: {name} are no numbers of shape [elements, 3]; correct them") from None
        if places.size == 0:
            raise InputError(f"antenna array: {name} hold no element; at least one is needed; add it")
        if places.ndim != 2 or places.shape[1] != 3 or not np.isfinite(places).all():
            raise InputError(
                f"antenna array: {name} of shape {places.shape}; finite numbers of shape [elements, 3] are needed; "
                "correct them"
            )
        object.__setattr__(self, name, tuple(map(tuple, places.tolist())))
        super().__post_init__()

    @property
    def element_count(self) -> int:
        return len(self._places)

    @property
    def _places(self) -> np.ndarray:
        return np.array(self.positions if self.positions_m is None else self.positions_m)

    def local_positions(self, carrier_hz: float) -> np.ndarray:
        return self._places * (SPEED_OF_LIGHT / carrier_hz if self.positions_m is None else 1.0)

    def aperture_m(self, carrier_hz: float) -> float:
        places = self.local_positions(carrier_hz)
        return float(max(np.linalg.norm(places - place, axis=1).max() for place in places))


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


ROW_KEYS = ("pattern", "polarization", "num_rows", "num_cols", "vertical_spacing", "horizontal_spacing")
"""Fields of `PlanarArray` that a row of table `sensors` has in `params`."""


def array_from_row(row: Mapping[str, Any]) -> PlanarArray:
    """Return the array of an antenna of a dataset, turned on its agent as its mount is.

    Args:
        row: Row of table `sensors` of type `antenna`: at least `type`, `params` and qx to qw.

    Raises:
        InputError: If the row is of another type of sensor.

    Examples:
        >>> import mmw
        >>> rows = mmw.open_dataset("out/quickstart").read("sensors", agent="rsu_1", sensor="antenna").to_pylist()
        >>> array_from_row(rows[0]).pattern
        'dipole'
    """
    if row["type"] != "antenna":
        raise InputError(f"array_from_row: type = {row['type']!r}; a row of an antenna is needed; give one")
    params = json.loads(row["params"])
    turn = tuple(float(row[name]) for name in ("qx", "qy", "qz", "qw"))
    return PlanarArray(**{name: params[name] for name in ROW_KEYS}, orientation=turn)
