"""mmw: multimodal wireless datasets from one configuration file."""

import logging as _logging
from pathlib import Path as _Path
from typing import Any as _Any

__version__ = "0.2.0"

_logging.getLogger(__name__).addHandler(_logging.NullHandler())  # whoever imports mmw decides where records go

_root = _Path(__file__).resolve().parent.parent
if (_root / "pyproject.toml").is_file():
    # Source checkout: kernels/, assets/ and configs/ sit beside this package; in a wheel they sit inside it.
    __path__.append(str(_root))


def __getattr__(name: str) -> _Any:
    """Load `open` and `connect` of `mmw.dataset` when they are first used, so that `import mmw` stays light."""
    if name in ("open", "connect"):
        from mmw import dataset

        return {"open": dataset.open_dataset, "connect": dataset.connect}[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
