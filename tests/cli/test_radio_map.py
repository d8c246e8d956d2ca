"""`mmw radiomap`: table, picture, and one line for every mistake."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image

from mmw.__main__ import main
from mmw.cli.radio_map import RADIO_MAP
from mmw.config import load_config
from mmw.core.resources import configs_dir

CONFIG = str(configs_dir() / "quickstart.yaml")
TWO_UNITS = (
    "scenarios.0.rsus=[{name: rsu_1, position_m: [13.5, -29.5, 0.0], yaw_deg: 115}, "
    "{name: rsu_2, position_m: [-60, 8, 0]}]"
)


@pytest.mark.slow
def test_table_and_picture_of_a_scenario(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    arguments = f"--config {CONFIG} --samples-per-tx 4e4 --depth 1 --size 120 --frame 1 --carrier 4.9e9".split()
    arguments = ["radiomap", *arguments, "--weather", "rainy", "--device", "cpu", "--out", str(tmp_path)]
    assert main([*arguments, "frames.count=2", TWO_UNITS]) == 0
    said, *files = capsys.readouterr().out.splitlines()
    assert "rainy, frame 1: 2 transmitter(s)" in said
    assert [Path(file).name for file in files] == [
        "town03_roundabout_radio_map.parquet", "town03_roundabout_radio_map.png",
    ]  # fmt: skip
    table = pq.read_table(files[0])
    assert table.column_names == [column.name for column in RADIO_MAP.columns]
    assert all(field.metadata[b"unit"] and field.metadata[b"doc"] for field in table.schema)
    made = json.loads(table.schema.metadata[b"mmw.radio_map"])
    assert (made["weather"], made["frame"], made["carrier_hz"], made["surface"]) == ("rainy", 1, 4.9e9, "roads")
    columns = {name: np.array(table.column(name).to_pylist(), dtype=object) for name in table.column_names}
    assert set(columns["transmitter"]) == {"rsu_1", "rsu_2"}
    half = table.num_rows // 2
    np.testing.assert_array_equal(columns["cell"], np.tile(np.arange(half), 2))
    middle = np.array([[13.5, -29.5], [-60.0, 8.0]]).mean(axis=0)
    assert (np.abs(np.stack([columns["x"], columns["y"]], axis=1).astype(float) - middle) <= 60).all()
    z = columns["z"].astype(float)
    assert z.min() >= 1.5  # the town's roads are at 0 to 8 m
    assert z.max() < 9.6
    is_reached = np.array([value is not None for value in columns["path_gain_db"]])
    assert 0.1 < is_reached.mean() < 1.0
    gain, rss, sinr = (columns[k][is_reached].astype(float) for k in ("path_gain_db", "rss_dbm", "sinr_db"))
    np.testing.assert_allclose(rss, gain + 44.0)
    assert (sinr <= rss - 30 - 10 * np.log10(1.380649e-23 * 293 * 1e6) + 1e-9).all()
    assert (gain < -40).all()
    assert made["channel"]["max_depth"] == 1 and made["channel"]["samples_per_tx"] == 40_000
    assert np.asarray(Image.open(files[1]).convert("L")).std() > 5


@pytest.mark.slow
def test_sectors_are_transmitters_at_the_carrier_of_the_configuration(tmp_path: Path) -> None:
    arguments = ["--config", "sectors_60ghz", "--samples-per-tx", "2e4", "--depth", "0", "--size", "90", "--table-only"]
    assert main(["radiomap", *arguments, "--device", "cpu", "--out", str(tmp_path), "frames.count=1"]) == 0
    table = pq.read_table(tmp_path / "sectors_60ghz_radio_map.parquet")
    made = json.loads(table.schema.metadata[b"mmw.radio_map"])
    assert made["channel"]["samples_per_tx"] == 20_000 and made["channel"]["max_depth"] == 0
    assert made["channel"]["candidates"] == load_config("sectors_60ghz").channel.candidates
    assert made["carrier_hz"] == 60e9 and made["power_dbm"] == [30.0] * 3
    assert set(table.column("transmitter").to_pylist()) == {f"rsu_1.sector_{number}" for number in (1, 2, 3)}


def test_mistakes_are_named(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    for arguments, part in (
        (["--config", str(tmp_path / "none.yaml")], "no such file"),
        (["--config", CONFIG, "--scenario", "elsewhere"], "town03_roundabout"),
        (["--config", CONFIG, "--frame", "10"], "frames 0 to 9"),
        (["--config", CONFIG, "--weather", "hail"], "hail"),
        (["--config", CONFIG, "--device", "cuda:77"], "cuda:77"),
        (["--config", CONFIG, "--points-per-cell", "3"], "points_per_cell = 3; the square of a whole number"),
        (["--config", CONFIG, "--bandwidth", "0"], "bandwidth_hz = 0"),
        (["--config", CONFIG, "--depth", "9"], "channel.max_depth"),
        (["--config", CONFIG, "--samples-per-tx", "10"], "channel.samples_per_tx"),
        (["--config", CONFIG, "--carrier", "28"], "channel.carriers_hz"),
    ):
        assert main(["radiomap", *arguments, "--out", str(tmp_path)]) == 2
        assert part in capsys.readouterr().err
    with pytest.raises(SystemExit, match="2"):
        main(["radiomap", "--config", CONFIG, "--samples-per-tx", "1.5"])
    assert "whole number" in capsys.readouterr().err
