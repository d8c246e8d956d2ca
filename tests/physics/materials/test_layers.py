"""Layers as objects and as text: both ways, and what is refused."""

import pytest

from mmw.core.errors import InputError
from mmw.physics.materials import Layer, RadioMaterial
from mmw.physics.materials.layers import parse_layer
from mmw.physics.materials.material import Material
from mmw.physics.materials.permittivity import extrapolation_notes, layer_permittivities, relative_permittivity

LAYERS = [
    (Layer("itu_glass", thickness=0.004), "itu_glass 0.004"),
    (Layer(relative_permittivity=2.5, conductivity=0.001, thickness=0.01), "constant 2.5 0.001 0.01"),
    (Layer.sheet(5.0), "sheet 5"),
    (Layer("itu_pec", thickness=1 / 3), "itu_pec 0.3333333333333333"),
]


@pytest.mark.parametrize(("layer", "text"), LAYERS)
def test_text_and_object_are_one(layer: Layer, text: str) -> None:
    assert layer.text == text and parse_layer(text) == layer
    radio = RadioMaterial("itu", itu="itu_brick", layers=[text, layer])
    assert radio.layers == (layer, layer)
    assert hash(radio) == hash(RadioMaterial("itu", itu="itu_brick", layers=(layer, layer)))


@pytest.mark.parametrize(
    ("text", "needed"),
    [
        ("itu_glass", "`itu_glass 0.004` (row, m)"), ("", "`itu_glass 0.004` (row, m)"),
        ("0.004 itu_glass", "(row, m)"),
        ("itu_glass 4 mm", "(row, m)"), ("itu_cheese 0.004", "one of itu_vacuum"), ("itu_glass 0", "above 0 m"),
        ("itu_glass -1", "above 0 m"), ("itu_glass inf", "above 0 m"), ("sheet", "(ohm)"),
        ("sheet 0", "above 0 ohm/square"),
        ("sheet nan", "above 0 ohm/square"), ("sheet inf", "at least 0 ohm/square"),
        ("constant 0.5 0 0.1", "at least 1"),
        ("constant 2 -1 0.1", "at least 0 S/m"), ("constant 2 0.1", "(relative permittivity, S/m, m)"),
    ],
)  # fmt: skip
def test_wrong_texts_are_refused(text: str, needed: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_layer(text)
    assert needed in str(caught.value)
    with pytest.raises(InputError, match=r"^radio material: layers = .* is needed; correct it$"):
        RadioMaterial("constant", layers=(text,))


@pytest.mark.parametrize("layers", ["sheet 5", 3, (3,), None])
def test_what_is_no_list_of_layers_is_refused(layers: object) -> None:
    with pytest.raises(InputError, match="a list of layers, outermost first"):
        RadioMaterial("constant", layers=layers)


def test_a_sheet_has_no_substance() -> None:
    with pytest.raises(InputError, match="a sheet has no substance"):
        Layer("itu_glass", sheet_resistance=5.0)
    with pytest.raises(InputError, match="a sheet has no thickness"):
        Layer(sheet_resistance=5.0, thickness=0.1)


def test_permittivities_of_layers_and_notes_where_a_row_has_none() -> None:
    layers = ("itu_brick 0.1", "sheet 5", "constant 2 0 0.1")
    radio = RadioMaterial("itu", itu="itu_glass", layers=layers)
    brick = relative_permittivity(RadioMaterial("itu", itu="itu_brick"), 28e9)
    assert layer_permittivities(radio, 28e9) == [brick, 1.0, 2.0]
    notes = extrapolation_notes([Material("wall", radio, "none", 0.3, (0.5, 0.5, 0.5))], [60e9])
    assert len(notes) == 1 and notes[0].startswith("wall (itu_brick) at 60 GHz")
