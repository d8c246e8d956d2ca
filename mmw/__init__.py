"""Generate and read multimodal wireless datasets.

`__all__` lists the public names, which are loaded at their first use. Sections of a configuration are in `mmw.config`,
sensors in `mmw.sensors`, and readers in `mmw.dataset`. `mmw.open` is the short name of `open_dataset`.
"""

import logging as _logging
from importlib import import_module as _import_module
from pathlib import Path as _Path
from typing import TYPE_CHECKING
from typing import Any as _Any

if TYPE_CHECKING:
    from mmw import config, dataset, sensors  # noqa: F401 - the packages of `_PACKAGES`
    from mmw.config import Config, load_config
    from mmw.core.errors import Error, InputError
    from mmw.dataset import Dataset, Frame, connect, open_dataset
    from mmw.dataset import open_dataset as open  # noqa: F401 - the short name
    from mmw.generation.run_config import generate
    from mmw.generation.simulation import Simulation
    from mmw.sensors import register_sensor

__all__ = [
    "Config", "Dataset", "Error", "Frame", "InputError", "Simulation", "connect", "generate", "load_config",
    "open_dataset", "register_sensor",
]  # fmt: skip

__version__ = "0.2.0"

_logging.getLogger(__name__).addHandler(_logging.NullHandler())  # whoever imports mmw decides where records go

_root = _Path(__file__).resolve().parent.parent
if (_root / "pyproject.toml").is_file():
    # Source checkout: kernels/, assets/ and configs/ sit beside this package; in a wheel they sit inside it.
    __path__.append(str(_root))


_HOME = {
    **dict.fromkeys(("Config", "load_config"), "mmw.config"),
    **dict.fromkeys(("Error", "InputError"), "mmw.core.errors"),
    **dict.fromkeys(("Dataset", "Frame", "connect", "open_dataset"), "mmw.dataset"),
    "Simulation": "mmw.generation.simulation",
    "generate": "mmw.generation.run_config",
    "register_sensor": "mmw.sensors",
}
"""Name -> module that defines it, so that `import mmw` stays light."""

_PACKAGES = ("config", "dataset", "sensors")
"""Public packages, imported at their first use as attributes of this one."""

_SHORT = {"open": "open_dataset"}
"""Short name -> name; not in `__all__`, so that `from mmw import *` replaces no built-in function."""


def __getattr__(name: str) -> _Any:
    name = _SHORT.get(name, name)
    if name in _PACKAGES:
        return _import_module(f"{__name__}.{name}")
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(_import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    loaded = {name for name in globals() if name[0] != "_"} - {"TYPE_CHECKING"}
    return sorted({*__all__, *_PACKAGES, *_SHORT, "__version__", *loaded})
