"""Generation from Python: the dataset of `mmw run`, no output where none is wanted, and one error for a fault."""

import multiprocessing
import subprocess
import sys
import threading
from pathlib import Path

import pytest

import mmw
from mmw.config import ConfigError
from mmw.core.resources import configs_dir
from tests.fixtures.own_world import SMALL, assert_same_files, assert_same_rows, run_own
from tests.fixtures.plugin_sensor import Thermometer, thermometer

LIDAR = "sensors=[{type: lidar, channels: 4, points_per_channel: 32}]"
MANY = "weathers=[sunny, light_rain, rainy, foggy]"
"""Forty scenario-weather-frames, for which `workers: auto` would start processes."""


def test_all_kinds_of_configuration_give_the_dataset_of_the_command(
    own_world: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run_own(own_world, "command", *SMALL, LIDAR, "--workers", "1") == 0
    capfd.readouterr()
    path = own_world / "mine.yaml"
    config = mmw.load_config(path, [*SMALL, LIDAR])
    how = {"device": "cpu", "workers": 1, "progress": False}
    found = mmw.generate(path, own_world / "file", overrides=[*SMALL, LIDAR], **how)
    mmw.generate(config, own_world / "object", base=own_world, **how)
    content = {
        "scenarios": ["mine.yaml"],
        "weathers": ("sunny", "rainy"),
        "sensors": [mmw.sensors.Lidar(channels=4, points_per_channel=32)],
        "channel": {"samples_per_tx": 10_000},
        "output": {"shard_frames": 2, "dir": own_world / "mapping"},
    }
    monkeypatch.chdir(own_world)  # where relative paths start from
    mmw.generate(content, overrides=["frames.count=10"], **how)
    for name in ("file", "object"):
        assert_same_files(own_world / "command", own_world / name)
    assert_same_rows(own_world / "command", own_world / "mapping")  # the included scenario has frames of its own
    assert isinstance(found, mmw.Dataset) and found.root == own_world / "file"
    assert found.read("lidar").num_rows == 2 * 10 * 2  # weathers, frames, agents
    assert "".join(capfd.readouterr()) == ""


def test_progress_is_that_of_the_command_and_a_second_call_resumes(
    own_world: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    def generate(**how: bool) -> str:
        mmw.generate(own_world / "mine.yaml", own_world / "d", overrides=[LIDAR], device="cpu", workers=1, **how)
        told = capfd.readouterr()
        return told.err + told.out

    first = generate()
    assert first.startswith("mine: 10/10 frames, ") and "10 frames in " in first and "query it" in first
    assert "10 of 10 frames are there already; nothing to make" in generate()
    assert generate(overwrite=True).startswith("mine: 10/10 frames, ")


def test_generation_in_a_thread(own_world: Path) -> None:
    found = []
    options = {"overrides": [LIDAR], "device": "cpu", "workers": 1, "progress": False}
    work = threading.Thread(
        target=lambda: found.append(mmw.generate(own_world / "mine.yaml", own_world / "d", **options))
    )
    work.start()
    work.join()
    assert len(found[0].read("frames")) == 10


@pytest.mark.slow
@pytest.mark.parametrize("guard", ["", 'if __name__ == "__main__":\n    '])
def test_workers_do_not_run_a_script_again(own_world: Path, guard: str) -> None:
    script = own_world / "script.py"
    call = (
        'mmw.generate("mine.yaml", "d", overrides=["output.shard_frames=2"], device="cpu", workers=2, progress=False)'
    )
    script.write_text(f'import mmw\nprint("once", __name__)\n{guard}print(len({call}.read("frames")))\n')
    for command in ([str(script)], ["-m", "script"]):
        done = subprocess.run([sys.executable, *command], cwd=own_world, capture_output=True, text=True, check=False)
        assert done.stdout == "once __main__\n10\n", done.stderr
        assert done.stderr == "" and done.returncode == 0
        names = [path.name for path in (own_world / "d" / "lidar").rglob("*.parquet")]
        assert len(names) == 5 and not (own_world / "d" / "_locks" / "part-0-of-1.json").exists()


@pytest.mark.slow
def test_an_error_in_a_worker_is_one_exception(own_world: Path) -> None:
    """Frame 30 is outside the stage, which only a worker finds out."""
    script = own_world / "script.py"
    call = 'mmw.generate("mine.yaml", "d", overrides=["frames.count=30"], device="cpu", workers=2, progress=False)'
    script.write_text(f'import mmw\ntry:\n    {call}\nexcept mmw.InputError as error:\n    print("caught", error)\n')
    done = subprocess.run([sys.executable, str(script)], cwd=own_world, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("caught ") and "outside the stage" in done.stdout and done.stdout.count("\n") == 1
    assert done.stderr == ""


def test_a_sensor_of_this_process_has_one_worker(own_world: Path, capfd: pytest.CaptureFixture[str]) -> None:
    note = "sensor 'thermometer' is registered in this process only, and is no entry point of a package"
    how = {"device": "cpu", "progress": True}
    with thermometer():
        config = mmw.load_config(own_world / "mine.yaml", [MANY], {"sensors": [Thermometer()]})
        found = mmw.generate(config, own_world / "d", base=own_world, **how)
        assert len(found.read("thermometer")) == 40
        assert f"note: one worker, because {note}\n" in capfd.readouterr().err
        for more, key, cure in (
            ({"workers": 2}, "compute.workers = 2", "give workers = 1"),
            ({"overrides": ["compute.engine=ray"]}, "compute.engine = 'ray'", "use engine local with workers = 1"),
        ):
            with pytest.raises(ConfigError) as caught:
                mmw.generate(config, own_world / "e", base=own_world, **how, **more)
            assert caught.value.problems == [f"configuration: {key}: {note}; {cure}"]
    assert not (own_world / "e").exists()


def test_a_worker_of_the_users_own_has_one_worker(own_world: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(multiprocessing.current_process()._config, "daemon", True)
    with pytest.raises(ConfigError, match=r"compute.workers = 2: this process is a worker of multiprocessing itself"):
        mmw.generate(own_world / "mine.yaml", own_world / "d", overrides=[LIDAR], device="cpu", workers=2)
    how = {"overrides": [LIDAR, MANY], "device": "cpu", "progress": False}
    assert len(mmw.generate(own_world / "mine.yaml", own_world / "d", **how).read("frames")) == 40


@pytest.mark.parametrize(
    ("config", "more", "message"),
    [
        ("quikstart", {}, "quikstart: no such file, and no shipped configuration; did you mean quickstart"),
        ("nowhere.yaml", {}, "nowhere.yaml: no such file; give an existing YAML file"),
        (7, {}, "configuration = 7: is of type int; give a YAML file, the name of a shipped configuration"),
        ({}, {}, "configuration: scenarios: missing; add it"),
        ({"scenarios": ["no.yaml"]}, {}, "no.yaml: no such file; give an existing YAML file"),
        ({"scenarios": [], "sed": 1}, {}, "configuration: sed = 1: unknown key; did you mean `seed`?"),
        ("MINE", {"overrides": ["sensors.lidar.channels=0"]}, "sensors[0].channels = 0: must be greater than or equal"),
        ("MINE", {"overrides": "frames.count=1"}, "overrides = 'frames.count=1': a list of texts is needed, such as"),
        ("MINE", {"out": 5}, "output.dir = 5: text is needed"),
        ("MINE", {"workers": 0}, "compute.workers = 0: 0 workers make nothing; give 1 to 1024, or auto"),
        ("MINE", {"device": "cuda:77"}, "compute.device = 'cuda:77': this machine has cpu"),
        ("MINE", {"accept": "versions"}, "accept = 'versions': give a list of some of 'versions', 'machine'"),
        ("MINE", {"accept": ["rows"]}, "accept = ['rows']: give a list of some of 'versions', 'machine'"),
        ("MINE", {"base": "/"}, "mine.yaml: scenario 'mine': stage = 'mine.usda': no such file (/mine.usda); give a"),
        ("MINE", {"out": "gs://b/x"}, "gs://b/x: is not the address of a dataset; give a folder or s3://bucket/folder"),
        ("MINE", {"overrides": ["frames.count=99"]}, "frame 98 is outside the stage, which holds frames 0 to 9"),
    ],
)
def test_bad_input_is_one_error(own_world: Path, config: object, more: dict, message: str) -> None:
    given = own_world / "mine.yaml" if config == "MINE" else config
    with pytest.raises(mmw.InputError) as caught:
        mmw.generate(given, **{"out": own_world / "d", "device": "cpu", "progress": False, **more})  # pyright: ignore
    assert any(message in problem for problem in caught.value.problems), caught.value.problems
    assert len(caught.value.problems) <= 2 and "Traceback" not in str(caught.value)


def test_a_folder_with_something_else_is_left_alone(own_world: Path) -> None:
    path, out = own_world / "mine.yaml", own_world / "d"
    how = {"device": "cpu", "workers": 1, "progress": False}
    (out / "letters").mkdir(parents=True)
    with pytest.raises(mmw.InputError, match=r"d: has letters but no dataset.json; a dataset needs an empty or new"):
        mmw.generate(path, out, overrides=[LIDAR], **how)
    (out / "letters").rmdir()
    first = mmw.generate(path, out, overrides=[LIDAR, "frames.count=2"], **how)
    with pytest.raises(mmw.InputError, match=r"d: belongs to configuration .*frames.count: 2 -> 3; use --overwrite"):
        mmw.generate(path, out, overrides=[LIDAR, "frames.count=3"], **how)
    assert len(first.read("frames")) == 2
    other = mmw.generate(path, out, overrides=[LIDAR, "frames.count=3"], overwrite=True, **how)
    assert len(other.read("frames")) == 3


@pytest.mark.slow
def test_a_shipped_configuration_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    small = ["frames.count=1", "sensors=[{type: imu}]", "channel.enabled=false"]
    found = mmw.generate("quickstart", overrides=small, device="cpu", progress=False)
    assert found.root == tmp_path / "out" / "quickstart" and len(found.read("imu")) == 3
    assert mmw.load_config("quickstart") == mmw.load_config(configs_dir() / "quickstart.yaml")
