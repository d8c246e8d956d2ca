"""Register the codeless USD schema `MmwRadioMaterialAPI` and name its attributes."""

import re
from dataclasses import dataclass

from pxr import Plug, Sdf

from mmw.core.errors import InputError
from mmw.core.resources import assets_dir
from mmw.physics.materials.material import RadioMaterial, file_values

RADIO_API = "MmwRadioMaterialAPI"
"""Name of the applied API schema, as in a prim's `apiSchemas`."""

PLUGIN_NAME = "mmwSchema"
"""Name of the plugin in `plugInfo.json`."""


@dataclass(frozen=True)
class RadioAttribute:
    """One attribute of the schema."""

    name: str
    """Full attribute name, such as `mmw:radio:thickness`."""
    type_name: Sdf.ValueTypeName
    variability: Sdf.Variability
    is_optional: bool = False
    """True if a material that does not need it leaves it out."""


_TYPES = {
    str: (Sdf.ValueTypeNames.Token, Sdf.VariabilityUniform),
    float: (Sdf.ValueTypeNames.Float, Sdf.VariabilityVarying),
    int: (Sdf.ValueTypeNames.Int, Sdf.VariabilityVarying),
    list: (Sdf.ValueTypeNames.StringArray, Sdf.VariabilityUniform),
}

_OPTIONAL = ("rms_height", "layers")
"""Fields that few materials have."""

RADIO_ATTRIBUTES = {
    name: RadioAttribute(
        "mmw:radio:" + re.sub("_(.)", lambda match: match[1].upper(), name), *_TYPES[type(value)], name in _OPTIONAL
    )
    for name, value in file_values(RadioMaterial("constant")).items()
}
"""Field of `mmw.physics.materials.material.RadioMaterial` -> attribute of the Material prim."""


def register() -> None:
    """Register the schema with USD in this process; a second call changes nothing.

    Call it before the first stage is opened: USD builds its table of schemas once. Without it authored values still
    read, but validation cannot check them and fallbacks do not resolve.

    Raises:
        InputError: If the schema's files are missing from the installation.
    """
    registry, folder = Plug.Registry(), assets_dir() / "schema"
    if registry.GetPluginWithName(PLUGIN_NAME) is None:
        registry.RegisterPlugins(str(folder))
    if registry.GetPluginWithName(PLUGIN_NAME) is None:
        raise InputError(
            f"USD schema {RADIO_API}: no plugin {PLUGIN_NAME!r} in {folder}; plugInfo.json and "
            "generatedSchema.usda are needed there; reinstall mmw"
        )
