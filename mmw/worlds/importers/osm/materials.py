"""Materials of OpenStreetMap tags: words for building materials and colors -> the library, or a tinted copy of it."""

from dataclasses import dataclass, field, replace

from PIL import ImageColor

from mmw.worlds.importers.imported_scene import ImportedMaterial, library_material
from mmw.worlds.importers.mesh_cleanup import linear

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


@dataclass
class Palette:
    """Choose materials, and collect the tinted ones that the library lacks."""

    foreign: dict[str, ImportedMaterial] = field(default_factory=dict)
    """Name -> material."""
    unknown: set[str] = field(default_factory=set)
    """Words for materials and colors that were not understood."""

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
        """Return a copy of a library material in another color, or the material itself without one."""
        code = colour.strip().lower().replace(" ", "").replace("_", "")
        rgb = _rgb(code) or _rgb(f"#{code}")
        if rgb is None:
            self.unknown |= {colour} if code else set()
            return material
        name = f"{material}_{bytes(rgb).hex()}"
        red, green, blue = (round(value, 5) for value in linear([value / 255 for value in rgb]))
        source = f"{material} #{bytes(rgb).hex()}"
        self.foreign[name] = replace(library_material(material), name=name, source=source, color=(red, green, blue))
        return name


def _rgb(code: str) -> tuple[int, ...] | None:
    """Return the sRGB bytes of a name or code of CSS, None if it is none."""
    try:
        return ImageColor.getrgb(code)[:3]
    except ValueError:
        return None
