"""Synthesize samples of an FMCW receiver: every ray is a point that adds one complex oscillation; noise is added."""

import warp as wp

from mmw.kernels.core.noise import normal2, uniform4
from mmw.kernels.radar.trace import RadarRays

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})

BLOCK = wp.constant(16)
"""Samples of one thread: it turns a phasor from one to the next instead of asking for sines."""

block_vec = wp.types.vector(length=16, dtype=wp.float32)


@wp.struct
class Waveform:
    """Size and scale of the samples [antennas, chirps, samples] of a sweep."""

    ys: int
    """Antennas along y."""
    chirps: int
    samples: int
    """Samples of a chirp."""
    turns_per_m: wp.float64
    """Turns of the echo's phase for one meter of distance, 2 / wavelength."""
    range_step: float
    """Range that turns the phase once more over the samples of a chirp [m]."""
    velocity_step: float
    """Velocity that turns it once more over the chirps of a sweep [m/s]."""
    noise_sd: float
    """Standard deviation of the noise, in i and in q [W^0.5]."""
    max_range: float
    """Distance from which on echoes are left out [m]."""
    draw: int
    """Draw of the noise."""


@wp.kernel
def scatterer_kernel(
    rays: RadarRays,
    waveform: Waveform,
    # out
    turns_out: wp.array2d[wp.vec4],
    start_out: wp.array2d[wp.vec2],
):
    """Prepare each ray: turns per sample, chirp, antenna along y and along z; amplitude [W^0.5] and phase at first.

    Launch: dim=(A, R).
    """
    view, ray = wp.tid()
    amplitude = wp.float32(0.0)
    start = wp.float32(0.0)
    turns = wp.vec4()
    distance = rays.range[view, ray]
    if rays.power[view, ray] > 0.0 and distance < waveform.max_range:
        amplitude = wp.sqrt(rays.power[view, ray])
        if rays.turns.shape[0] > 0:
            start = rays.turns[view, ray]
        else:
            whole = wp.float64(distance) * waveform.turns_per_m
            start = wp.float32(whole - wp.floor(whole))
        elevation = rays.elevation[view, ray]
        # half a wavelength between antennas is half a turn at endfire
        turns = wp.vec4(
            distance / (waveform.range_step * float(waveform.samples)),
            rays.velocity[view, ray] / (waveform.velocity_step * float(waveform.chirps)),
            0.5 * wp.sin(rays.azimuth[view, ray]) * wp.cos(elevation),
            0.5 * wp.sin(elevation),
        )
    turns_out[view, ray] = turns
    start_out[view, ray] = wp.vec2(amplitude, start)


@wp.kernel
def sample_kernel(
    key: wp.array[wp.vec2ui],
    turns: wp.array2d[wp.vec4],
    start: wp.array2d[wp.vec2],
    waveform: Waveform,
    # out
    sample_out: wp.array4d[wp.vec2],
):
    """Add up the echoes of all rays, in their order, and noise.

    Launch: dim=(A, antennas, chirps, blocks of samples).
    """
    view, antenna, chirp, block = wp.tid()
    first = block * BLOCK
    i_sum = block_vec()
    q_sum = block_vec()
    for ray in range(turns.shape[1]):
        amplitude = start[view, ray][0]
        if amplitude > 0.0:
            turn = turns[view, ray]
            phase = (
                start[view, ray][1]
                + turn[0] * float(first)
                + turn[1] * float(chirp)
                + turn[2] * float(antenna % waveform.ys)
                + turn[3] * float(antenna // waveform.ys)
            )
            angle = 2.0 * wp.PI * (phase - wp.floor(phase))
            i = amplitude * wp.cos(angle)
            q = amplitude * wp.sin(angle)
            c = wp.cos(2.0 * wp.PI * turn[0])
            s = wp.sin(2.0 * wp.PI * turn[0])
            for n in range(BLOCK):
                i_sum[n] += i
                q_sum[n] += q
                turned = i * c - q * s
                q = i * s + q * c
                i = turned
    for n in range(BLOCK):
        sample = first + n
        if sample < waveform.samples:
            item = (antenna * waveform.chirps + chirp) * waveform.samples + sample
            u = uniform4(key[view], item, waveform.draw)
            noise = normal2(u[0], u[1]) * waveform.noise_sd
            sample_out[view, antenna, chirp, sample] = wp.vec2(i_sum[n], q_sum[n]) + noise
