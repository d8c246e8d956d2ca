"""How every command ends: its exit code, one line on standard error for each problem, and a log file with the trace.

| ends with | standard error | exit code |
|---|---|---|
| `InputError`: input that has to be corrected | one line a problem | 2 |
| another `Error` (disk full, worker lost, package missing) or an `OSError` | one line | 1 |
| Ctrl-C | one line | 1 |
| anything else: a bug | one line that names the log file | 1 |

`--debug` shows the trace, and all log records, on standard error too.
"""

import argparse
import logging
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path

from mmw.core.errors import Error, InputError
from mmw.core.extras import missing_package
from mmw.core.log_files import logging_to_file

LOGGER = logging.getLogger(__name__)


def add_log_options(parser: argparse.ArgumentParser) -> argparse.ArgumentParser:
    """Add the options that `run_command` reads, and return the parser."""
    parser.add_argument("--debug", action="store_true", help="show log records and the trace of an error")
    return parser


def fail(problems: Sequence[str], code: int = 2) -> int:
    """Print problems for people and return the exit code."""
    for problem in problems:
        print(f"mmw: {problem}", file=sys.stderr)
    return code


def run_command(
    work: Callable[[], int], name: str, *, debug: bool = False, interrupted: str = "interrupted", kept: str = ""
) -> int:
    """Return the exit code of a command, also where it fails.

    Args:
        work: Does it and returns the exit code.
        name: Name of the command, for the log file.
        debug: Show log records and traces on standard error.
        interrupted: Line for Ctrl-C.
        kept: What to say of work that was finished before a bug or the system stopped the command.
    """
    with logging_to_file(name, debug=debug) as path:
        try:
            code = work()
        except Error as error:
            LOGGER.info("%s", error, exc_info=True)
            code = fail(error.problems if isinstance(error, InputError) else [str(error)], error.exit_code)
        except BrokenPipeError:  # whoever read the output has enough of it, such as `head`
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # else Python complains when it flushes
            code = 0
        except OSError as error:
            LOGGER.error("%s", error, exc_info=True)
            text = f"{error.filename}: {error.strerror}" if error.filename else " ".join(str(error).split())
            code = fail([f"{text}; {kept}" if kept else text], 1)
        except KeyboardInterrupt:
            LOGGER.info("interrupted")
            code = fail([interrupted], 1)
        except Exception as error:
            code = _fail_unexpectedly(error, path, debug, kept)
        LOGGER.info("exit code %d", code)
        return code


def _fail_unexpectedly(error: Exception, path: Path | None, debug: bool, kept: str) -> int:
    """Log the trace of an error that nobody foresaw, print one line about it and return the exit code."""
    missing = missing_package(error) if isinstance(error, ModuleNotFoundError) else None
    if missing is not None:
        LOGGER.info("%s", missing, exc_info=True)
        return fail([str(missing)], missing.exit_code)
    LOGGER.critical("internal error", exc_info=True)
    if path is None and not debug:
        traceback.print_exception(error)
    trace = f"the trace is in {path}" if path is not None else "the trace is above"
    text = " ".join(str(error).split())
    return fail(
        [
            f"internal error: {type(error).__name__}: {text}; this is a bug in mmw, not in your input{kept and '; '}"
            f"{kept}; {trace}; please report it with the trace (--debug shows it here)"
        ],
        1,
    )
