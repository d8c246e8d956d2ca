"""Share parts of the functions that make rows: columns by name, names of agents, lists of a sweep, images that threads
still encode."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from mmw.core.later import Waiting, start_all
from mmw.core.remember import remembered
from mmw.scene.scene_data import Actor, SceneData
from mmw.storage.name_column import NameColumn, name_column

Columns = dict[str, Any]
"""Columns of one table by name: arrays, `NameColumn`, `ListColumn`, Arrow arrays, or one scalar for all rows."""


def names(arrays: SceneData, actor: np.ndarray) -> NameColumn:
    """Return the names of actors given by their indices."""
    return actor_texts(arrays.actors, "name")[actor]


@remembered()
def actor_names(actors: tuple[Actor, ...]) -> tuple[str, ...]:
    """Return the names of all actors."""
    return tuple(actor.name for actor in actors)


@remembered()
def actor_texts(actors: tuple[Actor, ...], attribute: str) -> NameColumn:
    """Return an attribute of all actors, a text."""
    return name_column([getattr(actor, attribute) for actor in actors])


SensorNames = str | NameColumn
"""Name of the sensor of all rows, or that of each."""


def sensors_of(sensor: SensorNames, rows: np.ndarray) -> SensorNames:
    """Return the names of the sensors of some rows."""
    return sensor if isinstance(sensor, str) else sensor[rows]


def sample_columns(arrays: SceneData, sensor: SensorNames, frame: np.ndarray, actor: np.ndarray) -> Columns:
    """Return the columns that every table of a sensor has: frame, agent and sensor of each row."""
    return {"frame": frame.astype(np.int32), "agent": names(arrays, actor), "sensor": sensor}


def choices(texts: Sequence[str | None], index: np.ndarray) -> NameColumn:
    """Return some of a few texts, given by their indices."""
    return _column_of(tuple(texts))[index]


@remembered(owners=0)
def _column_of(texts: tuple[str | None, ...]) -> NameColumn:
    return name_column(texts)


def split(columns: Sequence[str], values: np.ndarray) -> Columns:
    """Return the columns of a matrix by name, contiguous."""
    return dict(zip(columns, np.ascontiguousarray(values.T), strict=True))


def resolved(columns: Columns) -> Columns:
    """Return columns with every image that a thread was encoding: (future of the bytes, path) becomes (bytes, path)."""
    start_all(cell[0] for values in columns.values() if _is_images(values) for cell in values)
    return {
        name: [_image(cell) for cell in values] if _is_images(values) else values for name, values in columns.items()
    }


def _is_images(values: Any) -> bool:
    return isinstance(values, list) and bool(values) and isinstance(values[0], tuple)


def _image(cell: tuple[Waiting | bytes, str]) -> tuple[bytes, str]:
    image, path = cell
    return (image.result() if isinstance(image, Waiting) else image), path
