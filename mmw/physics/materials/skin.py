"""Compute the permittivity of the human body's surface by the four-term Cole-Cole model of dry skin.

People reflect and block radio waves with their skin; thin clothing hardly changes it below 100 GHz.

Source: S. Gabriel, R. W. Lau, C. Gabriel, The dielectric properties of biological tissues: III, Phys. Med. Biol. 41
(1996), 2271-2293, table 1, skin (dry), 10 Hz to 100 GHz.
"""

import math

from mmw.core.constants import VACUUM_PERMITTIVITY

MIN_GHZ, MAX_GHZ = 1.0e-8, 100.0
"""Range of the model."""

EPS_INF = 4.0
"""Relative permittivity far above all relaxations [-]."""

SIGMA = 2.0e-4
"""Ionic conductivity [S/m]."""

TERMS = ((32.0, 7.23e-12, 0.0), (1100.0, 32.48e-9, 0.2))
"""Strength [-], relaxation time [s] and broadening alpha [-] of each relaxation."""


def skin_permittivity(carrier_hz: float) -> complex:
    """Return the complex relative permittivity of dry skin, for the time convention e^{+jwt}.

    Source: Gabriel et al., equation 1: eps_inf + sum of d_n / (1 + (j w tau_n)^(1 - alpha_n)) + sigma / (j w eps_0).
    """
    omega = 2.0 * math.pi * carrier_hz
    value = EPS_INF + SIGMA / (1j * omega * VACUUM_PERMITTIVITY)
    return value + sum(delta / (1.0 + (1j * omega * tau) ** (1.0 - alpha)) for delta, tau, alpha in TERMS)
