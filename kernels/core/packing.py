"""Unit vectors in 32 bits."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})


@wp.func
def octahedral(vector: wp.vec3) -> wp.vec2:
    """Return the octahedral projection of a vector, -1 to 1 each: the lower half is folded outwards.

    Source: Z. H. Cigolle et al., "A Survey of Efficient Representations for Independent Unit Vectors", JCGT 3(2), 2014.
    """
    scale = 1.0 / (wp.abs(vector[0]) + wp.abs(vector[1]) + wp.abs(vector[2]))
    x = vector[0] * scale
    y = vector[1] * scale
    if vector[2] < 0.0:
        folded = (1.0 - wp.abs(y)) * wp.where(x >= 0.0, 1.0, -1.0)
        y = (1.0 - wp.abs(x)) * wp.where(y >= 0.0, 1.0, -1.0)
        x = folded
    return wp.vec2(x, y)


@wp.func
def pack_unit(vector: wp.vec3) -> wp.uint32:
    """Return a unit vector in 32 bits, within 4e-5: its octahedral projection in steps of 2 / 65,534."""
    at = octahedral(vector)
    a = wp.uint32(int(wp.rint(at[0] * 32767.0)) + 32768)
    b = wp.uint32(int(wp.rint(at[1] * 32767.0)) + 32768)
    return (a << wp.uint32(16)) | b


@wp.func
def unpack_unit(packed: wp.uint32) -> wp.vec3:
    """Return the unit vector that `pack_unit` packed."""
    x = float(int(packed >> wp.uint32(16)) - 32768) / 32767.0
    y = float(int(packed & wp.uint32(65535)) - 32768) / 32767.0
    z = 1.0 - wp.abs(x) - wp.abs(y)
    fold = wp.max(-z, 0.0)
    x += wp.where(x >= 0.0, -fold, fold)
    y += wp.where(y >= 0.0, -fold, fold)
    return wp.normalize(wp.vec3(x, y, z))
