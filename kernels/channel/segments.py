"""Segments of a path: obstacles between two points, and the slabs that a wave passes on the way."""

import warp as wp

from mmw.kernels.channel.surfaces import Surfaces, holds, largest, mean_plane, single, triangle_at, triangle_plane
from mmw.kernels.core.structs import MISS_ID, Scene
from mmw.kernels.core.trace import closest_hit, occluded

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})

SPECULAR = wp.constant(1)
"""Interaction: mirror reflection. The numbers are those of Sionna RT."""
TRANSMISSION = wp.constant(4)
"""Interaction: straight through a slab."""
DIFFRACTION = wp.constant(8)
"""Interaction: around a wedge."""

MIN_LEG = wp.constant(wp.float64(0.01))
"""Shortest segment of a path [m]; nearer than this the far field means nothing. Source: Sionna RT 2.2 uses the same."""
LIFT = wp.constant(wp.float64(2e-6))
"""A segment starts off its surface by this times (5 m + largest coordinate): 16 roundings of float32."""
EDGE_LIFTS = wp.constant(wp.float64(4.0))
"""A segment starts off an edge by this many lifts, along the middle of the two outward normals."""
COVER_SHARE = wp.constant(wp.float64(0.75))
"""Share of the lift, from its upper end, that is searched for a surface that lies on the reflecting one."""
END_SLACK = wp.constant(wp.float64(6e-6))
"""Share of a segment at each antenna that is not searched for obstacles: an antenna may lie on a surface."""


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


@wp.func
def is_covered(
    scene: Scene, slot: int, start: wp.vec3d, normal: wp.vec3d, lift: wp.float64, origin: wp.vec3d, surface: int
) -> bool:
    """Return whether another surface lies between a point of reflection and `start`, where its segments start."""
    reach = wp.float32(lift * COVER_SHARE)
    hit = closest_hit(scene, slot, single(start - origin), -single(normal), reach, MISS_ID)
    return hit.surface != MISS_ID and hit.surface != surface


@wp.func
def is_own(surface: int, own: wp.vec4i) -> bool:
    """Return whether a surface is one of those on which a segment begins or ends."""
    return surface == own[0] or surface == own[1] or surface == own[2] or surface == own[3]


@wp.func
def pass_slab(
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    slot: int,
    begin: wp.vec3d,
    end: wp.vec3d,
    surface: int,
    near: wp.vec3d,
    trial: int,
    filled: int,
    limit: int,
    met: HitBuffers,
) -> int:
    """Write that the segment from `begin` to `end` goes through a surface near `near`; return the new row count.

    -1 if the surface lets nothing through, or row `limit` is reached.
    """
    if filled >= limit or surfaces.is_open[surface] == wp.uint8(0):
        return -1
    plane = mean_plane(surfaces, pose, slot, surface)
    corner = triangle_at(surfaces, pose, slot, surface, near)
    if corner >= 0:
        plane = triangle_plane(surfaces, pose, slot, surface, corner)
    along = wp.dot(plane.normal, end - begin)
    share = (plane.offset - wp.dot(plane.normal, begin)) / along
    met.kind[trial, filled] = TRANSMISSION
    met.surface[trial, filled] = surface
    met.vertex[trial, filled] = begin + share * (end - begin)
    met.normal[trial, filled] = wp.where(along > wp.float64(0.0), -plane.normal, plane.normal)
    return filled + 1


@wp.func
def walk_leg(
    scene: Scene,
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    origin: wp.vec3d,
    slot: int,
    begin: wp.vec3d,
    end: wp.vec3d,
    start: wp.vec3d,
    stop: wp.vec3d,
    own: wp.vec4i,
    trial: int,
    filled: int,
    room: int,
    met: HitBuffers,
) -> int:
    """Trace a segment; write the slabs that it passes through, `room` at most; return how many rows are filled, or -1.

    `begin` and `end` are its true ends, `start` and `stop` the same lifted off what they lie on. The surfaces of `own`,
    being flat, cannot obstruct the segment itself. Behind a slab the ray goes on a little further along; what lies in
    that gap is found by looking back from there, and what lies in the slab's own plane by its place in that plane.
    """
    leg = stop - start
    length = wp.length(leg)
    if not length > MIN_LEG:
        return -1
    way = leg / length
    direction = wp.normalize(single(way))
    if not occluded(scene, slot, single(start - origin), direction, wp.float32(length), MISS_ID):
        return filled
    written = filled
    limit = filled + room
    passed = wp.int32(MISS_ID)
    place = start
    tries = wp.int32(32)
    while tries > 0 and written >= 0:
        left = wp.dot(stop - place, way)
        if left <= wp.float64(0.0):
            return written
        hit = closest_hit(scene, slot, single(place - origin), direction, wp.float32(left), MISS_ID)
        if hit.surface == MISS_ID:
            return written
        at = place + wp.float64(hit.t) * way
        step = LIFT * (wp.float64(5.0) + largest(at - origin))
        place = at + step * way
        if not is_own(hit.surface, own) and hit.surface != passed:
            passed = hit.surface
            written = pass_slab(
                surfaces,
                pose,
                slot,
                begin,
                end,
                passed,
                at,
                trial,
                written,
                limit,
                met,
            )
            plane = surfaces.plane[passed]
            member = surfaces.first_member[plane]
            while written >= 0 and member < surfaces.first_member[plane + 1]:
                other = surfaces.member[member]
                if other != passed and not is_own(other, own) and holds(surfaces, pose, slot, other, at):
                    written = pass_slab(
                        surfaces,
                        pose,
                        slot,
                        begin,
                        end,
                        other,
                        at,
                        trial,
                        written,
                        limit,
                        met,
                    )
                member = member + 1
            back = closest_hit(scene, slot, single(place - origin), -direction, wp.float32(step), MISS_ID)
            is_hidden = written >= 0 and back.surface != MISS_ID and not is_own(back.surface, own)
            if is_hidden and surfaces.plane[back.surface] != plane:
                passed = back.surface
                written = pass_slab(
                    surfaces,
                    pose,
                    slot,
                    begin,
                    end,
                    passed,
                    place - wp.float64(back.t) * way,
                    trial,
                    written,
                    limit,
                    met,
                )
        tries = tries - 1
    return -1
