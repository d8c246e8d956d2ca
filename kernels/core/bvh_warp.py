"""Traverse Warp's own BVHs over triangles, `wp.Mesh`: the fallback of `bvh.py`, without native code.

Warp finds about where a ray hits a mesh first; then every face whose box holds that point is tested once more, in the
arithmetic of `bvh.py`. Hence distances are those of its traversal, and of equal distances the lowest face counts, which
Warp does not promise: it returns the first one that it finds.

- `mmw.core.bvh` makes the boxes of Warp's BVHs a little larger than what they hold, because Warp compares distances to
  boxes without a margin: a ray on the common edge of two faces could miss the box of the one that counts.
- What remains different: a ray that passes an outline closer than float32 resolves may hit it in one traversal
  and miss it in the other, since Warp rounds its shear otherwise.
- On CUDA a query of boxes has its stack in shared memory, apart from that of a query of instances: 16 KiB together
  in a block of 64 threads.
"""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})

MIN_COMPONENT = wp.constant(1.0e-20)
"""Minimum magnitude of a direction component before its inverse is taken, as in `bvh.py`."""

TINY_COMPONENT = wp.constant(1.0e-37)
"""Direction components below this magnitude are zero for Warp's traversal: their inverse would be infinite, and times
zero not a number."""


@wp.struct
class Shear:
    """A shear that makes a ray an axis: u and v lie across it, w counts along it."""

    u: wp.vec3
    v: wp.vec3
    w: wp.vec3


@wp.func
def inverse_component(component: float) -> float:
    """Return the inverse of a direction component, large for zero."""
    nonzero = wp.float32(component)
    if wp.abs(component) < MIN_COMPONENT:
        nonzero = MIN_COMPONENT
    return 1.0 / nonzero


@wp.func
def product(a: float, b: float) -> float:
    """Return a product that is rounded by itself.

    No compiler makes it one instruction with a sum, so neighbors of an edge see one value with opposite signs.
    """
    return float(wp.float64(a) * wp.float64(b))


@wp.func
def exact_difference(a: float, b: float, c: float, d: float) -> float:
    """Return a * b - c * d, rounded once or twice: both products are exact in float64."""
    return float(wp.float64(a) * wp.float64(b) - wp.float64(c) * wp.float64(d))


@wp.func
def rounded_dot(axis: wp.vec3, point: wp.vec3) -> float:
    """Return the inner product, each of its products rounded by itself."""
    return product(axis[0], point[0]) + product(axis[1], point[1]) + product(axis[2], point[2])


@wp.func
def shear_of(direction: wp.vec3) -> Shear:
    """Return the shear of a ray."""
    x = direction[0]
    y = direction[1]
    z = direction[2]
    shear = Shear()
    if wp.abs(z) >= wp.abs(x) and wp.abs(z) >= wp.abs(y):
        inverse = inverse_component(z)
        shear.u = wp.vec3(1.0, 0.0, -product(x, inverse))
        shear.v = wp.vec3(0.0, 1.0, -product(y, inverse))
        shear.w = wp.vec3(0.0, 0.0, inverse)
    elif wp.abs(x) >= wp.abs(y):
        inverse = inverse_component(x)
        shear.u = wp.vec3(-product(y, inverse), 1.0, 0.0)
        shear.v = wp.vec3(-product(z, inverse), 0.0, 1.0)
        shear.w = wp.vec3(inverse, 0.0, 0.0)
    else:
        inverse = inverse_component(y)
        shear.u = wp.vec3(0.0, -product(z, inverse), 1.0)
        shear.v = wp.vec3(1.0, -product(x, inverse), 0.0)
        shear.w = wp.vec3(0.0, inverse, 0.0)
    return shear


@wp.func
def distance_to_face(p: wp.vec3, q: wp.vec3, r: wp.vec3, shear: Shear) -> float:
    """Return the distance of a face along a ray [m], less than 0 where the ray passes it; its corners are relative to
    the start of the ray.

    Neighbors of an edge see the same value with opposite signs, in float64 where it is zero in float32: no ray passes
    between them. Source: S. Woop, C. Benthin and I. Wald, "Watertight ray/triangle intersection", 2013.
    """
    pu = rounded_dot(shear.u, p)
    pv = rounded_dot(shear.v, p)
    qu = rounded_dot(shear.u, q)
    qv = rounded_dot(shear.v, q)
    ru = rounded_dot(shear.u, r)
    rv = rounded_dot(shear.v, r)
    a = product(ru, qv) - product(rv, qu)
    b = product(pu, rv) - product(pv, ru)
    g = product(qu, pv) - product(qv, pu)
    if a == 0.0 or b == 0.0 or g == 0.0:
        a = exact_difference(ru, qv, rv, qu)
        b = exact_difference(pu, rv, pv, ru)
        g = exact_difference(qu, pv, qv, pu)
    volume = a + b + g
    t = wp.float32(-1.0)
    is_outside = wp.min(a, wp.min(b, g)) < 0.0 and wp.max(a, wp.max(b, g)) > 0.0
    if volume != 0.0 and not is_outside:
        along = product(a, rounded_dot(shear.w, p)) + product(b, rounded_dot(shear.w, q))
        t = (along + product(g, rounded_dot(shear.w, r))) / volume
    return t


@wp.func
def without_tiny_components(direction: wp.vec3) -> wp.vec3:
    """Return a direction with its tiniest components zeroed, which Warp's traversal cannot invert."""
    cleaned = wp.vec3(direction)
    for axis in range(3):
        if wp.abs(direction[axis]) < TINY_COMPONENT:
            cleaned[axis] = 0.0
    return cleaned


@wp.func
def mesh_nearest(id: wp.uint64, origin: wp.vec3, direction: wp.vec3, t_max: float) -> wp.uint64:
    """Return the nearest face on a ray as `bvh.traverse_nearest` does: the bits of its distance, and below them its
    number + 1, 0 for a miss.

    Args:
        id: wp.Mesh id; vertices 3 k to 3 k + 2 are those of face k.
        origin: Start of the ray in the mesh's frame [m].
        direction: Unit direction in the mesh's frame.
        t_max: Length of the ray [m].
    """
    nearest = wp.float32(t_max)
    nearest_face = wp.int32(-1)
    hit = wp.mesh_query_ray(id, origin, without_tiny_components(direction), t_max)
    if hit.result:
        mesh = wp.mesh_get(id)
        shear = shear_of(direction)
        at = origin + hit.t * direction
        face = wp.int32(0)
        query = wp.mesh_query_aabb(id, at, at)
        while wp.mesh_query_next(query, face):
            p = mesh.points[3 * face] - origin
            q = mesh.points[3 * face + 1] - origin
            r = mesh.points[3 * face + 2] - origin
            t = distance_to_face(p, q, r, shear)
            if t >= 0.0 and (t < nearest or (t == nearest and face < nearest_face)):
                nearest = t
                nearest_face = face
        if nearest_face < 0:  # an outline that only Warp's shear hits
            nearest = hit.t
            nearest_face = hit.face
    bits = wp.cast(nearest, wp.uint32)
    return (wp.uint64(bits) << wp.uint64(32)) | wp.uint64(nearest_face + 1)


@wp.func
def mesh_any(id: wp.uint64, origin: wp.vec3, direction: wp.vec3, t_max: float) -> bool:
    """Return whether a face lies on a ray before `t_max`; see `mesh_nearest`."""
    return wp.mesh_query_ray_anyhit(id, origin, without_tiny_components(direction), t_max)
