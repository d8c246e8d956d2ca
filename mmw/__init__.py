"""mmw: multimodal wireless datasets from one configuration file."""

import logging as _logging
from importlib import import_module as _import_module
from pathlib import Path as _Path
from typing import Any as _Any

__version__ = "0.2.0"

_logging.getLogger(__name__).addHandler(_logging.NullHandler())  # whoever imports mmw decides where records go

_root = _Path(__file__).resolve().parent.parent
if (_root / "pyproject.toml").is_file():
    # Source checkout: kernels/, assets/ and configs/ sit beside this package; in a wheel they sit inside it.
    __path__.append(str(_root))


_HOME = {"open": ("mmw.dataset", "open_dataset"), "connect": ("mmw.dataset", "connect")}
"""Name -> module that defines it, and its name there; loaded when first used, so that `import mmw` stays light."""


def __getattr__(name: str) -> _Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, attribute = _HOME[name]
    return getattr(_import_module(module), attribute)
