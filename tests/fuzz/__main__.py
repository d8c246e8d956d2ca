"""Throw hostile input at mmw: `python -m tests.fuzz [--kind maps] [--count 1000] [--seed 0] [--from FOLDER]`."""

import argparse
import os
import sys
import tempfile
from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tests.fuzz.kinds import KINDS
from tests.fuzz.map_excerpts import FOLDER
from tests.fuzz.runner import Fault, run, save


def main() -> int:
    """Run the cases, print and save the faults, and return 1 if there are some."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--kind", action="append", choices=tuple(KINDS), help="kind of input; all by default")
    parser.add_argument("--count", type=int, default=100, help="inputs of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    parser.add_argument("--jobs", type=int, default=2, help="processes at a time")
    parser.add_argument("--out", type=Path, help="folder for faulty inputs; a new temporary one by default")
    parser.add_argument("--from", dest="folder", type=Path, help="folder of .xodr and .osm files, for half of the maps")
    arguments = parser.parse_args()
    if arguments.folder:
        os.environ[FOLDER] = str(arguments.folder.resolve())
    kinds = arguments.kind or list(KINDS)
    size = max(1, min(250, -(-arguments.count // arguments.jobs)))
    stop = arguments.first + arguments.count
    jobs = [
        (kind, arguments.seed, first, min(size, stop - first))
        for kind in kinds
        for first in range(arguments.first, stop, size)
    ]
    with ThreadPoolExecutor(arguments.jobs) as pool:
        results = list(pool.map(lambda job: run(*job), jobs))
    groups: dict[tuple[str, str], list[Fault]] = defaultdict(list)
    for kind in kinds:
        found = [result for result in results if result.kind == kind]
        faults = [fault for result in found for fault in result.faults]
        inputs, steps = sum(r.cases for r in found), sum(r.steps for r in found)
        longest = max(r.longest_s for r in found)
        print(f"{kind}: {inputs} inputs, {steps} steps, longest {longest:.1f} s of CPU, {len(faults)} faults")
        for fault in faults:
            groups[kind, fault.signature].append(fault)
    out = arguments.out or Path(tempfile.mkdtemp(prefix="mmw-faults-"))
    for (kind, signature), faults in sorted(groups.items(), key=lambda item: -len(item[1])):
        print(f"\n{kind}: {len(faults)} x {signature}\n  {faults[0].step}\n  input: {save(faults[0], out)}")
    return 1 if groups else 0


if __name__ == "__main__":
    sys.exit(main())
