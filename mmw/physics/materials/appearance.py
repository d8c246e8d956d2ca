"""Describe the appearance of a material for the RGB camera by numbers and textures. Linear colors, 0 to 1."""

from dataclasses import dataclass, field
from typing import Literal

Wrap = Literal["repeat", "clamp", "mirror", "black"]
Lamp = Literal["none", "headlight", "taillight", "street", "brake"]

LAMPS: tuple[Lamp, ...] = ("none", "headlight", "taillight", "street", "brake")
"""Kinds of lamp by number. A tail light burns where head lights do, and brighter while its vehicle brakes; a brake
light while its vehicle brakes alone, by the same gain over its emission."""


@dataclass(frozen=True)
class TextureUse:
    """One texture as one input of a material reads it."""

    file: str
    """Resolved asset path, which `pxr.Ar` opens; inside a package it has the form `file.usdz[image.png]`."""
    is_srgb: bool | None = False
    """True if the file holds sRGB values, which are decoded to linear ones; None: if it has 8-bit r, g and b."""
    channel: int = 0
    """Channel that a number is read from: 0 r, 1 g, 2 b, 3 a; colors and normals read rgb."""
    wrap: tuple[Wrap, Wrap] = ("repeat", "repeat")
    """Wrap modes along u and v, beyond the edges."""
    scale: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    """Multiplies the value read."""
    bias: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    """Added after the scale."""
    row_u: tuple[float, float, float] = (1.0, 0.0, 0.0)
    """Texture coordinate u = row_u . (s, t, 1) of the mesh's coordinates `st`."""
    row_v: tuple[float, float, float] = (0.0, 1.0, 0.0)
    """Texture coordinate v; v = 0 is the bottom row of the image."""


@dataclass(frozen=True)
class Appearance:
    """One material to the RGB camera: the inputs of UsdPreviewSurface that are drawn, and what mmw adds."""

    color: tuple[float, float, float] = (0.5, 0.5, 0.5)
    """Base color: reflected diffusely by a dielectric, specularly by a metal."""
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Emitted luminance over `EMISSION_CD_M2`; of a lamp, while it is on."""
    roughness: float = 0.5
    """Perceptual roughness r; GGX alpha is r^2."""
    metallic: float = 0.0
    ior: float = 1.5
    """Refractive index of a dielectric, which gives its reflectance at normal incidence."""
    opacity: float = 1.0
    """Below 1 the surface is glass: it mirrors by Fresnel's law, and what it lets through is its own dark color."""
    opacity_threshold: float = 0.0
    """Above 0 the opacity texture cuts holes: where it is lower, a ray of a camera passes."""
    clearcoat: float = 0.0
    clearcoat_roughness: float = 0.01
    color_texture: TextureUse | None = None
    emission_texture: TextureUse | None = None
    roughness_texture: TextureUse | None = None
    metallic_texture: TextureUse | None = None
    normal_texture: TextureUse | None = None
    opacity_texture: TextureUse | None = None
    lamp: Lamp = "none"
    has_uv: bool = True
    """True if the meshes have the texture coordinates; without them a texture is drawn as its mean."""
    prim_path: str = field(default="", compare=False)
    """Material prim, for messages; materials that differ in nothing else are one."""

    @property
    def textures(self) -> tuple[TextureUse, ...]:
        """The textures that it reads."""
        uses = (
            self.color_texture, self.emission_texture, self.roughness_texture, self.metallic_texture,
            self.normal_texture, self.opacity_texture,
        )  # fmt: skip
        return tuple(use for use in uses if use is not None)


GREY = Appearance()
"""Appearance of a material without one of its own."""

EMISSION_CD_M2 = 1000.0
"""Luminance of an emission of 1 [cd/m2]: UsdPreviewSurface gives emission without a unit; design value, a bright
screen."""
