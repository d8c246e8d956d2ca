"""SUMO beside mmw: actors are where SUMO has its vehicles, and SUMO does what channel and LiDAR say."""

import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest

import mmw
from mmw.cli.import_scene import main as import_scene
from mmw.core.transforms import quaternion_to_ypr
from mmw.worlds.importers.sumo.netconvert import find_netconvert
from tests.fixtures.osm_files import needs_netconvert
from tests.fixtures.sumo_installed import needs_sumo
from tests.fixtures.traffic_towns import SEDAN

CONFIG = """
scenarios:
  - name: grid
    town: grid.usda
    traffic: {models: [sedan], vehicle_count: 14, spawn_center_m: [100, 100, 0], cav_ranks: [0, 1]}
    rsus: [{name: rsu_1, position_m: [94, 92, 0], yaw_deg: 53}]
weathers: [sunny]
frames: {count: 130}
sensors: [{type: lidar, on: [cav], channels: 8, points_per_channel: 90}]
channel: {carriers_hz: [28.0e9]}
"""


@pytest.mark.slow
@needs_sumo
def test_actors_are_where_sumo_has_its_vehicles(tmp_path: Path) -> None:
    needs_netconvert()
    from examples.beside_sumo.__main__ import drive
    from examples.beside_sumo.made_routes import write_routes

    network, routes, record = (tmp_path / name for name in ("grid.net.xml", "grid.rou.xml", "fcd.xml"))
    beside = [str(Path(find_netconvert()).parent), str(Path(sys.executable).parent)]
    program = next(filter(None, (shutil.which("netgenerate", path=place) for place in beside)))
    grid = ["--grid", "--grid.number", "2", "--grid.length", "120", "--grid.attach-length", "100"]
    subprocess.run([program, *grid, "-o", str(network)], check=True, capture_output=True)
    assert import_scene([str(network), "--out", str(tmp_path / "grid.usda")]) == 0
    (tmp_path / "grid.yaml").write_text(CONFIG)
    write_routes(routes, network, SEDAN.length)
    options = ["-n", str(network), "-r", str(routes), "--fcd-output", str(record), "--precision", "6"]
    with mmw.Simulation(tmp_path / "grid.yaml", mode="live", device="cpu") as simulation:
        told = drive(simulation, options, 120)
        frame = simulation.step()
        agents = {name: frame.agents[name].pose for name in ("cav_1", "cav_2")}
    states = {float(step.get("time")): list(step) for step in ElementTree.parse(record).getroot()}
    time = (frame.frame - 3) * 0.01  # a pose holds two frames later, and frame 1 is the first
    cavs = [state for state in states[round(time, 2)] if state.get("id").startswith("cav")]
    assert len(cavs) == 2
    for state, pose in zip(cavs, agents.values(), strict=True):
        yaw = quaternion_to_ypr(pose[3:])[0]
        ahead = SEDAN.front + 0.5 * SEDAN.wheelbase
        bumper = pose[:2] + ahead * np.array([np.cos(yaw), np.sin(yaw)])
        assert bumper == pytest.approx([float(state.get("x")), float(state.get("y"))], abs=1e-5)
        assert np.degrees(0.5 * np.pi - yaw) % 360.0 == pytest.approx(float(state.get("angle")), abs=1e-4)
    assert len(told) == 2 and all(re.search(r"path gain -\d+\.\d dB, \d+ LiDAR points", line) for line in told)
