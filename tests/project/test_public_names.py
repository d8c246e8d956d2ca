"""The names of `mmw` and `mmw.sensors`: what `dir` and `__all__` list is there, and loaded when it is first used."""

import subprocess
import sys
from importlib import import_module

import pytest

import mmw
from mmw import sensors


def test_dir_lists_what_is_public() -> None:
    assert {*mmw.__all__, "open", "__version__"} <= set(dir(mmw))
    assert not {"Any", "Path", "TYPE_CHECKING"} & set(dir(mmw))
    assert mmw.__all__ == sorted(mmw.__all__, key=lambda name: (name[0].islower(), name))


@pytest.mark.parametrize("name", mmw.__all__)
def test_every_name_is_that_of_its_module(name: str) -> None:
    assert getattr(mmw, name) is getattr(import_module(mmw._HOME[name]), name)
    assert getattr(mmw, name).__doc__


def test_open_is_a_short_name_that_a_star_import_leaves_alone() -> None:
    assert mmw.open is mmw.open_dataset
    assert "open" not in mmw.__all__


@pytest.mark.parametrize("name", sensors._HOME)
def test_every_name_of_sensors_is_that_of_its_module(name: str) -> None:
    assert getattr(sensors, name) is getattr(import_module(sensors._HOME[name]), name)
    assert getattr(sensors, name).__doc__ and name in sensors.__all__


def test_dir_of_sensors_lists_what_is_public() -> None:
    assert sorted(sensors.__all__) == sorted(sensors._HOME)
    assert set(sensors.__all__) <= set(dir(sensors))
    assert not {"Any", "import_module", "TYPE_CHECKING"} & set(dir(sensors))
    with pytest.raises(AttributeError, match=r"module 'mmw\.sensors' has no attribute 'Sonar'"):
        _ = sensors.Sonar  # pyright: ignore[reportAttributeAccessIssue]


def test_packages_are_there_without_an_import_of_their_own() -> None:
    code = "import mmw; print(mmw.sensors.Lidar().name, mmw.config.FramesConfig().count, mmw.dataset.Frame.__name__)"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.split() == ["lidar", "1000", "Frame"]
    assert {"config", "dataset", "sensors"} <= set(dir(mmw))


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'mmw' has no attribute 'load_dataset'"):
        _ = mmw.load_dataset  # pyright: ignore[reportAttributeAccessIssue]


def test_an_import_loads_no_library() -> None:
    libraries = ["numpy", "pyarrow", "pydantic", "warp"]
    used = "dir(mmw), dir(mmw.sensors)"
    code = f"import sys, mmw, mmw.sensors; {used}; print([name for name in {libraries} if name in sys.modules])"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[]"
