"""A script that runs SUMO in a process of its own: `libsumo` is one simulation a process, and brings its own libraries.

Its argument is a folder with `job.json`; it writes `states.npy` there. It imports nothing of mmw.
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

HINT_STEP = 1.0
"""Speed limits of a lane are this far apart [m]."""

NOT_LOADED = 3
"""Exit code if `libsumo` cannot be loaded; the reason is on stderr."""


def main(folder: Path) -> None:
    """Run the job of a folder.

    `job.json` holds `options` (SUMO's command line), `vehicles` (count; their ids are numbers), `steps` (count),
    `limits` (SUMO lane -> speed limit every meter [m/s]) and `top_speed` [m/s]. `states.npy` gets float64
    [steps + 1, V, 4]: x, y, z of the front bumper [m] and the angle clockwise from north [deg]; NaN where a vehicle is
    not in the network.
    """
    try:
        import libsumo
    except ImportError as error:  # the package is there, but not a system library that it links to
        print(error, file=sys.stderr)
        sys.exit(NOT_LOADED)

    job = json.loads((folder / "job.json").read_text())
    states = np.full((job["steps"] + 1, job["vehicles"], 4), np.nan)
    libsumo.start(["sumo", *job["options"]])
    try:
        for step in range(job["steps"] + 1):
            libsumo.simulationStep()
            for name in libsumo.vehicle.getIDList():
                x, y, z = libsumo.vehicle.getPosition3D(name)
                states[step, int(name)] = x, y, z, libsumo.vehicle.getAngle(name)
                libsumo.vehicle.setMaxSpeed(name, _limit(libsumo.vehicle, name, job))
    finally:
        libsumo.close()
    np.save(folder / "states.npy", states)


def _limit(vehicle: Any, name: str, job: dict[str, Any]) -> float:
    """Return how fast the road lets a vehicle go where it is [m/s]."""
    limits = job["limits"].get(vehicle.getLaneID(name))
    if not limits:
        return job["top_speed"]
    return limits[min(int(vehicle.getLanePosition(name) / HINT_STEP), len(limits) - 1)]


if __name__ == "__main__":
    main(Path(sys.argv[1]))
