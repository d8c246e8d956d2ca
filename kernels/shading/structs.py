"""Define types of the RGB camera: appearances of materials, textures, corners of faces, samples of an image."""

import warp as wp


@wp.struct
class Texture:
    """One image with its mip levels in `AppearanceTable.texels`; level k has max(w >> k, 1) x max(h >> k, 1) texels."""

    first: int
    """First texel of level 0; the levels follow one another, row 0 at the bottom (v = 0)."""
    mean: int
    """The one texel of the last level."""
    width: int
    height: int
    levels: int


@wp.struct
class TextureUse:
    """One texture as one input of a appearance reads it; see `mmw.physics.materials.appearance.TextureUse`."""

    texture: int
    row_u: wp.vec3
    row_v: wp.vec3
    scale: wp.vec4
    bias: wp.vec4
    channel: int
    wrap_u: int
    """0 repeat, 1 clamp, 2 mirror, 3 black."""
    wrap_v: int


@wp.struct
class Appearance:
    """One material; see `mmw.physics.materials.appearance.Appearance`. A texture use of -1 is none."""

    color: wp.vec3
    emission: wp.vec3
    roughness: float
    metallic: float
    normal_reflectance: float
    """Reflectance of a dielectric at normal incidence, ((n - 1) / (n + 1))^2 [-]."""
    opacity: float
    opacity_threshold: float
    clearcoat: float
    clearcoat_roughness: float
    color_texture: int
    emission_texture: int
    roughness_texture: int
    metallic_texture: int
    normal_texture: int
    opacity_texture: int
    lamp: int
    """Index into `mmw.physics.materials.appearance.LAMPS`."""
    is_porous: wp.bool
    """True if it soaks up water and darkens (`mmw.physics.materials.material.POROUS_BASES`, no coating)."""
    holds_puddles: wp.bool
    """True if water stands on it where it is level: ground that is no lawn."""


@wp.struct
class AppearanceTable:
    """AppearanceTable of a scene: all that a camera needs beyond its shape. Face rows are those of `Scene.town_*` and
    `Scene.model_*`."""

    town_uv: wp.array2d[wp.vec2]
    """Texture coordinates `st` of the corners of each town face, shape [M, 3]; zeros where a mesh has none."""
    town_normal: wp.array2d[wp.vec3]
    """Normals at the corners of each town face, scene frame, shape [M, 3]; zero where the face is flat."""
    model_uv: wp.array2d[wp.vec2]
    model_normal: wp.array2d[wp.vec3]
    """Like the town's, in the frame of the model."""
    appearances: wp.array[Appearance]
    """Appearance of each material id in one weather."""
    uses: wp.array[TextureUse]
    textures: wp.array[Texture]
    texels: wp.array[wp.uint64]
    """Linear values of all levels of all textures: r, g, b and a as half floats in one word, which is one load."""
    has_emission_textures: wp.bool
    """True if a appearance has an emission texture."""
    has_holes: wp.bool
    """True if a appearance cuts holes with its opacity texture."""


@wp.struct
class Samples:
    """Hits of the rays of an image, one row a sample: first the pixel centers of all views, row by row, then the
    further rays of pixels on edges (`Extras`)."""

    t: wp.array[float]
    """Distance along the unit ray [m], inf for a miss."""
    face: wp.array[int]
    """Face of the town or of the instance's model, -1 for a miss."""
    instance: wp.array[int]
    """Instance, -1 for the town or a miss."""
    surface: wp.array[int]
    """Surface id, -1 for a miss; may be empty, as may be `normal`."""
    normal: wp.array[wp.uint32]
    """Normal of the face, scene frame, turned against the ray, packed by `kernels.packing.pack_unit`."""


@wp.struct
class Extras:
    """The further rays of pixels on edges: K in each, rows `first + edge * K + k` of the samples.

    Lists have room for more rows than there are, and launches have threads for all of that room; threads beyond the
    number of rows, which only the device knows, do nothing.
    """

    first: int
    """Row of the first one: the number of pixel centers."""
    row: wp.array[int]
    """Row of the pixel's center, shape [E]."""
    count: wp.array[int]
    """Number of pixels on edges, shape [1]."""
    offset: wp.array[wp.vec2]
    """Place of the k-th ray from the pixel's center [px], shape [K]."""
    source: wp.array[int]
    """Row whose light each further ray brings, shape [E * K]: that of a pixel beside it which shows the same, or its
    own."""
    shaded: wp.array[int]
    """Rows of those that bring their own; while it is being found out whose light they bring, of those to trace."""
    shaded_count: wp.array[int]
    """Number of rows in `shaded`, shape [1]."""


MATT = wp.constant(wp.uint8(0))
"""Gloss of what reflects nothing sharply while it is dry, and of nothing."""
FAINT_COAT = wp.constant(wp.uint8(1))
"""Gloss of a smooth clear coat that is looked at so straight that it reflects no more than the blurred sky is worth."""
COATED = wp.constant(wp.uint8(2))
"""Gloss of a smooth clear coat over a rougher base."""
SMOOTH = wp.constant(wp.uint8(3))
"""Gloss of smooth glass and metal."""


@wp.struct
class Surfaces:
    """Surfaces of samples before any light: rows of the samples, or of what they reflect."""

    material: wp.array[int]
    color: wp.array[wp.uint64]
    """Linear base color and, fourth, roughness: four halves in one word, which is one load."""
    normal: wp.array[wp.uint32]
    """Shading normal, scene frame, packed by `kernels.packing.pack_unit`."""
    more: wp.array[wp.uint32]
    """Metallic and opacity: two halves in one word."""
    emission: wp.array[wp.uint64]
    """Emission, like `color`, of appearances with an emission texture; empty where no appearance has one."""
    gloss: wp.array[wp.uint8]
    """`MATT`, `FAINT_COAT`, `COATED` or `SMOOTH`."""


@wp.struct
class SurfacePoint:
    """A point of a surface as a camera shades it."""

    point: wp.vec3
    """Scene frame [m]."""
    normal: wp.vec3
    """Unit normal of the face, turned against the ray."""
    shading_normal: wp.vec3
    """Unit normal after interpolation and normal map, on the same side as `normal`."""
    material: int
    color: wp.vec3
    emission: wp.vec3
    roughness: float
    metallic: float
    opacity: float
