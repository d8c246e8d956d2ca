"""Independent oracle of layered walls: all waves of both polarizations at once, by boundary conditions, in float64.

Every medium has four waves, forward and backward, TE and TM. Ex and Ey are continuous at each face, Hx and Hy are but
for the currents of a sheet, and `numpy.linalg.solve` does the rest. Nothing of `mmw.physics.em` is used.
"""

from dataclasses import dataclass

import numpy as np

LIGHT_M_S = 299_792_458.0
VACUUM_OHM = 376.730313412
NODES, WEIGHTS = np.polynomial.legendre.leggauss(200)


@dataclass(frozen=True)
class Slab:
    """A layer of a substance."""

    eta: complex
    thickness: float
    """[m]; 0 for the half-space at the back."""


@dataclass(frozen=True)
class Sheet:
    """A conducting sheet."""

    ohm: float
    """[ohm/square]."""


@dataclass(frozen=True)
class Solution:
    """Answer of a wall to a plane wave of unit amplitude; TM waves are counted by their magnetic field."""

    reflected: complex
    """In the sign of r_TE or r_TM of Fresnel's formulas."""
    transmitted: complex
    """At the back face, without the phase of a straight ray in air."""
    absorbed: float
    """Power that sheets and lossy layers take over the power that comes in."""
    gone: float
    """Power that goes on into a half-space at the back over the power that comes in."""


def solve_stack(stack: list[Slab | Sheet], cosine: float, carrier_hz: float, *, is_te: bool) -> Solution:
    """Return the solution for one polarization; z goes into the wall, the plane of incidence is x-z."""
    wave = 2 * np.pi * carrier_hz / LIGHT_M_S
    sine = np.sqrt(1 - cosine**2)
    media: list[tuple[complex, float]] = [(1.0 + 0j, 0.0)]
    sheets: list[list[float]] = [[]]
    for item in stack:
        if isinstance(item, Sheet):
            sheets[-1].append(item.ohm)
        else:
            media.append((complex(item.eta), item.thickness))
            sheets.append([])
    if media[-1][1] > 0.0 or len(media) == 1:
        media.append((1.0 + 0j, 0.0))
    else:
        assert not sheets.pop()
    faces = sheets[: len(media) - 1]
    inner = [_forward(eta, sine) for eta, _ in media]
    count = 4 * len(media)
    matrix, right = np.zeros((count, count), complex), np.zeros(count, complex)
    row = 0
    for k, ohms in enumerate(faces):
        conductance = sum(VACUUM_OHM / ohm for ohm in ohms)
        before = _fields(media[k][0], inner[k], wave, media[k][1])
        behind = _fields(media[k + 1][0], inner[k + 1], wave, 0.0)
        for component in range(2):
            matrix[row, 4 * k : 4 * k + 4] = before[component]
            matrix[row, 4 * k + 4 : 4 * k + 8] = -behind[component]
            row += 1
        # z x (H_behind - H_before) = J = E / R, with H in units of E / Z0: (-dHy, dHx) = g (Ex, Ey)
        for magnetic, electric, sign in ((3, 0, -1.0), (2, 1, 1.0)):
            matrix[row, 4 * k : 4 * k + 4] = -sign * before[magnetic]
            matrix[row, 4 * k + 4 : 4 * k + 8] = sign * behind[magnetic] - conductance * behind[electric]
            row += 1
    incoming = 0 if is_te else 2  # waves of a medium: TE forward, TE backward, TM forward, TM backward
    for index, value in ((0, is_te), (2, not is_te), (count - 3, 0.0), (count - 1, 0.0)):
        matrix[row, index], right[row] = 1.0, value
        row += 1
    waves = np.linalg.solve(matrix, right)
    assert np.abs(waves[[2, 3] if is_te else [0, 1]]).max() < 1e-9  # the polarizations do not mix
    power_in = _power(media[0][0], inner[0], wave, 0.0, np.array([is_te, 0, not is_te, 0], complex))
    absorbed = 0.0
    for k, ohms in enumerate(faces):
        electric = _fields(media[k + 1][0], inner[k + 1], wave, 0.0)[:2] @ waves[4 * k + 4 : 4 * k + 8]
        absorbed += sum(0.5 * VACUUM_OHM / ohm * float((np.abs(electric) ** 2).sum()) for ohm in ohms)
    for k, (eta, thickness) in enumerate(media):
        if thickness > 0.0:
            absorbed += _ohmic_loss(eta, inner[k], wave, thickness, sine, waves[4 * k : 4 * k + 4])
    last = waves[-4:]
    gone = _power(media[-1][0], inner[-1], wave, 0.0, last)
    return Solution(complex(waves[incoming + 1]), complex(last[incoming]), absorbed / power_in, gone / power_in)


def _forward(eta: complex, sine: float) -> complex:
    value = np.sqrt(complex(eta) - sine**2)
    return -value if value.imag > 0 else value


def _fields(eta: complex, inner: complex, wave: float, depth: float) -> np.ndarray:
    """Return Ex, Ey and Z0 Hx, Z0 Hy at a depth for unit waves, shape [4, 4]; TM waves have unit Z0 Hy / sqrt(eta)."""
    ahead, back = np.exp(-1j * wave * inner * depth), np.exp(1j * wave * inner * depth)
    index = np.sqrt(complex(eta))
    out = np.zeros((4, 4), complex)
    out[1, 0], out[1, 1] = ahead, back
    out[2, 0], out[2, 1] = -inner * ahead, inner * back
    out[3, 2], out[3, 3] = index * ahead, index * back
    out[0, 2], out[0, 3] = inner / index * ahead, -inner / index * back
    return out


def _power(eta: complex, inner: complex, wave: float, depth: float, waves: np.ndarray) -> float:
    """Return the Poynting vector along z, times 2 Z0."""
    ex, ey, hx, hy = _fields(eta, inner, wave, depth) @ waves
    return 0.5 * float((ex * np.conj(hy) - ey * np.conj(hx)).real)


def _ohmic_loss(eta: complex, inner: complex, wave: float, thickness: float, sine: float, waves: np.ndarray) -> float:
    """Return the integral of -Im(eta) k |E|^2 / 2 over a layer, by Gauss's quadrature."""
    z = 0.5 * (NODES + 1) * thickness
    ahead, back = np.exp(-1j * wave * inner * z), np.exp(1j * wave * inner * z)
    index = np.sqrt(complex(eta))
    ex = inner / index * (waves[2] * ahead - waves[3] * back)
    ey = waves[0] * ahead + waves[1] * back
    ez = -sine / index * (waves[2] * ahead + waves[3] * back)  # of Ampere's law: eta Ez = -sine Z0 Hy
    density = np.abs(ex) ** 2 + np.abs(ey) ** 2 + np.abs(ez) ** 2
    return 0.25 * thickness * wave * -complex(eta).imag * float(WEIGHTS @ density)
