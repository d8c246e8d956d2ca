"""Write USD layers atomically."""

import errno
import os
from collections.abc import Mapping
from pathlib import Path

from pxr import Sdf, Tf

from mmw.core.temp_files import temporary_path


def save_layers(layers: Mapping[Path, Sdf.Layer], files: Mapping[Path, bytes] | None = None) -> None:
    """Write layers that belong together: no file is replaced before all of them are on the disk.

    Args:
        layers: File -> layer. Folders are made; a layer may be anonymous.
        files: Other files that belong to them, such as textures, and their content.

    Raises:
        OSError: If one cannot be written; the files that were there before stay.
    """
    temporaries: dict[Path, Path] = {}
    try:
        for path, layer in layers.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            temporaries[path] = temporary_path(path, path.suffix)  # the suffix tells USD the format
            _export(layer, temporaries[path], path)
        for path, data in (files or {}).items():
            path.parent.mkdir(parents=True, exist_ok=True)
            temporaries[path] = temporary_path(path, path.suffix)
            temporaries[path].write_bytes(data)
            _sync(temporaries[path])
        for path, temporary in temporaries.items():
            temporary.replace(path)
    finally:
        for temporary in temporaries.values():
            temporary.unlink(missing_ok=True)
    for path in layers:
        reload_layer(path)


def _export(layer: Sdf.Layer, temporary: Path, path: Path) -> None:
    try:
        is_written = layer.Export(str(temporary))
    except Tf.ErrorException as error:
        # USD reports a full disk as text, followed by hundreds of lines about the torn file.
        code = errno.ENOSPC if os.strerror(errno.ENOSPC) in str(error) else errno.EIO
        raise OSError(code, os.strerror(code), str(path)) from None
    if not is_written:
        raise OSError(errno.EIO, os.strerror(errno.EIO), str(path))
    _sync(temporary)


def _sync(file: Path) -> None:
    with file.open("rb+") as opened:
        os.fsync(opened.fileno())


def reload_layer(path: Path) -> None:
    """Make USD read a file again that it may hold in memory."""
    opened = Sdf.Layer.Find(str(path))
    if opened:
        opened.Reload(force=True)
