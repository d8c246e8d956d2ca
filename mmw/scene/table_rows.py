"""Share parts of the functions that make rows: columns by name, names of agents, lists of a sweep, images that threads
still encode."""

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from mmw.core.later import start_all
from mmw.core.remember import remembered
from mmw.scene.scene_data import Actor, SceneData

Columns = dict[str, Any]
"""Columns of one table by name: arrays, Arrow arrays, or one scalar for all rows."""


def names(arrays: SceneData, actor: np.ndarray) -> pa.DictionaryArray:
    """Return the names of actors given by their indices."""
    return texts_of(actor_texts(arrays.actors, "name"), actor)


@dataclass(frozen=True)
class ActorTexts:
    """A text of each actor of a scene, V of them."""

    code: np.ndarray
    """Index of the text in `dictionary`, -1 for none, shape [V], int32."""
    dictionary: pa.StringArray
    """The texts, without repetition."""
    has_null: bool
    """True if an actor has none."""


def texts_of(texts: ActorTexts, actor: np.ndarray) -> pa.DictionaryArray:
    """Return the texts of actors given by their indices."""
    code = texts.code[actor]
    index = pa.array(code, mask=code < 0) if texts.has_null else pa.array(code)
    return pa.DictionaryArray.from_arrays(index, texts.dictionary)


def encoded_texts(texts: Sequence[str | None]) -> ActorTexts:
    """Return texts of actors, None for none."""
    array = pa.array(texts, pa.string()).dictionary_encode()
    code = array.indices.fill_null(-1).to_numpy().astype(np.int32)
    return ActorTexts(code, array.dictionary, array.null_count > 0)


@remembered()
def actor_texts(actors: tuple[Actor, ...], attribute: str) -> ActorTexts:
    """Return an attribute of all actors, a text."""
    return encoded_texts([getattr(actor, attribute) for actor in actors])


SensorNames = str | pa.DictionaryArray
"""Name of the sensor of all rows, or that of each."""


def sensors_of(sensor: SensorNames, rows: np.ndarray) -> SensorNames:
    """Return the names of the sensors of some rows."""
    return sensor if isinstance(sensor, str) else sensor.take(pa.array(rows))


def sample_columns(arrays: SceneData, sensor: SensorNames, frame: np.ndarray, actor: np.ndarray) -> Columns:
    """Return the columns that every table of a sensor has: frame, agent and sensor of each row."""
    return {"frame": frame.astype(np.int32), "agent": names(arrays, actor), "sensor": sensor}


def choices(texts: Sequence[str | None], index: np.ndarray) -> pa.DictionaryArray:
    """Return some of a few texts, given by their indices."""
    return pa.array(texts, pa.string()).dictionary_encode().take(pa.array(index))


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


def _image(cell: tuple[Future[bytes] | bytes, str]) -> tuple[bytes, str]:
    image, path = cell
    return (image.result() if isinstance(image, Future) else image), path
