"""Which formats there are. A format's module is imported when it is used, so that nobody needs another's packages.

To add a format: a module of this folder with `FORMAT: Format`, and one line in `MODULES`.
"""

import importlib
from typing import TYPE_CHECKING

from mmw.errors import InputError

if TYPE_CHECKING:
    from mmw.export.base import Format

MODULES = {
    "deepmimo": "mmw.export.deepmimo",
    "huggingface": "mmw.export.huggingface",
    "kitti": "mmw.export.kitti",
    "nuscenes": "mmw.export.nuscenes",
    "opv2v": "mmw.export.opv2v",
    "v1": "mmw.export.v1",
}
"""Name of a format -> module whose `FORMAT` describes it."""


def load_format(name: str) -> "Format":
    """Return a format by its name.

    Raises:
        InputError: If there is no such format.
        ImportError: If the format needs a package that is not installed.
    """
    if name not in MODULES:
        raise InputError(f"format {name!r}: is not known; give one of {', '.join(sorted(MODULES))}")
    return importlib.import_module(MODULES[name]).FORMAT
