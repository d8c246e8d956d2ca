"""The object that describes a kind of sensor."""

from dataclasses import replace

import pytest

from mmw.config.sensor_spec import SENSORS
from mmw.core.errors import InputError
from mmw.core.registry import load_reference


@pytest.mark.parametrize(
    "given",
    [
        {"simulate": ""},
        {"to_tables": ""},
        {"capture": "a:b"},
        {"start": "a:b"},
        {"to_tables": "", "capture": "a:b", "start": "a:b"},
        {"to_tables": "", "capture": "", "simulate": ""},
    ],
)
def test_a_sensor_has_one_way_to_its_rows(given: dict[str, str]) -> None:
    with pytest.raises(InputError, match="'imu': give `simulate`, and one of `to_tables`, `capture` and `start`"):
        replace(SENSORS["imu"], **given)


@pytest.mark.parametrize("name", ["lidar", "radar", "rgb", "depth", "imu", "gnss"])
def test_every_kind_gives_samples(name: str) -> None:
    spec = SENSORS[name]
    rows = spec.to_tables or spec.capture or spec.start
    assert all(callable(load_reference(reference)) for reference in (spec.simulate, rows))
