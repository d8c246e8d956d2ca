"""Open the files of a dataset: a local folder, or a place that pyarrow or fsspec can read, such as S3."""

from pathlib import Path, PurePosixPath
from typing import Any

import pyarrow as pa
import pyarrow.fs as pafs

from mmw.core.errors import InputError


def find_storage(root: str | Path, filesystem: Any = None) -> tuple[Path | PurePosixPath, pafs.FileSystem | None]:
    """Return the folder of a dataset and its filesystem, None for the local one.

    Args:
        root: Folder, or a URI such as `s3://bucket/folder` or `file:///folder`. pyarrow opens s3, gs, hdfs and file;
            fsspec, where it is installed, opens the rest.
        filesystem: A pyarrow or fsspec filesystem in which `root` is a path; None finds it from `root`.

    Raises:
        InputError: If nothing opens the URI.
    """
    if filesystem is not None:
        if isinstance(filesystem, pafs.FileSystem):
            return PurePosixPath(str(root)), filesystem
        path = filesystem._strip_protocol(str(root))  # as the filesystem itself names its files
        return PurePosixPath(path), pafs.PyFileSystem(pafs.FSSpecHandler(filesystem))
    text = str(root)
    if "://" not in text:
        try:
            return Path(root).resolve(), None
        except (OSError, RuntimeError) as error:  # a link to itself
            text = " ".join(str(error).split())
            raise InputError(f"{root}: cannot be opened ({text}); give the folder that mmw.run wrote") from error
    try:
        found, path = pafs.FileSystem.from_uri(text)
    except (pa.ArrowException, OSError, ValueError) as error:
        found, path = _by_fsspec(text, error)
    return (Path(path), None) if isinstance(found, pafs.LocalFileSystem) else (PurePosixPath(path), found)


def _by_fsspec(uri: str, reason: Exception) -> tuple[pafs.FileSystem, str]:
    try:
        from fsspec.core import url_to_fs

        filesystem, path = url_to_fs(uri)
    except (ImportError, ValueError) as error:
        text = " ".join(f"pyarrow: {reason}; fsspec: {error}".split())
        raise InputError(f"{uri}: cannot be opened ({text}); give a local folder or s3://bucket/folder") from error
    return pafs.PyFileSystem(pafs.FSSpecHandler(filesystem)), path


def read_bytes(root: Path | PurePosixPath, name: str, filesystem: pafs.FileSystem) -> bytes | None:
    """Return the content of a file of a dataset that is not local; None if it is not there.

    Raises:
        InputError: If the place cannot be reached.
    """
    path = (root / name).as_posix()
    try:
        if filesystem.get_file_info(path).type != pafs.FileType.File:
            return None
        with filesystem.open_input_stream(path) as stream:
            return stream.read()
    except (pa.ArrowException, OSError) as error:
        raise InputError(f"{path}: {' '.join(str(error).split())}; check address and credentials") from error


def read_text(root: Path | PurePosixPath, name: str, filesystem: pafs.FileSystem | None) -> str:
    """Return the content of a text file of a dataset, such as `LICENSE`; empty if there is none."""
    if filesystem is not None:
        return (read_bytes(root, name, filesystem) or b"").decode("utf-8", "replace")
    path = Path(root) / name
    return path.read_text("utf-8", "replace") if path.is_file() else ""
