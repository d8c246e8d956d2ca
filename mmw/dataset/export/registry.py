"""Register export formats. A format is imported when it is used, so that packages of others stay optional.

To add one to mmw: a module of this folder with `FORMAT: Format`, and one line below. Other packages use the entry point
group `mmw.exporters`.
"""

from typing import TYPE_CHECKING

from mmw.core.errors import InputError
from mmw.core.registry import Registry

if TYPE_CHECKING:
    from mmw.dataset.export.exporter import Format

EXPORTERS: "Registry[Format]" = Registry(
    "mmw.exporters",
    "export format",
    "mmw.dataset.export.exporter:Format",
    {
        "deepmimo": "mmw.dataset.export.deepmimo.scenarios:FORMAT",
        "huggingface": "mmw.dataset.export.huggingface:FORMAT",
        "kitti": "mmw.dataset.export.kitti:FORMAT",
        "mcap": "mmw.dataset.export.mcap.recording:FORMAT",
        "nuscenes": "mmw.dataset.export.nuscenes.scenes:FORMAT",
        "opv2v": "mmw.dataset.export.opv2v:FORMAT",
        "v1": "mmw.dataset.export.multimodal_wireless.layout:FORMAT",
    },
)
"""Formats by name."""


def load_format(name: str) -> "Format":
    """Return a format by its name.

    Raises:
        InputError: If there is no such format.
        ImportError: If the format needs a package that is not installed.
    """
    if name not in EXPORTERS:
        raise InputError(f"format {name!r}: is not known; give one of {', '.join(sorted(EXPORTERS))}")
    return EXPORTERS[name]
