"""Traverse a four-wide BVH over triangles, with up to four triangles in a leaf.

The traversal is the only native code of the project, because it is written once for each kind of processor: on CUDA a
thread tests boxes and triangles one by one, on a CPU the four boxes of a node and the four triangles of a leaf are one
vector. `bvh_build.py` builds the BVH. Native code depends on Warp's present compilers, so there is a fallback without
any, through Warp's own BVHs (`bvh_warp.py`): `WIDE` says which of the two is compiled into `nearest_face` and
`is_any_face`.

- A node holds the boxes of its children side by side, so that the near and the far planes of all four are read with one
  offset a ray and axis, after the sign of its direction.
- Boxes are a little larger than what they hold, and a ray enters one that it touches: no rounding loses a triangle.
- The test of a triangle gives neighbors of an edge the same value with opposite signs, in float64 where it is zero in
  float32: no ray passes between them. Source: S. Woop, C. Benthin and I. Wald, "Watertight ray/triangle intersection",
  2013.
- Of equal distances the lowest face counts, and the numbers of a triangle do not depend on its neighbors in a leaf, so
  the result does not depend on the BVH.
- Both kinds of processor round every product and every sum, so a ray of the same bits has the same face and distance on
  both: no product is fused with a sum, which CUDA's compiler does wherever it may. Boxes, which may be hit or missed
  by a rounding, are exempt.
"""

import warp as wp

from mmw.kernels.core.bvh_warp import mesh_any, mesh_nearest

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})

WIDE = wp.constant(True)
"""True if rays traverse the BVHs of this file, false if they traverse Warp's. `mmw.core.bvh.select_bvh` sets it
before any kernel is built: the other one is not compiled, and kernels of either kind have hashes of their own in
Warp's cache."""

LEAF_FACES = wp.constant(4)
"""Maximum number of triangles in a leaf."""

NODE_ROWS = wp.constant(8)
"""Rows of four numbers in a node: lower x, y, z and upper x, y, z of its children, references to them, a spare row."""

REFERENCE_ROW = wp.constant(6)
"""Row of a node that holds the references to its children."""

LEAF_ROWS = wp.constant(10)
"""Rows of four numbers in a leaf: x, y, z of the first, second and third corners of its triangles, and their faces."""

MAX_DEPTH = wp.constant(15)
"""Maximum number of nodes from the root to a leaf."""

MAX_STACK = 3 * MAX_DEPTH + 1
"""Nodes and leaves on the stack of a ray: three of each level, and the next. A larger stack, or one that holds
distances too, costs CUDA more than it saves: local memory bounds its traversal."""


@wp.struct
class Tree:
    """BVHs of several meshes; the root of each is the number of a node, with Warp's BVHs that of a mesh."""

    nodes: wp.array[wp.vec4]
    """`NODE_ROWS` rows a node. A reference >= 0 is a node; any other is -1 - (8 * leaf + number of its triangles)."""
    leaves: wp.array[wp.vec4]
    """`LEAF_ROWS` rows a leaf. Unused places repeat the last one."""
    meshes: wp.array[wp.uint64]
    """wp.Mesh ids, where rays traverse Warp's BVHs; the other two are empty then, and this one is otherwise."""


RAY = """
#pragma clang fp contract(off)
    const float FAR = 3.0e38f;
    const float ox = origin[0], oy = origin[1], oz = origin[2];
    const float dx = direction[0], dy = direction[1], dz = direction[2];
    // A direction without a part along an axis has a tiny one among the boxes, so that no quotient is infinite.
    const float ix = 1.0f / (fabsf(dx) < 1.0e-20f ? 1.0e-20f : dx);
    const float iy = 1.0f / (fabsf(dy) < 1.0e-20f ? 1.0e-20f : dy);
    const float iz = 1.0f / (fabsf(dz) < 1.0e-20f ? 1.0e-20f : dz);
    const int near_x = ix < 0.0f ? 12 : 0, near_y = iy < 0.0f ? 12 : 0, near_z = iz < 0.0f ? 12 : 0;
    // A shear that makes the ray an axis: w is its longest part, u and v lie across. Rows of corners in a leaf, origin
    // and factors in that order.
    int row_u = 0, row_v = 4, row_w = 8;
    float ou = ox, ov = oy, ow = oz, su = -dx * iz, sv = -dy * iz, sw = iz;
    if (fabsf(dz) < fabsf(dx) || fabsf(dz) < fabsf(dy)) {
        if (fabsf(dx) >= fabsf(dy)) {
            row_u = 4; row_v = 8; row_w = 0; ou = oy; ov = oz; ow = ox; su = -dy * ix; sv = -dz * ix; sw = ix;
        } else {
            row_u = 8; row_v = 0; row_w = 4; ou = oz; ov = ox; ow = oy; su = -dz * iy; sv = -dx * iy; sw = iy;
        }
    }
    float nearest = t_max;
    int nearest_face = -1;
    int stack[MAX_STACK];
    int size = 0;
    int node = root;
    while (true) {
        if (node >= 0) {
            const float* n = (const float*)nodes.data + NODE_NUMBERS * node;
"""
"""Precomputed values of a ray's direction, and the stack of nodes and leaves still to visit."""

CUDA_BOXES = """
            const float4 lower_x = __ldg((const float4*)(n + near_x));
            const float4 upper_x = __ldg((const float4*)(n + 12 - near_x));
            const float4 lower_y = __ldg((const float4*)(n + 4 + near_y));
            const float4 upper_y = __ldg((const float4*)(n + 16 - near_y));
            const float4 lower_z = __ldg((const float4*)(n + 8 + near_z));
            const float4 upper_z = __ldg((const float4*)(n + 20 - near_z));
            const int4 below = __ldg((const int4*)(n + 24));
            int child[4] = {below.x, below.y, below.z, below.w};
            float enter[4];
            auto enter_box = [&](float x, float y, float z, float to_x, float to_y, float to_z) {
                const float in = fmaxf(fmaxf((x - ox) * ix, (y - oy) * iy), fmaxf((z - oz) * iz, 0.0f));
                const float out = fminf(fminf((to_x - ox) * ix, (to_y - oy) * iy), fminf((to_z - oz) * iz, nearest));
                return in <= out * 1.0000004f ? in : FAR;
            };
            enter[0] = enter_box(lower_x.x, lower_y.x, lower_z.x, upper_x.x, upper_y.x, upper_z.x);
            enter[1] = enter_box(lower_x.y, lower_y.y, lower_z.y, upper_x.y, upper_y.y, upper_z.y);
            enter[2] = enter_box(lower_x.z, lower_y.z, lower_z.z, upper_x.z, upper_y.z, upper_z.z);
            enter[3] = enter_box(lower_x.w, lower_y.w, lower_z.w, upper_x.w, upper_y.w, upper_z.w);
"""

CPU_BOXES = """
            typedef float f4 __attribute__((ext_vector_type(4)));
            typedef int i4 __attribute__((ext_vector_type(4)));
            f4 lower_x, lower_y, lower_z, upper_x, upper_y, upper_z;
            i4 child;
            memcpy(&lower_x, n + near_x, 16);
            memcpy(&lower_y, n + 4 + near_y, 16);
            memcpy(&lower_z, n + 8 + near_z, 16);
            memcpy(&upper_x, n + 12 - near_x, 16);
            memcpy(&upper_y, n + 16 - near_y, 16);
            memcpy(&upper_z, n + 20 - near_z, 16);
            memcpy(&child, n + 24, 16);
            auto low = [](f4 a, f4 b) { return a < b ? a : b; };
            auto high = [](f4 a, f4 b) { return a > b ? a : b; };
            const f4 in = high(high((lower_x - ox) * ix, (lower_y - oy) * iy), high((lower_z - oz) * iz, f4(0.0f)));
            const f4 out = low(low((upper_x - ox) * ix, (upper_y - oy) * iy), low((upper_z - oz) * iz, f4(nearest)));
            const f4 enter = in <= out * 1.0000004f ? in : f4(FAR);
"""

CUDA_ORDER = """
            auto order = [&](int i, int j) {
                if (enter[i] > enter[j]) {
                    const float t = enter[i]; enter[i] = enter[j]; enter[j] = t;
                    const int c = child[i]; child[i] = child[j]; child[j] = c;
                }
            };
            order(0, 1); order(2, 3); order(0, 2); order(1, 3); order(1, 2);
            if (enter[0] < FAR) {
#pragma unroll
                for (int i = 3; i > 0; --i)
                    if (enter[i] < FAR) stack[size++] = child[i];
                node = child[0];
                continue;
            }
"""
"""Visit the nearest child next; push the others, the nearest of them last."""

CPU_ORDER = """
            const int first = size;
            float t[4];
            for (int i = 0; i < 4; ++i)
                if (enter[i] < FAR) {
                    int place = size++;
                    for (; place > first && t[place - first - 1] < enter[i]; --place) {
                        t[place - first] = t[place - first - 1];
                        stack[place] = stack[place - 1];
                    }
                    t[place - first] = enter[i];
                    stack[place] = child[i];
                }
            if (size > first) { node = stack[--size]; continue; }
"""

NO_ORDER = """
            for (int i = 0; i < 4; ++i)
                if (enter[i] < FAR) stack[size++] = child[i];
"""

CUDA_LEAF = """
        } else {
            const float* leaf = (const float*)leaves.data + LEAF_NUMBERS * ((-1 - node) >> 3);
            const int count = (-1 - node) & 7;
            for (int k = 0; k < count; ++k) {
                const float* cu = leaf + k + row_u;
                const float* cv = leaf + k + row_v;
                const float* cw = leaf + k + row_w;
                const float pl = __ldg(cw) - ow, ql = __ldg(cw + 12) - ow, rl = __ldg(cw + 24) - ow;
                auto across = [](float x, float s, float l) { return __fadd_rn(x, __fmul_rn(s, l)); };
                const float pu = across(__ldg(cu) - ou, su, pl), pv = across(__ldg(cv) - ov, sv, pl);
                const float qu = across(__ldg(cu + 12) - ou, su, ql), qv = across(__ldg(cv + 12) - ov, sv, ql);
                const float ru = across(__ldg(cu + 24) - ou, su, rl), rv = across(__ldg(cv + 24) - ov, sv, rl);
                float a = __fsub_rn(__fmul_rn(ru, qv), __fmul_rn(rv, qu));
                float b = __fsub_rn(__fmul_rn(pu, rv), __fmul_rn(pv, ru));
                float g = __fsub_rn(__fmul_rn(qu, pv), __fmul_rn(qv, pu));
                if (a == 0.0f || b == 0.0f || g == 0.0f) {
                    a = (float)((double)ru * (double)qv - (double)rv * (double)qu);
                    b = (float)((double)pu * (double)rv - (double)pv * (double)ru);
                    g = (float)((double)qu * (double)pv - (double)qv * (double)pu);
                }
                const float volume = a + b + g;
                if (volume == 0.0f || (fminf(a, fminf(b, g)) < 0.0f && fmaxf(a, fmaxf(b, g)) > 0.0f)) continue;
                const float pw = __fmul_rn(a, sw * pl), qw = __fmul_rn(b, sw * ql), rw = __fmul_rn(g, sw * rl);
                const float t = __fadd_rn(__fadd_rn(pw, qw), rw) / volume;
                if (t >= 0.0f && t <= nearest) {
                    const int face = __float_as_int(__ldg(leaf + k + 36));
                    FOUND
                }
            }
        }
"""

CPU_LEAF = """
        } else {
            typedef float f4 __attribute__((ext_vector_type(4)));
            typedef int i4 __attribute__((ext_vector_type(4)));
            typedef double d4 __attribute__((ext_vector_type(4)));
            const float* leaf = (const float*)leaves.data + LEAF_NUMBERS * ((-1 - node) >> 3);
            const int count = (-1 - node) & 7;
            auto corners = [&](int row) { f4 c; memcpy(&c, leaf + row, 16); return c; };
            const f4 pl = corners(row_w) - ow, ql = corners(row_w + 12) - ow, rl = corners(row_w + 24) - ow;
            const f4 pu = corners(row_u) - ou + su * pl, pv = corners(row_v) - ov + sv * pl;
            const f4 qu = corners(row_u + 12) - ou + su * ql, qv = corners(row_v + 12) - ov + sv * ql;
            const f4 ru = corners(row_u + 24) - ou + su * rl, rv = corners(row_v + 24) - ov + sv * rl;
            f4 a = ru * qv - rv * qu, b = pu * rv - pv * ru, g = qu * pv - qv * pu;
            const i4 is_flat = (a == 0.0f) | (b == 0.0f) | (g == 0.0f);
            if (__builtin_reduce_or(is_flat)) {
                auto wide = [](f4 x) { return __builtin_convertvector(x, d4); };
                auto narrow = [](d4 x) { return __builtin_convertvector(x, f4); };
                a = is_flat ? narrow(wide(ru) * wide(qv) - wide(rv) * wide(qu)) : a;
                b = is_flat ? narrow(wide(pu) * wide(rv) - wide(pv) * wide(ru)) : b;
                g = is_flat ? narrow(wide(qu) * wide(pv) - wide(qv) * wide(pu)) : g;
            }
            const f4 volume = a + b + g;
            const i4 is_left = (a < 0.0f) | (b < 0.0f) | (g < 0.0f), is_right = (a > 0.0f) | (b > 0.0f) | (g > 0.0f);
            const i4 is_hit = ~(is_left & is_right) & (volume != 0.0f);
            if (__builtin_reduce_or(is_hit)) {
                const f4 at = (a * (sw * pl) + b * (sw * ql) + g * (sw * rl)) / volume;
                i4 faces;
                memcpy(&faces, leaf + 36, 16);
                for (int k = 0; k < count; ++k) {
                    const float t = at[k];
                    if (is_hit[k] && t >= 0.0f && t <= nearest) {
                        const int face = faces[k];
                        FOUND
                    }
                }
            }
        }
"""

NEXT = """
        if (size == 0) { RETURN }
        node = stack[--size];
    }
"""

KEEP_NEAREST = "if (t < nearest || (nearest_face >= 0 && face < nearest_face)) { nearest = t; nearest_face = face; }"

RETURN_NEAREST = """
                unsigned bits;
                memcpy(&bits, &nearest, 4);
                return ((unsigned long long)bits << 32) | (unsigned)(nearest_face + 1);
"""

STOP_BEFORE_END = "if (t < nearest) return true;"


def _traversal(cuda_order: str, cpu_order: str, found: str, end: str) -> str:
    """Return the code of a traversal.

    Args:
        cuda_order: Code that pushes the children that the ray enters, on CUDA.
        cpu_order: The same on a CPU.
        found: Code for a face on the ray, up to the end so far.
        end: Code that returns when the stack is empty.
    """
    cuda = CUDA_BOXES + cuda_order + CUDA_LEAF.replace("FOUND", found)
    cpu = CPU_BOXES + cpu_order + CPU_LEAF.replace("FOUND", found)
    code = f"{RAY}#ifdef __CUDA_ARCH__\n{cuda}#else\n{cpu}#endif\n{NEXT.replace('RETURN', end)}"
    sizes = {"MAX_STACK": MAX_STACK, "NODE_NUMBERS": 4 * NODE_ROWS, "LEAF_NUMBERS": 4 * LEAF_ROWS}
    for name, size in sizes.items():
        code = code.replace(name, str(size))
    return code


@wp.func_native(_traversal(CUDA_ORDER, CPU_ORDER, KEEP_NEAREST, RETURN_NEAREST))
def traverse_nearest(
    nodes: wp.array[wp.vec4], leaves: wp.array[wp.vec4], root: int, origin: wp.vec3, direction: wp.vec3, t_max: float
) -> wp.uint64:
    """Return the nearest face on a ray: the bits of its distance, and below them its number + 1, 0 for a miss."""


@wp.func_native(_traversal(NO_ORDER, NO_ORDER, STOP_BEFORE_END, "return false;"))
def traverse_any(
    nodes: wp.array[wp.vec4], leaves: wp.array[wp.vec4], root: int, origin: wp.vec3, direction: wp.vec3, t_max: float
) -> bool:
    """Return whether a face lies on a ray before `t_max`."""


@wp.func
def nearest_face(tree: Tree, root: int, origin: wp.vec3, direction: wp.vec3, t_max: float) -> wp.uint64:
    """Return the nearest face of one mesh on a ray: the bits of its distance, and below them its number + 1, 0 for a
    miss."""
    if WIDE:
        found = traverse_nearest(tree.nodes, tree.leaves, root, origin, direction, t_max)
    else:
        found = mesh_nearest(tree.meshes[root], origin, direction, t_max)
    return found


@wp.func
def is_any_face(tree: Tree, root: int, origin: wp.vec3, direction: wp.vec3, t_max: float) -> bool:
    """Return whether a face of one mesh lies on a ray before `t_max`."""
    if WIDE:
        is_hit = traverse_any(tree.nodes, tree.leaves, root, origin, direction, t_max)
    else:
        is_hit = mesh_any(tree.meshes[root], origin, direction, t_max)
    return is_hit
