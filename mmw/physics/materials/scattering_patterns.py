"""Register and check scattering patterns of users: densities of scattered power as functions of directions."""

from collections.abc import Callable
from functools import cache

import numpy as np

from mmw.core.errors import InputError
from mmw.core.registry import Registry

ScatteringFunction = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""(k_in, k_out, normal) -> density of scattered power [1/sr], shape [B], which integrates to 1 over the hemisphere of
the normal. All three are unit vectors in the world frame, shape [B, 3], float64: the direction in which the wave comes,
the one in which it leaves, and the normal on the side of the incoming wave (k_in . normal < 0 < k_out . normal)."""

LOBES = ("lambertian", "directive", "backscattering")
"""Scattering patterns of mmw; `mmw.physics.em.scattering` computes them."""

PATTERNS: Registry[ScatteringFunction] = Registry(
    "mmw.scattering_patterns",
    "scattering pattern",
    "collections.abc:Callable",
    {},
    check="mmw.physics.materials.scattering_patterns:check_scattering_pattern",
)
"""Scattering patterns of users by name. Other packages add theirs by the entry point group `mmw.scattering_patterns`,
which worker processes find too."""

INCIDENCE_DEG = (0.0, 30.0, 60.0, 80.0)
"""Angles between incoming wave and normal at which a pattern is integrated [deg]."""

INTEGRAL_TOLERANCE = 0.01
"""Largest distance of the integral from 1: 0.04 dB."""

NODES = (64, 128)
"""Directions of the integration along cosine and azimuth; they resolve lobes of 3 degrees."""


def register_scattering_pattern(name: str, function: ScatteringFunction) -> ScatteringFunction:
    """Give a scattering pattern a name for this process, and return the function.

    `RadioMaterial(scattering_pattern=name)`, `mmw:radio:scatteringPattern` of a USD material and `scattering_pattern`
    of a material map take it. A run with worker processes needs the entry point group `mmw.scattering_patterns`.

    Raises:
        InputError: If the name is taken, or the function is no density (see `check_scattering_pattern`).
    """
    if name in LOBES:
        raise InputError(f"scattering pattern {name!r}: is one of mmw; choose another name")
    return PATTERNS.register(name, function)


def scattering_pattern_names() -> tuple[str, ...]:
    """Return the names of all scattering patterns: those of mmw, of other packages, and of this process."""
    return (*LOBES, *PATTERNS)


def scattered_density(
    pattern: str | ScatteringFunction, k_in: np.ndarray, k_out: np.ndarray, normal: np.ndarray
) -> np.ndarray:
    """Return the density of a user's pattern [1/sr], shape [B], 0 behind the surface.

    Args:
        pattern: A name that is not one of `LOBES`, or a function.
        k_in: Unit directions of the incoming waves, shape [B, 3].
        k_out: Unit directions of the scattered waves, shape [B, 3].
        normal: Unit normals on the side of the incoming waves, shape [B, 3].

    Raises:
        InputError: If the name is not known in this process, or values have another shape, are negative or not finite.
    """
    if not isinstance(pattern, str):
        return _evaluate(function_name(pattern), pattern, k_in, k_out, normal)
    if pattern not in PATTERNS:
        raise InputError(
            f"scattering pattern {pattern}: is not known in this process; known are "
            f"{', '.join(scattering_pattern_names())}; register it, for worker processes by the entry point group "
            "mmw.scattering_patterns"
        )
    return _evaluate(pattern, PATTERNS[pattern], k_in, k_out, normal)


def check_scattering_pattern(name: str, function: ScatteringFunction) -> None:
    """Integrate a pattern over the hemisphere, for a few angles of incidence on surfaces of several attitudes.

    Raises:
        InputError: If an integral is further than `INTEGRAL_TOLERANCE` from 1, or a value is wrong (see
            `scattered_density`).
    """
    local, weight = _hemisphere()
    for turn, degrees in enumerate(INCIDENCE_DEG):
        angle, azimuth = np.radians(degrees), 1.0 + turn
        incoming = np.array([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), -np.cos(angle)])
        axes = _attitude(turn)
        k_in, normal = (np.tile(vector, (len(local), 1)) for vector in (incoming @ axes, axes[2]))
        integral = float(_evaluate(name, function, k_in, local @ axes, normal) @ weight)
        if not abs(integral - 1.0) <= INTEGRAL_TOLERANCE:
            raise InputError(
                f"scattering pattern {name}: its integral over the hemisphere is {integral:.4g} at {degrees:g} degrees "
                f"of incidence; 1 within {INTEGRAL_TOLERANCE:g} is needed; divide the function by its integral"
            )


def function_name(function: ScatteringFunction) -> str:
    """Return the name of a function, for messages."""
    return getattr(function, "__qualname__", type(function).__name__)


def _evaluate(
    name: str, function: ScatteringFunction, k_in: np.ndarray, k_out: np.ndarray, normal: np.ndarray
) -> np.ndarray:
    value = np.asarray(function(k_in, k_out, normal))
    if value.shape != (len(k_in),) or value.dtype.kind not in "fiu":
        raise InputError(
            f"scattering pattern {name}: returned {value.dtype} of shape {value.shape} for {len(k_in)} directions; one "
            "real density a direction is needed; correct the function"
        )
    in_front = np.einsum("ij,ij->i", k_out, normal) > 0.0
    wrong = in_front & ~(np.isfinite(value) & (value >= 0.0))
    if wrong.any():
        raise InputError(
            f"scattering pattern {name}: returned {value[wrong][0]:g}; finite densities of at least 0 [1/sr] are "
            "needed; correct the function"
        )
    return np.where(in_front, value, 0.0).astype(np.float64)


@cache
def _hemisphere() -> tuple[np.ndarray, np.ndarray]:
    """Return directions above z = 0, shape [N, 3], and their solid angles [sr], shape [N]."""
    rows, columns = NODES
    node, weight = np.polynomial.legendre.leggauss(rows)
    z, phi = np.meshgrid((node + 1.0) / 2.0, (np.arange(columns) + 0.5) * 2.0 * np.pi / columns, indexing="ij")
    across = np.sqrt(1.0 - z**2)
    solid = np.repeat(weight / 2.0 * 2.0 * np.pi / columns, columns)
    return np.stack([across * np.cos(phi), across * np.sin(phi), z], axis=-1).reshape(-1, 3), solid


def _attitude(turn: int) -> np.ndarray:
    """Return the axes of a surface in the world, the last one its normal, shape [3, 3]: level at first, then tilted."""
    cosine, sine = np.cos(0.9 * turn), np.sin(0.9 * turn)
    return np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])
