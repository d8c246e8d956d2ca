"""Describe the optics of a pulsed LiDAR for rain and fog: beam, threshold, overlap, pulse, and presets of sensors."""

import math
from dataclasses import dataclass

from mmw.core.errors import InputError
from mmw.physics.weather.optics import DROP_BACKSCATTER

WAVELENGTHS_NM = (905, 1550)
"""Wavelengths of LiDAR that `mmw.physics.weather.optics` has values for [nm]."""

POSITIVE = "a finite number above 0"
"""Conditions on the values, as error messages state them."""


@dataclass(frozen=True)
class LidarOptics:
    """Beam, receiver and threshold of a LiDAR.

    Power is the normalized received power [1/m2]: a Lambert target of reflectance rho at normal incidence and distance
    R, which fills the beam, returns rho exp(-2 extinction R) / R^2. The sensor's constants are divided out.
    """

    wavelength_nm: int
    """905 or 1550 [nm]."""
    aperture_m: float
    """Diameter of the beam at the sensor [m]."""
    divergence: float
    """Full angle of the beam [rad]: its diameter grows by this much a meter."""
    min_power: float
    """Power below which nothing is detected [1/m2]; 0.1 / 50^2 sees 10 % of reflectance at 50 m in clear air."""
    overlap_start_m: float
    """Distance at which the receiver's field of view reaches the beam [m]; nothing returns from nearer."""
    overlap_full_m: float
    """Distance from which it holds the whole beam [m]; between the two the share grows with a power of distance."""
    pulse_s: float
    """Half-power width of the pulse [s]; 0 leaves out the echo of fog, which only attenuates then, as in LISA."""
    nearest_m: float
    """Nearest echo that the sensor reports [m]."""
    range_resolution_m: float = 0.03
    """Range resolution dR [m]; the range noise is dR / sqrt(2 SNR), the SNR at least 1. The default gives 2 cm there,
    one sigma, as the data sheet of Velodyne's HDL-64E; LISA, arXiv 2107.07004, has 0.09 m."""
    drop_backscatter: float | None = None
    """Backscatter efficiency of a rain drop [-]; None for that of the wavelength,
    `mmw.physics.weather.optics.DROP_BACKSCATTER`."""
    overlap_exponent: float = 1.0
    """Power with which the share grows from `overlap_start_m` to `overlap_full_m`. 1: as a length, linearly, as in M.
    Hahner et al., ICCV 2021. 2: as an area; received power, share over squared distance, is then strongest at
    `overlap_full_m`."""
    threshold_snr: float = 5.0
    """`min_power` over the standard deviation of the receiver's noise, as power [-]. Noise alone is above 5 deviations
    once in 6,000 pulses of 5 ns and 120 m (S. O. Rice, Bell Syst. Tech. J. 24, 1945: exp(-k^2 / 2) / (2 sqrt(3) tau) a
    second). Design value: no data sheet states it."""

    def __post_init__(self) -> None:
        def check(name: str, good: bool, needed: str) -> None:
            if not good:
                raise InputError(f"optics: {name} = {getattr(self, name)!r}; {needed} is needed; correct it")

        check("wavelength_nm", self.wavelength_nm in WAVELENGTHS_NM, " or ".join(map(str, WAVELENGTHS_NM)))
        check("aperture_m", 0.0 <= self.aperture_m <= 1.0, "0 to 1")
        check("divergence", 0.0 <= self.divergence <= 0.1, "0 to 0.1 rad")
        check("divergence", self.aperture_m + self.divergence > 0.0, "a beam with a diameter")
        check("min_power", 0.0 < self.min_power < math.inf, POSITIVE)
        check("overlap_start_m", 0.0 <= self.overlap_start_m < math.inf, "a finite number from 0")
        check("overlap_full_m", self.overlap_start_m <= self.overlap_full_m < math.inf, "overlap_start_m or more")
        check("pulse_s", 0.0 <= self.pulse_s <= 1e-6, "0 to 1e-6 s")
        check(
            "overlap_start_m", self.pulse_s == 0.0 or self.overlap_start_m > 0.0, "a number above 0 (pulse_s is not 0)"
        )
        check("nearest_m", 0.1 <= self.nearest_m < math.inf, "0.1 m or more")
        check("range_resolution_m", 0.0 <= self.range_resolution_m < math.inf, "a finite number from 0")
        check("drop_backscatter", self.drop_backscatter is None or 0.0 < self.drop_backscatter < math.inf, POSITIVE)
        check("overlap_exponent", 1.0 <= self.overlap_exponent <= 4.0, "1 to 4")
        check("threshold_snr", 4.0 <= self.threshold_snr < math.inf, "4 or more (below, noise is an echo)")

    @property
    def drop_efficiency(self) -> float:
        """Backscatter efficiency of a rain drop [-], the given one or that of the wavelength."""
        if self.drop_backscatter is not None:
            return self.drop_backscatter
        return DROP_BACKSCATTER[self.wavelength_nm]


PRESETS: dict[str, LidarOptics] = {
    "hdl64": LidarOptics(905, 0.010, 2.0e-3, 0.1 / 50**2, 0.9, 8.0, 5e-9, 1.0, overlap_exponent=2.0),
    "modern64": LidarOptics(905, 0.008, 2.5e-3, 0.1 / 120**2, 0.9, 5.0, 5e-9, 1.0),
    "nir1550": LidarOptics(1550, 0.008, 2.5e-3, 0.1 / 120**2, 0.9, 5.0, 5e-9, 1.0),
    "lisa": LidarOptics(
        905, 0.0, 3.0e-3, 0.9 / 120**2, 0.0, 0.0, 0.0, 1.5, range_resolution_m=0.09, drop_backscatter=4 * 0.01981
    ),
}
"""Sensor -> optics.

- `hdl64`: an HDL-64E class unit: 10 % of reflectance at 50 m (data sheet of Velodyne), nothing from nearer than 0.9 m,
  and a received power that is strongest at 8 m: "At this distance, the intensity goes to max. [...] On the upper block,
  it averages 1500cm. On the lower block, it averages 800cm" (Velodyne, "HDL-64E S2 and S2.1 user's manual", appendix F;
  the manual of the S3 calls it "maximum intensity distance"). The lower block looks at what is near. With both,
  plates of 90 % end within 30 % of fog chambers at 30 to 60 m of visibility; with 15 m few rays would return fog.
- `modern64`: 10 % at 120 m; `nir1550`: the same at 1550 nm. Their overlap is a design value.
- `lisa`: the sensor of Kilic et al., arXiv 2107.07004, whose drops reflect ((n - 1) / (n + 1))^2 and whose fog has no
  echo.

Beams and pulses of the first three are design values; Velodyne's site has pulses of "typically 4 nanoseconds"."""
