"""Check names that come from data, such as those of agents, before they become names of files."""

import re
from pathlib import Path, PurePosixPath

from mmw.core.errors import InputError

MAX_NAME_BYTES = 64
"""Longest name from data: four of them fit into the name of a file, which may have 255 bytes. Design value."""

_PLAIN = re.compile(r"\w[\w.=-]*")


def is_file_name(name: object, max_bytes: int = MAX_NAME_BYTES) -> bool:
    """Return whether a name is plain: letters, digits and `_.=-`, no dot, `=` or hyphen first, and not too long."""
    return isinstance(name, str) and _PLAIN.fullmatch(name) is not None and len(name.encode()) <= max_bytes


def check_file_name(name: object, kind: str, where: object) -> str:
    """Return a name that files may have.

    Args:
        name: Name from data.
        kind: Its kind, such as `agent`.
        where: Place for the message, such as a dataset.

    Raises:
        InputError: If it is not plain; files of that name could be anywhere.
    """
    if isinstance(name, str) and is_file_name(name):
        return name
    text = ascii(name)
    shown = text if len(text) <= MAX_NAME_BYTES else f"{text[:MAX_NAME_BYTES]}..."
    raise InputError(
        f"{where}: {kind} {shown} cannot be the name of a file; letters, digits and _.=- are needed, at most "
        f"{MAX_NAME_BYTES} bytes; rename it in the configuration and make the dataset again"
    )


def path_inside(folder: Path, name: str) -> Path:
    """Return the path of a file below a folder, by its relative name with slashes.

    Raises:
        InputError: If it would be outside.
    """
    parts = PurePosixPath(name).parts
    if not parts or ".." in parts or parts[0].startswith("/") or "\0" in name:
        raise InputError(f"{folder}: the name {name!a} leads out of the folder; rename that file")
    return folder.joinpath(*parts)
