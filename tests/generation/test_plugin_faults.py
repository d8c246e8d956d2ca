"""Faults of a sensor of another package name it, its table and its column, and are no bugs of mmw."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mmw.dataset.windows import Feature
from tests.fixtures.own_world import run_own
from tests.fixtures.plugin_sensor import NAME, thermometer

CHANGES = (f"sensors=[{{type: {NAME}}}]", "channel.enabled=false", "frames.count=2", "--workers", "1")


def giving(value: Callable) -> Callable:
    return lambda data, config, samples: {NAME: {"celsius": value(samples)}}


def raising(*_: object) -> None:
    raise IndexError("reading 3 of 2")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            {"to_tables": giving(lambda n: np.full(n, np.nan))},
            "table 'thermometer', column 'celsius': 2 values are not ",
        ),
        ({"to_tables": giving(lambda n: ["hot"] * n)}, "table 'thermometer', column 'celsius': "),
        ({"to_tables": giving(lambda n: np.zeros(n + 1))}, "table 'thermometer': columns have lengths "),
        (
            {"to_tables": lambda *_: {NAME: {"kelvin": 3.0}}},
            "table 'thermometer': missing columns ['celsius'], unknown ",
        ),
        ({"to_tables": lambda *_: {"poses": {"x": 3.0}}}, "gives table 'poses'; its SensorSpec lists thermometer"),
        (
            {"simulate": raising},
            "IndexError in the package that provides its type 'thermometer' (register()): reading 3",
        ),
    ],
    ids=["nan", "text", "length", "column", "table", "raises"],
)
def test_the_message_names_the_sensor(
    own_world: Path, options: dict, words: str, capsys: pytest.CaptureFixture
) -> None:
    with thermometer(**options):
        assert run_own(own_world, "d", *CHANGES) == 1
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("mmw: ")]
    assert len(lines) == 1 and lines[0].startswith("mmw: sensor 'thermometer'") and words in lines[0]
    assert "bug in mmw" not in lines[0]


def test_a_sensor_without_a_window_says_what_to_set() -> None:
    with thermometer(), pytest.raises(ValueError, match=r"Feature\('thermometer'\): .* set `SensorSpec.window`"):
        Feature(NAME)
