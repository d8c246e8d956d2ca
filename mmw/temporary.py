"""Names of files that are not complete yet."""

import os
import re
from functools import cache
from pathlib import Path, PurePath
from uuid import uuid4

_TEMPORARY = re.compile(r"\..*\.tmp(\.\w+)?")


def temporary_path(path: Path, suffix: str = "") -> Path:
    """Return the name that a file has until it is complete; readers skip it (leading dot, no `.parquet` at the end).

    Every process has its own, on whatever machine: two that write the same file never mix their bytes.

    Args:
        path: Final name.
        suffix: What the name must end with, for a library that tells the format by it.
    """
    return path.with_name(f".{path.name}.{_mark(os.getpid())}.tmp{suffix}")


def is_temporary(path: PurePath) -> bool:
    """Return whether a file's name is one of `temporary_path`."""
    return _TEMPORARY.fullmatch(path.name) is not None


@cache
def _mark(process: int) -> str:
    return uuid4().hex[:12]
