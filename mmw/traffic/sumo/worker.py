"""A script that runs SUMO in a process of its own: `libsumo` is one simulation a process, and brings its own libraries.

Its argument is a folder with `job.json`: `options` (SUMO's command line), `limits` (SUMO lane -> speed limit every
meter [m/s]) and `top_speed` [m/s]. Every line on stdin makes one step: a JSON list of calls [method of
`libsumo.vehicle`, arguments...], which are made before it. A line on stdout answers: a list of states [id, x, y, z of
the front bumper [m], angle clockwise from north [deg], speed [m/s], SUMO lane] of the vehicles in the network whose ids
are numbers. It ends with the end of stdin, and imports nothing of mmw.
"""

import json
import os
import sys
from pathlib import Path
from typing import Any

HINT_STEP = 1.0
"""Speed limits of a lane are this far apart [m]."""

NOT_LOADED = 3
"""Exit code if `libsumo` cannot be loaded; the reason is on stderr."""


def main(folder: Path) -> None:
    """Run the job of a folder."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what SUMO prints is no answer
    try:
        import libsumo
    except ImportError as error:  # the package is there, but not a system library that it links to
        print(error, file=sys.stderr)
        sys.exit(NOT_LOADED)

    job = json.loads((folder / "job.json").read_text())
    vehicle = libsumo.vehicle
    libsumo.start(["sumo", *job["options"]])
    try:
        for line in sys.stdin:
            for method, *arguments in json.loads(line):
                getattr(vehicle, method)(*arguments)
            libsumo.simulationStep()
            states = []
            for name in filter(str.isdigit, vehicle.getIDList()):
                place, lane = vehicle.getPosition3D(name), vehicle.getLaneID(name)
                states.append([int(name), *place, vehicle.getAngle(name), vehicle.getSpeed(name), lane])
                vehicle.setMaxSpeed(name, _limit(vehicle.getLanePosition(name), lane, job))
            answers.write(json.dumps(states) + "\n")
            answers.flush()
    finally:
        libsumo.close()


def _limit(station: float, lane: str, job: dict[str, Any]) -> float:
    """Return how fast the road lets a vehicle go at a station of a lane [m/s]."""
    limits = job["limits"].get(lane)
    if not limits:
        return job["top_speed"]
    return limits[min(int(station / HINT_STEP), len(limits) - 1)]


if __name__ == "__main__":
    main(Path(sys.argv[1]))
