"""Radio maps: rays that carry their field from bounce to bounce and leave power in the cells they cross.

Power is added up in fixed point, in two 64-bit halves. Integer sums do not depend on their order, so that a map has the
same bytes for every launch shape.
"""

import warp as wp

from mmw.kernels.channel.surfaces import lift_at
from mmw.kernels.channel.transmitted_field import MapSources, RayField, complex_product, transmitted_field
from mmw.kernels.core.bvh import Tree
from mmw.kernels.core.compiler import DOUBLE_PRECISION
from mmw.kernels.core.geometry import double, fibonacci_direction, single
from mmw.kernels.core.structs import MISS_ID, Scene
from mmw.kernels.core.trace import closest_hit, nearest_in_tree

wp.set_module_options(DOUBLE_PRECISION)

COSINE_FLOOR = wp.constant(wp.float64(2.0**-16))
"""A crossing flatter than this counts as if it were this steep: the one place where 1 / cos(theta) is bounded."""
LOW_BITS = wp.constant(wp.int64(32))
"""Bits of a fixed-point number that go to the low half."""
LOW_MASK = wp.constant(wp.int64(2**32 - 1))
"""Mask of the low half."""
MAX_AMOUNT = wp.constant(wp.float64(2.0**62))
"""Largest fixed-point number of one crossing."""
MIN_COSINE = wp.constant(wp.float64(1e-9))
"""Minimum cosine of incidence at a surface, where both coefficients are -1 to nine digits and no quotient is 0 / 0."""


@wp.struct
class MapMaterials:
    """Materials at one carrier, by id."""

    permittivity: wp.array[wp.vec2d]
    """Relative permittivity (real, imaginary), shape [M]."""
    thickness: wp.array[wp.float64]
    """Slab thickness [m], 0 for a half-space, shape [M]."""
    specular: wp.array[wp.float64]
    """sqrt(1 - S^2), the share of the reflected field that stays specular, shape [M]."""


@wp.struct
class MapGrid:
    """Mesh that counts the rays; every face belongs to a cell."""

    tree: Tree
    """Of the mesh, scene frame; its root is node 0."""
    normal: wp.array[wp.vec3d]
    """Unit normal of each face, shape [F]."""
    cell: wp.array[int]
    """Cell of each face, shape [F]."""


@wp.struct
class MapLaunch:
    """Rays of a launch, and the depth to which it follows them."""

    batch_index: int
    """Position of the frame in the batch."""
    first: int
    """First thread number of this launch."""
    ray_count: int
    """N: rays of a transmitter, over all launches."""
    stride: int
    """Rays whose numbers differ by it are neighbors on the sphere."""
    row_count: int
    """ceil(N / stride)."""
    max_depth: int
    """Most interactions of a ray."""
    wavenumber: wp.float64
    """2 pi / wavelength [1/m]."""
    scale: wp.float64
    """Fixed-point steps of one unit of |E|^2 / cos(theta), a power of two."""


@wp.struct
class SlabField:
    """Coefficients of a slab for the two polarizations (real, imaginary)."""

    reflect_te: wp.vec2d
    reflect_tm: wp.vec2d
    pass_te: wp.vec2d
    pass_tm: wp.vec2d


@wp.func
def complex_quotient(a: wp.vec2d, b: wp.vec2d) -> wp.vec2d:
    """Return a / b."""
    return complex_product(a, wp.vec2d(b[0], -b[1])) / wp.dot(b, b)


@wp.func
def complex_root(a: wp.vec2d) -> wp.vec2d:
    """Return the square root with a real part >= 0; of a negative number the one of a wave that dies out, -j."""
    zero = wp.float64(0.0)
    half = wp.sqrt(wp.float64(0.5) * (wp.length(a) + wp.abs(a[0])))
    root = wp.vec2d(zero, zero)
    if half > zero:
        other = wp.float64(0.5) * a[1] / half
        if a[0] >= zero:
            root = wp.vec2d(half, other)
        else:
            root = wp.vec2d(wp.abs(other), wp.where(a[1] > zero, half, -half))
    return root


@wp.func
def slab_pair(outside: wp.vec2d, inner: wp.vec2d, single_trip: wp.vec2d) -> wp.vec4d:
    """Return (reflection, transmission) of a slab for one polarization; `outside` is c for TE and eta c for TM."""
    one = wp.vec2d(wp.float64(1.0), wp.float64(0.0))
    total = outside + inner
    r = complex_quotient(outside - inner, total)
    # 1 - r^2 itself would lose its digits at grazing incidence.
    crossing = complex_quotient(wp.float64(4.0) * complex_product(outside, inner), complex_product(total, total))
    round_trip = complex_product(single_trip, single_trip)
    echoes = one - round_trip + complex_product(crossing, round_trip)
    reflected = complex_quotient(complex_product(r, one - round_trip), echoes)
    passed = complex_quotient(complex_product(crossing, single_trip), echoes)
    return wp.vec4d(reflected[0], reflected[1], passed[0], passed[1])


@wp.func
def slab_field(permittivity: wp.vec2d, cosine: wp.float64, thickness: wp.float64, wavenumber: wp.float64) -> SlabField:
    """Return reflection and transmission of a slab; of a half-space, which passes nothing on, at thickness 0.

    An infinite permittivity is a perfect conductor. In float64: the phase of a slab is `2 thickness wavenumber
    sqrt(eta)`, 10^4 rad for 10 m at 28 GHz, of which float32 would keep three digits behind the point.

    Source: ITU-R P.2040-4, equations 37a, 37b, 43 and 44; the same as `mmw.physics.em.fresnel`.
    """
    zero = wp.float64(0.0)
    result = SlabField()
    if wp.isinf(permittivity[0]) or wp.isinf(permittivity[1]):
        result.reflect_te = wp.vec2d(wp.float64(-1.0), zero)
        result.reflect_tm = wp.vec2d(wp.float64(1.0), zero)
    else:
        c = wp.vec2d(wp.max(cosine, MIN_COSINE), zero)
        inner = c  # in vacuum, which reflects exactly nothing
        if permittivity[0] != wp.float64(1.0) or permittivity[1] != zero:
            inner = complex_root(permittivity - wp.vec2d(wp.float64(1.0) - c[0] * c[0], zero))
        single_trip = wp.vec2d()  # e^{-jq}, q = 2 pi d inner / lambda: factor of one passage
        if thickness > zero:
            q = wavenumber * thickness * inner
            specular = wp.exp(q[1])
            single_trip = wp.vec2d(specular * wp.cos(q[0]), -specular * wp.sin(q[0]))
        te = slab_pair(c, inner, single_trip)
        tm = slab_pair(complex_product(permittivity, c), inner, single_trip)
        result.reflect_te = wp.vec2d(te[0], te[1])
        result.reflect_tm = wp.vec2d(tm[0], tm[1])
        result.pass_te = wp.vec2d(te[2], te[3])
        result.pass_tm = wp.vec2d(tm[2], tm[3])
    return result


@wp.func
def te_axis(direction: wp.vec3d, normal: wp.vec3d) -> wp.vec3d:
    """Return the unit vector across the plane of incidence; any one across the ray at normal incidence."""
    axis = wp.cross(direction, normal)
    if wp.dot(axis, axis) < wp.float64(1e-12):
        other = wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0))
        if wp.abs(direction[0]) >= wp.float64(0.9):
            other = wp.vec3d(wp.float64(0.0), wp.float64(1.0), wp.float64(0.0))
        axis = wp.cross(direction, other)
    return wp.normalize(axis)


@wp.func
def apply_surface(
    field: RayField, before: wp.vec3d, after: wp.vec3d, normal: wp.vec3d, te: wp.vec2d, tm: wp.vec2d
) -> RayField:
    """Return the field behind a surface that turns a ray from `before` to `after`.

    Source: C. A. Balanis, Advanced Engineering Electromagnetics, chapter 5: TE and TM parts each by its coefficient.
    """
    across = te_axis(before, normal)
    along_before = wp.cross(before, across)
    along_after = wp.cross(after, across)
    te_part = complex_product(te, wp.vec2d(wp.dot(across, field.real), wp.dot(across, field.imag)))
    tm_part = complex_product(tm, wp.vec2d(wp.dot(along_before, field.real), wp.dot(along_before, field.imag)))
    result = RayField()
    result.real = te_part[0] * across + tm_part[0] * along_after
    result.imag = te_part[1] * across + tm_part[1] * along_after
    return result


@wp.func
def interaction_count(branch: int) -> int:
    """Return the number of interactions up to and with the last passage of a branch, 0 for a branch without."""
    count = wp.int32(0)
    while (branch >> count) > 0:
        count = count + 1
    return count


@wp.kernel
def map_kernel(
    scene: Scene,
    sources: MapSources,
    materials: MapMaterials,
    grid: MapGrid,
    launch: MapLaunch,
    # out
    high_out: wp.array2d[wp.int64],
    low_out: wp.array2d[wp.int64],
):
    """Follow rays over `max_depth` interactions and add |E|^2 / cos(theta) to every cell that a segment crosses.

    Bit k of `branch` sends the ray through the surface of its k-th interaction instead of off it. Segments up to the
    last passage belong to the branch without it, which counts them; so every segment of the tree is counted once.

    Launch: dim=(T, n, B), block_dim=64; n threads from `launch.first`, `row_count * stride` in all; B = 1, or
    2^max_depth with transmission. Outputs start as zeros, shape [T, C]; an amount is high * 2^32 + low.
    """
    source, thread, branch = wp.tid()
    thread = thread + launch.first
    ray = (thread % launch.row_count) * launch.stride + thread // launch.row_count
    if ray >= launch.ray_count:
        return
    direction = wp.normalize(double(fibonacci_direction(ray, launch.ray_count)))
    position = sources.position[source]
    field = transmitted_field(sources, source, direction)
    first_segment = interaction_count(branch)
    segment = wp.int32(0)
    while segment <= launch.max_depth:
        power = wp.dot(field.real, field.real) + wp.dot(field.imag, field.imag)
        if power * launch.scale < wp.float64(0.5) * COSINE_FLOOR:  # no crossing could add a step any more
            return
        crossing = nearest_in_tree(grid.tree, 0, single(position), single(direction), wp.inf)
        if crossing.face < 0 and segment == launch.max_depth:
            return
        hit = closest_hit(scene, launch.batch_index, single(position), single(direction), wp.inf, MISS_ID)
        if segment >= first_segment:
            at = position
            travelled = crossing.t
            while crossing.face >= 0 and travelled < hit.t:
                normal = grid.normal[crossing.face]
                normal = wp.where(wp.dot(normal, direction) > wp.float64(0.0), -normal, normal)
                cosine = wp.max(wp.abs(wp.dot(normal, direction)), COSINE_FLOOR)
                amount = wp.int64(wp.rint(wp.min(power / cosine * launch.scale, MAX_AMOUNT)))
                cell = grid.cell[crossing.face]
                if (amount >> LOW_BITS) > wp.int64(0):
                    wp.atomic_add(high_out, source, cell, amount >> LOW_BITS)
                wp.atomic_add(low_out, source, cell, amount & LOW_MASK)
                at = at + wp.float64(crossing.t) * direction
                at = at - lift_at(at) * normal
                crossing = nearest_in_tree(grid.tree, 0, single(at), single(direction), wp.inf)
                travelled = travelled + crossing.t
        if hit.object_id == MISS_ID or segment == launch.max_depth:
            return
        normal = wp.normalize(double(hit.normal))
        cosine = wp.min(-wp.dot(normal, direction), wp.float64(1.0))
        thickness = materials.thickness[hit.material_id]
        slab = slab_field(materials.permittivity[hit.material_id], cosine, thickness, launch.wavenumber)
        position = position + wp.float64(hit.t) * direction
        if (branch >> segment) & 1 == 1:
            if not thickness > wp.float64(0.0):
                return
            field = apply_surface(field, direction, direction, normal, slab.pass_te, slab.pass_tm)
            position = position - lift_at(position) * normal
        else:
            specular = materials.specular[hit.material_id]
            after = wp.normalize(direction + wp.float64(2.0) * cosine * normal)
            field = apply_surface(
                field, direction, after, normal, specular * slab.reflect_te, specular * slab.reflect_tm
            )
            direction = after
            position = position + lift_at(position) * normal
        segment = segment + 1
