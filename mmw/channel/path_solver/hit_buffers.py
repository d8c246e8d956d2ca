"""Device buffers for the interactions of paths."""

import warp as wp

from mmw.kernels.channel.segments import HitBuffers


def make_hit_buffers(shape: tuple[int, int], device: str) -> HitBuffers:
    """Return empty rows for the kernels that trace segments, shape [C, D]."""
    met = HitBuffers()
    met.kind, met.surface = (wp.zeros(shape, dtype=wp.int32, device=device) for _ in range(2))
    met.vertex, met.normal = (wp.zeros(shape, dtype=wp.vec3d, device=device) for _ in range(2))
    return met
