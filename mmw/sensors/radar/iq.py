"""Synthesize FMCW samples of all virtual antennas from the rays of the detections."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

import math

import numpy as np
import warp as wp

from mmw.core.transfer import to_host
from mmw.kernels.radar import iq as radar_iq
from mmw.kernels.radar import trace as radar
from mmw.sensors.radar.config import Radar
from mmw.sensors.radar.resolution_cells import cell_grid

IQ_DRAW = 10
"""Draw of the random numbers of the receivers' noise; the item is the sample."""


def radar_iq_samples(config: Radar, rays: radar.RadarRays, keys: np.ndarray) -> np.ndarray:
    """Return the samples of the batch [W^0.5], shape [A, antennas, chirps, samples], complex64.

    Each ray is a point that returns sqrt(P) exp(2 pi i (2 R / wavelength + n R / (dR Ns) + m v / (dv M) + (p y + q z) /
    2)) in sample n of Ns, chirp m of M and antenna (p, q): distance, beat frequency, Doppler shift and direction. The
    antenna is q azimuth_antennas + p, p growing to the left and q upward. Rays are coherent, so a cell of many
    fluctuates by itself as its surfaces move. The noise of a sample is noise_w times the number of samples: a Fourier
    transform over all axes, divided by the number of samples, leaves noise_w in a cell and P in that of an echo.
    With `multipath` or `coherent` phases are those of path lengths in float64 and of reflections, and every path of a
    ray is a point of its own.
    Rain attenuates the echoes but is no echo here; all antennas transmit at once; targets stay in their cell.

    Args:
        config: Waveform and noise.
        rays: Echoes [A, R] in one weather.
        keys: Key of each view's random numbers, with the weather, shape [A, 2], uint32.

    Source: Richards, Fundamentals of Radar Signal Processing, 2nd edition; S. Patole et al., "Automotive radars", IEEE
    Signal Process. Mag. 34, 2017.
    """
    device, (antennas, chirps, samples) = rays.range.device, config.iq_shape
    grid = cell_grid(config)
    waveform = radar_iq.Waveform()
    waveform.ys, waveform.chirps, waveform.samples = grid.ys, chirps, samples
    waveform.turns_per_m = 2.0 / config.wavelength
    waveform.range_step, waveform.velocity_step = grid.range_step, grid.velocity_step
    waveform.noise_sd = math.sqrt(config.noise_w * antennas * chirps * samples / 2.0)
    waveform.max_range = (grid.ranges - 0.5) * grid.range_step
    waveform.draw = IQ_DRAW
    turns = wp.empty(rays.range.shape, dtype=wp.vec4, device=device)
    start = wp.empty(rays.range.shape, dtype=wp.vec2, device=device)
    wp.launch(radar_iq.scatterer_kernel, rays.range.shape, [rays, waveform], [turns, start], device=device)
    out = wp.empty((len(keys), antennas, chirps, samples), dtype=wp.vec2, device=device)
    blocks = math.ceil(samples / 16)
    inputs = [wp.array(keys, dtype=wp.vec2ui, device=device), turns, start, waveform]
    wp.launch(radar_iq.sample_kernel, (len(keys), antennas, chirps, blocks), inputs, [out], device=device)
    return np.ascontiguousarray(to_host([out])[0]).view(np.complex64)[..., 0]
