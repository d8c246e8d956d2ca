"""Arguments that are one of some names."""

from typing import Literal

import pytest

from mmw.core.choices import check_choice
from mmw.core.errors import InputError


def test_a_name_is_returned_and_anything_else_is_an_error() -> None:
    kind = Literal["hull", "leaves"]
    assert check_choice("foliage", "leaves", kind) == "leaves"
    for value in ("cards", None, 3, ("hull",)):
        with pytest.raises(InputError, match=r"^foliage = .*; one of hull, leaves is needed; choose one$"):
            check_choice("foliage", value, kind)
