"""A case: the commands and calls that one hostile input is given to, and what they may end with."""

import contextlib
import io
import logging
import random
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from mmw.__main__ import main
from mmw.core.errors import Error


@dataclass(frozen=True)
class Step:
    """One command or call; what it prints is held against the rules of `run_step`."""

    text: str
    """Command or call, for a message."""
    work: Callable[[], object]
    is_command: bool = True


class Kind(Protocol):
    """A kind of input, such as maps."""

    def prepare(self, folder: Path) -> None:
        """Write the sound files that are mutated, once a process."""
        ...

    def make(self, rng: random.Random, folder: Path) -> list[Step]:
        """Write one hostile input into a new folder, and return what to do with it."""
        ...


def command(*argv: str) -> Step:
    """Return a step that runs an `mmw` command."""
    return Step("mmw " + " ".join(repr(each)[:200] for each in argv), lambda: main(argv))


def call(text: str, work: Callable[[], object]) -> Step:
    """Return a step that calls the library."""
    return Step(text, work, is_command=False)


class _Internal(logging.Handler):
    """Keeps the traces that commands write to their log for an internal error."""

    def __init__(self) -> None:
        super().__init__(logging.CRITICAL)
        self.traces: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        error = record.exc_info[1] if record.exc_info else None
        self.traces.append("".join(traceback.format_exception(error)) if error else record.getMessage())


@contextlib.contextmanager
def _internal_errors() -> Iterator[list[str]]:
    handler = _Internal()
    logging.getLogger("mmw").addHandler(handler)
    try:
        yield handler.traces
    finally:
        logging.getLogger("mmw").removeHandler(handler)


def run_step(step: Step) -> str:
    """Run one step and return what is wrong with how it ended, empty for nothing.

    A command ends with 0, 1 or 2, and says why if it is not 0; a call returns or raises an `mmw.core.errors.Error`.
    Anything else, a stack trace or a full memory is a fault.
    """
    out, err = io.StringIO(), io.StringIO()
    code: object = 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), _internal_errors() as traces:
        try:
            code = step.work()
        except SystemExit as end:  # of argparse
            code = end.code
        except Error as error:
            if step.is_command:
                return _trace(error)
        except (Exception, KeyboardInterrupt) as error:
            return _trace(error)
    said = out.getvalue() + err.getvalue()
    if traces:
        return traces[0]
    if not step.is_command:
        return ""
    if "memory is full" in said:
        return "memory is full: " + said[-300:]
    if "Traceback (most recent call last)" in said or "internal error" in said:
        return said[-2000:]
    if code not in (0, 1, 2):
        return f"exit code {code!r}: {said[-300:]}"
    return f"exit code {code} without a word" if code and not said.strip() else ""


def _trace(error: BaseException) -> str:
    return "".join(traceback.format_exception(error))
