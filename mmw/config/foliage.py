"""`foliage`: what sensors meet where a world has crowns of trees."""

from typing import Literal, get_args

from mmw.core.errors import InputError

FoliageModel = Literal["hull", "leaves"]
"""`hull`: the closed hull of a crown, solid to light and radar. `leaves`: leaf cards inside of it, which they pass
between (`mmw.scene.leaf_cards`). The radio channel has the hull in both."""


def check_foliage(where: str, value: object) -> FoliageModel:
    """Return a model of foliage that is known.

    Args:
        where: Place of the value, for the message.
        value: The value.

    Raises:
        InputError: If it is not known.
    """
    for known in get_args(FoliageModel):
        if value == known:
            return known
    raise InputError(f"{where} = {value!r}; one of {', '.join(get_args(FoliageModel))} is needed; choose one")
