"""Read UsdPreviewSurface with UsdUVTexture as an `Appearance`, in the selected weather.

Every input of UsdPreviewSurface but `occlusion` and `displacement`, each as a number or
from a texture; `clearcoat`, `ior` and `specularColor` as numbers, is read. A node that is not read is named in a
note, and the input's own number is drawn. UsdPreviewSurface and its nodes: https://openusd.org/release/spec_usdpreviewsurface.html
"""

from dataclasses import dataclass, field

import numpy as np
from pxr import Usd, UsdShade

from mmw.core.errors import InputError
from mmw.physics.materials.appearance import LAMPS, Appearance, TextureUse, Wrap
from mmw.usd.material_library import LAMP
from mmw.usd.prim_values import attribute_value, decimal, decimals

CUT_AT = 0.5
"""Opacity below which an opacity texture cuts a hole, where the material leaves the threshold out. Design value."""

DIELECTRIC_F0 = 0.04
"""Reflectance at normal incidence of refractive index 1.5 [-]: ((1.5 - 1) / (1.5 + 1))^2."""

DEFAULT_PRIMVAR = "st"
"""Texture coordinates of a mesh where no node names them."""

Color = tuple[float, float, float]
Notes = dict[str, None]
"""Notes for the user, one line each, in order and once."""

_NUMBERS = {"roughness": 0.5, "metallic": 0.0, "ior": 1.5, "opacity": 1.0, "opacityThreshold": 0.0, "clearcoat": 0.0,
            "clearcoatRoughness": 0.01}  # fmt: skip
"""Inputs of UsdPreviewSurface that are one number, and its defaults."""

_TEXTURED = {"color": "diffuseColor", "emission": "emissiveColor", "roughness": "roughness", "metallic": "metallic",
             "normal": "normal", "opacity": "opacity"}  # fmt: skip
"""Texture of an `Appearance` -> input of UsdPreviewSurface that it comes from."""

_CHANNELS = {"rgb": 0, "r": 0, "g": 1, "b": 2, "a": 3}


@dataclass
class _Shader:
    """One UsdPreviewSurface while it is read."""

    prim: Usd.Prim
    shader: UsdShade.Shader
    display_color: Color | None
    notes: Notes
    varnames: dict[str, None] = field(default_factory=dict)

    def note(self, text: str) -> None:
        """Note something about the material."""
        self.notes[f"material {self.prim.GetPath()}: {text}"] = None

    def read(self, name: str) -> tuple[object, TextureUse | None]:
        """Return the number or color that an input has, or would have without its texture; and the texture."""
        port = self.shader.GetInput(name)
        if not port:
            return None, None
        producers = UsdShade.Utils.GetValueProducingAttributes(port)
        if not producers:
            return port.Get(), None
        source = producers[0]
        if not UsdShade.Output.IsOutput(source):
            return source.Get(), None
        node, plain = UsdShade.Shader(source.GetPrim()), port.Get()
        kind = node.GetIdAttr().Get() or ""
        if kind == "UsdUVTexture":
            use, fallback = self.texture(node, name, source.GetBaseName())
            return plain if fallback is None else fallback, use
        if kind.startswith("UsdPrimvarReader_"):
            if name == "diffuseColor" and _input(node, "varname", "") == "displayColor" and self.display_color:
                return self.display_color, None
            fallback = _input(node, "fallback", None)
            plain = plain if fallback is None else fallback
        drawn = "its default" if plain is None else _text(plain)
        self.note(f"{name} comes from {_name(node)} ({node.GetPath()}), which is not read; {drawn} is drawn")
        return plain, None

    def texture(self, node: UsdShade.Shader, name: str, output: str) -> tuple[TextureUse, object]:
        """Return how an input reads a UsdUVTexture, and what it has where the texture is missing, None for its own."""
        port = node.GetInput("file")
        attribute = _producer(port)
        asset = attribute.Get() if attribute else None
        path = str(asset.resolvedPath or asset.path) if asset else ""
        is_color = name in ("diffuseColor", "emissiveColor")
        space = str(_input(node, "sourceColorSpace", "auto"))
        if space == "auto" and attribute and attribute.GetColorSpace():
            space = {"srgb": "sRGB", "srgb_rec709_scene": "sRGB"}.get(attribute.GetColorSpace().lower(), "raw")
        is_srgb = {"sRGB": True, "raw": False}.get(space, None if is_color else False)
        fallback = _input(node, "fallback", None)
        channel = _CHANNELS.get(output, 0)
        if fallback is not None:
            fallback = tuple(fallback)[:3] if is_color or name == "normal" else fallback[channel]
        row_u, row_v = self.coordinates(node)
        wrap = (self.wrap(node, "wrapS"), self.wrap(node, "wrapT"))
        scale, bias = (
            tuple(map(decimal, _input(node, key, (value,) * 4))) for key, value in (("scale", 1.0), ("bias", 0.0))
        )
        return TextureUse(path, is_srgb, channel, wrap, scale, bias, row_u, row_v), fallback

    def wrap(self, node: UsdShade.Shader, name: str) -> Wrap:
        """Return a wrap mode; files that are read hold no wrap metadata, and without it a texture repeats."""
        value = str(_input(node, name, "useMetadata"))
        return value if value in ("clamp", "mirror", "black") else "repeat"

    def coordinates(self, node: UsdShade.Shader) -> tuple[Color, Color]:
        """Return the rows that make a texture's u and v of the mesh's coordinates, through all UsdTransform2d."""
        matrix = np.eye(3)
        while True:
            attribute = _producer(node.GetInput("in" if _id(node) == "UsdTransform2d" else "st"))
            if not attribute or not UsdShade.Output.IsOutput(attribute):
                break
            node = UsdShade.Shader(attribute.GetPrim())
            if _id(node) == "UsdTransform2d":
                matrix = matrix @ _transform(node)
                continue
            if _id(node).startswith("UsdPrimvarReader_"):
                self.varnames[str(_input(node, "varname", "") or "st")] = None
            else:
                self.note(
                    f"texture coordinates come from {_name(node)} ({node.GetPath()}), which is not read; those of the "
                    "mesh are drawn"
                )
            break
        return decimals(matrix[0]), decimals(matrix[1])


def _transform(node: UsdShade.Shader) -> np.ndarray:
    """Return a UsdTransform2d as matrix [3, 3] for columns (s, t, 1): scale, then turn counter-clockwise, then move."""
    angle = np.deg2rad(float(_input(node, "rotation", 0.0)))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    matrix = np.eye(3)
    matrix[:2, :2] = turn * np.asarray(tuple(_input(node, "scale", (1.0, 1.0))))
    matrix[:2, 2] = tuple(_input(node, "translation", (0.0, 0.0)))
    return matrix


def read_appearance(prim: Usd.Prim, notes: Notes, display_color: Color | None = None) -> Appearance:
    """Return the appearance of a material in the selected weather.

    Textures whose path does not resolve stay in it; their loader reports them. Opacity textures cut holes, at 0.5 where
    `opacityThreshold` is left out. With `useSpecularWorkflow`, a gray `specularColor` up to 0.2 becomes the
    refractive index of a dielectric; a brighter or colored one becomes a metal as `metallic_workflow` says.

    Args:
        prim: The Material prim.
        notes: Receives notes for the user.
        display_color: Color of the mesh, drawn where the material has no UsdPreviewSurface.
    """
    lamp = attribute_value(prim, LAMP) or "none"
    if lamp not in LAMPS:
        raise InputError(f"{prim.GetPath()}: {LAMP} = {lamp!r}; needed is one of {', '.join(LAMPS)}; correct it")
    plain = Appearance(color=display_color or Appearance.color, lamp=lamp, prim_path=str(prim.GetPath()))
    source = surface_shader(prim)
    shader = _Shader(prim, source, display_color, notes)
    if not source or _id(source) != "UsdPreviewSurface":
        found = (
            f"surface shader {_name(source)} ({source.GetPath()}) is not read" if source else "has no surface shader"
        )
        shader.note(f"{found}; needed is UsdPreviewSurface; drawn in {_text(plain.color)}")
        return plain
    values = {name: shader.read(name) for name in (*_TEXTURED.values(), *_NUMBERS)}
    numbers = {name: _number(values[name][0], default) for name, default in _NUMBERS.items()}
    for name in ("ior", "opacityThreshold", "clearcoat", "clearcoatRoughness"):
        if values[name][1] is not None:
            shader.note(f"the texture of {name} is not read; {numbers[name]:g} is drawn")
    color = _color(values["diffuseColor"][0], (0.18, 0.18, 0.18))
    metallic, ior = numbers["metallic"], numbers["ior"]
    if shader.read("useSpecularWorkflow")[0] == 1:
        specular, texture = shader.read("specularColor")
        specular = _color(specular, (0.0, 0.0, 0.0))
        if texture is not None:
            shader.note(f"the texture of specularColor is not read; {_text(specular)} is drawn")
        color, metallic, ior = metallic_workflow(color, specular, values["diffuseColor"][1] is not None)
        values["metallic"] = (metallic, None)
    threshold = numbers["opacityThreshold"]
    if values["opacity"][1] is not None and threshold <= 0.0:
        threshold = CUT_AT
        shader.note(f"opacity is a texture without opacityThreshold; it cuts holes where it is below {CUT_AT}")
    if len(shader.varnames) > 1:
        first, *others = shader.varnames
        shader.note(f"textures use several coordinates; {first} is read for {', '.join(others)} too")
    return Appearance(
        color=color,
        emission=_color(values["emissiveColor"][0], (0.0, 0.0, 0.0)),
        roughness=numbers["roughness"],
        metallic=metallic,
        ior=max(ior, 1.0),
        opacity=numbers["opacity"],
        opacity_threshold=threshold,
        clearcoat=numbers["clearcoat"],
        clearcoat_roughness=numbers["clearcoatRoughness"],
        lamp=lamp,
        prim_path=str(prim.GetPath()),
        **{f"{name}_texture": values[source][1] for name, source in _TEXTURED.items()},
    )


def metallic_workflow(diffuse: Color, specular: Color, is_textured: bool) -> tuple[Color, float, float]:
    """Return base color, metallic and refractive index of the diffuse and specular colors of the specular workflow.

    A gray specular color up to 0.2, or any beside a diffuse texture, is the reflectance F0 of a dielectric of index
    (1 + sqrt F0) / (1 - sqrt F0). Otherwise metallic m solves, by brightness (largest channel) d and s,
    0.04 (1 - m) + b m = s and b (1 - m) 0.96 = d (1 - s) with base color b, which then goes from the diffuse to the
    specular color with m squared.

    Source: Khronos glTF, "KHR_materials_pbrSpecularGlossiness", its conversion between the two workflows.
    """
    d, s = max(diffuse), max(specular)
    if is_textured or (s <= 0.2 and s - min(specular) <= 0.02):
        root = float(np.sqrt(min(s, 0.9)))
        return diffuse, 0.0, (1.0 + root) / (1.0 - root)
    a, c = DIELECTRIC_F0, DIELECTRIC_F0 - s
    b = d * (1.0 - s) / (1.0 - a) + s - 2.0 * a
    metal = float(np.clip((-b + np.sqrt(max(b * b - 4.0 * a * c, 0.0))) / (2.0 * a), 0.0, 1.0))
    as_dielectric = np.array(diffuse) * (1.0 - s) / ((1.0 - a) * max(1.0 - metal, 1e-6))
    as_metal = (np.array(specular) - a * (1.0 - metal)) / max(metal, 1e-6)
    base = np.clip(as_dielectric + (as_metal - as_dielectric) * metal**2, 0.0, 1.0)
    return decimals(base), metal, 1.5


def surface_shader(prim: Usd.Prim) -> UsdShade.Shader | None:
    """Return the shader of a material's surface: the one for all renderers, else that of any; None if it has none."""
    material = UsdShade.Material(prim)
    shader = material.ComputeSurfaceSource()[0]
    if shader:
        return shader
    for output in material.GetSurfaceOutputs():
        context = output.GetBaseName().removesuffix("surface").strip(":")
        shader = material.ComputeSurfaceSource(context)[0] if context else None
        if shader:
            return shader
    return None


def texture_primvar(prim: Usd.Prim) -> tuple[str, bool]:
    """Return the primvar that a material's textures read, `st` where they name none, and whether its shader is read."""
    source = surface_shader(prim)
    if not source or _id(source) != "UsdPreviewSurface":
        return DEFAULT_PRIMVAR, False
    shader = _Shader(prim, source, None, {})
    for port in source.GetInputs():
        shader.read(port.GetBaseName())
    return next(iter(shader.varnames), DEFAULT_PRIMVAR), True


def _producer(port: UsdShade.Input | None) -> Usd.Attribute | None:
    """Return the attribute that gives an input its value: an own one, or an output of a node."""
    producers = UsdShade.Utils.GetValueProducingAttributes(port) if port else ()
    return producers[0] if producers else None


def _input(node: UsdShade.Shader, name: str, default: object):
    attribute = _producer(node.GetInput(name))
    value = attribute.Get() if attribute and not UsdShade.Output.IsOutput(attribute) else None
    return default if value is None else value


def _id(node: UsdShade.Shader) -> str:
    return str(node.GetIdAttr().Get() or "")


def _name(node: UsdShade.Shader) -> str:
    """Return the kind of a node, by id or MDL name."""
    return _id(node) or attribute_value(node.GetPrim(), "info:mdl:sourceAsset:subIdentifier") or "without info:id"


def _number(value: object, default: float) -> float:
    return decimal(value) if isinstance(value, (int, float)) else default


def _color(value: object, default: Color) -> Color:
    try:
        return decimals(tuple(value))  # pyright: ignore[reportArgumentType] - checked by trying
    except (TypeError, ValueError):
        return default


def _text(value: object) -> str:
    """Return a number or color as a message shows it."""
    return f"{value:g}" if isinstance(value, (int, float)) else f"({', '.join(f'{v:g}' for v in tuple(value))})"  # pyright: ignore
