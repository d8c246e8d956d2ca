"""Store first hits of rays of views: the part that the kernels of LiDAR and radar share."""

from typing import Any

import warp as wp

from mmw.kernels.core.structs import Hit


@wp.func
def store_hit(rays_out: Any, view: int, ray: int, hit: Hit, direction: wp.vec3):
    """Write distance, cosine of incidence, object and material of a hit to arrays [A, R] of these names."""
    rays_out.range[view, ray] = hit.t
    rays_out.cos_incidence[view, ray] = wp.clamp(-wp.dot(hit.normal, direction), 0.0, 1.0)
    rays_out.object_id[view, ray] = hit.object_id
    rays_out.material_id[view, ray] = hit.material_id
