"""Which formats there are. A format's module is imported when it is used, so that nobody needs another's packages.

To add a format: a module of this folder with `FORMAT: Format`, and one line in `MODULES`.
"""

import importlib
from typing import TYPE_CHECKING

from mmw.core.errors import InputError

if TYPE_CHECKING:
    from mmw.dataset.export.exporter import Format

MODULES = {
    "deepmimo": "mmw.dataset.export.deepmimo.exporter",
    "huggingface": "mmw.dataset.export.huggingface",
    "kitti": "mmw.dataset.export.kitti",
    "nuscenes": "mmw.dataset.export.nuscenes.exporter",
    "opv2v": "mmw.dataset.export.opv2v",
    "v1": "mmw.dataset.export.multimodal_wireless.layout",
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
