"""Write log files of commands: arguments, messages, and stack traces of errors.

Every module logs below the logger `mmw`. A program that uses mmw as a library configures it as usual; a command writes
it to a file. Records of worker processes are sent to the command as messages
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
"""Environment variable with another folder for log files."""

MAX_FILES = 20
"""Maximum number of log files; the oldest are removed. Design value."""

FORMAT = "%(asctime)s %(levelname)s %(processName)s %(name)s: %(message)s"


class _LogFile(logging.FileHandler):
    """Log file that says once, in one line, that it cannot be written, and takes no more records."""

    def handleError(self, record: logging.LogRecord) -> None:
        error = sys.exc_info()[1]
        if not isinstance(error, OSError):
            super().handleError(record)  # a bug in the record
        elif self.level <= logging.CRITICAL:
            self.setLevel(logging.CRITICAL + 1)
            print(f"mmw: {self.baseFilename}: {error.strerror}; the log ends here", file=sys.stderr)

    def close(self) -> None:
        with suppress(OSError):  # of what could not be written, which is said already
            super().close()


@contextmanager
def logging_to_file(command: str, *, debug: bool) -> Iterator[Path | None]:
    """Write the records of a command to a file of its own while the block runs.

    Yields:
        The file; None if it cannot be written.
    """
    level, handlers, path = ROOT.level, [], _new_file(command)
    if path is not None:
        handlers.append(_LogFile(path, encoding="utf-8", errors="backslashreplace"))
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
    folder = Path(os.environ.get(LOG_DIR_VARIABLE) or cache_dir() / "mmw" / "logs")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{time.strftime('%Y%m%d-%H%M%S')}-{name}-{os.getpid()}.log"
        path.touch()
    except OSError:
        return None
    for old in sorted(folder.glob("*.log"))[:-MAX_FILES]:
        with suppress(OSError):  # another command may remove it too
            old.unlink()
    return path
