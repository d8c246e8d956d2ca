"""Replay in memory: the rows of a dataset bit for bit, one frame at a time, and nothing left behind."""

import gc
import logging
import pickle
import shutil
import tempfile
from pathlib import Path

import psutil
import pytest

import mmw
from mmw.config import Config, ScenarioConfig
from mmw.core.resources import configs_dir
from mmw.storage.schemas import TABLES
from tests.fixtures.own_world import DATA
from tests.fixtures.plugin_sensor import Thermometer, thermometer
from tests.fixtures.simulated_files import assert_same_dataset, assert_same_samples
from tests.fixtures.small_dataset import SCENARIO, SMALL

LIDAR = "sensors=[{type: lidar, channels: 4, points_per_channel: 32}]"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a stage with a configuration of every sensor in every mode, three weathers, frames 3 and 4."""
    folder = tmp_path_factory.mktemp("every")
    shutil.copy(DATA / "mine.usda", folder)
    shutil.copy(DATA / "every_sensor.yaml", folder / "mine.yaml")
    return folder


@pytest.fixture(scope="module")
def every(folder: Path) -> mmw.Dataset:
    """Generate its dataset, its channel with diffraction."""
    return mmw.generate(folder / "mine.yaml", folder / "d", overrides=BENT, device="cpu", progress=False)


BENT = ["channel.diffraction=true", "channel.edge_diffraction=true"]  # at the rim of the plate on the body


@pytest.fixture(scope="module")
def tiny(folder: Path) -> Config:
    """Return the same world with one LiDAR."""
    return mmw.load_config(folder / "mine.yaml", [LIDAR])


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Let temporary files be in a folder of their own."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


@pytest.mark.parametrize(("weather", "launch"), [("sunny", 1), ("mine", 2)])
def test_every_table_of_every_sensor_is_that_of_a_dataset(
    every: mmw.Dataset, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, weather: str, launch: int
) -> None:
    monkeypatch.setattr("mmw.generation.simulation.FRAMES_PER_LAUNCH", {"cpu": launch})
    config = mmw.load_config(folder / "mine.yaml", BENT)
    with mmw.Simulation(config, weather=weather, base=folder, device="cpu") as simulation:
        frames = list(simulation)
    assert [frame.frame for frame in frames] == list(simulation.frames) == [3, 4]
    assert set().union(*(frame.data.tables for frame in frames)) == set(TABLES) == set(every.tables)
    assert_same_dataset(every, simulation, frames, tmp_path)
    assert any("diffraction" in frame.table("paths").column("kind").to_pylist() for frame in frames)
    for frame in frames:  # and what users see of them
        assert assert_same_samples(every.frame("mine", weather, frame.frame), frame) > 10


@pytest.mark.slow
def test_ten_frames_of_two_scenarios_are_those_of_a_dataset(tmp_path: Path) -> None:
    """Towns with traffic, in the second of two weathers."""
    shipped = [configs_dir() / "scenarios" / f"{name}.yaml" for name in (SCENARIO, "town05_parking_lot")]
    base = mmw.load_config(configs_dir() / "quickstart.yaml", [*SMALL, "frames.count=10"])
    config = base.model_copy(update={"scenarios": tuple(mmw.load_config(path).scenarios[0] for path in shipped)})
    radar = mmw.sensors.Radar(azimuth_rays=24, elevation_rays=8)
    config = mmw.load_config(config, patch={"sensors": [*config.sensors, radar]})
    dataset = mmw.generate(config, tmp_path / "d", device="cpu", progress=False)
    for place, scenario in enumerate(config.scenarios):
        with mmw.Simulation(config, scenario=scenario.name, weather="rainy", device="cpu") as simulation:
            assert len(simulation) == 10
            files = assert_same_dataset(dataset, simulation, simulation, tmp_path / str(place))
        assert files == 5 * 14 + 3  # five shards of two frames, and the static tables


def test_one_frame_by_position_and_by_number(tiny: Config, folder: Path) -> None:
    with mmw.Simulation(tiny, base=folder, device="cpu") as simulation:
        assert (simulation.scenario, simulation.weather, simulation.device) == ("mine", "sunny", "cpu")
        assert len(simulation) == 2 and simulation.frames == range(3, 5)
        first, last = simulation
        assert simulation[0].table("lidar").equals(first.table("lidar"))
        assert simulation[-1].frame == simulation[1].frame == last.frame == 4
        assert simulation.frame(4).table("poses").equals(last.table("poses"))
        assert not first.table("poses").equals(last.table("poses"))
        assert [frame.frame for frame in simulation] == [3, 4]  # again, and beside another
        assert [(one.frame, two.frame) for one, two in zip(simulation, simulation, strict=True)] == [(3, 3), (4, 4)]
        for wrong in (2, -3):
            with pytest.raises(mmw.InputError, match=rf"^simulation\[{wrong}\]: has 2 frames; give 0 to 1$"):
                simulation[wrong]
        with pytest.raises(mmw.InputError, match=r"^frame = 5: mine has 3 to 4; name one of them$"):
            simulation.frame(5)


def test_a_frame_outlives_the_simulation_and_has_the_tables_of_a_dataset(tiny: Config, folder: Path) -> None:
    with mmw.Simulation(tiny, base=folder, device="cpu") as simulation:
        frame = simulation[0]
    simulation.close()
    with pytest.raises(mmw.InputError, match=r"^simulation of mine: is closed; make another one$"):
        next(iter(simulation))
    copy = pickle.loads(pickle.dumps(frame))  # as a data loader's worker gets it
    assert len(copy.agents["Ego"].sensor("lidar")) == len(frame.agents["Ego"].sensor("lidar")) > 0
    assert frame.data.read("sensors", agent="Ego", columns=["sensor"]).to_pydict() == {"sensor": ["antenna", "lidar"]}
    assert frame.data.read("poses", frames=range(4, 9)).num_rows == 0 < frame.data.read("poses").num_rows
    assert frame.table("rgb").num_rows == 0  # no such sensor
    with pytest.raises(mmw.InputError, match=r"^simulation of mine: has no table 'rgb'; it has frames, poses"):
        frame.data.read("rgb")
    with pytest.raises(mmw.InputError, match=r"^simulation of mine: table 'poses': has no column z2; it has"):
        frame.data.read("poses", columns=["z2"])


def test_nothing_is_left_on_the_disk(
    tiny: Config, folder: Path, temporary: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    before = sorted(folder.rglob("*"))
    simulation = mmw.Simulation(tiny, base=folder, device="cpu")
    assert len(list(temporary.iterdir())) == 1
    simulation.close()
    assert not list(temporary.iterdir())
    assert [frame.frame for frame in mmw.Simulation(tiny, base=folder, device="cpu")] == [3, 4]  # closed by nobody
    gc.collect()
    with pytest.raises(mmw.InputError, match="frame 999 is outside the stage"):  # begun, and failed
        mmw.Simulation({"scenarios": [{"name": "a", "stage": folder / "mine.usda"}]}, device="cpu")
    assert not [*temporary.iterdir(), *here.iterdir()] and sorted(folder.rglob("*")) == before


@pytest.mark.slow
def test_memory_does_not_grow_with_simulations(tiny: Config, folder: Path) -> None:
    def use(times: int) -> int:
        for _ in range(times):
            with mmw.Simulation(tiny, base=folder, device="cpu") as simulation:
                assert sum(len(frame.boxes) for frame in simulation) == 2
        gc.collect()
        return psutil.Process().memory_info().rss

    settled = use(5)
    assert use(50) - settled < 10e6  # 0.2 MB each; what they hold takes 5 MB


def test_notes_are_log_records(tiny: Config, folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    config = mmw.load_config(tiny, ["channel.links=[v2v]"])
    with caplog.at_level(logging.WARNING, "mmw"), mmw.Simulation(config, base=folder, device="cpu"):
        pass
    assert [record.getMessage() for record in caplog.records] == [
        "channel.links has v2v, but the scenario has 1 CAV, 1 RSU: no such link"
    ]


def test_a_sensor_of_this_process_is_simulated(folder: Path) -> None:
    with thermometer():
        config = mmw.load_config(folder / "mine.yaml", patch={"sensors": [Thermometer()]})
        with mmw.Simulation(config, base=folder, device="cpu") as simulation:
            assert simulation[0].agents["Ego"].sensor("thermometer").celsius == 20.0


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"scenario": "yours"}, "^scenario = yours: there are mine; name one of them$"),
        ({"weather": "snow"}, "^weather = snow: there are sunny, foggy, mine; name one of them$"),
        ({"device": "cuda:99"}, r"^compute.device = 'cuda:99': this machine has cpu"),
        ({"base": None}, r"^configuration: scenario 'mine': stage = 'mine.usda': no such file \(.*mine.usda\); give"),
        ({"base": "/nowhere"}, "^base = '/nowhere': no such folder; give the one that relative paths start from$"),
    ],
)
def test_what_is_not_there_is_one_error(tiny: Config, folder: Path, given: dict, message: str) -> None:
    with pytest.raises(mmw.InputError, match=message) as caught:
        mmw.Simulation(tiny, **{"base": folder, **given})
    assert len(caught.value.problems) == 1


def test_a_configuration_made_of_sections(folder: Path) -> None:
    roles, materials = {"/World/Ego": "cav"}, {"/World/*": "itu_concrete"}
    scenario = ScenarioConfig(name="mine", stage=folder / "mine.usda", actor_roles=roles, materials=materials)
    sensors = [mmw.sensors.Lidar(channels=4, points_per_channel=32), mmw.sensors.Imu()]
    config = Config(scenarios=[scenario], sensors=sensors, frames={"count": 3}, channel={"enabled": False})
    with mmw.Simulation(config, device="cpu") as simulation:
        frame = simulation[2]
    assert set(frame.agents["Ego"].sensors) == {"lidar", "imu"} and len(simulation) == 3
