"""Permittivity of the human body's surface: the four-term Cole-Cole model of dry skin.

People reflect and block radio waves with their skin; thin clothing hardly changes it below 100 GHz.
"""

import math
from dataclasses import dataclass

from mmw.core.constants import VACUUM_PERMITTIVITY

MIN_GHZ, MAX_GHZ = 1.0e-8, 100.0
"""Range of the model: 10 Hz to 100 GHz. Source: as `DRY_SKIN`."""


@dataclass(frozen=True)
class Tissue:
    """Parameters of a sum of Cole-Cole relaxations."""

    eps_inf: float
    """Relative permittivity far above all relaxations [-]."""
    sigma: float
    """Ionic conductivity [S/m]."""
    terms: tuple[tuple[float, float, float], ...]
    """Strength [-], relaxation time [s] and broadening alpha [-] of each relaxation."""


DRY_SKIN = Tissue(4.0, 2.0e-4, ((32.0, 7.23e-12, 0.0), (1100.0, 32.48e-9, 0.2)))
"""Source: S. Gabriel, R. W. Lau, C. Gabriel, The dielectric properties of biological tissues: III, Phys. Med. Biol. 41
(1996), 2271-2293, table 1, skin (dry)."""


def tissue_permittivity(carrier_hz: float, tissue: Tissue = DRY_SKIN) -> complex:
    """Return the complex relative permittivity of a tissue, for the time convention e^{+jwt}.

    Source: as `DRY_SKIN`, equation 1: eps_inf + sum of d_n / (1 + (j w tau_n)^(1 - alpha_n)) + sigma / (j w eps_0).
    """
    omega = 2.0 * math.pi * carrier_hz
    value = tissue.eps_inf + tissue.sigma / (1j * omega * VACUUM_PERMITTIVITY)
    return value + sum(delta / (1.0 + (1j * omega * tau) ** (1.0 - alpha)) for delta, tau, alpha in tissue.terms)
