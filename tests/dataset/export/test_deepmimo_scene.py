"""Materials of a DeepMIMO scene: numbers at the carrier, and materials that a dataset holds no numbers of."""

from types import SimpleNamespace
from typing import Any

import pyarrow as pa
import pytest

from mmw.dataset.export.deepmimo.scene import material_list
from mmw.physics.materials.material import RadioMaterial, file_values
from tests.fixtures.radio_materials import lambertian

PART: Any = SimpleNamespace(scenario="s", weather="sunny")


def listed(radio: RadioMaterial) -> dict[str, Any]:
    """Return what DeepMIMO is told about one material of a dataset."""
    row = {"material_id": 0, "name": "paint", **file_values(radio)}
    dataset: Any = SimpleNamespace(read=lambda table, **where: pa.Table.from_pylist([row]))
    return material_list(dataset, PART, 28e9)["material_0"]


def test_numbers_at_the_carrier() -> None:
    row = listed(RadioMaterial("itu", itu="itu_concrete", scattering=0.3, scattering_pattern="directive"))
    assert (row["permittivity"], row["conductivity"]) == pytest.approx((5.24, 0.0462 * 28**0.7822))
    assert (row["scattering_model"], row["scattering_coefficient"]) == ("directive", 0.3)


@pytest.mark.parametrize(
    "radio",
    [
        RadioMaterial("function", permittivity=lambda f: 4.0),
        RadioMaterial("constant", scattering=0.3, scattering_pattern=lambertian),
    ],
)
def test_functions_are_told(radio: RadioMaterial) -> None:
    with pytest.raises(ValueError, match=r"material 'paint': model .*function.*; DeepMIMO needs numbers"):
        listed(radio)
