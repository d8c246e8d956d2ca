"""Describe the layers of a wall in front of its substance: panes, coats, films of water, and conducting sheets."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from numbers import Real
from typing import Any

from mmw.core.errors import InputError
from mmw.physics.materials.itu_rows import PERMITTIVITY, PREFIX

CONSTANT = "constant"
"""First word of a layer of constant values in text form."""

SHEET = "sheet"
"""First word of a conducting sheet in text form."""

FORMS = "`itu_glass 0.004` (row, m), `constant 2.5 0.001 0.01` (relative permittivity, S/m, m) or `sheet 5` (ohm)"
"""Forms of a layer as text, for messages."""


@dataclass(frozen=True)
class Layer:
    """One layer of a wall: a substance of some thickness, or a conducting sheet of no thickness.

    Raises:
        InputError: If a value is unknown, out of range or not finite.

    Examples:
        >>> Layer("itu_glass", thickness=0.004).text
        'itu_glass 0.004'
        >>> Layer.sheet(5.0).text
        'sheet 5'
    """

    itu: str = ""
    """Row of the substance with its prefix, such as `itu_glass`; empty for the two constants below."""
    relative_permittivity: float = 1.0
    """Real part of the relative permittivity, without a row [-]."""
    conductivity: float = 0.0
    """Conductivity, without a row [S/m]."""
    thickness: float = 0.0
    """Thickness [m]; above 0, but 0 for a sheet."""
    sheet_resistance: float = 0.0
    """Resistance of a conducting sheet, such as the metal film of coated glass [ohm/square]; 0 for a substance."""

    def __post_init__(self) -> None:
        wrong = _wrong_value(self)
        if wrong:
            name, needed = wrong
            raise InputError(f"layer: {name} = {getattr(self, name)!r}; {needed} is needed; correct it")

    @classmethod
    def sheet(cls, resistance: float) -> "Layer":
        """Return a conducting sheet of a resistance [ohm/square]."""
        return cls(sheet_resistance=resistance)

    @property
    def text(self) -> str:
        """Text form, which files hold."""
        if self.sheet_resistance > 0.0:
            return f"{SHEET} {_short(self.sheet_resistance)}"
        if self.itu:
            return f"{self.itu} {_short(self.thickness)}"
        return " ".join([CONSTANT, *map(_short, (self.relative_permittivity, self.conductivity, self.thickness))])


def _short(value: float) -> str:
    """Return the shortest text that reads back as the same number."""
    text = f"{value:g}"
    return text if float(text) == value else repr(float(value))


def parse_layer(text: str) -> Layer:
    """Return the layer of a text form; see `FORMS`.

    Raises:
        InputError: If it has another form, or a value is wrong.
    """
    words = text.split()
    try:
        numbers = [float(word) for word in words[1:]]
    except ValueError:
        numbers = []
    if words[:1] == [SHEET] and len(words) == len(numbers) + 1 == 2:
        if not numbers[0] > 0.0:
            raise InputError(f"layer {text!r}: a sheet resistance above 0 ohm/square is needed; correct it")
        return Layer.sheet(numbers[0])
    if words[:1] == [CONSTANT] and len(words) == len(numbers) + 1 == 4:
        return Layer(relative_permittivity=numbers[0], conductivity=numbers[1], thickness=numbers[2])
    if len(words) == len(numbers) + 1 == 2:
        return Layer(words[0], thickness=numbers[0])
    raise InputError(f"layer {text!r}: {FORMS} is needed; correct it")


def as_layers(values: Any) -> Any:
    """Return layers of which some may be text, as a tuple of `Layer`; what is neither stays, for a check to tell."""
    if isinstance(values, str) or not isinstance(values, Iterable):
        return values
    return tuple(parse_layer(value) if isinstance(value, str) else value for value in values)


def wrong_layers(values: Any) -> str:
    """Return what layers need if they are wrong, empty if they are right.

    Args:
        values: Layers, or their text forms.
    """
    try:
        layers = as_layers(values)
    except InputError as error:
        return f"a list of layers, outermost first ({error}),"
    if isinstance(layers, tuple) and all(isinstance(layer, Layer) for layer in layers):
        return ""
    return f"a list of layers, outermost first, each {FORMS},"


def _wrong_value(layer: Layer) -> tuple[str, str] | None:
    """Return the first field that has a wrong value, and what it needs."""

    def above(name: str, low: float, *, or_equal: bool = True) -> bool:
        value = getattr(layer, name)
        if not (isinstance(value, Real) and math.isfinite(value)):
            return False
        return float(value) >= low if or_equal else float(value) > low

    is_sheet = layer.sheet_resistance != 0.0
    is_row = isinstance(layer.itu, str) and layer.itu.removeprefix(PREFIX) in PERMITTIVITY
    rules = (
        ("sheet_resistance", above("sheet_resistance", 0.0), "at least 0 ohm/square"),
        ("itu", not layer.itu or is_row, f"a row, one of {', '.join(PREFIX + name for name in PERMITTIVITY)},"),
        ("itu", not (is_sheet and layer.itu), "none, for a sheet has no substance,"),
        ("relative_permittivity", above("relative_permittivity", 1.0), "at least 1"),
        ("conductivity", above("conductivity", 0.0), "at least 0 S/m"),
        ("thickness", is_sheet or above("thickness", 0.0, or_equal=False), "above 0 m"),
        ("thickness", not is_sheet or layer.thickness == 0.0, "0 m, for a sheet has no thickness,"),
    )
    return next(((name, needed) for name, is_good, needed in rules if not is_good), None)
