"""Compute element patterns and polarization: the field vector of an antenna in any direction.

Angles: zenith theta from +z, azimuth phi from +x. The local frame of an antenna is the agent's frame: x forward, y
left, z up; a vertical dipole lies along local z, and turns with the agent's full attitude.

A pattern is a name, a `PatternTable`, or a function of your own (see `pattern_components`); `register_pattern` names
your own ones. Fields are phasors of e^{+jwt}; a complex pattern receives by the transpose of its field, without
conjugation (reciprocity).

Source: patterns and polarization models of 3GPP TR 38.901, section 7.3, and of Sionna RT 2.2, whose amplitudes these
equal.
"""

import csv
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from mmw.core.errors import InputError
from mmw.core.registry import Registry
from mmw.physics.em.vectors import direction_angles

PatternName = Literal["iso", "dipole", "hw_dipole", "tr38901"]
"""Patterns of mmw: `iso`; `dipole`, a short one along z of gain 1.5; `hw_dipole`, half a wavelength long; `tr38901`, a
sector."""
PatternFunction = Callable[[np.ndarray, np.ndarray], Any]
PolarizationName = Literal["V", "H", "VH", "cross"]
Polarization = PolarizationName | float | tuple[float, ...]
PolarizationModel = Literal["tr38901_1", "tr38901_2"]

SLANTS: dict[str, tuple[float, ...]] = {
    "V": (0.0,),
    "H": (np.pi / 2,),
    "VH": (0.0, np.pi / 2),
    "cross": (-np.pi / 4, np.pi / 4),
}
"""Slant angle of each element of a polarization [rad]."""


@dataclass(frozen=True, eq=False)
class PatternTable:
    """A measured or simulated pattern on a grid of directions, interpolated bilinearly.

    The values are field amplitudes: the square root of the gain over an isotropic antenna, real or complex. They are
    interpolated, so the phase of a complex pattern must not turn by more than a fraction of pi between grid points.
    Near the poles theta and phi components turn with phi; give a table whose poles are in quiet directions, or a fine
    grid there.

    Raises:
        InputError: If the grid is not increasing, does not span the sphere, or a value is missing or not finite.

    Examples:
        >>> import numpy as np
        >>> theta, phi = np.radians(np.arange(0, 181, 5)), np.radians(np.arange(0, 360, 5))
        >>> beam = np.exp(-4 * (theta[:, None] - np.pi / 2) ** 2 - np.minimum(phi, 2 * np.pi - phi) ** 2)
        >>> horn = PatternTable(theta, phi, beam)
        >>> c_theta, c_phi = horn(np.pi / 2, 0.0)  # ahead, on the horizon
        >>> float(c_theta), float(c_phi)
        (1.0, 0.0)
    """

    theta: np.ndarray
    """Zenith angles [rad], increasing from 0 to pi, shape [T], at least two."""
    phi: np.ndarray
    """Azimuths [rad], increasing, one turn at most, shape [F]; one azimuth alone is a pattern round the z axis. The
    column that closes the turn (first azimuth + 2 pi) may be there, and must then equal the first one."""
    c_theta: np.ndarray
    """Amplitude of the theta-polarised field, shape [T, F]."""
    c_phi: np.ndarray | None = None
    """Amplitude of the phi-polarised field, shape [T, F]; None is 0."""

    def __post_init__(self) -> None:
        theta, phi = np.asarray(self.theta, dtype=np.float64), np.asarray(self.phi, dtype=np.float64)
        c_theta = np.asarray(self.c_theta)
        c_phi = np.zeros_like(c_theta) if self.c_phi is None else np.asarray(self.c_phi)
        shape = (theta.size, phi.size)
        if theta.ndim != 1 or phi.ndim != 1 or c_theta.shape != shape or c_phi.shape != shape:
            raise InputError(
                f"pattern table: theta {theta.shape}, phi {phi.shape}, c_theta {c_theta.shape}, c_phi {c_phi.shape}; "
                "values need shape [len(theta), len(phi)]"
            )
        for name, values in (("theta", theta), ("phi", phi), ("c_theta", c_theta), ("c_phi", c_phi)):
            if not np.isfinite(values).all():
                raise InputError(f"pattern table: {name} holds values that are not finite; give every grid point")
        if theta.size < 2 or abs(theta[0]) > 1e-6 or abs(theta[-1] - np.pi) > 1e-6 or (np.diff(theta) <= 0).any():
            raise InputError(
                f"pattern table: theta has {theta.size} values from {theta.min(initial=np.inf):g} to "
                f"{theta.max(initial=-np.inf):g}; it must increase from 0 to pi [rad]; nothing is extrapolated"
            )
        turn = 2 * np.pi
        if phi.size == 0 or (np.diff(phi) <= 0).any() or phi[-1] - phi[0] > turn + 1e-6:
            raise InputError(f"pattern table: phi has {phi.size} values; it must increase, over one turn at most [rad]")
        if phi.size > 1 and abs(phi[-1] - phi[0] - turn) <= 1e-6:
            scale = max(np.abs(c_theta).max(), np.abs(c_phi).max())
            for name, values in (("c_theta", c_theta), ("c_phi", c_phi)):
                if np.abs(values[:, -1] - values[:, 0]).max() > 1e-9 * scale:
                    raise InputError(
                        f"pattern table: {name} differs between the first azimuth and the same one a turn later; "
                        "leave one of the two columns out"
                    )
            phi, c_theta, c_phi = phi[:-1], c_theta[:, :-1], c_phi[:, :-1]
        if phi.size > 1 and turn - (phi[-1] - phi[0]) > 1.5 * np.diff(phi).max():
            raise InputError(
                f"pattern table: phi leaves {turn - (phi[-1] - phi[0]):.3g} rad of the turn empty, over 1.5 of its "
                "largest step; give the whole turn, nothing is extrapolated"
            )
        for name, values in (("theta", theta), ("phi", phi), ("c_theta", c_theta), ("c_phi", c_phi)):
            object.__setattr__(self, name, values)

    def __call__(self, theta: np.ndarray, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (C_theta, C_phi) in directions given by zenith and azimuth [rad], shape [...] each."""
        row = np.clip(np.searchsorted(self.theta, theta, side="right") - 1, 0, len(self.theta) - 2)
        v = np.clip((theta - self.theta[row]) / (self.theta[row + 1] - self.theta[row]), 0.0, 1.0)
        around = np.append(self.phi - self.phi[0], 2 * np.pi)
        turned = np.mod(phi - self.phi[0], 2 * np.pi)
        column = np.clip(np.searchsorted(around, turned, side="right") - 1, 0, len(self.phi) - 1)
        u = (turned - around[column]) / (around[column + 1] - around[column])
        after = (column + 1) % len(self.phi)

        def mix(values: np.ndarray) -> np.ndarray:
            upper = (1 - u) * values[row, column] + u * values[row, after]
            lower = (1 - u) * values[row + 1, column] + u * values[row + 1, after]
            return (1 - v) * upper + v * lower

        return mix(self.c_theta), mix(np.asarray(self.c_phi))

    @classmethod
    def read(cls, path: str | Path) -> "PatternTable":
        """Return the table in a file.

        `.npz`: arrays `theta`, `phi`, `c_theta` and, if there is one, `c_phi`, as the fields of this class. `.csv`: one
        direction a row in any order, the full grid, with a header: `theta` and `phi` [rad], or `theta_deg` and
        `phi_deg` [deg]; `c_theta_re`; and, 0 where absent, `c_theta_im`, `c_phi_re`, `c_phi_im`.

        Raises:
            InputError: If the file is of neither kind, or not a table; the message names the file and the row.
        """
        path = Path(path)
        if path.suffix == ".npz":
            with np.load(path) as arrays:
                missing = [name for name in ("theta", "phi", "c_theta") if name not in arrays]
                if missing:
                    raise InputError(f"{path}: arrays {missing} are missing; it needs theta, phi, c_theta")
                values = {name: arrays[name] for name in ("theta", "phi", "c_theta", "c_phi") if name in arrays}
        elif path.suffix == ".csv":
            values = _read_csv(path)
        else:
            raise InputError(f"{path}: a pattern table is a .csv or .npz file; convert it")
        try:
            return cls(**values)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None


Pattern = str | PatternTable | PatternFunction
"""A name in `PATTERNS`, a table or a function."""


def _read_csv(path: Path) -> dict[str, np.ndarray]:
    """Return the fields of a `PatternTable` of a CSV file."""
    with path.open(newline="", encoding="utf-8-sig") as file:
        reader = csv.DictReader(file, skipinitialspace=True)
        names = reader.fieldnames or []
        angles = [name if name in names else f"{name}_deg" for name in ("theta", "phi")]
        missing = [name for name in (*angles, "c_theta_re") if name not in names]
        if missing:
            raise InputError(
                f"{path}, row 1: columns {missing} are missing; the header needs theta, phi (or theta_deg, "
                "phi_deg) and c_theta_re"
            )
        parts = [name for name in ("c_theta_re", "c_theta_im", "c_phi_re", "c_phi_im") if name in names]
        values_at: dict[tuple[float, float], list[float]] = {}
        for row in reader:
            cells = [row[name] for name in (*angles, *parts)]
            try:
                numbers = [float(cell) for cell in cells]
            except (TypeError, ValueError):
                raise InputError(f"{path}, row {reader.line_num}: {cells}; every cell needs a number") from None
            if not all(math.isfinite(number) for number in numbers):
                raise InputError(f"{path}, row {reader.line_num}: {cells}; every number must be finite")
            if (numbers[0], numbers[1]) in values_at:
                raise InputError(f"{path}, row {reader.line_num}: direction {cells[:2]} was there before; give it once")
            values_at[numbers[0], numbers[1]] = numbers[2:]
    grid = [sorted({direction[axis] for direction in values_at}) for axis in range(2)]
    for theta in grid[0]:
        for phi in grid[1]:
            if (theta, phi) not in values_at:
                raise InputError(
                    f"{path}: {angles[0]} = {theta:g}, {angles[1]} = {phi:g} has no row; give the full grid"
                )
    table = np.array([[values_at[theta, phi] for phi in grid[1]] for theta in grid[0]])
    value = {name: table[..., i] for i, name in enumerate(parts)} if values_at else {"c_theta_re": np.zeros((0, 0))}
    fields: dict[str, np.ndarray] = {
        name: np.radians(axis) if angle.endswith("_deg") else np.array(axis)
        for name, angle, axis in zip(("theta", "phi"), angles, grid, strict=True)
    }
    for name in ("c_theta", "c_phi"):
        real, imaginary = value.get(f"{name}_re"), value.get(f"{name}_im")
        if real is not None or imaginary is not None:
            fields[name] = (0.0 if real is None else real) + (0.0 if imaginary is None else 1j * imaginary)
    return fields


def iso(theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Return the amplitude of an isotropic element, 1 in every direction."""
    return _amplitude("iso", theta, phi)


def dipole(theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Return the amplitude of a short dipole along z. Source: C. A. Balanis, Antenna Theory, section 4.2."""
    return _amplitude("dipole", theta, phi)


def hw_dipole(theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Return the amplitude of a dipole of half a wavelength along z. Source: Balanis, section 4.6."""
    return _amplitude("hw_dipole", theta, phi)


def tr38901(theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Return the amplitude of a sector that looks along x. Source: 3GPP TR 38.901, table 7.3-1."""
    return _amplitude("tr38901", theta, phi)


_NUMBERS: dict[str, int] = {name: number for number, name in enumerate(get_args(PatternName))}
"""Numbers of the patterns of mmw in the kernels."""


def _amplitude(name: str, theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Return the amplitude of a pattern of mmw, of the shape of the angles."""
    from mmw.channel.antennas.element_fields import pattern_amplitude  # brings Warp, which datasets are read without

    return pattern_amplitude(_NUMBERS[name], theta, phi)


PATTERNS: Registry[PatternTable | PatternFunction] = Registry(
    "mmw.antenna_patterns",
    "antenna pattern",
    "collections.abc:Callable",
    {name: f"{__name__}:{name}" for name in get_args(PatternName)},
    check=f"{__name__}:check_pattern",
)
"""Patterns by name. Other packages add theirs by the entry point group `mmw.antenna_patterns`."""


def register_pattern(name: str, pattern: PatternTable | PatternFunction) -> PatternTable | PatternFunction:
    """Give an antenna pattern a name for this process, as in `PlanarArray(pattern=name)`, and return the pattern.

    Its power is not normalized: `mmw.channel.radiated_power` tells how much it radiates.

    Args:
        name: A name that is not taken.
        pattern: A `PatternTable` or a function (see `pattern_components`).

    Raises:
        InputError: If the name is taken, or the pattern is none (see `check_pattern`).
    """
    return PATTERNS.register(name, pattern)


def check_pattern(name: str, pattern: PatternTable | PatternFunction) -> None:
    """Evaluate a pattern over the sphere, every 5 degrees, poles included.

    Raises:
        InputError: If a value is no number, not finite, or there is not one a direction.
    """
    theta, phi = np.meshgrid(np.radians(np.arange(0.0, 181.0, 5.0)), np.radians(np.arange(-180.0, 180.0, 5.0)))
    _components(name, pattern, theta.ravel(), phi.ravel())


def slant_angles(polarization: Polarization) -> tuple[float, ...]:
    """Return the slant angle of each polarization of an element [rad]: of a name, or of one or several angles.

    Raises:
        InputError: If the name is not known or an angle is not a finite number.
    """
    if isinstance(polarization, str):
        if polarization not in SLANTS:
            raise InputError(f"polarization = {polarization!r}; use one of {', '.join(SLANTS)}, or slant angles [rad]")
        return SLANTS[polarization]
    angles = tuple(float(angle) for angle in np.atleast_1d(np.asarray(polarization, dtype=np.float64)))
    if not angles or not all(math.isfinite(angle) for angle in angles):
        raise InputError(f"polarization = {polarization!r}; slant angles are finite numbers [rad], at least one")
    return angles


def pattern_components(pattern: Pattern, theta: np.ndarray, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the field amplitudes (C_theta, C_phi) of an element that is not slanted, shape of `theta` each.

    Args:
        pattern: A name in `PATTERNS`; a `PatternTable`; or a function (theta, phi) -> amplitude, real or complex, of a
            vertical element, or -> (C_theta, C_phi). A function takes and returns arrays of one shape, or numbers. An
            amplitude is the square root of the gain.
        theta: Zenith in the antenna's frame [rad].
        phi: Azimuth in the antenna's frame [rad].

    Raises:
        InputError: If the name is not known, or a function returns another shape or a value that is not finite.
    """
    if not isinstance(pattern, str):
        return _components("function", pattern, theta, phi)
    if pattern not in PATTERNS:
        raise InputError(f"pattern = {pattern!r}; known patterns are {', '.join(PATTERNS)}")
    return _components(pattern, PATTERNS[pattern], theta, phi)


def _components(
    name: str, pattern: PatternTable | PatternFunction, theta: np.ndarray, phi: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    value = pattern(theta, phi)
    if not isinstance(value, tuple):
        value = (value, 0.0)
    if len(value) != 2:
        raise InputError(f"pattern {name}: returned {len(value)} arrays; return the amplitude, or (C_theta, C_phi)")
    parts = [np.asarray(part) for part in value]
    for part in parts:
        if part.shape not in ((), theta.shape):
            raise InputError(
                f"pattern {name}: returned shape {part.shape} for angles of shape {theta.shape}; return one value a "
                "direction"
            )
        if part.dtype.kind not in "fiuc" or not np.isfinite(part).all():
            raise InputError(f"pattern {name}: returned values that are not finite; return a number in any direction")
    first, second = (part if part.shape == theta.shape else np.full(theta.shape, part) for part in parts)
    return first, second


def antenna_field(
    direction: np.ndarray,
    rotation: np.ndarray,
    pattern: Pattern,
    polarization: Polarization,
    model: PolarizationModel = "tr38901_2",
    angles: tuple[np.ndarray, np.ndarray] | None = None,
) -> np.ndarray:
    """Return the far field of an antenna in the world's theta and phi basis.

    Args:
        direction: Unit directions away from the antenna, world frame, shape [P, 3]. For a receiver: toward the
            incoming wave.
        rotation: Antenna-to-world rotations, shape [P, 3, 3].
        pattern: Element pattern: a name, a `PatternTable`, or a function (see `pattern_components`).
        polarization: One element for `V` and `H`, two for `VH` and `cross`; or the slant angle of each element [rad].
        model: Polarization model. It turns (C_theta, C_phi) of any pattern by the slant.
        angles: `direction_angles` of the directions, where they are known, shape [P] each.

    Returns:
        Field components (theta, phi), shape [P, elements, 2]; real, or complex for a complex pattern.

    Source: TR 38.901 equation 7.3-3; for a pattern of both components the whole rotation matrix.
    """
    from mmw.channel.antennas.element_fields import pattern_field, slanted_field  # brings Warp, as above

    slants, is_turned_in_space = np.array(slant_angles(polarization)), model != "tr38901_2"
    rows = (direction, *(direction_angles(direction) if angles is None else angles), rotation)
    if isinstance(pattern, str) and pattern in _NUMBERS:
        return pattern_field(_NUMBERS[pattern], rows, slants, is_turned_in_space)
    return slanted_field(partial(pattern_components, pattern), rows, slants, is_turned_in_space)
