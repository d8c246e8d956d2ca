"""Values of Python code as the content of a file: what is taken, and what is refused with its place."""

from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

from mmw.config import FramesConfig, MountConfig
from mmw.config.file_content import file_content
from mmw.core.errors import InputError
from mmw.sensors import Gnss, Lidar


def test_sections_give_their_type_and_the_keys_that_are_set() -> None:
    assert file_content(Gnss()) == {"type": "gnss"}
    assert file_content(FramesConfig(count=3)) == {"count": 3}
    lidar = Lidar(elevations_deg=(1.0, -2.0), mount={"cav": MountConfig(yaw_deg=90)})  # its channels follow from these
    found = file_content({"sensors": (lidar,)})["sensors"][0]
    assert found.keys() == {"type", "elevations_deg", "mount"} and found["elevations_deg"] == [1.0, -2.0]
    assert found["mount"]["cav"] == {"yaw_deg": 90.0}


def test_values_become_those_of_a_file_and_share_nothing() -> None:
    inner = [1, 2.5, None, True, "text"]
    given = MappingProxyType({"a": inner, 1: Path("b") / "c", "d": np.arange(3), "e": np.float32(0.5), "f": np.int8(3)})
    found = file_content(given)
    assert found == {"a": inner, 1: str(Path("b") / "c"), "d": [0, 1, 2], "e": 0.5, "f": 3}
    assert [type(found[key]) for key in "def"] == [list, float, int]
    found["a"].append(3)
    assert len(inner) == 5


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ({"a": [{"b": {1, 2}}]}, "a[0].b = {1, 2}: is of type set; give text, numbers, truth values, lists, maps"),
        ({"a": object}, "a = <class 'object'>: is of type type; give text"),
        ({"a": {(1, 2): 3}}, "a: the key (1, 2) is of type tuple; give text"),
        ({None: 3}, "the key None is of type NoneType; give text"),
        (b"bytes", "value = b'bytes': is of type bytes; give text"),
    ],
)
def test_other_values_are_refused(value: object, message: str) -> None:
    with pytest.raises(InputError) as caught:
        file_content(value)
    assert str(caught.value).startswith(message)


def test_a_value_inside_itself_is_refused() -> None:
    value: list = []
    value.append({"a": value})
    with pytest.raises(InputError, match="is nested more than 100 deep"):
        file_content(value)
