"""Steps that do what is forbidden, so that the fuzzer itself can be tested."""

import os
import random
import signal
import time
from pathlib import Path

from mmw.core.errors import InputError
from tests.fuzz.cases import Step, call


def _refuse() -> None:
    raise InputError("file: found; needed; cure")


def _fail() -> None:
    raise KeyError("a bug")


def _crash() -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def _hang() -> None:
    end = time.process_time() + 3600.0
    while time.process_time() < end:
        pass


def _fill() -> None:
    bytearray(2**36)


STEPS = {"sound": lambda: None, "refuse": _refuse, "fail": _fail, "crash": _crash, "hang": _hang, "fill": _fill}


class Broken:
    """Case k is step k of `STEPS`, by turns."""

    def prepare(self, folder: Path) -> None:
        (folder / "sound.txt").write_text("sound")

    def make(self, rng: random.Random, folder: Path) -> list[Step]:
        name = list(STEPS)[int(folder.name.rpartition("-")[2]) % len(STEPS)]
        (folder / "input.txt").write_text(name)
        return [call(name, STEPS[name])]
