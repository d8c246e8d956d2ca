"""The codeless USD schema `MmwRadioMaterialAPI`: its name, its attributes, and how USD gets to know it."""

from dataclasses import dataclass
from pathlib import Path

from pxr import Plug, Sdf

from mmw.core.errors import InputError
from mmw.core.resources import assets_dir

RADIO_API = "MmwRadioMaterialAPI"
"""Name of the applied API schema, as it stands in a prim's `apiSchemas`."""

PLUGIN_NAME = "mmwSchema"
"""Name of the plugin in `plugInfo.json`."""


@dataclass(frozen=True)
class RadioAttribute:
    """One attribute of the schema."""

    name: str
    """Full attribute name, such as `mmw:radio:thickness`."""
    type_name: Sdf.ValueTypeName
    variability: Sdf.Variability


RADIO_ATTRIBUTES = {
    "model": RadioAttribute("mmw:radio:model", Sdf.ValueTypeNames.Token, Sdf.VariabilityUniform),
    "itu": RadioAttribute("mmw:radio:itu", Sdf.ValueTypeNames.Token, Sdf.VariabilityUniform),
    "relative_permittivity": RadioAttribute(
        "mmw:radio:relativePermittivity", Sdf.ValueTypeNames.Float, Sdf.VariabilityVarying
    ),
    "conductivity": RadioAttribute("mmw:radio:conductivity", Sdf.ValueTypeNames.Float, Sdf.VariabilityVarying),
    "thickness": RadioAttribute("mmw:radio:thickness", Sdf.ValueTypeNames.Float, Sdf.VariabilityVarying),
    "scattering": RadioAttribute("mmw:radio:scattering", Sdf.ValueTypeNames.Float, Sdf.VariabilityVarying),
    "xpd": RadioAttribute("mmw:radio:xpd", Sdf.ValueTypeNames.Float, Sdf.VariabilityVarying),
    "scattering_pattern": RadioAttribute(
        "mmw:radio:scatteringPattern", Sdf.ValueTypeNames.Token, Sdf.VariabilityUniform
    ),
    "alpha_r": RadioAttribute("mmw:radio:alphaR", Sdf.ValueTypeNames.Int, Sdf.VariabilityVarying),
    "alpha_i": RadioAttribute("mmw:radio:alphaI", Sdf.ValueTypeNames.Int, Sdf.VariabilityVarying),
    "lobe_share": RadioAttribute("mmw:radio:lobeShare", Sdf.ValueTypeNames.Float, Sdf.VariabilityVarying),
}
"""Field of `mmw.physics.materials.material.RadioMaterial` -> attribute of the Material prim."""


def schema_dir() -> Path:
    """Return the folder that holds `plugInfo.json` and `generatedSchema.usda`."""
    return assets_dir() / "schema"


def register() -> None:
    """Make the schema known to USD in this process; a second call changes nothing.

    Call it before the first stage is opened: USD builds its table of schemas once, when first asked for one. Without it
    a stage still opens and its authored values still read, but validation cannot check them and fallbacks do not
    resolve.

    Raises:
        InputError: If the schema's files are missing from the installation.
    """
    registry = Plug.Registry()
    if registry.GetPluginWithName(PLUGIN_NAME) is None:
        registry.RegisterPlugins(str(schema_dir()))
    if registry.GetPluginWithName(PLUGIN_NAME) is None:
        raise InputError(
            f"USD schema {RADIO_API}: no plugin {PLUGIN_NAME!r} in {schema_dir()}; plugInfo.json and "
            "generatedSchema.usda are needed there; reinstall mmw"
        )
