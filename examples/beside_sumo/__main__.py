"""SUMO beside mmw: your scenario drives the vehicles, mmw gives channel and LiDAR of every step, SUMO obeys both.

    netgenerate --grid --grid.number 2 --grid.length 120 --grid.attach-length 100 -o out/grid.net.xml
    mmw import out/grid.net.xml --out out/grid.usda --buildings suburb
    python -m examples.beside_sumo out/grid.net.xml out/grid.yaml --steps 300

`out/grid.yaml` has the scenario that `mmw import` prints, with `traffic.models: [sedan]` and a LiDAR on the CAVs
(`docs/guides/closed-loop.md`). `--routes FILE` takes your own routes, in place of those that are made. Vehicles whose
ids begin with `cav` carry LiDAR and a radio. SUMO runs through TraCI (`pip install traci eclipse-sumo`); `import
libsumo as traci` is the same without a second process.
"""

import argparse
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import sumolib
import traci

import mmw
from examples.beside_sumo.made_routes import write_routes
from mmw.core.errors import InputError
from mmw.dataset.frame import Agent
from mmw.traffic.vehicle_pose import Shape, make_shape
from mmw.usd.vehicle_catalog import load_catalog

MODEL = "sedan"
"""Model of all vehicles; a fleet of several needs one for each type of SUMO's."""

WEAK_DB = -93.0
"""Path gain below which a vehicle drives more slowly. Design value."""

SLOW_M_S = 5.0
"""Speed where the link is weak. Design value."""


class Actors:
    """Actors of a simulation that play vehicles of SUMO; those without a part stand 60 m below the ground."""

    def __init__(self, names: Sequence[str], shape: Shape) -> None:
        """Take the actors: CAVs play vehicles that are called so, the others all others."""
        self.part: dict[str, str] = {}
        """Vehicle of SUMO -> actor."""
        self._shape = shape
        self._parked = {name: (20.0 * k, 0.0, -60.0, 0.0) for k, name in enumerate(names)}
        self._free = list(names)

    def controls(self, vehicles: Mapping[str, tuple[Sequence[float], float]]) -> dict[str, mmw.Control]:
        """Return where every actor is.

        Args:
            vehicles: SUMO's front bumpers [m] and angles [deg clockwise from north].

        Raises:
            InputError: If there are more vehicles than actors.
        """
        for gone in self.part.keys() - vehicles.keys():
            self._free.append(self.part.pop(gone))
        for vehicle in sorted(vehicles.keys() - self.part.keys()):
            kind = "cav" if vehicle.startswith("cav") else "veh"
            free = sorted(name for name in self._free if name.startswith(kind))
            if not free:
                raise InputError(f"vehicle {vehicle!r}: no actor is free for it; give more cav_ranks or vehicle_count")
            self.part[vehicle] = free[0]
            self._free.remove(free[0])
        poses = {name: self._parked[name] for name in self._free}
        poses |= {name: self._pose(*vehicles[vehicle]) for vehicle, name in self.part.items()}
        return {name: mmw.Control(pose=pose) for name, pose in poses.items()}

    def _pose(self, bumper: Sequence[float], angle: float) -> tuple[float, float, float, float]:
        """Return the ground point midway between the axles and the yaw of a vehicle of SUMO."""
        yaw = 0.5 * np.pi - np.radians(angle)
        back = self._shape.front + 0.5 * self._shape.wheelbase
        return bumper[0] - back * np.cos(yaw), bumper[1] - back * np.sin(yaw), bumper[2], float(yaw)


def drive(simulation: mmw.Simulation, options: Sequence[str], steps: int) -> list[str]:
    """Step SUMO and a live simulation together, and return a line for every second and CAV."""
    shape = make_shape(load_catalog()[MODEL])
    simulation.reset()
    objects = simulation.static_tables["objects"].column("actor").to_pylist()
    actors = Actors(sorted({name for name in objects if name and name.startswith(("cav_", "veh_"))}), shape)
    told: list[str] = []
    traci.start([sumolib.checkBinary("sumo"), *options, "--step-length", "0.01", "--no-step-log", "true"])
    try:
        for step in range(steps):
            traci.simulationStep()
            vehicles = {
                name: (traci.vehicle.getPosition3D(name), traci.vehicle.getAngle(name))
                for name in traci.vehicle.getIDList()
            }
            frame = simulation.step(actors.controls(vehicles))
            if step % 100 != 99:  # nothing of a frame is traced before it is looked at
                continue
            for vehicle, name in sorted(actors.part.items()):
                if vehicle.startswith("cav"):
                    told.append(f"{frame.time_s:.2f} s: {vehicle} is {name}: {_obey(vehicle, frame.agents[name])}")
    finally:
        traci.close()
    return told


def _obey(vehicle: str, agent: Agent) -> str:
    """Slow a vehicle of SUMO down where its link is weak; return what it sees."""
    gain = max((link.gain_db for link in agent.links if link.gain_db is not None), default=-np.inf)
    traci.vehicle.setSpeed(vehicle, SLOW_M_S if gain < WEAK_DB else -1.0)  # -1: SUMO's driver again
    points = agent.sensor("lidar").points
    near = np.linalg.norm(points[points[:, 2] > -1.5], axis=1).min(initial=np.inf)
    speed = traci.vehicle.getSpeed(vehicle)
    return f"{speed:.1f} m/s, path gain {gain:.1f} dB, {len(points)} LiDAR points, the nearest obstacle at {near:.1f} m"


def main(argv: Sequence[str] | None = None) -> None:
    """Drive, print, save."""
    parser = argparse.ArgumentParser(prog="python -m examples.beside_sumo")
    parser.add_argument("network", type=Path, help="SUMO network; the town has its coordinates")
    parser.add_argument("config", type=Path, help="configuration with the town, as many vehicles as SUMO has, LiDAR")
    parser.add_argument("--routes", type=Path, help="routes; made for the network if left out")
    parser.add_argument("--steps", type=int, default=300, help="steps of 10 ms")
    parser.add_argument("--sumo", default="", help="more options of SUMO, in one word, as '--sumo=--seed 7'")
    parser.add_argument("--out", type=Path, help="save the episode as a dataset")
    given = parser.parse_args(argv)
    config = mmw.load_config(given.config, [f"frames.count={given.steps + 3}"])
    live = mmw.Simulation(config, mode="live", base=given.config.parent)
    with tempfile.TemporaryDirectory() as folder, live as simulation:
        routes = given.routes or Path(folder) / "made.rou.xml"
        if given.routes is None:
            write_routes(routes, given.network, make_shape(load_catalog()[MODEL]).length)
        options = ["-n", str(given.network), "-r", str(routes), *given.sumo.split()]
        print("\n".join(drive(simulation, options, given.steps)))
        if given.out is not None:
            print(f"saved: {simulation.save(given.out).root}")


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except InputError as error:
        sys.exit(str(error))
