"""The benchmark of whole runs ends with one line of JSON that holds what it says."""

import json

import pytest

from bench.pipeline import main
from tests.own_world import write_own_world


def test_a_run_is_measured(tmp_path, capsys):
    folder = write_own_world(tmp_path)
    weathers = "weathers=[sunny,foggy]"
    main(["--config", str(folder / "mine.yaml"), "--device", "cpu", "--frames", "4", "--format", "json", weathers])
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["frames"] == 8 and result["workers"] == 1
    assert result["seconds_per_frame"] * result["frames_per_s"] == pytest.approx(1.0)
    assert result["seconds"] > result["set_up_s"] > 0.0 and result["processor_s"] > 0.0
    assert {"scene", "lidar", "channel"} <= set(result["stages"]) and result["rays_per_s"] > 0.0
    assert result["rows"] > 8 and result["bytes"] > 0 and 0.1 < result["host_gb"] < 100.0
    assert result["gpu_busy"] is None
    # Ten frames are the whole: more than the four that were made, less than ten runs.
    assert result["seconds"] < result["projected_s"] < 10 * result["seconds"]


def test_an_unknown_scenario_is_named(tmp_path):
    folder = write_own_world(tmp_path)
    with pytest.raises(SystemExit, match="--scenarios nowhere"):
        main(["--config", str(folder / "mine.yaml"), "--device", "cpu", "--scenarios", "nowhere"])
