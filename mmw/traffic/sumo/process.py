"""Run SUMO in a process of its own, step by step: as many simulations at once as there are processes."""

import json
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from mmw.core.errors import InputError, MissingPackageError
from mmw.traffic.sumo import worker

PATIENCE_S = 10.0
"""A process that was told to end has this long before it is killed [s]."""

State = tuple[int, float, float, float, float, float, str]
"""Vehicle; x, y, z of its front bumper [m]; angle clockwise from north [deg]; speed [m/s]; its lane in SUMO."""


class SumoProcess:
    """A process that runs one SUMO simulation, in files of a temporary folder that it removes."""

    def __init__(self, holder: tempfile.TemporaryDirectory[str], job: Mapping[str, Any]) -> None:
        """Start the process.

        Args:
            holder: Folder of SUMO's input files.
            job: See `mmw.traffic.sumo.worker`.
        """
        folder = Path(holder.name)
        (folder / "job.json").write_text(json.dumps(job))
        self._errors = folder / "errors.txt"
        # -P: the folder of the script holds modules whose names must not hide others
        command = [sys.executable, "-P", str(Path(worker.__file__)), str(folder)]
        with self._errors.open("wb") as errors:
            process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, text=True, encoding="utf-8"
            )
        assert process.stdin is not None and process.stdout is not None
        self._process, self._calls, self._answers = process, process.stdin, process.stdout
        self.close = weakref.finalize(self, _end, process, holder)
        """Ends the process and removes the folder; closing again changes nothing."""

    def step(self, calls: Sequence[Sequence[Any]] = ()) -> list[State]:
        """Make calls, advance SUMO by one step, and return the states of its vehicles; the first step is time 0.

        Args:
            calls: Method of `libsumo.vehicle` and its arguments, each.

        Raises:
            InputError: If SUMO fails, or has ended.
            MissingPackageError: If `libsumo` cannot be loaded, because a system library is missing.
        """
        if not self.close.alive:
            raise InputError("engine = 'sumo': SUMO has ended; reset the simulation, or make another one")
        with suppress(BrokenPipeError):  # then it has ended, and has no answer
            self._calls.write(json.dumps(calls) + "\n")
            self._calls.flush()
        line = self._answers.readline()
        if not line:
            self._fail()
        return [tuple(state) for state in json.loads(line)]

    def _fail(self) -> None:
        code = self._process.wait()
        lines = [line for line in self._errors.read_text(errors="replace").splitlines() if line.strip()]
        self.close()
        why = lines[-1] if lines else f"exit code {code}"
        if code == worker.NOT_LOADED:
            raise MissingPackageError(
                f"engine = 'sumo': the package libsumo cannot be loaded: {why}; install that library with the system's "
                "package manager, or use engine: idm"
            )
        raise InputError(f"engine = 'sumo': SUMO failed: {why}; correct the lanes, or use engine: idm")


def _end(process: subprocess.Popen[str], holder: tempfile.TemporaryDirectory[str]) -> None:
    """End a process and remove its folder."""
    assert process.stdin is not None and process.stdout is not None
    with suppress(BrokenPipeError):  # the last line may wait for a process that has ended
        process.stdin.close()
    try:
        process.wait(PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    process.stdout.close()
    holder.cleanup()
