"""Launch rays: the sequences of planes that they hit are the path candidates of the image method.

Transmitters that stay where they are keep what their rays hit of the town, which does not change: such a ray is tested
against vehicles alone until it hits one.

Coplanar surfaces have one image, so a ray that hits one of them counts for all. A candidate is a node of a tree: its
last plane and its parent, the candidate before. The first level is a table of bytes, one for each transmitter and
plane; deeper nodes are in a hash table keyed by (level, plane, parent), so that equal candidates are one node and
different ones never are. Which cell a node gets depends on the order of the threads; the set of nodes does not.
"""

import warp as wp

from mmw.kernels.channel.candidate_list import FULL
from mmw.kernels.core.compiler import FINITE
from mmw.kernels.core.geometry import fibonacci_direction
from mmw.kernels.core.structs import MISS_ID, RawHit, Scene
from mmw.kernels.core.trace import (
    TRACE_REGISTERS,
    nearest_in_town,
    nearest_with_instances,
    surface_of,
    world_normal,
)

wp.set_module_options(
    {"enable_backward": False, "default_grid_stride": False, "fast_math": False, "cpu_compiler_flags": FINITE}
)

EMPTY_CELL = wp.constant(wp.uint64(0))
"""Key of a free cell; no node has it, because its level is at least 2."""
PLANE_BITS = wp.constant(wp.uint64(28))
"""Bits of a key that hold the plane; the parent has 32 below, the level 4 above."""
PROBES = wp.constant(256)
"""Cells that are tried for a node before the table counts as full."""
PATCH = wp.constant(8)
"""Azimuths, and belts, of a patch of rays, which a block of `PATCH`^2 threads takes. Design value."""
BOUNCE_LIFT = wp.constant(wp.float32(4e-6))
"""A ray goes on at this times (5 m + largest coordinate) off the surface that it hit."""


@wp.struct
class RayPatches:
    """Fibonacci lattice of rays on the sphere, in patches of neighbors, so that the rays of a block stay together.

    Rays i and i + F are neighbors one below the other where F, a Fibonacci number, is near the root of the number of
    rays. The F rays from j F on are a belt around the sphere.
    """

    ray_count: int
    """Rays of a transmitter."""
    patches_below: int
    """Patches one below the other, which threads take one after the other."""
    order: wp.array[int]
    """Rays of a belt, from its first on, in the order of their azimuths, shape [F]."""


@wp.struct
class TownHits:
    """Hits of rays that have met nothing but the town so far, of transmitters that stay where they are."""

    row: wp.array[int]
    """Row of each transmitter, -1 for one whose rays are not known; no entries if none are, shape [A] or [0]."""
    face: wp.array3d[int]
    """Face of the town that the thread's ray hits next, after none, one, ... reflections; -1 for a miss, shape
    [C, D, T]."""
    t: wp.array3d[float]
    """Distance of that hit [m], inf for a miss, shape [C, D, T]."""
    is_filled: wp.bool
    """False while a launch fills the rows, which looks for the town alone and stores no candidates."""


@wp.func
def ray_of(patches: RayPatches, thread: int) -> int:
    """Return the ray of a thread, -1 for none."""
    patch = thread // (PATCH * PATCH)
    own = thread % (PATCH * PATCH)
    place = (patch // patches.patches_below) * PATCH + own % PATCH
    size = patches.order.shape[0]
    ray = wp.int32(-1)
    if place < size:
        belt = (patch % patches.patches_below) * PATCH + own // PATCH
        ray = belt * size + patches.order[place]
        if ray >= patches.ray_count:
            ray = wp.int32(-1)
    return ray


@wp.func
def cell_of(key: wp.uint64, mask: int) -> int:
    """Return the home cell of a key. Source: multiplicative hashing, Knuth, TAOCP 3, section 6.4."""
    mixed = (key ^ (key >> wp.uint64(29))) * wp.uint64(0x9E3779B97F4A7C15)
    return wp.int32((mixed ^ (mixed >> wp.uint64(32))) & wp.uint64(0x7FFFFFFF)) & mask


@wp.func
def insert_candidate(keys: wp.array[wp.uint64], parent: int, plane: int, level: int) -> int:
    """Return the cell of a candidate, assigned now if it has none; -1 if the table is full.

    Args:
        keys: Keys of the candidates, a power of two of them.
        parent: Code of the candidate before.
        plane: Plane that is added.
        level: Number of planes of the candidate, 2 to 15.
    """
    key = wp.uint64(parent) | (wp.uint64(plane) << wp.uint64(32)) | (wp.uint64(level) << (wp.uint64(32) + PLANE_BITS))
    mask = keys.shape[0] - 1
    cell = cell_of(key, mask)
    result = wp.int32(-1)
    tries = wp.int32(0)
    while tries < PROBES and result < 0:
        found = keys[cell]
        if found == EMPTY_CELL:
            found = wp.atomic_cas(keys, cell, EMPTY_CELL, key)
            if found == EMPTY_CELL:
                result = cell
        if found == key:
            result = cell
        cell = (cell + 1) & mask
        tries = tries + 1
    return result


@wp.kernel(cuda_max_registers=TRACE_REGISTERS)
def launch_kernel(
    scene: Scene,
    batch_index: wp.array[int],
    origin: wp.array[wp.vec3],
    plane: wp.array[int],
    is_slab: wp.array[wp.uint8],
    patches: RayPatches,
    depth: int,
    passes: int,
    # scratch
    town: TownHits,
    # out
    is_hit_out: wp.array2d[wp.uint8],
    keys_out: wp.array[wp.uint64],
    counts_out: wp.array[int],
):
    """Follow each ray over `depth` surfaces and store every sequence of planes that reflects it.

    Bit k of `passes` lets the ray go through the k-th surface that it hits instead of off it. All writers of a
    byte write 1, so their order does not matter. Hits in `town` are those of reflections, `passes` 0; a launch that
    fills them has a row for each transmitter.

    Launch: dim=(A, threads of all patches), block_dim=64; A transmitters, one a frame and actor. `is_hit_out` starts as
    zeros, shape [A, K], as do `keys_out` and `counts_out`, whose entry `FULL` becomes 1 where a node found no cell.
    `plane` and `is_slab` have an entry a surface.
    """
    source, thread = wp.tid()
    ray = ray_of(patches, thread)
    if ray < 0:
        return
    direction = fibonacci_direction(ray, patches.ray_count)
    position = origin[source]
    parent = wp.int32(-1)
    level = wp.int32(1)
    hit_count = wp.int32(0)
    row = wp.int32(-1)
    is_filling = wp.bool(False)
    if town.row.shape[0] > 0:
        row = town.row[source]
        is_filling = not town.is_filled
    while hit_count < depth:
        near = RawHit()
        near.instance = MISS_ID
        if row >= 0 and not is_filling:
            near.face = town.face[row, hit_count, thread]
            near.t = town.t[row, hit_count, thread]
        else:
            near = nearest_in_town(scene, position, direction, wp.inf)
        if is_filling:
            town.face[row, hit_count, thread] = near.face
            town.t[row, hit_count, thread] = near.t
        else:
            near = nearest_with_instances(scene, batch_index[source], position, direction, near)
            if near.instance >= 0:
                row = wp.int32(-1)
        if near.face < 0:
            hit_count = depth
        else:
            surface = surface_of(scene, near)
            own = plane[surface]
            code = source * is_hit_out.shape[1] + own
            if is_filling:
                code = wp.int32(0)
            elif level == 1:
                if is_hit_out[source, own] == wp.uint8(0):  # most rays hit what others did: stores would queue
                    is_hit_out[source, own] = wp.uint8(1)
            else:
                cell = insert_candidate(keys_out, parent, own, level)
                code = is_hit_out.shape[0] * is_hit_out.shape[1] + cell
                if cell < 0:
                    counts_out[FULL] = 1
                    hit_count = depth
            hit_count = hit_count + 1
            if hit_count < depth:
                normal = world_normal(scene, batch_index[source], near)
                if wp.dot(normal, direction) > 0.0:
                    normal = -normal
                position = position + near.t * direction
                lift = BOUNCE_LIFT * (5.0 + wp.max(wp.abs(position)))
                if (passes >> (hit_count - 1)) & 1 == 0:
                    parent = code
                    level = level + 1
                    direction = wp.normalize(direction - 2.0 * wp.dot(normal, direction) * normal)
                    position = position + lift * normal
                elif is_slab[surface] == wp.uint8(0):
                    hit_count = depth
                else:
                    position = position - lift * normal
