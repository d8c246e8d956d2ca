"""Trace the segments between the points of path candidates, and add those that get through to the paths."""

import warp as wp

from mmw.kernels.channel.candidate_list import FOUND
from mmw.kernels.channel.edges import Wedges, can_diffract, edge_world
from mmw.kernels.channel.image_method import PathCandidates
from mmw.kernels.channel.segments import (
    BLOCKED,
    DIFFRACTION,
    EDGE_LIFTS,
    END_SLACK,
    LIFT_SHARE,
    MIN_PATH_M,
    NO_SEGMENT,
    SPECULAR,
    HitBuffers,
    Segment,
    is_covered,
    pass_obstacles,
    sight_of,
)
from mmw.kernels.channel.surfaces import LinkEnds, Surfaces, lift_at
from mmw.kernels.core.compiler import DOUBLE_PRECISION
from mmw.kernels.core.structs import MISS_ID, Scene

wp.set_module_options(DOUBLE_PRECISION)


@wp.struct
class FoundPaths:
    """Paths that were found among candidates, in any order."""

    candidate: wp.array[int]
    """Number of the candidate, shape [P]."""
    link: wp.array[int]
    """Link of each, in the order of the transmitters, shape [P]."""
    order: wp.array[int]
    """Number of interactions, shape [P]."""


@wp.func
def point_at(candidates: PathCandidates, ends: LinkEnds, candidate: int, k: int) -> wp.vec3d:
    """Return the point of step k of a candidate; the transmitter before the first, the receiver behind the last."""
    link = candidates.link[candidate]
    world = ends.tx.shape[1] - 1
    point = ends.tx[link, world]
    if k >= candidates.steps[candidate]:
        point = ends.rx[link, world]
    elif k >= 0:
        point = candidates.point[candidate, k]
    return point


@wp.func
def away_from(candidates: PathCandidates, candidate: int, k: int, begin: wp.vec3d) -> wp.vec3d:
    """Return the normal at step k, towards the point where its segment begins; zero for a diffraction."""
    away = wp.vec3d()
    if k != candidates.edge[candidate]:
        away = candidates.normal[candidate, k]
        if wp.dot(away, begin) < candidates.offset[candidate, k]:
            away = -away
    return away


@wp.func
def lift_off(
    candidates: PathCandidates, ends: LinkEnds, wedges: Wedges, pose: wp.array2d[wp.transformd], origin: wp.vec3d,
    batch_index: int, candidate: int, k: int,
) -> wp.vec3d:  # fmt: skip
    """Return by how much segments are lifted off the surface, or the edge, of step k [m]."""
    before = point_at(candidates, ends, candidate, k - 1)
    point = candidates.point[candidate, k]
    after = point_at(candidates, ends, candidate, k + 1)
    nearest = wp.min(wp.length(point - before), wp.length(after - point))
    lift = wp.min(lift_at(point - origin), LIFT_SHARE * nearest)
    if k == candidates.edge[candidate]:
        edge = edge_world(wedges, pose, batch_index, -2 - candidates.step[candidate, k])
        return EDGE_LIFTS * lift * edge.away
    return lift * away_from(candidates, candidate, k, before)


@wp.func
def own_surfaces(candidates: PathCandidates, wedges: Wedges, candidate: int, k: int) -> wp.vec2i:
    """Return the surfaces at step k: two of an edge, else one and -1."""
    own = wp.vec2i(candidates.step[candidate, k], MISS_ID)
    if k == candidates.edge[candidate]:
        wedge = -2 - candidates.step[candidate, k]
        own = wp.vec2i(wedges.surface_0[wedge], wedges.surface_n[wedge])
    return own


@wp.func
def segment_at(
    candidates: PathCandidates, ends: LinkEnds, wedges: Wedges, pose: wp.array2d[wp.transformd], origin: wp.vec3d,
    batch_index: int, candidate: int, k: int,
) -> Segment:  # fmt: skip
    """Return the segment that ends at step k of a candidate, or at the receiver behind the last one."""
    segment = Segment()
    segment.begin = point_at(candidates, ends, candidate, k - 1)
    segment.end = point_at(candidates, ends, candidate, k)
    segment.own = wp.vec4i(MISS_ID, MISS_ID, MISS_ID, MISS_ID)
    segment.start = segment.begin
    segment.stop = segment.end
    if k > 0:
        segment.start = segment.begin + lift_off(candidates, ends, wedges, pose, origin, batch_index, candidate, k - 1)
        own = own_surfaces(candidates, wedges, candidate, k - 1)
        segment.own[0] = own[0]
        segment.own[1] = own[1]
    else:
        segment.start = segment.start + END_SLACK * (segment.end - segment.start)
    if k < candidates.steps[candidate]:
        segment.lift = lift_off(candidates, ends, wedges, pose, origin, batch_index, candidate, k)
        segment.stop = segment.end + segment.lift
        own = own_surfaces(candidates, wedges, candidate, k)
        segment.own[2] = own[0]
        segment.own[3] = own[1]
    else:
        segment.stop = segment.stop + END_SLACK * (segment.begin - segment.stop)
    return segment


@wp.func
def reaches_step(
    scene: Scene, surfaces: Surfaces, candidates: PathCandidates, ends: LinkEnds, wedges: Wedges,
    pose: wp.array2d[wp.transformd], origin: wp.vec3d, batch_index: int, candidate: int, k: int, segment: Segment,
) -> bool:  # fmt: skip
    """Return whether a wave along the segment to step k meets the edge from outside, or the surface uncovered."""
    if k == candidates.edge[candidate]:
        wedge = -2 - candidates.step[candidate, k]
        edge = edge_world(wedges, pose, batch_index, wedge)
        return can_diffract(wedges, wedge, edge, segment.begin, point_at(candidates, ends, candidate, k + 1))
    return not is_covered(scene, surfaces, pose, origin, batch_index, segment)


@wp.kernel
def sight_kernel(
    scene: Scene,
    ends: LinkEnds,
    surfaces: Surfaces,
    wedges: Wedges,
    pose: wp.array2d[wp.transformd],
    origin: wp.vec3d,
    threads: int,
    passes: int,
    candidates: PathCandidates,
    # out
    sight_out: wp.array2d[wp.uint8],
):
    """Look along the segments of each candidate: of its `threads`, thread t takes the segments t, t + threads, ...

    `origin` is the world position of the scene frame's origin. A path may go through up to `passes` slabs. A thread
    ends with the first segment without a path. `sight_out` has the result of `sight_of` for each segment, shape [C, D +
    1]. Of S threads one works, see `mmw.core.device.thread_spread`. Launch: dim=(C, threads, S), block_dim=64.
    """
    candidate, first, lane = wp.tid()
    if lane > 0:
        return
    steps = candidates.steps[candidate]
    k = first
    while k <= steps:
        batch_index = ends.batch_index[candidates.link[candidate]]
        segment = segment_at(candidates, ends, wedges, pose, origin, batch_index, candidate, k)
        is_met = wp.bool(True)
        if k < steps:
            is_met = reaches_step(
                scene, surfaces, candidates, ends, wedges, pose, origin, batch_index, candidate, k, segment
            )
        sight = wp.int32(NO_SEGMENT)
        if is_met:
            max_slabs = wp.min(candidates.step.shape[1] - steps, passes)
            sight = sight_of(scene, surfaces, pose, origin, batch_index, segment, max_slabs)
        sight_out[candidate, k] = wp.uint8(sight)
        k = k + threads
        if sight == NO_SEGMENT:
            k = steps + 1


@wp.func
def add_path(
    candidate: int, link: int, order: int, hits: HitBuffers, row: int,
    # out
    counts: wp.array[int], found: FoundPaths, found_hits: HitBuffers,
):  # fmt: skip
    """Add a path whose interactions are a row of `hits`, if there is room; the counts have it in any case.

    Behind its interactions are 0, -1, NaN and NaN.
    """
    place = wp.atomic_add(counts, FOUND, 1)
    if place >= found.link.shape[0]:
        return
    found.candidate[place] = candidate
    found.link[place] = link
    found.order[place] = order
    none = wp.vec3d(wp.float64(wp.nan), wp.float64(wp.nan), wp.float64(wp.nan))
    for k in range(hits.kind.shape[1]):
        found_hits.kind[place, k] = wp.where(k < order, hits.kind[row, k], 0)
        found_hits.surface[place, k] = wp.where(k < order, hits.surface[row, k], MISS_ID)
        found_hits.vertex[place, k] = wp.where(k < order, hits.vertex[row, k], none)
        found_hits.normal[place, k] = wp.where(k < order, hits.normal[row, k], none)


@wp.kernel
def found_kernel(
    scene: Scene,
    ends: LinkEnds,
    surfaces: Surfaces,
    wedges: Wedges,
    pose: wp.array2d[wp.transformd],
    origin: wp.vec3d,
    begin: int,
    passes: int,
    candidates: PathCandidates,
    sight: wp.array2d[wp.uint8],
    # scratch
    hits: HitBuffers,
    # out
    counts_out: wp.array[int],
    found_out: FoundPaths,
    found_hits_out: HitBuffers,
):
    """Add each candidate of which all segments get through, past what does not count and through up to `passes` slabs.

    `sight` is that of `sight_kernel`, up to the first segment without a path; candidates count from `begin`.
    Of S threads one works, see `mmw.core.device.thread_spread`. Launch: dim=(C, S), block_dim=64.
    """
    candidate, lane = wp.tid()
    steps = candidates.steps[candidate]
    if lane > 0 or steps < 0:
        return
    for k in range(steps + 1):
        if sight[candidate, k] == wp.uint8(NO_SEGMENT):
            return
    link = candidates.link[candidate]
    batch_index = ends.batch_index[link]
    max_slabs = wp.min(hits.kind.shape[1] - steps, passes)
    filled = wp.int32(0)
    length = wp.float64(0.0)
    point = point_at(candidates, ends, candidate, -1)
    for k in range(steps + 1):
        before = point
        point = point_at(candidates, ends, candidate, k)
        length = length + wp.length(point - before)
        if sight[candidate, k] == wp.uint8(BLOCKED):
            segment = segment_at(candidates, ends, wedges, pose, origin, batch_index, candidate, k)
            filled = pass_obstacles(
                scene, surfaces, pose, origin, batch_index, segment, candidate, filled, max_slabs - (filled - k), hits
            )
            if filled < 0:
                return
        if k < steps:
            is_edge = k == candidates.edge[candidate]
            step = candidates.step[candidate, k]
            hits.kind[candidate, filled] = wp.where(is_edge, DIFFRACTION, SPECULAR)
            hits.surface[candidate, filled] = wp.where(is_edge, -2 - step, step)
            hits.vertex[candidate, filled] = point
            hits.normal[candidate, filled] = away_from(candidates, candidate, k, before)
            filled = filled + 1
    if length > MIN_PATH_M:
        add_path(begin + candidate, link, filled, hits, candidate, counts_out, found_out, found_hits_out)
