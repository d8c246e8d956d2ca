"""`foliage`: what sensors meet where a world has crowns of trees."""

from typing import Literal

FoliageModel = Literal["hull", "leaves"]
"""`hull`: the closed hull of a crown, solid to light and radar. `leaves`: leaf cards inside of it, which they pass
between (`mmw.scene.leaf_cards`). The radio channel has the hull in both."""
