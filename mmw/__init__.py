"""mmw: multimodal wireless datasets from one configuration file."""

from pathlib import Path as _Path

__version__ = "0.1.0"

_root = _Path(__file__).resolve().parent.parent
if (_root / "pyproject.toml").is_file():
    # Source checkout: kernels/, assets/ and configs/ sit beside this package; in a wheel they sit inside it.
    __path__.append(str(_root))
