"""Workers that die while they write a file: killed when a shard's file is on the disk under its temporary name."""

import os
import signal
from pathlib import Path
from typing import Any

import mmw.engines.processes
from mmw.worker import Making


def die_while_writing(folder: Path, times: int = 1) -> None:
    """Let this process be killed when it flushes an unfinished file of a table below a folder.

    Args:
        folder: The dataset. What was killed is noted beside it, so that whoever comes after lives.
        times: How many processes die.
    """
    fsync = os.fsync

    def flush(handle: int) -> None:
        path = Path(f"/proc/self/fd/{handle}").readlink()
        if path.name.startswith(".part-") and path.is_relative_to(folder.resolve()):
            for i in range(times):
                try:
                    note_of(folder, i).open("x").write(path.name)
                except FileExistsError:
                    continue
                os.kill(os.getpid(), signal.SIGKILL)
        fsync(handle)

    os.fsync = flush


def note_of(folder: Path, number: int) -> Path:
    """Return the file that holds the name of the temporary file that was open when a process was killed."""
    return folder.with_name(f"{folder.name}-killed-{number}")


def serve(connection: Any, lifeline: Any, making: Making, device: str) -> None:
    """Stand in for `mmw.engines.processes._serve` in a worker process."""
    die_while_writing(making.root.staging)
    ORIGINAL(connection, lifeline, making, device)


ORIGINAL = mmw.engines.processes._serve
