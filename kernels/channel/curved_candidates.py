"""Find the facets of curved surfaces that reflect, and where: every facet for every link, in float64."""

import warp as wp

from mmw.kernels.channel.curved_surfaces import CurvedFacets, curved_point
from mmw.kernels.channel.selected_pairs import select_pair
from mmw.kernels.channel.surfaces import LinkEnds, Surfaces, from_carrier
from mmw.kernels.core.compiler import DOUBLE_PRECISION

wp.set_module_options(DOUBLE_PRECISION)


@wp.kernel
def cull_curved_kernel(
    ends: LinkEnds,
    surfaces: Surfaces,
    facets: CurvedFacets,
    first_link: int,
    longest_m: wp.float64,
    # out
    count_out: wp.array[int],
    pair_out: wp.array2d[int],
):
    """Select the (link, facet) pairs with a point of reflection. Launch: dim=(L, F)."""
    row, facet = wp.tid()
    link = first_link + row
    carrier = surfaces.carrier[facets.surface[facet]]
    found = curved_point(facets, facets.shape[facet], ends.tx[link, carrier], ends.rx[link, carrier], longest_m)
    if found.is_found:
        select_pair(row, facet, count_out, pair_out)


@wp.kernel
def curved_points_kernel(
    ends: LinkEnds,
    surfaces: Surfaces,
    facets: CurvedFacets,
    pose: wp.array2d[wp.transformd],
    link: wp.array[int],
    facet: wp.array[int],
    longest_m: wp.float64,
    # out
    touched_out: wp.array2d[wp.vec3d],
    normal_out: wp.array2d[wp.vec3d],
    point_out: wp.array[wp.vec3d],
):
    """Write where each path touches its surface, with the normal, in column 0, and the point of reflection itself, that
    may lie beyond, all in the world frame [m]. Launch: dim=C.
    """
    row = wp.tid()
    own = link[row]
    carrier = surfaces.carrier[facets.surface[facet[row]]]
    found = curved_point(facets, facets.shape[facet[row]], ends.tx[own, carrier], ends.rx[own, carrier], longest_m)
    touched_out[row, 0] = from_carrier(found.touched, pose, ends.batch_index[own], carrier)
    point_out[row] = from_carrier(found.point, pose, ends.batch_index[own], carrier)
    normal = found.touched_normal
    if carrier < pose.shape[1]:
        normal = wp.transform_vector(pose[ends.batch_index[own], carrier], normal)
    normal_out[row, 0] = normal
