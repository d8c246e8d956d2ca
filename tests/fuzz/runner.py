"""Run cases in processes that may crash, hang or fill the memory, and say which input did it."""

import contextlib
import functools
import io
import json
import os
import random
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from tests.fuzz.kinds import make_kind
from tests.fuzz.map_excerpts import FOLDER

if TYPE_CHECKING:
    from tests.fuzz.cases import Kind

ROOT = Path(__file__).parents[2]
CPU_S, IDLE_S = 20.0, 120.0
"""CPU time that a step may take, and time in which it must use some, however loaded the machine is [s]."""
START_S = 900.0
"""Time until a process has its sound files [s]."""


@dataclass
class Result:
    """Counts and faults of a run."""

    kind: str
    seed: int
    cases: int = 0
    steps: int = 0
    longest_s: float = 0.0
    faults: list["Fault"] = field(default_factory=list)

    def add(self, fault: "Fault") -> None:
        """Keep a fault, and tell of it at once: a run may take hours."""
        self.faults.append(fault)
        print(f"{fault.kind} {fault.number}: {fault.signature}", file=sys.stderr, flush=True)


@dataclass(frozen=True)
class Fault:
    """One input that ended in what is forbidden."""

    kind: str
    seed: int
    number: int
    step: str
    what: str

    @property
    def signature(self) -> str:
        """Last line of the trace, and the place in mmw that it comes from: equal for equal faults."""
        lines = self.what.strip().splitlines()
        places = [line.strip() for line in lines if "/mmw/" in line and "line" in line]
        return f"{lines[-1][:160] if lines else ''} @ {places[-1] if places else '?'}"


def run(kind: str, seed: int, first: int, count: int, seconds: float = float("inf")) -> Result:
    """Run `count` cases of a kind from number `first` on, for at most some seconds."""
    result, number, end = Result(kind, seed), first, time.monotonic() + seconds
    with tempfile.TemporaryDirectory(prefix="mmw-fuzz-", ignore_cleanup_errors=True) as name:
        while number < first + count and time.monotonic() < end:
            folder = Path(name) / str(number)
            (folder / "sound").mkdir(parents=True)
            number = _process(result, folder, number, first + count, end)
            shutil.rmtree(folder, ignore_errors=True)
    return result


def _process(result: Result, folder: Path, number: int, stop: int, end: float) -> int:
    """Run cases in one process until they are done or it ends, and return the next number."""
    arguments = [result.kind, str(result.seed), str(folder), str(number), str(stop)]
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.fuzz.worker", *arguments], cwd=ROOT, stdout=subprocess.PIPE, text=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])},
    )  # fmt: skip
    assert process.stdout is not None
    step, buffer, chunk, since, cpu, is_ready = "", b"", b"-", time.monotonic(), 0.0, False
    seen, idle_since = 0.0, since
    try:
        while True:
            if select.select([process.stdout], [], [], 0.5)[0]:
                chunk = os.read(process.stdout.fileno(), 65536)
                if not chunk:
                    break
                buffer += chunk
                *lines, buffer = buffer.split(b"\n")
                for line in lines:
                    message = json.loads(line)
                    since = idle_since = time.monotonic()
                    cpu, seen = _cpu(process.pid), 0.0
                    is_ready |= "ready" in message
                    number = message.get("case", number)
                    step = message.get("step", step)
                    result.steps += "cpu_s" in message
                    result.longest_s = max(result.longest_s, message.get("cpu_s", 0.0))
                    if "fault" in message:
                        result.add(Fault(result.kind, result.seed, number, step, message["fault"]))
                    if "done" in message:
                        result.cases += 1
                        number += 1
            used, waited = _cpu(process.pid) - cpu, time.monotonic() - since
            if used > seen + 0.1:
                seen, idle_since = used, time.monotonic()
            if is_ready and (used > CPU_S or time.monotonic() - idle_since > IDLE_S):
                process.send_signal(signal.SIGUSR1)  # it writes its stack
                time.sleep(1.0)
                result.add(_ended(result, folder, number, step, f"took {used:.0f} s of CPU, {waited:.0f} s"))
                result.cases += 1
                return number + 1
            if not is_ready and waited > START_S:
                raise RuntimeError(f"{result.kind}: not ready after {START_S} s: {_tail(folder / 'output.txt')}")
            if time.monotonic() > end and is_ready:
                return stop
    finally:
        try:
            code = process.wait(5.0 if number >= stop or chunk == b"" else 0.0)
        except subprocess.TimeoutExpired:
            process.kill()
            code = process.wait()
        process.stdout.close()
    if number >= stop:
        return stop
    if not is_ready:
        raise RuntimeError(f"{result.kind}: the worker ended with {code}: {_tail(folder / 'output.txt')}")
    what = f"the process died ({code}): {_tail(folder / 'output.txt')}"
    result.add(_ended(result, folder, number, step, what))
    result.cases += 1
    return number + 1


def _ended(result: Result, folder: Path, number: int, step: str, what: str) -> Fault:
    return Fault(result.kind, result.seed, number, step, f"{_tail(folder / 'stack.txt', 4000)}\n{what}")


def _tail(path: Path, size: int = 1500) -> str:
    return path.read_text(errors="replace")[-size:] if path.exists() else ""


def _cpu(pid: int) -> float:
    """Return the CPU time of a process [s]."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@functools.cache
def _prepared(name: str, folder: Path) -> "Kind":
    """Return a kind with its sound files beside the faulty ones."""
    kind, sound = make_kind(name), folder / f"sound-{name}"
    shutil.rmtree(sound, ignore_errors=True)
    sound.mkdir(parents=True)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        kind.prepare(sound)
    return kind


def save(fault: Fault, folder: Path) -> Path:
    """Make the input of a fault again, in a folder of its own, with a text on how to repeat it; return the folder."""
    place = folder / f"{fault.kind}-{fault.seed}" / f"case-{fault.number}"
    if place.exists():
        return place
    kind = _prepared(fault.kind, folder)
    place.mkdir(parents=True)
    here = Path.cwd()
    os.chdir(place)
    try:
        kind.make(random.Random(f"{fault.kind} {fault.seed} {fault.number}"), place)
    finally:
        os.chdir(here)
    repeat = f"python -m tests.fuzz --kind {fault.kind} --seed {fault.seed} --first {fault.number} --count 1"
    repeat += f" --from {os.environ[FOLDER]}" if FOLDER in os.environ else ""
    (place / "FAULT.txt").write_text(f"{repeat}\n{fault.step}\n\n{fault.what}\n")
    return place
