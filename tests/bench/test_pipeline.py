"""The benchmark of whole runs ends with one line of JSON with its figures."""

import json
import os

import pytest

import bench.pipeline
from bench.pipeline import Busy, _busy, main
from mmw.generation.executors.process_pool import CAN_FORK

pytestmark = pytest.mark.slow  # benchmarks are not part of the package


def test_a_run_is_measured(own_world, capsys):
    weathers = "weathers=[sunny,foggy]"
    main(["--config", str(own_world / "mine.yaml"), "--device", "cpu", "--frames", "4", "--format", "json", weathers])
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["frames"] == 8 and result["workers"] == 1
    assert result["seconds_per_frame"] * result["frames_per_s"] == pytest.approx(1.0)
    assert result["seconds"] > result["set_up_s"] > 0.0 and result["processor_s"] > 0.0
    assert {"scene", "lidar", "channel"} <= set(result["stages"]) and result["rays_per_s"] > 0.0
    assert result["rows"] > 8 and result["bytes"] > 0 and 0.1 < result["host_gb"] < 100.0
    assert result["gpu_busy"] is None
    # Ten frames are the whole: more than the four that were made, less than ten runs.
    assert result["seconds"] < result["projected_s"] < 10 * result["seconds"]


def test_work_of_other_processes_counts(own_world, capsys, monkeypatch):
    """The system adds the workers' processor time to this process's when their server has ended."""
    end_server, added = bench.pipeline._end_server, []

    def end() -> None:
        before = os.times()
        end_server()
        added.append(os.times().children_user - before.children_user)

    monkeypatch.setattr(bench.pipeline, "_end_server", end)
    work = ["--device", "cpu", "--workers", "2", "--format", "json", "output.shard_frames=2"]
    main(["--config", str(own_world / "mine.yaml"), *work])
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["workers"] == 2 and "lidar" in result["stages"]
    assert CAN_FORK is (len(added) == 1 and added[0] > 0.0)
    assert result["processor_s"] > sum(added)


def test_set_up_counts_in_one_share_alone():
    samples = [(0.5, 1.0), (1.5, 0.0), (2.5, 0.4), (3.5, 0.8), (4.5, 0.9), (5.5, 0.0)]
    found = _busy(samples, 1.0, 2.0, 5.0)
    assert found == Busy(mean=pytest.approx(0.7), median=0.8, whole=pytest.approx(0.525))
    assert str(found) == "busy 70 % (half of the time 80 % and more; 52 % with set-up)"
    assert _busy(samples, 1.0, 6.0, 7.0) is None


def test_an_unknown_scenario_is_named(own_world):
    with pytest.raises(SystemExit, match="--scenarios nowhere"):
        main(["--config", str(own_world / "mine.yaml"), "--device", "cpu", "--scenarios", "nowhere"])
