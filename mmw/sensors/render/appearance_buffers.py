"""Load the appearance of a scene on the device: corners of faces, textures, and materials of each weather.

Textures lie one after the other in a flat array of half floats with all their mip levels, and
`kernels/shading/texture.py` filters them. `wp.Texture2D` would filter in hardware on CUDA; the array makes the same
picture on every device, sets no limit to number and size of textures, and one launch can read any of them by a number
that a material holds.
"""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import warp as wp

from mmw.core.errors import InputError
from mmw.kernels.shading import structs as structs
from mmw.physics.materials.appearance import LAMPS, Appearance, TextureUse
from mmw.physics.materials.material import POROUS_BASES, Material
from mmw.scene.device_scene import DeviceScene
from mmw.usd.textures import Image, MissingImageError, decode_image, mip_levels

PUDDLE_BASES = frozenset({"asphalt", "concrete", "stone", "soil", "dirt", "mud", "gravel"})
"""Non-visual bases of ground on which water stands where it is level, painted or not: markings lie in the puddle too.
A lawn drains, and brick, wood and bark are no ground. Design choice."""

MAGENTA = (1.0, 0.0, 1.0, 1.0)
"""Color of faces whose texture is missing, to make them visible (`debug`)."""

WRAPS = ("repeat", "clamp", "mirror", "black")
"""Wraps by their number in the kernel."""

TEXTURED = ("color", "emission", "roughness", "metallic", "normal", "opacity")
"""Inputs of a appearance that a texture can give: fields `<name>_texture`."""


@dataclass
class _Textures:
    """Images that are loaded, each once for every kind of decoding."""

    debug: bool
    notes: dict[str, None] = field(default_factory=dict)
    row_of: dict[tuple[str, bool | None], int | None] = field(default_factory=dict)
    row_of_content: dict[tuple[tuple[int, ...], bytes], int] = field(default_factory=dict)
    levels: list[list[np.ndarray]] = field(default_factory=list)

    def row(self, use: TextureUse, appearance: Appearance) -> int | None:
        """Return the row of a texture, which is loaded if it is new; None where it is missing."""
        key = use.file, use.is_srgb
        if key not in self.row_of:
            self.row_of[key] = self._load(use, appearance)
        return self.row_of[key]

    def _load(self, use: TextureUse, appearance: Appearance) -> int | None:
        where = appearance.prim_path or "a material"
        try:
            image = decode_image(use.file, use.is_srgb, where)
        except MissingImageError as error:
            drawn = "magenta" if self.debug else "its fallback"
            self.notes[f"{error}; {drawn} is drawn"] = None
            if not self.debug:
                return None
            texel = np.array(MAGENTA, dtype=np.float32).reshape(1, 1, 4)
            image = Image(texel, texel.astype(np.float16))
        if image.note:
            self.notes[image.note] = None
        content = image.halves.shape, hashlib.sha256(np.ascontiguousarray(image.halves)).digest()
        if content not in self.row_of_content:  # towns hold copies of one library
            self.row_of_content[content] = len(self.levels)
            smaller = [level.astype(np.float16) for level in mip_levels(image.values)[1:]]
            self.levels.append([image.halves, *smaller])
        return self.row_of_content[content]

    def mean(self, row: int) -> np.ndarray:
        """Return the mean value of a texture, shape [4]."""
        return self.levels[row][-1].reshape(4).astype(np.float64)


class AppearanceArrays:
    """Corners, textures and appearances of one scene on its device, for every weather that the scene was read for.

    Attributes:
        notes: Notes for the user: textures that are missing or were made smaller, one line each.
    """

    def __init__(self, scene: DeviceScene, *, debug: bool = False):
        """Load corners and textures.

        Raises:
            InputError: If a texture file is there and cannot be decoded.
        """
        self._device = scene.device
        self._materials = scene.arrays.materials
        self._textures = _Textures(debug)
        self._uses: dict[TextureUse, int] = {}
        self._rows: dict[str, list[structs.Appearance]] = {}
        for weather, materials in self._materials.items():
            self._rows[weather] = [self._appearance(material) for material in materials]
        self._struct = self._upload(scene)
        self._of_weather: dict[str, structs.AppearanceTable] = {}

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user, one line each."""
        return tuple(self._textures.notes)

    @property
    def alpha_cutouts(self) -> "structs.AppearanceTable | None":
        """Appearance whose holes all rays of cameras pass, that of the scene's first weather; None without any hole."""
        first = self.for_weather(next(iter(self._rows)))
        return first if first.has_holes else None

    def for_weather(self, name: str) -> structs.AppearanceTable:
        """Return the kernel struct of one weather; all weathers share corners and textures.

        Raises:
            InputError: If the scene was not read for the weather.
        """
        if name not in self._rows:
            known = ", ".join(self._rows) or "none"
            raise InputError(f"weather {name!r}: the scene has materials for {known}; read it for this weather too")
        if name not in self._of_weather:
            shared, struct = self._struct, structs.AppearanceTable()
            for key in structs.AppearanceTable.vars:
                setattr(struct, key, getattr(shared, key))
            struct.appearances = self._structs(self._rows[name], structs.Appearance)
            self._of_weather[name] = struct
        return self._of_weather[name]

    def _structs(self, rows: Sequence, dtype) -> wp.array:
        return wp.array(rows, dtype=dtype, device=self._device) if rows else wp.empty(0, dtype, device=self._device)

    def _upload(self, scene: DeviceScene) -> structs.AppearanceTable:
        arrays, struct = scene.arrays, structs.AppearanceTable()
        models = arrays.models

        def corners(values: np.ndarray, dtype) -> wp.array:
            return wp.array(np.ascontiguousarray(values, dtype=np.float32), dtype=dtype, device=self._device)

        struct.town_uv = corners(arrays.uv, wp.vec2)
        struct.town_normal = corners(arrays.normals, wp.vec3)
        struct.model_uv = corners(np.concatenate([np.zeros((0, 3, 2))] + [m.uv for m in models]), wp.vec2)
        struct.model_normal = corners(np.concatenate([np.zeros((0, 3, 3))] + [m.normals for m in models]), wp.vec3)
        textures, first = [], 0
        texels = [np.zeros((0, 4), dtype=np.float16)]
        for levels in self._textures.levels:
            texture = structs.Texture()
            texture.first, texture.levels = first, len(levels)
            texture.height, texture.width = levels[0].shape[:2]
            texels += [level.reshape(-1, 4) for level in levels]
            first += sum(level.shape[0] * level.shape[1] for level in levels)
            texture.mean = first - 1
            textures.append(texture)
        if first >= 2**31:
            raise InputError(f"textures: {first} texels; fewer than 2^31 can be numbered; use smaller textures")
        struct.textures = self._structs(textures, structs.Texture)
        words = np.concatenate(texels).view(np.uint64).reshape(-1)
        struct.texels = wp.array(words, dtype=wp.uint64, device=self._device)
        appearances = [appearance for rows in self._rows.values() for appearance in rows]
        struct.has_emission_textures = any(appearance.emission_texture >= 0 for appearance in appearances)
        struct.has_holes = any(appearance.opacity_threshold > 0.0 for appearance in appearances)
        struct.uses = self._structs([self._use_struct(use) for use in self._uses], structs.TextureUse)
        return struct

    def _use_struct(self, use: TextureUse) -> structs.TextureUse:
        struct = structs.TextureUse()
        struct.texture = self._textures.row_of[use.file, use.is_srgb]
        struct.row_u, struct.row_v = wp.vec3(*use.row_u), wp.vec3(*use.row_v)
        struct.scale, struct.bias = wp.vec4(*use.scale), wp.vec4(*use.bias)
        struct.channel = use.channel
        struct.wrap_u, struct.wrap_v = (WRAPS.index(wrap) for wrap in use.wrap)
        return struct

    def _appearance(self, material: Material) -> structs.Appearance:
        """Return the kernel struct of a material; its textures are loaded."""
        appearance, struct = material.appearance, structs.Appearance()
        numbers = {name: getattr(appearance, name) for name in TEXTURED if name != "normal"}
        for name in TEXTURED:
            row, use = -1, getattr(appearance, f"{name}_texture")
            texture = self._textures.row(use, appearance) if use is not None else None
            if texture is not None and appearance.has_uv:
                row = self._uses.setdefault(use, len(self._uses))
            elif use is not None and texture is not None and name != "normal":
                mean = self._textures.mean(texture) * use.scale + use.bias
                is_color = name in ("color", "emission")
                numbers[name] = tuple(mean[:3].tolist()) if is_color else float(mean[use.channel])
            setattr(struct, f"{name}_texture", row)
        struct.color = wp.vec3(*np.clip(numbers["color"], 0.0, 1.0))
        struct.emission = wp.vec3(*np.maximum(numbers["emission"], 0.0))
        for name in ("roughness", "metallic", "opacity"):
            setattr(struct, name, float(np.clip(numbers[name], 0.0, 1.0)))
        has_holes = struct.opacity_texture >= 0 or appearance.opacity_texture is None
        struct.opacity_threshold = appearance.opacity_threshold if has_holes else 0.0  # a lost texture cuts nothing
        if appearance.opacity_threshold > 0.0 and not has_holes:
            struct.opacity = 1.0
        struct.normal_reflectance = ((appearance.ior - 1.0) / (appearance.ior + 1.0)) ** 2
        struct.clearcoat, struct.clearcoat_roughness = appearance.clearcoat, appearance.clearcoat_roughness
        struct.lamp = LAMPS.index(appearance.lamp)
        is_open = material.coating == "none" and not material.is_retroreflective
        struct.is_porous = material.nonvisual_base in POROUS_BASES and is_open
        struct.holds_puddles = material.nonvisual_base in PUDDLE_BASES
        return struct


def alpha_cutouts(scene: DeviceScene) -> "structs.AppearanceTable | None":
    """Return the appearance of a scene with cut-out textures, for cameras without colors; None without any.

    Nothing is loaded where no material has such a texture.
    """
    found = [material.appearance for material in next(iter(scene.arrays.materials.values()), ())]
    if not any(entry.opacity_threshold > 0.0 and entry.opacity_texture for entry in found):
        return None
    return AppearanceArrays(scene).alpha_cutouts
