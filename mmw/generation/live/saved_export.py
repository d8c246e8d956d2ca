"""Write an episode in the format of other tools: a dataset of it in a temporary folder, and the export of that."""

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

from mmw.core.errors import InputError
from mmw.dataset import Dataset
from mmw.dataset.export.export_folder import check_new, remove_export
from mmw.dataset.export.exporter import export
from mmw.dataset.export.registry import EXPORTERS, load_format

DATASET = "dataset"
"""Name of mmw's own format."""


def save_export(
    save: Callable[[Path], Dataset], out: str | os.PathLike[str], name: str, overwrite: bool, where: str
) -> Path:
    """Write an episode in an export format with its default options, and return the folder.

    Args:
        save: Writes the episode as a dataset into a folder that does not exist.
        out: Folder of the export.
        name: The format, a key of `EXPORTERS`.
        overwrite: Replace the export that is in the folder.
        where: The simulation in messages.

    Raises:
        InputError: If there is no such format, the folder has other files, or the episode lacks something that the
            format needs.
        MissingPackageError: If the format needs a package that is not installed.
        Error: If the disk is full.
    """
    if name not in EXPORTERS:
        known = ", ".join([DATASET, *sorted(EXPORTERS)])
        raise InputError(f"{where}: save: format = {name!r}: there are {known}; name one of them")
    if "://" in os.fspath(out):
        raise InputError(f"{where}: save: {out}: format {name} is written to a local folder; give one")
    folder = Path(out).resolve()
    load_format(name).check_packages()
    check_new(folder, overwrite)
    folder.parent.mkdir(parents=True, exist_ok=True)
    # Beside the export, because the disk of temporary files may be too small for all sensors of an episode.
    with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as holder:
        saved = save(Path(holder) / "dataset")
        remove_export(folder)
        export(saved.root, name, folder, is_quiet=True)
    return folder
