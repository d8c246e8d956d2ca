"""Trace segments of a path: obstacles between two points, and the slabs that a wave passes in between."""

import warp as wp

from mmw.kernels.channel.surfaces import (
    BOX_TOLERANCE,
    Plane,
    Surfaces,
    lift_at,
    mean_plane,
    next_member,
    plane_at,
    to_carrier,
)
from mmw.kernels.core.compiler import DOUBLE_PRECISION
from mmw.kernels.core.geometry import single
from mmw.kernels.core.structs import MISS_ID, Scene
from mmw.kernels.core.trace import closest_hit, occluded

wp.set_module_options(DOUBLE_PRECISION)

SPECULAR = wp.constant(1)
"""Interaction: mirror reflection. The numbers are those of Sionna RT."""
TRANSMISSION = wp.constant(4)
"""Interaction: straight through a slab."""
DIFFRACTION = wp.constant(8)
"""Interaction: around a wedge."""

MIN_PATH_M = wp.constant(wp.float64(0.01))
"""Shortest path, and shortest segment at a rough patch [m]; nearer than this the far field means nothing. Source:
Sionna RT 2.2, which has it for every segment."""
MIN_SEGMENT_M = wp.constant(wp.float64(1e-6))
"""Shortest segment between interactions [m]; the length of the whole path counts for the field. Design value."""
LIFT_SHARE = wp.constant(wp.float64(0.25))
"""The lift off a surface is at most this share of the segments that meet there."""
IN_PLANE_M = wp.constant(wp.float64(1e-9))
"""An end of a segment this close to a plane lies in it [m]."""
NEAR_PLANE_M = wp.constant(wp.float64(1e-2))
"""Farther than this from the mean plane of a surface [m], its triangles need not be looked at."""
EDGE_LIFTS = wp.constant(wp.float64(4.0))
"""A segment starts off an edge by this many lifts, along the middle of the two outward normals."""
COVER_SHARE = wp.constant(wp.float64(0.75))
"""Share of the lift, from its upper end, that is searched for a surface that lies on the reflecting one."""
END_SLACK = wp.constant(wp.float64(6e-6))
"""Share of a segment at each antenna that is not searched for obstacles: an antenna may lie on a surface."""


FREE = wp.constant(0)
"""Sight along a segment: nothing lies on it."""
BLOCKED = wp.constant(1)
"""Sight along a segment: something lies on it, which may be a slab, or may not count."""
NO_SEGMENT = wp.constant(2)
"""Sight along a segment: there is no path through it."""


@wp.struct
class HitBuffers:
    """Interactions of paths in order, from transmitter to receiver; the tracing of segments fills the rows."""

    kind: wp.array2d[int]
    """Kind of each interaction, shape [C, D]."""
    surface: wp.array2d[int]
    """Surface of each interaction, of a diffraction its wedge, shape [C, D]."""
    vertex: wp.array2d[wp.vec3d]
    """Point of each interaction [m], shape [C, D]."""
    normal: wp.array2d[wp.vec3d]
    """Unit normal there, turned to the side that the wave comes from, 0 for a diffraction, shape [C, D]."""


@wp.struct
class Segment:
    """Straight segment of a path, world frame [m]."""

    begin: wp.vec3d
    end: wp.vec3d
    start: wp.vec3d
    """`begin`, lifted off the surface that it lies on."""
    stop: wp.vec3d
    """`end`, lifted off the surface that it lies on."""
    own: wp.vec4i
    """Surfaces on which it begins (two) and ends (two), -1 for none."""
    lift: wp.vec3d
    """From `end` to `stop` [m]; not set where it ends at an antenna."""


@wp.func
def is_own(surface: int, own: wp.vec4i) -> bool:
    """Return whether a surface is one of those on which a segment begins or ends."""
    return surface == own[0] or surface == own[1] or surface == own[2] or surface == own[3]


@wp.func
def is_across(plane: Plane, one: wp.vec3d, other: wp.vec3d, margin: wp.float64) -> bool:
    """Return whether two points lie on different sides of a plane, both farther from it than a margin."""
    height = wp.dot(plane.normal, one) - plane.offset
    other_height = wp.dot(plane.normal, other) - plane.offset
    return height * other_height < wp.float64(0.0) and wp.min(wp.abs(height), wp.abs(other_height)) > margin


@wp.func
def is_covered(
    scene: Scene, surfaces: Surfaces, pose: wp.array2d[wp.transformd], origin: wp.vec3d, batch_index: int,
    segment: Segment,
) -> bool:  # fmt: skip
    """Return whether a surface that a segment crosses lies on the reflecting one, within the lift off where it ends."""
    start = segment.end + segment.lift
    height = wp.length(segment.lift)
    down, reach = -single(segment.lift / height), wp.float32(height * COVER_SHARE)
    hit = closest_hit(scene, batch_index, single(start - origin), down, reach, MISS_ID)
    is_between = hit.surface != MISS_ID and hit.surface != segment.own[2]
    if is_between:
        at = start - (wp.float64(hit.t) / height) * segment.lift
        plane = plane_at(surfaces, pose, batch_index, hit.surface, at)
        is_between = is_across(plane, segment.begin, segment.end, IN_PLANE_M)
    return is_between


@wp.func
def crosses(
    surfaces: Surfaces, pose: wp.array2d[wp.transformd], batch_index: int, segment: Segment, surface: int, at: wp.vec3d
) -> bool:  # fmt: skip
    """Return whether a segment goes through the plane of a surface near `at`, in float64.

    Rays are rounded to float32: one that runs close to a surface, or ends there, may hit it from the wrong side. An
    edge counts where the ray leaves it, since it may lie on another surface.
    """
    begin = segment.begin
    end = segment.end
    if segment.own[1] != MISS_ID:
        begin = segment.start
    if segment.own[3] != MISS_ID:
        end = segment.stop
    is_through = is_across(mean_plane(surfaces, pose, batch_index, surface), begin, end, NEAR_PLANE_M)
    if not is_through:
        is_through = is_across(plane_at(surfaces, pose, batch_index, surface, at), begin, end, IN_PLANE_M)
    return is_through


@wp.func
def pass_slab(
    surfaces: Surfaces, pose: wp.array2d[wp.transformd], batch_index: int, segment: Segment, surface: int,
    near: wp.vec3d, row: int, filled: int, limit: int, hits: HitBuffers,
) -> int:  # fmt: skip
    """Write that a segment goes through a surface near `near`; return the new row count.

    -1 if the surface lets nothing through, or row `limit` is reached.
    """
    if filled >= limit or surfaces.is_slab[surface] == wp.uint8(0):
        return -1
    plane = plane_at(surfaces, pose, batch_index, surface, near)
    along = wp.dot(plane.normal, segment.end - segment.begin)
    share = (plane.offset - wp.dot(plane.normal, segment.begin)) / along
    hits.kind[row, filled] = TRANSMISSION
    hits.surface[row, filled] = surface
    hits.vertex[row, filled] = segment.begin + share * (segment.end - segment.begin)
    hits.normal[row, filled] = wp.where(along > wp.float64(0.0), -plane.normal, plane.normal)
    return filled + 1


@wp.func
def sight_of(
    scene: Scene, surfaces: Surfaces, pose: wp.array2d[wp.transformd], origin: wp.vec3d, batch_index: int,
    segment: Segment, max_slabs: int,
) -> int:  # fmt: skip
    """Return whether a segment is `FREE`, or `BLOCKED` by what may not count, or there is `NO_SEGMENT`.

    There is none if it is too short, or if the first surface on it stops it: one that it crosses, not its own, and no
    slab or one more than `max_slabs`. Of a blocked segment `pass_obstacles` tells whether it gets through.
    """
    span = segment.stop - segment.start
    length = wp.length(span)
    if not wp.length(segment.end - segment.begin) > MIN_SEGMENT_M:
        return NO_SEGMENT
    if not length > MIN_SEGMENT_M:
        return FREE
    unit = span / length
    start = single(segment.start - origin)
    direction = wp.normalize(single(unit))
    if not occluded(scene, batch_index, start, direction, wp.float32(length), MISS_ID):  # of most, and the quicker test
        return FREE
    hit = closest_hit(scene, batch_index, start, direction, wp.float32(length), MISS_ID)
    if hit.surface == MISS_ID:
        return FREE
    sight = BLOCKED
    is_last = max_slabs <= 0 or surfaces.is_slab[hit.surface] == wp.uint8(0)
    if is_last and not is_own(hit.surface, segment.own):
        at = segment.start + wp.float64(hit.t) * unit
        if crosses(surfaces, pose, batch_index, segment, hit.surface, at):
            sight = NO_SEGMENT
    return sight


@wp.func
def pass_obstacles(
    scene: Scene, surfaces: Surfaces, pose: wp.array2d[wp.transformd], origin: wp.vec3d, batch_index: int,
    segment: Segment, row: int, filled: int, max_slabs: int, hits: HitBuffers,
) -> int:  # fmt: skip
    """Trace a blocked segment; write `max_slabs` slabs that it passes through at most; return how many rows are filled,
    or -1.

    The surfaces of `segment.own`, being flat, cannot obstruct the segment itself, nor can those that it does not cross.
    Behind a slab the ray goes on a little further along; surfaces in that gap are found by a ray back from there, and
    those in the slab's own plane by their position in that plane.
    """
    span = segment.stop - segment.start
    unit = span / wp.length(span)
    direction = wp.normalize(single(unit))
    written = filled
    limit = filled + max_slabs
    passed = wp.int32(MISS_ID)
    position = segment.start
    tries_left = wp.int32(32)
    while tries_left > 0 and written >= 0:
        remaining = wp.dot(segment.stop - position, unit)
        if remaining <= wp.float64(0.0):
            return written
        hit = closest_hit(scene, batch_index, single(position - origin), direction, wp.float32(remaining), MISS_ID)
        if hit.surface == MISS_ID:
            return written
        at = position + wp.float64(hit.t) * unit
        step = lift_at(at - origin)
        position = at + step * unit
        if not is_own(hit.surface, segment.own) and hit.surface != passed:
            passed = hit.surface
            plane = surfaces.plane[passed]
            member = wp.int32(-1)
            local = to_carrier(at, pose, batch_index, surfaces.carrier[passed])
            if crosses(surfaces, pose, batch_index, segment, passed, at):
                written = pass_slab(surfaces, pose, batch_index, segment, passed, at, row, written, limit, hits)
                member = next_member(surfaces, plane, surfaces.first_member[plane] - 1, local, BOX_TOLERANCE)
            while written >= 0 and member >= 0:
                other = surfaces.member[member]
                if other != passed and not is_own(other, segment.own):
                    written = pass_slab(surfaces, pose, batch_index, segment, other, at, row, written, limit, hits)
                member = next_member(surfaces, plane, member, local, BOX_TOLERANCE)
            if written >= 0:
                back = closest_hit(scene, batch_index, single(position - origin), -direction, wp.float32(step), MISS_ID)
                is_hidden = back.surface != MISS_ID and not is_own(back.surface, segment.own)
                if is_hidden and surfaces.plane[back.surface] != plane:
                    at = position - wp.float64(back.t) * unit
                    if crosses(surfaces, pose, batch_index, segment, back.surface, at):
                        passed = back.surface
                        written = pass_slab(surfaces, pose, batch_index, segment, passed, at, row, written, limit, hits)
        tries_left = tries_left - 1
    return -1


@wp.func
def trace_segment(
    scene: Scene, surfaces: Surfaces, pose: wp.array2d[wp.transformd], origin: wp.vec3d, batch_index: int,
    segment: Segment, row: int, filled: int, max_slabs: int, hits: HitBuffers,
) -> int:  # fmt: skip
    """Return how many rows are filled behind a segment, -1 if it does not get through; see `pass_obstacles`."""
    sight = sight_of(scene, surfaces, pose, origin, batch_index, segment, max_slabs)
    if sight == BLOCKED:
        return pass_obstacles(scene, surfaces, pose, origin, batch_index, segment, row, filled, max_slabs, hits)
    return wp.where(sight == FREE, filled, -1)
