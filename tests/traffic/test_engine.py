"""The traffic engine protocol: specs, keys, packages, an engine of another package, and steps of the IDM engine."""

import sys
from pathlib import Path

import numpy as np
import pytest

from mmw.config import ConfigError, TrafficConfig, load_config, traffic_engine
from mmw.config.load import json_schema
from mmw.config.traffic_engine import ENGINES, TrafficEngineSpec, check_package
from mmw.core.errors import InputError
from mmw.core.registry import load_reference
from mmw.generation.estimate import check_inputs
from mmw.traffic.engine import simulate_traffic
from mmw.traffic.idm.simulation import record_steps, start_fleet
from tests.fixtures.traffic_towns import crossroad, demand

CONVOY = '''
import numpy as np
from mmw.config.traffic_engine import TrafficEngineSpec
from mmw.core.errors import InputError
from mmw.traffic.demand import TrafficResult, VehicleTrack
from mmw.traffic.spawn import connected_ranks, name_vehicle

SPEC = TrafficEngineSpec(
    "convoy", "convoy:simulate", keys=("options",), required=("options",), needs_lanes=False, package="json"
)

def simulate(demand):
    """Move vehicles east, 20 m behind each other."""
    speed = demand.traffic.options.get("speed_mps")
    if not isinstance(speed, float):
        raise InputError(f"options.speed_mps = {speed}: a number is needed")
    cavs = len(connected_ranks(demand.traffic, demand.seed))
    tracks = []
    for position in range(demand.traffic.vehicle_count):
        poses = np.tile([-20.0 * position, 0, 0, 0, 0, 0, 1], (demand.frame_count, 1))
        poses[:, 0] += speed * np.arange(demand.frame_count) / 100
        name, role = name_vehicle(position, cavs)
        tracks.append(VehicleTrack(name, role, "sedan", "red", poses))
    return TrafficResult(tracks)
'''

CONFIG = """
scenarios:
- {name: s, town: town03, traffic: {engine: convoy, vehicle_count: 3, spawn_center_m: [0, 0, 0], cav_ranks: [0],
   options: {speed_mps: 8.0}}}
weathers: [sunny]
frames: {start: 0, count: 1}
channel: {enabled: false}
"""


@pytest.fixture
def convoy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Install a package with an engine, which needs the package `json`, into a folder for one test."""
    (tmp_path / "convoy.py").write_text(CONVOY)
    info = tmp_path / "convoy-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: convoy\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[mmw.traffic_engines]\nconvoy = convoy:SPEC\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "convoy", raising=False)
    monkeypatch.setattr(ENGINES, "_found", None)
    monkeypatch.setattr(ENGINES, "_loaded", {})
    (tmp_path / "mine.yaml").write_text(CONFIG)
    return tmp_path


def test_an_engine_of_another_package_drives(convoy: Path) -> None:
    config = load_config(convoy / "mine.yaml")
    check_inputs(config, convoy)
    assert json_schema()["$defs"]["TrafficConfig"]["properties"]["engine"]["enum"][-1] == "convoy"
    options = {"engine": "convoy", "vehicle_count": 3, "cav_ranks": (0,), "pedestrian_count": 0}
    result = simulate_traffic(demand(crossroad(), options={"speed_mps": 8.0}, frame_count=101, **options))
    assert [(track.name, track.role) for track in result.tracks] == [
        ("cav_1", "cav"), ("veh_001", "vehicle"), ("veh_002", "vehicle"),
    ]  # fmt: skip
    assert result.tracks[1].poses[-1, 0] == pytest.approx(-12.0)
    with pytest.raises(InputError, match=r"^options.speed_mps = None: a number is needed"):
        simulate_traffic(demand(crossroad(), options={"speed": 8.0}, **options))
    with pytest.raises(ConfigError, match=r"engine = 'convoy' needs `options` \(.*\); give it"):
        load_config(convoy / "mine.yaml", ["scenarios.0.traffic.options={}"])
    with pytest.raises(ConfigError, match=r"`signals` goes with engine: idm; engine is 'convoy'"):
        load_config(convoy / "mine.yaml", ["scenarios.0.traffic.signals=true"])


SUMO = ["scenarios.0.traffic.engine=sumo", "scenarios.0.traffic.options={}"]


@pytest.mark.parametrize(("changes", "package"), [([], "json"), (SUMO, r"'multimodal-wireless\[sumo\]'")])
def test_a_missing_package_is_named_before_the_run(
    changes: list[str], package: str, convoy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(traffic_engine, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=rf"'s': traffic.engine = '\w+': .*pip install {package}$") as caught:
        check_inputs(load_config(convoy / "mine.yaml", changes), convoy)
    assert len(caught.value.problems) == 1


def test_an_unknown_engine_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(CONFIG)
    with pytest.raises(ConfigError, match=r"engine = 'convoy': is not known; give one of idm, sumo, replay"):
        load_config(tmp_path / "mine.yaml")
    with pytest.raises(InputError, match=r"engine = 'convoy': is not known"):
        check_package("convoy")


@pytest.mark.parametrize(
    ("engine", "key", "value", "users"),
    [
        ("idm", "cav_ids", ("a",), "replay"),
        ("sumo", "trajectories", "t.csv", "replay"),
        ("sumo", "signals", True, "idm"),
        ("replay", "cav_pool", 4, "idm or sumo"),
        ("replay", "lane_changes", False, "idm or sumo"),
        ("idm", "options", {"x": 1}, "of a package that is not installed"),
    ],
)
def test_a_key_of_another_engine_is_refused(engine: str, key: str, value: object, users: str) -> None:
    needed = {"trajectories": "t.csv"} if engine == "replay" else {}
    with pytest.raises(ValueError, match=rf"`{key}` goes with engine: {users}; engine is '{engine}'"):
        TrafficConfig(engine=engine, spawn_center_m=(0, 0, 0), cav_ranks=(0,), **needed, **{key: value})


def test_specs_are_checked() -> None:
    for keys in ({"keys": ("vehicle_count",)}, {"required": ("options",)}):
        with pytest.raises(InputError, match=r"traffic engine 'mine': key '.*' is none of cav_pool, cav_models"):
            TrafficEngineSpec("mine", "mine:simulate", **keys)
    for spec in ENGINES.values():
        assert callable(load_reference(spec.simulate))
        assert not spec.live or callable(load_reference(spec.live))


def test_the_idm_engine_is_advanced_step_by_step() -> None:
    scenario = demand(crossroad(), vehicle_count=6)
    live, _ = start_fleet(scenario)
    station, speed, _ = record_steps(start_fleet(scenario)[0], 40)
    for _ in range(40):
        live.step()
    assert live.time == pytest.approx(2.0)
    np.testing.assert_array_equal([car.station for car in live.cars], station[-1])
    np.testing.assert_array_equal([car.speed for car in live.cars], speed[-1])
