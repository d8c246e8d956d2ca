"""Log files of commands: what was run, what it said, and the trace of whatever failed.

Every module logs below the logger `mmw`. A program that uses mmw as a library decides itself where that goes; a command
writes it to a file. Records of worker processes travel to the command as messages
(`mmw.generation.executors.worker_protocol`).
"""

import logging
import os
import platform
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from mmw import __version__
from mmw.core.resources import cache_dir

ROOT = logging.getLogger("mmw")
"""Parent of every logger of the package."""

LOG_DIR_VARIABLE = "MMW_LOG_DIR"
"""Environment variable that names another folder for log files."""

MAX_FILES = 20
"""Log files that are kept; older ones are removed. Design value."""

FORMAT = "%(asctime)s %(levelname)s %(processName)s %(name)s: %(message)s"


def log_dir() -> Path:
    """Return the folder of the log files; it need not exist."""
    given = os.environ.get(LOG_DIR_VARIABLE)
    return Path(given) if given else cache_dir() / "mmw" / "logs"


@contextmanager
def logging_to_file(command: str, *, debug: bool) -> Iterator[Path | None]:
    """Write the records of a command to a file of its own while the block runs.

    Args:
        command: Name of the command, such as `mmw export`.
        debug: Keep records of level DEBUG too, and show all on standard error.

    Yields:
        The file; None if it cannot be written.
    """
    level, handlers, path = ROOT.level, [], _new_file(command)
    if path is not None:
        handlers.append(logging.FileHandler(path, encoding="utf-8"))
    if debug:
        handlers.append(logging.StreamHandler(sys.stderr))
    for handler in handlers:
        handler.setFormatter(logging.Formatter(FORMAT))
        ROOT.addHandler(handler)
    ROOT.setLevel(logging.DEBUG if debug else logging.INFO)
    ROOT.info("mmw %s, Python %s, %s: %s", __version__, platform.python_version(), platform.platform(), sys.argv)
    try:
        yield path
    finally:
        ROOT.setLevel(level)
        for handler in handlers:
            ROOT.removeHandler(handler)
            handler.close()


def _new_file(command: str) -> Path | None:
    """Create an empty log file, and remove the oldest of more than `MAX_FILES`; return None if that fails."""
    name = "-".join(part for part in command.replace(".", " ").split() if part not in ("python", "-m"))
    folder = log_dir()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{time.strftime('%Y%m%d-%H%M%S')}-{name}-{os.getpid()}.log"
        path.touch()
    except OSError:
        return None
    for old in sorted(folder.glob("*.log"))[:-MAX_FILES]:
        with suppress(OSError):  # another command removes it too
            old.unlink()
    return path
