"""The line that names the software: equal for equal code, another one for any other."""

import shutil
import sys
from pathlib import Path

import pytest

import mmw.kernels
from mmw.config import Config, load_config
from mmw.config.sensor_spec import SENSORS, register_sensor
from mmw.generation import software


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Let mmw be a copy of its code, without assets."""
    root = tmp_path / "mmw"
    shutil.copytree(software.PACKAGE, root, ignore=shutil.ignore_patterns("kernels", "__pycache__"))
    monkeypatch.setattr(software, "PACKAGE", root)
    monkeypatch.setattr(software, "OWN_ASSETS", ())
    return root


@pytest.mark.parametrize(
    ("file", "counts"),
    [("sensors/lidar/simulate.py", True), ("scene/rows.py", True), ("brand_new/code.py", True), ("config/air.py", True),
     ("cli/verify.py", False), ("viz/new.py", False), ("generation/verification/physics.py", False)],
)  # fmt: skip
def test_code_that_makes_rows_counts(tree: Path, file: str, counts: bool) -> None:
    before = software.code_digest.__wrapped__()
    assert software.code_digest.__wrapped__() == before
    (tree / file).parent.mkdir(exist_ok=True)
    with (tree / file).open("a") as end:
        end.write("\nX = 1\n")
    assert (software.code_digest.__wrapped__() != before) is counts


def test_a_checkout_and_a_wheel_have_one_digest(tree: Path) -> None:
    """The kernels stand beside the package in a checkout, and inside it in a wheel."""
    before = software.code_digest.__wrapped__()
    shutil.copytree(Path(mmw.kernels.__file__).parent, tree / "kernels", ignore=shutil.ignore_patterns("__pycache__"))
    assert software.code_digest.__wrapped__() == before


def config() -> Config:
    return load_config("quickstart")


def test_the_line_names_what_computes_alone() -> None:
    own = software.own_software(config())
    line = software.software_of(own)
    assert line.startswith("mmw ") and "warp-lang " in line and "numpy " in line and "pyarrow" not in line
    assert line == software.software_of({**own, "packages": {**own["packages"], "pyarrow": "0.1"}, "git": "x"})
    old = software.software_of({**own, "packages": {**own["packages"], "warp-lang": "0.1"}})
    assert software.software_differences(old, line) == f"warp-lang 0.1 -> {own['packages']['warp-lang']}"
    assert software.software_differences(line, line) == ""


def test_a_sensor_of_another_package_counts_with_its_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "my_sensor.py").write_text(
        "from typing import Literal\nfrom mmw.config.sensor import SensorConfig\n"
        "class Config(SensorConfig):\n    type: Literal['mine'] = 'mine'\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    import my_sensor  # type: ignore[import-not-found]

    monkeypatch.setattr(SENSORS, "_added", {})
    imu = SENSORS["imu"]
    register_sensor(type(imu)(**{**vars(imu), "type": "mine", "config": my_sensor.Config}))
    sensor = my_sensor.Config(name="m", on=("cav",))
    other = config().model_copy(update={"sensors": (sensor,)})
    first = software.package_versions(other)["my_sensor"]
    with (tmp_path / "my_sensor.py").open("a") as end:
        end.write("# changed\n")
    assert software.package_versions(other)["my_sensor"] != first
    assert "my_sensor" not in software.package_versions(config())
    del sys.modules["my_sensor"]
