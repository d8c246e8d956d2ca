"""Keep the arrays that a sensor traces into from batch to batch: making them costs more than tracing a single frame."""

from collections.abc import Callable
from typing import Any, TypeVar

from mmw.config import SensorConfig

T = TypeVar("T")

KEPT_RAYS = 1 << 21
"""Rays of a batch up to which its arrays are kept, below 0.2 GB of them; larger batches trace for longer than it takes
to make arrays. Design value."""

KEPT_SPACES = 16
"""Sensors and numbers of views of which arrays are kept in one store; design value."""


def workspace(store: dict[Any, Any], config: SensorConfig, views: int, rays: int, make: Callable[[], T]) -> T:
    """Return the arrays of a sensor for a number of views, those of the last such batch if they were kept.

    Args:
        store: Where they are kept, `SensorInput.cache`.
        config: The sensor.
        views: Views of the batch.
        rays: Rays of a view.
        make: Makes them.
    """
    if views * rays > KEPT_RAYS:
        return make()
    kept: dict[tuple[int, int], tuple[SensorConfig, T]] = store.setdefault("workspaces", {})
    found = kept.get((id(config), views))
    if found is None:
        if len(kept) >= KEPT_SPACES:
            kept.clear()
        found = kept[id(config), views] = config, make()
    return found[1]
