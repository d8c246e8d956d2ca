"""End every command alike: its exit code, one line on standard error for each problem, and a log file with the trace.

| ends with | standard error | exit code |
|---|---|---|
| `InputError`: input that has to be corrected | one line a problem | 2 |
| another `Error` (disk full, worker lost, package missing), an `OSError`, memory that is full | one line | 1 |
| Ctrl-C | one line | 1 |
| anything else: a bug | one line that names the log file | 1 |

`--debug` shows the trace, and all log records, on standard error too.
"""

import argparse
import errno
import logging
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path

from mmw.core.errors import Error, InputError, is_out_of_memory, is_out_of_threads
from mmw.core.extras import missing_package
from mmw.core.log_files import logging_to_file
from mmw.storage.atomic_files import StoreError

LOGGER = logging.getLogger(__name__)

CURES = {
    errno.EACCES: "change its permissions, or use another folder",
    errno.EPERM: "change its permissions, or use another folder",
    errno.EROFS: "mount it for writing, or use another folder",
    errno.EFBIG: "raise the limit of file sizes (ulimit -f), or use another file system",
    errno.EMFILE: "raise the limit of open files (ulimit -n), or use fewer --workers or compute.writer_threads",
    errno.ENFILE: "close other programs: the whole machine has too many open files",
    errno.EAGAIN: "raise the limit of processes (ulimit -u), or use fewer --workers or compute.writer_threads",
    errno.ENOMEM: "make room, or use fewer --workers or compute.writer_threads",
    errno.ENOSPC: "free some space, or use another folder",
    errno.EDQUOT: "free some space, or use another folder",
    errno.EIO: "check the disk",
}
"""Error number of the system -> what a user can do."""


def fail(problems: Sequence[str], code: int = 2) -> int:
    """Print problems for people and return the exit code."""
    for problem in problems:
        print(f"mmw: {printable(problem)}", file=sys.stderr)
    return code


def printable(text: str) -> str:
    """Return a text on one line: names from data may hold line ends, or codes that a terminal obeys."""
    line = " ".join(text.splitlines())
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in line)


def run_command(
    parser: argparse.ArgumentParser,
    work: Callable[[argparse.Namespace], int | None],
    argv: Sequence[str] | None,
    *,
    intermixed: bool = False,
    finished: str = "",
) -> int:
    """Parse a command line, do its work, and return the exit code, also where it fails.

    Args:
        parser: Options of the command; `--debug` is added.
        work: Function of the parsed options that does the work and returns the exit code, None for 0.
        argv: Command line; None for that of the process.
        intermixed: Allow options between the positional arguments.
        finished: Sentence on finished work, if a bug, the system, a store or Ctrl-C stops the command.
    """
    parser.add_argument("--debug", action="store_true", help="show log records and the trace of an error")
    options = (parser.parse_intermixed_args if intermixed else parser.parse_args)(argv)
    with logging_to_file(parser.prog, debug=options.debug) as path:
        LOGGER.info("options %s", vars(options))
        try:
            code = work(options) or 0
        except Error as error:
            LOGGER.info("%s", error, exc_info=True)
            text = _join(str(error), finished if isinstance(error, StoreError) else "")
            code = fail(error.problems if isinstance(error, InputError) else [text], error.exit_code)
        except BrokenPipeError:  # the reader has closed the pipe, such as `head`
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # else Python complains when it flushes
            code = 0
        except OSError as error:
            LOGGER.error("%s", error, exc_info=True)
            text = f"{error.filename}: {error.strerror}" if error.filename else " ".join(str(error).split())
            code = fail([_join(text, CURES.get(error.errno or 0, ""), finished)], 1)
        except KeyboardInterrupt:
            LOGGER.info("interrupted")
            code = fail([_join("interrupted", finished)], 1)
        except Exception as error:
            code = _fail_unexpectedly(error, path, options.debug, finished)
        LOGGER.info("exit code %d", code)
        return code


def _fail_unexpectedly(error: Exception, path: Path | None, debug: bool, finished: str) -> int:
    """Log the trace of an unexpected error, print one line about it and return the exit code."""
    missing = missing_package(error) if isinstance(error, ModuleNotFoundError) else None
    if missing is not None:
        LOGGER.info("%s", missing, exc_info=True)
        return fail([str(missing)], missing.exit_code)
    text = " ".join(str(error).split())
    if is_out_of_memory(error):
        LOGGER.error("%s", error, exc_info=True)
        advice = "make room, or use fewer --workers or compute.writer_threads"
        return fail([_join(f"memory is full ({text}); {advice}", finished)], 1)
    if is_out_of_threads(error):
        LOGGER.error("%s", error, exc_info=True)
        advice = "raise the limit of memory (ulimit -v) or processes (ulimit -u), or use fewer --workers"
        return fail([_join(f"no thread can be started ({text}); {advice} or compute.writer_threads", finished)], 1)
    LOGGER.critical("internal error", exc_info=True)
    if path is None and not debug:
        traceback.print_exception(error)
    trace = f"the trace is in {path}" if path is not None else "the trace is above"
    bug = _join(f"internal error: {type(error).__name__}: {text}; this is a bug in mmw, not in your input", finished)
    return fail([f"{bug}; {trace}; please report it with the trace (--debug shows it here)"], 1)


def _join(*parts: str) -> str:
    """Join the parts that are not empty."""
    return "; ".join(part for part in parts if part)
