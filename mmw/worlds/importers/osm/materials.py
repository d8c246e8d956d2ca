"""Materials of OpenStreetMap tags: words for building materials and colours -> the library, or a tinted copy of it."""

import re
from dataclasses import dataclass, field

from mmw.usd.material_library import LIBRARY
from mmw.worlds.importers.imported_scene import ForeignMaterial

FACADE = {
    "brick": "brick_facade", "clay": "brick_facade", "concrete": "concrete_facade", "cement_block": "concrete_facade",
    "plaster": "concrete_facade", "reinforced_concrete": "concrete_facade", "render": "concrete_facade",
    "stone": "marble_facade", "sandstone": "marble_facade", "limestone": "marble_facade", "marble": "marble_facade",
    "granite": "marble_facade", "glass": "glass_facade", "mirror": "glass_facade", "metal": "metal_fascia",
    "steel": "metal_fascia", "metal_plates": "metal_fascia", "aluminium": "metal_fascia", "wood": "wood",
    "timber_framing": "wood", "plastic": "plastic", "vinyl": "plastic",
}  # fmt: skip
"""building:material or building:facade:material -> library; design values for what ITU-R P.2040 has no row for."""
ROOF = {
    "roof_tiles": "tile_roof", "tile": "tile_roof", "slate": "tile_roof", "brick": "tile_roof", "metal": "metal_fascia",
    "copper": "metal_fascia", "tin": "metal_fascia", "zinc": "metal_fascia", "metal_sheet": "metal_fascia",
    "steel": "metal_fascia", "concrete": "concrete_roof", "tar_paper": "concrete_roof", "gravel": "concrete_roof",
    "asphalt": "concrete_roof", "stone": "concrete_roof", "glass": "glass_facade", "wood": "wood", "thatch": "wood",
    "grass": "grass", "plants": "grass", "plastic": "plastic",
}  # fmt: skip
"""roof:material -> library."""
COLOURS = {
    "white": "ffffff", "black": "000000", "grey": "808080", "gray": "808080", "silver": "c0c0c0", "red": "ff0000",
    "maroon": "800000", "brown": "a52a2a", "beige": "f5f5dc", "yellow": "ffff00", "orange": "ffa500", "green": "008000",
    "olive": "808000", "blue": "0000ff", "navy": "000080", "teal": "008080", "purple": "800080", "pink": "ffc0cb",
    "tan": "d2b48c", "lightgrey": "d3d3d3", "lightgray": "d3d3d3", "darkgrey": "a9a9a9", "darkgray": "a9a9a9",
}  # fmt: skip
"""Colour name -> sRGB. Source: CSS Color Module Level 4; only names that are common in the data."""


@dataclass
class Palette:
    """Hands out materials, and keeps the tinted ones that the library lacks."""

    foreign: dict[str, ForeignMaterial] = field(default_factory=dict)
    """Name -> material."""
    unknown: set[str] = field(default_factory=set)
    """Words for materials and colours that were not understood."""

    def facade(self, tags: dict[str, str]) -> str:
        """Return the material of the walls; concrete where none is given."""
        word = tags.get("building:facade:material") or tags.get("building:material") or ""
        return self._tint(self._look_up(FACADE, word, "concrete_facade"), tags.get("building:colour", ""))

    def roof(self, tags: dict[str, str], form: str) -> str:
        """Return the material of the roof; concrete for a flat roof and tiles for others where none is given."""
        default = "concrete_roof" if form == "flat" else "tile_roof"
        return self._tint(self._look_up(ROOF, tags.get("roof:material", ""), default), tags.get("roof:colour", ""))

    def _look_up(self, table: dict[str, str], word: str, default: str) -> str:
        word = word.strip().lower().split(";")[0]
        if word and word not in table:
            self.unknown.add(word)
        return table.get(word, default)

    def _tint(self, material: str, colour: str) -> str:
        """Return a copy of a library material in another colour, or the material itself without one."""
        code = colour.strip().lower().replace(" ", "").replace("_", "")
        code = COLOURS.get(code, code.removeprefix("#"))
        if re.fullmatch("[0-9a-f]{3}", code):
            code = "".join(2 * c for c in code)
        if not re.fullmatch("[0-9a-f]{6}", code):
            if code:
                self.unknown.add(colour)
            return material
        name = f"{material}_{code}"
        spec = LIBRARY[material]
        r, g, b = (_linear(int(code[k : k + 2], 16) / 255) for k in (0, 2, 4))
        self.foreign[name] = ForeignMaterial(
            name,
            f"{material} #{code}",
            (r, g, b),
            spec.opacity,
            spec.metallic,
            spec.roughness,
            spec.radio,
            spec.base,
            spec.coating,
            spec.attributes,
        )
        return name


def _linear(value: float) -> float:
    """Return an sRGB component as linear light. Source: IEC 61966-2-1."""
    return round(value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4, 5)
