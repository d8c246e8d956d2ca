"""Image method: exact points of interaction of path candidates, in float64."""

import warp as wp

from mmw.kernels.channel.candidate_list import LISTED, CandidateList
from mmw.kernels.channel.edges import Wedges, edge_point, edge_world
from mmw.kernels.channel.finite_surfaces import Outlines, beside_surface
from mmw.kernels.channel.surfaces import (
    LinkEnds,
    Plane,
    Surfaces,
    is_mirror,
    mean_plane,
    mirror_point,
    mirrored,
    surface_at,
    triangle_at,
    triangle_plane,
)
from mmw.kernels.core.compiler import DOUBLE_PRECISION
from mmw.kernels.core.structs import MISS_ID

wp.set_module_options(DOUBLE_PRECISION)


@wp.struct
class PathCandidates:
    """Scratch for the geometry of candidate paths."""

    step: wp.array2d[int]
    """Interactions as in `CandidateList`; of planes the surfaces, once they are found, shape [C, D]."""
    image: wp.array2d[wp.vec3d]
    """Image of the end that a step belongs to, before its surface [m], shape [C, D]."""
    normal: wp.array2d[wp.vec3d]
    """Plane of each step, shape [C, D]."""
    offset: wp.array2d[wp.float64]
    """Plane of each step, shape [C, D]."""
    point: wp.array2d[wp.vec3d]
    """Point of each step [m], shape [C, D]."""
    link: wp.array[int]
    """Link of each candidate, in the order of the transmitters, shape [C]."""
    steps: wp.array[int]
    """Number of steps of each, -1 for a candidate without points, shape [C]."""
    edge: wp.array[int]
    """Step that is a diffraction, behind the last one if none is, shape [C]."""
    is_curved: wp.bool
    """True if each is one reflection at a curved surface, whose point and normal are given."""


@wp.func
def plane_at(candidates: PathCandidates, candidate: int, step: int) -> Plane:
    """Return the plane of a step."""
    plane = Plane()
    plane.normal = candidates.normal[candidate, step]
    plane.offset = candidates.offset[candidate, step]
    return plane


@wp.func
def find_points(
    candidates: PathCandidates,
    wedges: Wedges,
    pose: wp.array2d[wp.transformd],
    batch_index: int,
    candidate: int,
    steps: int,
    edge: int,
    tx: wp.vec3d,
    rx: wp.vec3d,
) -> bool:
    """Write the points of all steps by the image method, and return whether there are any.

    Images of the transmitter go up to the wedge at step `edge` (`steps` if there is none), images of the receiver down
    to it; the point on the wedge follows from both, the reflections from the point.
    """
    image = tx
    for k in range(edge):
        candidates.image[candidate, k] = image
        image = mirrored(image, plane_at(candidates, candidate, k))
    target = rx
    is_valid = wp.bool(True)
    if edge < steps:
        back = rx
        step = steps - 1
        while step > edge:
            candidates.image[candidate, step] = back
            back = mirrored(back, plane_at(candidates, candidate, step))
            step = step - 1
        wedge = -2 - candidates.step[candidate, edge]
        ends = edge_world(wedges, pose, batch_index, wedge)
        found = edge_point(ends, image, back)
        is_valid = found[3] > wp.float64(0.0)
        target = wp.vec3d(found[0], found[1], found[2])
        candidates.point[candidate, edge] = target
        on = target
        step = edge + 1
        while is_valid and step < steps:
            plane = plane_at(candidates, candidate, step)
            is_valid = is_mirror(plane.normal, plane.offset, candidates.image[candidate, step], on)
            if is_valid:
                on = mirror_point(plane, candidates.image[candidate, step], on)
                candidates.point[candidate, step] = on
            step = step + 1
    step = edge - 1
    while is_valid and step >= 0:
        plane = plane_at(candidates, candidate, step)
        is_valid = is_mirror(plane.normal, plane.offset, candidates.image[candidate, step], target)
        if is_valid:
            target = mirror_point(plane, candidates.image[candidate, step], target)
            candidates.point[candidate, step] = target
        step = step - 1
    return is_valid


@wp.func
def find_exact_points(
    candidates: PathCandidates,
    is_plane: bool,
    surfaces: Surfaces,
    wedges: Wedges,
    outlines: Outlines,
    pose: wp.array2d[wp.transformd],
    batch_index: int,
    candidate: int,
    steps: int,
    edge: int,
    tx: wp.vec3d,
    rx: wp.vec3d,
) -> bool:
    """Write the exact points of all steps, and return whether there are any.

    The mean planes of the surfaces pick surfaces and triangles, without gaps at inner edges; the planes of those
    triangles then give the points. A single finite surface also reflects beside its outline; its path then touches it.
    """
    if candidates.is_curved:
        candidates.offset[candidate, 0] = wp.dot(candidates.normal[candidate, 0], candidates.point[candidate, 0])
        return True
    is_beside = wp.bool(False)
    for k in range(steps):
        if k != edge:
            surface = candidates.step[candidate, k]
            if is_plane:
                surface = surfaces.lead[surface]
            plane = mean_plane(surfaces, pose, batch_index, surface)
            candidates.normal[candidate, k] = plane.normal
            candidates.offset[candidate, k] = plane.offset
    is_valid = find_points(candidates, wedges, pose, batch_index, candidate, steps, edge, tx, rx)
    step = wp.int32(0)
    while is_valid and step < steps:
        if step != edge:
            if is_plane:
                plane_id = candidates.step[candidate, step]
                found = surface_at(surfaces, pose, batch_index, plane_id, candidates.point[candidate, step])
                if found < 0 and steps == 1 and outlines.longest_m > wp.float64(0.0):
                    mean = plane_at(candidates, candidate, step)
                    touched = beside_surface(outlines, surfaces, pose, batch_index, plane_id, mean, tx, rx)
                    if touched[3] > wp.float64(0.0):
                        is_beside = wp.bool(True)
                        candidates.point[candidate, step] = wp.vec3d(touched[0], touched[1], touched[2])
                        found = surface_at(surfaces, pose, batch_index, plane_id, candidates.point[candidate, step])
                candidates.step[candidate, step] = found
            is_valid = candidates.step[candidate, step] >= 0
            if is_valid and not is_beside:
                surface = candidates.step[candidate, step]
                corner = triangle_at(surfaces, pose, batch_index, surface, candidates.point[candidate, step])
                is_valid = corner >= 0
                if is_valid:
                    plane = triangle_plane(surfaces, pose, batch_index, surface, corner)
                    candidates.normal[candidate, step] = plane.normal
                    candidates.offset[candidate, step] = plane.offset
        step = step + 1
    if is_valid and steps > 0 and not is_beside:
        is_valid = find_points(candidates, wedges, pose, batch_index, candidate, steps, edge, tx, rx)
    return is_valid


@wp.kernel
def points_kernel(
    ends: LinkEnds,
    surfaces: Surfaces,
    wedges: Wedges,
    pose: wp.array2d[wp.transformd],
    outlines: Outlines,
    listed: CandidateList,
    given: int,
    sights: int,
    begin: int,
    counts: wp.array[int],
    # out
    candidates_out: PathCandidates,
):
    """Find the exact points of each candidate.

    The first `sights` candidates are the lines of sight of the links of these numbers. Those of `listed` follow, as
    many as are `given`, or, where that is negative, as `counts` tells; thread c takes candidate `begin` + c. Of S
    threads one works, see `mmw.core.device.thread_spread`. Launch: dim=(C, S).
    """
    candidate, lane = wp.tid()
    if lane > 0:
        return
    number = begin + candidate
    depth = candidates_out.step.shape[1]
    link = number
    is_plane = wp.bool(False)
    steps = wp.int32(0)
    edge = wp.int32(-1)
    candidates_out.steps[candidate] = -1
    if number >= sights:
        row = number - sights
        rows = given
        if given < 0:
            rows = wp.min(counts[LISTED], listed.link.shape[0])
        if row >= rows:
            return
        link = listed.link[row]
        is_plane = listed.is_plane[row] != wp.uint8(0)
        while steps < depth and listed.step[row, steps] != MISS_ID:
            candidates_out.step[candidate, steps] = listed.step[row, steps]
            if listed.step[row, steps] < MISS_ID:
                edge = steps
            steps = steps + 1
    batch_index = ends.batch_index[link]
    world = ends.tx.shape[1] - 1
    tx = ends.tx[link, world]
    rx = ends.rx[link, world]
    if edge < 0:
        edge = steps
    candidates_out.link[candidate] = link
    candidates_out.edge[candidate] = edge
    if find_exact_points(
        candidates_out, is_plane, surfaces, wedges, outlines, pose, batch_index, candidate, steps, edge, tx, rx
    ):
        candidates_out.steps[candidate] = steps
