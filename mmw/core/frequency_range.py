"""Check that frequencies are in the range of a model, which is never extrapolated."""

import numpy as np
from numpy.typing import ArrayLike

from mmw.core.errors import InputError


def check_frequency_range(carrier_hz: ArrayLike, low_ghz: float, high_ghz: float, what: str, source: str) -> np.ndarray:
    """Return carrier frequencies in GHz after a check that they are in the range of a model, ends included.

    Args:
        carrier_hz: Carrier frequencies [Hz], any shape.
        low_ghz: Lower end of the range [GHz].
        high_ghz: Upper end of the range [GHz].
        what: Computed quantity, for the error message.
        source: Recommendation that defines the range.

    Raises:
        InputError: If a frequency is outside the range.
    """
    ghz = np.asarray(carrier_hz, dtype=np.float64) / 1e9
    outside = ~((ghz >= low_ghz * (1 - 1e-12)) & (ghz <= high_ghz * (1 + 1e-12)))
    if outside.any():
        raise InputError(
            f"{what}: no value at {ghz[outside].flat[0]:g} GHz; {source} holds from {low_ghz:g} to {high_ghz:g} GHz; "
            "choose a carrier inside"
        )
    return ghz
