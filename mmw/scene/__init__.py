"""Hold scenes: worlds with actors, on the host and on a device.

The names below are loaded when they are first used, so that `import mmw.scene` stays light.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mmw.scene.loading import load_scene
    from mmw.scene.material_handle import MaterialHandle
    from mmw.scene.object_handle import ObjectHandle
    from mmw.scene.radio_devices import Receiver, Transmitter
    from mmw.scene.ray_casting import RayHits
    from mmw.scene.scene import Scene

__all__ = ["MaterialHandle", "ObjectHandle", "RayHits", "Receiver", "Scene", "Transmitter", "load_scene"]

_HOME = {
    "MaterialHandle": "material_handle",
    "ObjectHandle": "object_handle",
    "RayHits": "ray_casting",
    "Receiver": "radio_devices",
    "Scene": "scene",
    "Transmitter": "radio_devices",
    "load_scene": "loading",
}
"""Name -> module that defines it."""


if not TYPE_CHECKING:  # checkers of types would take any name as there

    def __getattr__(name: str) -> Any:
        if name in _HOME:
            return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
