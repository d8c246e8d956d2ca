"""Evaluate the large-scale parameters of 3GPP TR 38.901 for the urban micro cell in a street canyon, as a reference."""

from dataclasses import dataclass

import numpy as np

from mmw.core.errors import InputError

__all__ = ["LogNormal", "StreetCanyon", "street_canyon"]

MIN_CARRIER_GHZ = 2.0
"""Below, table 7.5-6 takes this carrier for the street canyon [GHz]; its note 7."""

MODEL_RANGE_HZ = (0.5e9, 100e9)
"""Carriers of the model, TR 38.901, section 7.1 [Hz]."""

AZIMUTH_LIMIT_DEG, ZENITH_LIMIT_DEG = 104.0, 52.0
"""Largest spreads of azimuth and zenith, TR 38.901, section 7.5, step 4 [deg]."""

NORMAL_DECILE = 1.2815515655446004
"""The 90th percentile of the standard normal distribution."""


@dataclass(frozen=True)
class LogNormal:
    """A quantity whose logarithm to base 10 is normal."""

    mean: float
    """Mean of the logarithm."""
    std: float
    """Standard deviation of the logarithm."""
    limit: float = float("inf")
    """Larger values count as this one."""

    @property
    def percentiles(self) -> tuple[float, float, float]:
        """The 10th, 50th and 90th percentile."""
        decile = NORMAL_DECILE * self.std
        low, middle, high = (min(10.0 ** (self.mean + k * decile), self.limit) for k in (-1, 0, 1))
        return low, middle, high


@dataclass(frozen=True)
class StreetCanyon:
    """Large-scale parameters of a link in a street canyon."""

    delay_spread_s: LogNormal
    azimuth_spread_departure_deg: LogNormal
    """Departure is at the base station."""
    azimuth_spread_arrival_deg: LogNormal
    zenith_spread_departure_deg: LogNormal
    zenith_spread_arrival_deg: LogNormal
    k_factor_db: tuple[float, float] | None
    """Mean and standard deviation of the Rician K-factor, normal in dB; None without line of sight."""


def street_canyon(
    carrier_hz: float, is_los: bool, distance_m: float, rx_height_m: float = 1.5, tx_height_m: float = 10.0
) -> StreetCanyon:
    """Return the parameters of the scenario UMi - Street Canyon.

    Args:
        carrier_hz: Carrier frequency [Hz].
        is_los: With line of sight, or without.
        distance_m: Horizontal distance, of which the zenith spread of departure depends [m].
        rx_height_m: Height of the terminal [m].
        tx_height_m: Height of the base station [m].

    Raises:
        InputError: If the carrier is not of the model.

    Source: 3GPP TR 38.901 V17.0.0, table 7.5-6 part 1; zenith spread of departure: table 7.5-8.
    """
    if not MODEL_RANGE_HZ[0] <= carrier_hz <= MODEL_RANGE_HZ[1]:
        raise InputError(f"street_canyon: carrier_hz = {carrier_hz:g}; TR 38.901 is for 0.5 to 100 GHz")
    x = float(np.log10(1.0 + max(carrier_hz / 1e9, MIN_CARRIER_GHZ)))
    km, higher = distance_m / 1000.0, rx_height_m - tx_height_m
    if is_los:
        return StreetCanyon(
            delay_spread_s=LogNormal(-0.24 * x - 7.14, 0.38),
            azimuth_spread_departure_deg=LogNormal(-0.05 * x + 1.21, 0.41, AZIMUTH_LIMIT_DEG),
            azimuth_spread_arrival_deg=LogNormal(-0.08 * x + 1.73, 0.014 * x + 0.28, AZIMUTH_LIMIT_DEG),
            zenith_spread_departure_deg=LogNormal(
                max(-0.21, -14.8 * km + 0.01 * abs(higher) + 0.83), 0.35, ZENITH_LIMIT_DEG
            ),
            zenith_spread_arrival_deg=LogNormal(-0.1 * x + 0.73, -0.04 * x + 0.34, ZENITH_LIMIT_DEG),
            k_factor_db=(9.0, 5.0),
        )
    return StreetCanyon(
        delay_spread_s=LogNormal(-0.24 * x - 6.83, 0.16 * x + 0.28),
        azimuth_spread_departure_deg=LogNormal(-0.23 * x + 1.53, 0.11 * x + 0.33, AZIMUTH_LIMIT_DEG),
        azimuth_spread_arrival_deg=LogNormal(-0.08 * x + 1.81, 0.05 * x + 0.3, AZIMUTH_LIMIT_DEG),
        zenith_spread_departure_deg=LogNormal(
            max(-0.5, -3.1 * km + 0.01 * max(higher, 0.0) + 0.2), 0.35, ZENITH_LIMIT_DEG
        ),
        zenith_spread_arrival_deg=LogNormal(-0.04 * x + 0.92, -0.07 * x + 0.41, ZENITH_LIMIT_DEG),
        k_factor_db=None,
    )
