"""Configuration: what is accepted, and the one clear line for everything that is not."""

import json
import re
from pathlib import Path

import jsonschema
import pytest
import yaml

from mmw.cli.run import main
from mmw.config import Config, ConfigError, load_config
from mmw.config.load import json_schema, to_yaml
from mmw.config.yaml_loader import Loader
from mmw.core.resources import configs_dir

BASE = """
scenarios:
  - name: s1
    town: town03
    traffic: {vehicle_count: 20, spawn_center_m: [0, 0, 0], cav_ranks: [1, 2, 3]}
    rsus: [{position_m: [1, 2, 3]}]
frames: {count: 10}
sensors:
  - {type: lidar}
  - {type: depth}
"""


@pytest.fixture
def config_file(tmp_path: Path) -> Path:
    path = tmp_path / "c.yaml"
    path.write_text(BASE)
    return path


def test_defaults_are_the_papers_tables(config_file: Path) -> None:
    config = load_config(config_file)
    lidar, depth = config.sensors
    assert (lidar.channels * lidar.points_per_channel, lidar.range_m) == (30016, 120)
    assert (lidar.upper_fov_deg, lidar.lower_fov_deg) == (2, -25)
    assert (depth.width_px, depth.height_px, depth.fov_deg, depth.on) == (640, 480, 110, ("rsu",))
    channel = config.channel
    assert (channel.carriers_hz, channel.samples_per_tx, channel.max_depth) == ((28e9, 4.9e9), 10**6, 1)
    assert [(one.pattern, one.polarization) for one in channel.antennas] == [("dipole", "V")]


def test_overrides_reach_lists_and_new_sections(config_file: Path) -> None:
    changes = [
        "sensors.0.range_m=80",
        "channel.samples_per_tx=1e5",
        "channel.carriers_hz=[28e9]",
        "scenarios.0.rsus.0.yaw_deg=-90",
    ]
    config = load_config(config_file, changes)
    assert config.sensors[0].range_m == 80
    assert (config.channel.samples_per_tx, config.channel.carriers_hz) == (100_000, (28e9,))
    assert config.scenarios[0].rsus[0].yaw_deg == -90


def test_overrides_reach_into_defaults_that_the_file_leaves_out(tmp_path: Path) -> None:
    path = tmp_path / "short.yaml"
    path.write_text("scenarios: [{name: s, stage: s.usda}]")
    changes = [
        "sensors.0.range_m=80",
        "sensors.0.mount.cav.position_m.2=1.9",
        "sensors.1.on=[cav]",
        "channel.carriers_hz.1=3.5e9",
        "channel.antennas.antenna.mount.rsu.position_m.2=9",
    ]
    config, default = load_config(path, changes), load_config(path)
    lidar, depth, imu = config.sensors[:3]
    assert (lidar.range_m, lidar.channels, lidar.mount["cav"].position_m) == (80, 64, (0, 0, 1.9))
    assert lidar.mount["rsu"] == default.sensors[0].mount["rsu"]
    assert (depth.on, imu) == (("cav",), default.sensors[2])
    assert config.channel.carriers_hz == (28e9, 3.5e9)
    mount = config.channel.antennas[0].mount
    assert [mount[role].position_m for role in ("cav", "rsu")] == [(0, 0, 2.5), (0, 0, 9)]


def test_overrides_name_items_of_lists_or_all(tmp_path: Path) -> None:
    path = tmp_path / "two.yaml"
    traffic = "traffic: {vehicle_count: 9, spawn_center_m: [0, 0, 0], cav_ranks: [1]}"
    path.write_text(
        f"scenarios: [{{name: one, town: town03, {traffic}}}, {{name: two, town: town05, {traffic}}}]\n"
        "sensors: [{type: lidar}, {type: lidar, name: roof}, {type: imu}]"
    )
    changes = [
        "scenarios.*.traffic.warmup_s=5",
        "scenarios.*.traffic.cav_ranks=[2, 3]",
        "scenarios.*.traffic.cav_ranks.0=4",
        "scenarios.two.traffic.cav_ranks.1=0",
        "sensors.lidar.range_m=80",
        "sensors.roof.range_m=70",
        "sensors.*.on=[cav]",
    ]
    config = load_config(path, changes)
    one, two = (scenario.traffic for scenario in config.scenarios)
    assert one and two
    assert (one.warmup_s, two.warmup_s) == (5, 5)
    assert (one.cav_ranks, two.cav_ranks) == ((4, 3), (4, 0))  # a value that all have been given is not shared
    assert [sensor.on for sensor in config.sensors] == [("cav",)] * 3
    assert [getattr(sensor, "range_m", None) for sensor in config.sensors[:2]] == [80, 70]
    for change, cure in (
        ("sensors.1.name=lidar sensors.lidar.range_m=3", "sensors holds 'lidar' 2 times; give its number"),
        ("scenarios.*.rsus.*.yaw_deg=3", "scenarios.*.rsus is a list of 0; give the whole list"),
        ("sensors.0.name=[a] sensors.1.name=5 sensors.x.range_m=3", "index it with 0 to 2, a name (imu) or *"),
    ):
        with pytest.raises(ConfigError, match=re.escape(cure)):
            load_config(path, change.split())
    path.write_text("scenarios: [{name: s, stage: s.usda}]")  # and in the default list
    front = load_config(path, ["sensors.front.width_px=320"]).sensors[5]
    assert (front.name, front.width_px) == ("front", 320)


def test_on_is_a_key_and_a_role_without_a_mount_keeps_its_default(tmp_path: Path) -> None:
    path = tmp_path / "on.yaml"
    path.write_text(
        "scenarios: [{name: s, stage: s.usda}]\n"
        "sensors:\n  - {type: lidar, on: [cav, rsu], mount: {cav: {position_m: [0, 0, 1.8]}}}\n"
        "channel: {antennas: [{mount: {cav: {position_m: [0, 0, 1.5]}}}]}\n"
    )
    config = load_config(path)
    assert config.sensors[0].on == ("cav", "rsu")
    positions = {role: mount.position_m for role, mount in config.sensors[0].mount.items()}
    assert positions == {"cav": (0, 0, 1.8), "rsu": (0, 0, 4.0)}
    mount = config.channel.antennas[0].mount
    assert [mount[role].position_m for role in ("cav", "rsu")] == [(0, 0, 1.5), (0, 0, 4)]


@pytest.mark.parametrize(
    ("override", "key", "cure"),
    [
        ("sensors.0.chanels=4", "sensors[0].chanels", "did you mean `channels`"),
        ("scenarios.0.twon=x", "scenarios[0].twon", "did you mean `town`"),
        ("frame.count=3", "frame", "did you mean `frames`"),
        ("frames.count=0", "frames.count = 0", "greater than or equal to 1"),
        ("sensors.1.fov_deg=190", "sensors[1].fov_deg = 190", "less than 180"),
        ("sensors.0.upper_fov_deg=-80", "sensors[0]", "swap them"),
        ("channel.carriers_hz=[28]", "channel.carriers_hz", "hertz"),
        ("scenarios.0.traffic.cav_ranks=[99]", "scenarios[0].traffic", "ranks count from 0 to"),
        ("scenarios=[]", "scenarios", "at least one"),
        ("sensors.7.range_m=3", "sensors", "list of 2; index it with 0 to 1, a name (lidar, depth) or * for all"),
        ("sensors.lidr.range_m=3", "sensors", "a name (lidar, depth)"),
        ("sensors.*.channels=4", "sensors[1].channels", "unknown key"),
        ("channel.carriers_hz.x=3e9", "channel.carriers_hz is a list of 2", "index it with 0 to 1 or * for all"),
        ("scenarios.0.traffic.cav_pool=2", "scenarios[0].traffic", "choose a number from 3 to "),
        ("scenarios.0.traffic.cav_pool=99", "scenarios[0].traffic", "cav_pool = 99: 3 CAVs are drawn from it"),
        ("nonsense", "override 'nonsense'", "key=value"),
        ("scenarios.0.stage=x.usda", "scenarios[0]", "exactly one"),
        ("compute.batch_frames=0", "compute.batch_frames = 0", "frames traced in one launch"),
        ("seed='42'", 'seed = "42"', "whole number is needed, without quotes"),
        ("channel.enabled=yes", 'channel.enabled = "yes"', "true or false"),
        ("sensors=", "sensors = null", "a list is needed"),
        ("channel=", "channel = null", "a section of keys is needed"),
        ("frames.count=[1", "override 'frames.count=[1'", "not valid YAML"),
        ("frames..count=1", "override 'frames..count=1'", "part of the key is empty"),
        ("seed.x=1", "override 'seed.x=1'", "42 has no keys below it"),
        ("scenarios.0.rsus.0.position_m=[1, 2]", "scenarios[0].rsus[0].position_m", "world frame"),
        ("scenarios.0.rsus.0.position_m=[1, 2, 3, 4]", "position_m", "holds 4 values; 3 are needed"),
        ("scenarios.0.rsus.0.name=veh_003", "veh_003", "rename it"),
        ("scenarios.0.actor_roles={/World/A: cav}", "scenarios[0]", "goes with `stage`"),
        ("sensors.0.name=antenna", "antenna", "rename one"),
        ("air.rainy.relative_humidity=60", "air.rainy.relative_humidity = 60", "less than or equal to 1"),
    ],
)
def test_bad_values_give_one_clear_line_and_exit_code_2(
    config_file: Path, override: str, key: str, cure: str, capsys: pytest.CaptureFixture
) -> None:
    with pytest.raises(ConfigError) as error:
        load_config(config_file, [override])
    (line,) = error.value.problems
    assert "\n" not in line and key in line and cure in line
    assert main(["--config", str(config_file), override]) == 2
    assert key in capsys.readouterr().err


def test_every_problem_gets_its_line(config_file: Path) -> None:
    with pytest.raises(ConfigError) as error:
        load_config(config_file, ["frames.count=0", "seed=-1", "sensors.0.range_m=-1"])
    assert len(error.value.problems) == 3


@pytest.mark.parametrize(
    ("text", "part"),
    [("a: [1", "not valid YAML"), ("- 1", "a mapping"), ("frames: {count: 1}\nframes: {count: 2}", "given twice")],
)
def test_unreadable_files(tmp_path: Path, text: str, part: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=part):
        load_config(path)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "--config"),
        (["--config", "FOLDER"], "directory"),
        (["--config", "FOLDER/no.yaml"], "no such file"),
        (["--config", "FOLDER/c.yaml", "--device", "cuda:99", "--dry-run"], "cuda:99"),
        (["--config", "FOLDER/c.yaml", "scenarios.0.town=atlantis", "--dry-run"], "shipped towns are"),
        (["--config", "FOLDER/c.yaml", "scenarios=[{name: s, stage: nowhere.usda}]", "--dry-run"], "nowhere.usda"),
    ],
)
def test_what_is_not_there_is_exit_code_2(
    config_file: Path, arguments: list[str], said: str, capsys: pytest.CaptureFixture
) -> None:
    assert main([argument.replace("FOLDER", str(config_file.parent)) for argument in arguments]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ("weathers=[sunny, snowy]", "presets are sunny, light_rain, rainy"),
        ("air.sunny.variant=snowy", "foggy, rainy, sunny, none of snowy; set air.sunny.variant"),
        ("scenarios.0.town=torn.usda", "USD cannot read"),
        ("scenarios.0.materials={/World/*: itu_cheese}", "itu_concrete"),
        ("scenarios.0.rsus=[]", "[v2v]"),
    ],
)
def test_inputs_are_checked_before_anything_is_made(
    config_file: Path, change: str, part: str, capsys: pytest.CaptureFixture
) -> None:
    (config_file.parent / "torn.usda").write_text("no USD file {")
    out = config_file.parent / "out"
    for more in (["--dry-run"], []):
        assert main(["--config", str(config_file), change, "--out", str(out), "--device", "cpu", *more]) == 2
        text = capsys.readouterr().err
        assert part in text
        assert text.startswith(f"mmw: {config_file}: ")
        assert text.count("mmw: ") == text.count("\n") == 1
    assert not out.exists()


def test_dry_run_counts_rays(config_file: Path, capsys: pytest.CaptureFixture) -> None:
    assert main(["--config", str(config_file), "--dry-run", "--quick", "--device", "cpu"]) == 0
    text = capsys.readouterr().out
    assert "3 CAV + 1 RSU" in text
    assert "1.43 M" in text  # 4 x 30,016 + 307,200 + 1,000,000


def test_printed_config_is_a_config_again(config_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert main(["--config", str(config_file), "--print-config", "--out", "elsewhere"]) == 0
    text = capsys.readouterr().out
    again = tmp_path / "again.yaml"
    again.write_text(text)
    assert load_config(again) == load_config(config_file, [], {"output.dir": "elsewhere"})
    assert yaml.safe_load(text)["output"]["dir"] == "elsewhere"


def test_identity_ignores_place_and_machine(config_file: Path) -> None:
    one = load_config(config_file)
    assert one.sha256() == load_config(config_file, ["output.dir=b", "compute.batch_frames=7"]).sha256()
    assert one.sha256() != load_config(config_file, ["seed=7"]).sha256()


def test_shipped_schema_is_current_and_shipped_configs_follow_it() -> None:
    schema = json.loads((configs_dir() / "mmw.schema.json").read_text())
    assert schema == json.loads(json.dumps(json_schema()))
    validator = jsonschema.validators.validator_for(schema)(schema)
    validator.check_schema(schema)
    top, scenarios = sorted(configs_dir().glob("*.yaml")), sorted(configs_dir().glob("scenarios/*.yaml"))
    assert [path.name for path in top] == ["full.yaml", "quickstart.yaml"] and len(scenarios) == 16
    for path in (*top, *scenarios, *sorted(configs_dir().glob("examples/*.yaml"))):
        validator.validate(yaml.load(path.read_text(), Loader))
        validator.validate(json.loads(load_config(path).model_dump_json()))
        folder = "." if path in top else ".."
        assert path.read_text().startswith(f"# yaml-language-server: $schema={folder}/mmw.schema.json")


def test_the_full_configuration_is_the_papers() -> None:
    """Sixteen scenarios of 8 to 13 s at 100 Hz with 50 CAVs in three weathers: 16,900 frames a weather."""
    config = load_config(configs_dir() / "full.yaml")
    lengths = {
        "town03_roundabout": 10, "town03_gas_station": 8, "town03_t_junction_slope": 10, "town03_crossroad_slope": 10,
        "town03_five_way": 11, "town05_dual_skybridges": 11, "town05_ring_road": 13, "town05_t_junction_overpass": 10,
        "town05_cbd_crossroad": 12, "town05_parking_lot": 11, "town07_single_lane": 10, "town07_crossroad": 12,
        "town10_crossroad": 10, "town10_curvy_road": 10, "town10_h_road": 10, "town10_wide_skybridge": 11,
    }  # fmt: skip
    assert {s.name: config.frames_of(s).count / 100 for s in config.scenarios} == lengths
    assert config.weathers == ("sunny", "rainy", "foggy") and config.frame_total == 3 * 16_900
    assert sum(len(s.traffic.cav_ranks) for s in config.scenarios if s.traffic) == 50
    assert all(20 <= s.traffic.vehicle_count <= 40 and len(s.rsus) == 1 for s in config.scenarios if s.traffic)
    cavs = {s.name: len(s.traffic.cav_ranks) for s in config.scenarios if s.traffic}
    with_four = {name for name, count in cavs.items() if count == 4}
    assert with_four == {"town05_t_junction_overpass", "town05_cbd_crossroad"}


def test_yaml_round_trip() -> None:
    config = load_config(configs_dir() / "quickstart.yaml")
    assert Config.model_validate(yaml.safe_load(to_yaml(config))) == config
