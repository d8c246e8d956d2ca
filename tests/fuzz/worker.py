"""A process that runs numbered cases of one kind and reports each: `python -m tests.fuzz.worker`, for `runner.py`."""

import faulthandler
import json
import os
import random
import resource
import shutil
import signal
import sys
import time
from pathlib import Path

MEMORY = 3 * 2**30 + (os.cpu_count() or 1) * 2**28
"""Address space that the cases may take beyond what the process has after its first one [bytes]; libraries start a
thread for each core, which takes its own."""


def work(kind_name: str, seed: int, folder: Path, numbers: list[int]) -> None:
    """Run cases; one line of JSON is written to the standard output for each step that begins and each that ends."""
    report = os.fdopen(os.dup(1), "w", buffering=1)
    log = os.open(folder / "output.txt", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    os.dup2(log, 1)
    os.dup2(log, 2)
    trace = (folder / "stack.txt").open("w")  # of a process that is stopped or crashes
    faulthandler.enable(trace)
    faulthandler.register(signal.SIGUSR1, trace)
    os.environ["MMW_LOG_DIR"] = str(folder / "logs")
    from tests.fuzz.cases import run_step
    from tests.fuzz.kinds import make_kind

    kind = make_kind(kind_name)
    kind.prepare(folder / "sound")
    print(json.dumps({"ready": os.getpid()}), file=report)
    limit_memory()
    runner = os.getppid()
    for number in numbers:
        if os.getppid() != runner:  # it was killed, and nobody would stop a case that hangs
            return
        place = folder / f"case-{number}"
        place.mkdir()
        os.chdir(place)
        steps = kind.make(random.Random(f"{kind_name} {seed} {number}"), place)
        fault = ""
        for step in steps:
            print(json.dumps({"case": number, "step": step.text}), file=report)
            start = time.process_time()
            fault = run_step(step)
            seconds = time.process_time() - start
            if fault:
                print(json.dumps({"case": number, "step": step.text, "fault": fault}), file=report)
            print(json.dumps({"case": number, "cpu_s": round(seconds, 3)}), file=report)
        print(json.dumps({"case": number, "done": True}), file=report)
        os.chdir(folder)
        shutil.rmtree(place, ignore_errors=True)  # the runner makes faulty inputs again


def limit_memory() -> None:
    """Let allocations fail that a case must not ask for."""
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + MEMORY, resource.RLIM_INFINITY))


if __name__ == "__main__":
    work(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]), list(range(int(sys.argv[4]), int(sys.argv[5]))))
