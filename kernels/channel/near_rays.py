"""Follow rays of transmitters at rest on a GPU: few come near a vehicle, and each would hold up those of its warp.

A first launch follows all rays as far as no vehicle is near, by what is known of the town. It queues the others, which
a second one follows side by side.
"""

import warp as wp

from mmw.kernels.channel.ray_launch import TownHits, add_candidate, first_ray, follow_ray, kept_hit, ray_after
from mmw.kernels.core.compiler import FINITE
from mmw.kernels.core.structs import Scene
from mmw.kernels.core.trace import TRACE_REGISTERS, passes_instance_box, surface_of

wp.set_module_options(
    {"enable_backward": False, "default_grid_stride": False, "fast_math": False, "cpu_compiler_flags": FINITE}
)

QUEUE_BLOCK = 64
"""Threads, one after the other, that share a queue: those of a block."""
QUEUES = 64
"""Queues of a transmitter, which its blocks take in turn: writers of one counter wait for each other. Design value."""


@wp.struct
class NearRays:
    """Rays of transmitters at rest that pass the box of an instance, in `QUEUES` queues for each transmitter."""

    thread: wp.array2d[int]
    """Thread of each ray, queues one after the other, shape [n, QUEUES * size]."""
    count: wp.array2d[int]
    """Rays in each queue, shape [n, QUEUES]."""


@wp.kernel
def queue_kernel(
    scene: Scene,
    batch_index: wp.array[int],
    origin: wp.array[wp.vec3],
    plane: wp.array[int],
    ray_count: int,
    stride: int,
    row_count: int,
    depth: int,
    first_source: int,
    town: TownHits,
    # out
    near_out: NearRays,
    is_hit_out: wp.array2d[wp.uint8],
    keys_out: wp.array[wp.uint64],
    counts_out: wp.array[int],
):
    """Follow rays whose hits of the town are known as far as they pass no box of an instance, and queue those that do.

    The other arguments are those of `launch_kernel`; every transmitter has a row in `town`. There are queues for some
    transmitters from `first_source` on, of which the counts start as zeros.
    Launch: dim=(transmitters with queues, row_count * stride), block_dim=64.
    """
    own, thread = wp.tid()
    source = first_source + own
    number = (thread % row_count) * stride + thread // row_count
    if number >= ray_count:
        return
    row = town.row[source]
    ray = first_ray(origin[source], number, ray_count)
    parent = wp.int32(-1)
    hit_count = wp.int32(0)
    while hit_count < depth:
        near = kept_hit(town, row, hit_count, thread)
        hit_count = hit_count + 1
        if passes_instance_box(scene, batch_index[source], ray.position, ray.direction, near.t):
            queue = (thread // QUEUE_BLOCK) % QUEUES
            size = near_out.thread.shape[1] // QUEUES
            place = queue * size + wp.atomic_add(near_out.count, own, queue, 1)
            near_out.thread[own, place] = thread
            hit_count = depth
        elif near.face < 0:
            hit_count = depth
        else:
            reflecting = plane[surface_of(scene, near)]
            parent = add_candidate(parent, reflecting, hit_count, source, is_hit_out, keys_out, counts_out)
            if parent < 0:
                hit_count = depth
            elif hit_count < depth:
                ray = ray_after(scene, batch_index[source], ray, near, False)


@wp.kernel(cuda_max_registers=TRACE_REGISTERS)
def follow_queued_kernel(
    scene: Scene,
    batch_index: wp.array[int],
    origin: wp.array[wp.vec3],
    plane: wp.array[int],
    is_slab: wp.array[wp.uint8],
    ray_count: int,
    stride: int,
    row_count: int,
    depth: int,
    first_source: int,
    queued: NearRays,
    # scratch
    town: TownHits,
    # out
    is_hit_out: wp.array2d[wp.uint8],
    keys_out: wp.array[wp.uint64],
    counts_out: wp.array[int],
):
    """Follow the rays in the queues of `queue_kernel` from their start, as `launch_kernel` does.

    Launch: dim=(transmitters with queues, QUEUES * size), block_dim=64.
    """
    own, place = wp.tid()
    size = queued.thread.shape[1] // QUEUES
    if place % size >= queued.count[own, place // size]:
        return
    source = first_source + own
    thread = queued.thread[own, place]
    follow_ray(
        scene,
        batch_index,
        origin,
        plane,
        is_slab,
        ray_count,
        stride,
        row_count,
        depth,
        0,
        source,
        thread,
        town,
        is_hit_out,
        keys_out,
        counts_out,
    )
