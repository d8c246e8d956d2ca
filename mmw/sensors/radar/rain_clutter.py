"""Model rain for a radar: its backscatter, its velocity, and what each resolution cell receives of it."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

import math
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.core.errors import InputError
from mmw.core.packed_arrays import borrow_arrays, device_arrays
from mmw.core.remember import remembered
from mmw.core.transfer import to_host
from mmw.core.transforms import rotate
from mmw.kernels.radar import detection as radar_detection
from mmw.physics.weather.optics import marshall_palmer
from mmw.physics.weather.weather import Weather
from mmw.sensors.radar.config import Radar
from mmw.sensors.radar.resolution_cells import angle_cells, cell_grid
from mmw.sensors.radar.trace import air_loss_db_per_km, radome_loss_db

RAIN_BACKSCATTER = {
    24.125e9: (-12.32465, 1.56377, -0.03814, -0.00315),
    28.0e9: (-11.72172, 1.51899, -0.05252, -0.00178),
    60.0e9: (-9.49219, 1.08240, -0.07678, 0.00346),
    76.5e9: (-9.17170, 0.92527, -0.06729, 0.00390),
    79.0e9: (-9.14353, 0.90569, -0.06560, 0.00391),
}
"""Carrier [Hz] -> coefficients c of ln(eta) = sum c_i ln(R)^i, eta in m2/m3 and R in mm/h. Fit within 0.3 % of Mie
theory over Marshall and Palmer's drops at 10 C, 1 to 100 mm/h."""

CARRIERS_HZ = (24e9, 81e9)
"""Carriers that `RAIN_BACKSCATTER` serves [Hz]: between its own it is interpolated, beyond by 3 % the nearest holds."""

FIT_MM_H = (1.0, 100.0)
"""Rain rates of the fit [mm/h]; beyond them eta goes on with the slope it ends with."""

BEAM_VOLUME = math.pi / (8.0 * math.log(2.0))
"""Share of (angle x angle x length) that fills a beam of Gaussian shape, both ways.

Source: J. Probert-Jones, "The radar equation in meteorology", Q. J. R. Meteorol. Soc. 88, 1962."""

TURBULENCE_M_S = 0.5
"""Standard deviation of the air's velocity within a cell [m/s]. Design value; Nathanson, Radar Design Principles, gives
1 m/s for the far larger cells of surveillance radars."""

NEAREST_M = 1.0
"""Distance from which on rain is modeled [m]: nearer, a cell holds few drops, and the antennas are not yet one array.
Design value."""

MIN_SHARE = 0.02
"""Rain that returns less than this share of the noise in a direction is left out: at a false alarm probability of 1e-6
it would raise the false alarms there by less than 32 %. Design value."""

RAIN_DRAW = 64
"""First draw of the random numbers of rain; echoes, errors and false alarms use those below."""


def rain_backscatter(rain_mm_h: float, carrier_hz: float) -> float:
    """Return the backscatter coefficient eta of rain, RCS per volume [m2/m3]; 0 without rain.

    Args:
        rain_mm_h: Rain rate [mm/h].
        carrier_hz: Carrier, 24 to 81 GHz [Hz].

    Raises:
        InputError: If the carrier is outside.
    """
    if rain_mm_h <= 0.0:
        return 0.0
    if not CARRIERS_HZ[0] <= carrier_hz <= CARRIERS_HZ[1]:
        raise InputError(
            f"rain clutter at {carrier_hz / 1e9:g} GHz: drops are tabulated for 24 to 81 GHz; set carrier_hz within, "
            "or leave rain out"
        )
    logs = [_log_backscatter(rain_mm_h, c) for c in RAIN_BACKSCATTER.values()]
    known = [math.log(carrier) for carrier in RAIN_BACKSCATTER]
    return math.exp(np.interp(math.log(carrier_hz), known, logs))


def _log_backscatter(rain_mm_h: float, c: tuple[float, ...]) -> float:
    x = math.log(rain_mm_h)
    inside = min(max(x, math.log(FIT_MM_H[0])), math.log(FIT_MM_H[1]))
    value = c[0] + inside * (c[1] + inside * (c[2] + inside * c[3]))
    slope = c[1] + inside * (2.0 * c[2] + inside * 3.0 * c[3])
    return value + slope * (x - inside)


def cell_volume(distance_m: float, solid_angle: float, length_m: float) -> float:
    """Return the volume of a resolution cell [m3].

    Args:
        distance_m: Distance of the cell [m].
        solid_angle: Product of its widths in two angles [sr].
        length_m: Its length [m].

    Source: Probert-Jones 1962, see `BEAM_VOLUME`.
    """
    return distance_m**2 * solid_angle * length_m * BEAM_VOLUME


def fall_speed(rain_mm_h: float) -> tuple[float, float]:
    """Return mean and standard deviation of the fall speed of rain drops, each weighted by its echo [m/s].

    The speed is 9.65 - 10.3 exp(-0.6 D) for a diameter D in mm. The echo of a drop is taken as proportional to D^2,
    around which Mie theory oscillates once drops are not small against the wavelength, as at 77 GHz; over the drops of
    Marshall and Palmer the means are closed forms.

    Args:
        rain_mm_h: Rain rate, above 0 [mm/h].

    Source: D. Atlas, R. Srivastava and R. Sekhon, "Doppler radar characteristics of precipitation at vertical
    incidence", Rev. Geophys. 11, 1973.
    """
    _, slope = marshall_palmer(rain_mm_h)
    first, second = (1.0 + 0.6 / slope) ** -3, (1.0 + 1.2 / slope) ** -3
    return 9.65 - 10.3 * first, 10.3 * math.sqrt(second - first**2)


@dataclass(frozen=True)
class RainClutter:
    """The strongest echo of rain and noise in every range cell and direction of a batch, in one weather.

    A views, G range cells, J directions: the angle cells of the field of view, all z cells of a y cell together.
    """

    power: np.ndarray
    """Power of the echo, noise included [W]; 0 where rain is left out, shape [A, G, J], float32."""
    velocity_cell: np.ndarray
    """Velocity cell that it is in, counted from 0 m/s, shape [A, G, J], int32."""
    y_cell: np.ndarray
    """Angle cell along y of each direction, centered, shape [J]."""
    z_cell: np.ndarray
    """Angle cell along z of each direction, centered, shape [J]."""
    rcs_per_w: np.ndarray
    """RCS [m2] for 1 W received, shape [G, J], float64."""
    mean_velocity: np.ndarray
    """Mean radial velocity of the rain, positive while the distance grows [m/s], shape [A, J], float64."""
    spread: np.ndarray
    """Standard deviation of the same [m/s], shape [A, J], float64."""


def rain_clutter(
    config: Radar, weather: Weather, pose: np.ndarray, velocity: np.ndarray, keys: np.ndarray, device: str
) -> RainClutter | None:
    """Return the rain clutter of a batch, None without rain.

    A cell returns the radar equation of its RCS eta V, spread over velocity cells as a normal distribution: wind and
    falling drops give the mean, the fall speeds of the drops and turbulence the width. Velocity cells beyond three
    standard deviations hold none. Rain behind a wall counts too.

    Args:
        config: Cells, link and noise.
        weather: Rain rate and wind.
        pose: Sensor to world, shape [A, 7].
        velocity: Velocity of the sensors, world frame [m/s], shape [A, 3].
        keys: Key of each view's random numbers, with the weather, shape [A, 2], uint32.
        device: Warp device name.

    Raises:
        InputError: If there is rain and the carrier is not within 24 to 81 GHz.

    Source: radar equation of a volume target, Skolnik, Radar Handbook, chapter on weather.
    """
    if weather.rain_mm_h <= 0.0:
        return None
    rain = _rain(weather, config, device)
    los = rotate(pose[:, None, 3:], rain.los_s[None])
    drift = np.asarray(weather.wind) - np.array([0.0, 0.0, rain.mean_fall]) - velocity
    mean_velocity = np.einsum("aji,ai->aj", los, drift)
    spread = np.sqrt(TURBULENCE_M_S**2 + (rain.fall_spread * los[..., 2]) ** 2)
    shape = (len(pose), cell_grid(config).ranges, len(rain.los_s))
    power, cell = device_arrays(device, ((shape, wp.float32), (shape, wp.int32)))
    given = borrow_arrays(device, *[(mean_velocity.shape, wp.float32)] * 2, ((len(keys),), wp.vec2ui))
    given.host[0][:], given.host[1][:], given.host[2][:] = mean_velocity, spread, keys
    *motion, key = given.upload()
    inputs = [key, cell_grid(config), rain.link, rain.gain, *motion]
    wp.launch(radar_detection.rain_kernel, shape, inputs, [power, cell], device=device)
    clutter = RainClutter(*to_host([power, cell]), rain.y_cell, rain.z_cell, rain.rcs_per_w, mean_velocity, spread)
    given.release()
    return clutter


@dataclass(frozen=True)
class _Rain:
    """The rain of a weather as a radar meets it in J directions, whatever its pose."""

    y_cell: np.ndarray
    z_cell: np.ndarray
    rcs_per_w: np.ndarray
    los_s: np.ndarray
    """Directions in the sensor frame, shape [J, 3]."""
    mean_fall: float
    fall_spread: float
    link: radar_detection.RainLink
    gain: wp.array
    """Two-way gain over boresight times the solid angle of each direction [sr], shape [J]."""


@remembered(owners=2, size=32)
def _rain(weather: Weather, config: Radar, device: str) -> _Rain:
    grid = cell_grid(config)
    axes = (
        (grid.y_step, grid.ys, config.horizontal_fov_deg),
        (grid.z_step, grid.zs, config.vertical_fov_deg),
    )
    cells = [angle_cells(count, fov) for _, count, fov in axes]
    y_cell, z_cell = (axis.reshape(-1) for axis in np.meshgrid(*cells, indexing="ij"))
    y, z = y_cell * grid.y_step, z_cell * grid.z_step
    is_forward = y**2 + z**2 < 0.999  # beyond lies no direction
    y_cell, z_cell, y, z = y_cell[is_forward], z_cell[is_forward], y[is_forward], z[is_forward]
    x = np.sqrt(1.0 - y**2 - z**2)
    # One antenna has no angle cells: it sees the whole field of view.
    widths = [step if count > 1 else 2.0 * math.sin(math.radians(fov) / 2.0) for step, count, fov in axes]
    solid_angle = widths[0] * widths[1] / x
    across = np.arctan2(y, x) / math.radians(config.horizontal_beam_deg or config.horizontal_fov_deg)
    upward = np.arcsin(z) / math.radians(config.vertical_beam_deg or config.vertical_fov_deg)
    gain = np.exp(-8.0 * math.log(2.0) * (across**2 + upward**2)) * solid_angle

    eta = rain_backscatter(weather.rain_mm_h, config.carrier_hz)
    rain = radar_detection.RainLink()
    link_constant = config.link_constant * 10.0 ** (-radome_loss_db(weather, config) / 10.0)
    rain.constant = link_constant * eta * cell_volume(1.0, 1.0, grid.range_step)
    rain.loss_per_m = 2.0 * air_loss_db_per_km(weather, config.carrier_hz) / 1000.0 * math.log(10.0) / 10.0
    rain.noise, rain.least, rain.draw = config.noise_w, MIN_SHARE * config.noise_w, RAIN_DRAW
    rain.nearest = math.ceil(NEAREST_M / grid.range_step)
    distance = np.maximum(np.arange(grid.ranges), 0.5)[:, None] * grid.range_step
    loss = np.exp(-rain.loss_per_m * distance)
    rcs_per_w = distance**4 / (link_constant * (gain / solid_angle)[None] * loss)
    gain_on_device = wp.array(gain.astype(np.float32), dtype=float, device=device)
    los = np.stack([x, y, z], axis=-1)
    return _Rain(y_cell, z_cell, rcs_per_w, los, *fall_speed(weather.rain_mm_h), rain, gain_on_device)
