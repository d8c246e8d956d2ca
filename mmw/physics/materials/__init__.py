"""Describe materials: permittivity at radio frequencies, appearance in visible light and LiDAR reflectance.

The names below are loaded when they are first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mmw.physics.materials.itu_rows import RADIO_ROWS
    from mmw.physics.materials.layers import Layer
    from mmw.physics.materials.material import Material, RadioMaterial
    from mmw.physics.materials.permittivity import relative_permittivity
    from mmw.physics.materials.scattering_patterns import register_scattering_pattern

__all__ = ["RADIO_ROWS", "Layer", "Material", "RadioMaterial", "register_scattering_pattern", "relative_permittivity"]

_HOME = {
    "RADIO_ROWS": "itu_rows",
    "Layer": "layers",
    **dict.fromkeys(("Material", "RadioMaterial"), "material"),
    "relative_permittivity": "permittivity",
    "register_scattering_pattern": "scattering_patterns",
}
"""Name -> module that defines it."""


if not TYPE_CHECKING:  # checkers of types would take any name as there

    def __getattr__(name: str) -> Any:
        if name not in _HOME:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
