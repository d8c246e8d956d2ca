"""Sources of features that are read from Parquet files row by row: point clouds and images, with a cache."""

import io
import os
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.dataset as pds
import pyarrow.parquet as pq
from PIL import Image

from mmw.core.errors import InputError
from mmw.dataset.files import framed_parts
from mmw.dataset.windows.memory_sources import (
    by_sensor,
    in_order,
    max_age_of,
    no_samples,
    number_columns,
    one_sensor,
    sensor_periods,
)
from mmw.dataset.windows.tracks import LatestSamples, Track, find_latest
from mmw.dataset.windows.window_spec import Feature
from mmw.storage.codecs.images import decode_metres

if TYPE_CHECKING:
    from mmw.dataset import Dataset

OPEN_FILES = 64
"""Files of all tables open at once at most. Design value."""


class Cache:
    """Cache of the latest values, up to a number of bytes; every process has its own, which starts empty."""

    def __init__(self, limit: int):
        """Make an empty cache of `limit` bytes."""
        self.limit = limit
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._process = os.getpid()
        self._size = 0
        self._values: OrderedDict[Hashable, tuple[Any, int]] = OrderedDict()

    def __getstate__(self) -> dict[str, Any]:
        """Return the limit alone: the content is not sent to another process."""
        return {"limit": self.limit}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Start empty."""
        self.limit = state["limit"]
        self.clear()

    def get(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return the value of a key, made by `make` and stored if it is missing; its `nbytes` count."""
        if self._process != os.getpid():
            self.clear()
        if key in self._values:
            self._values.move_to_end(key)
            return self._values[key][0]
        value = make()
        size = int(getattr(value, "nbytes", 1))
        self._values[key] = value, size
        self._size += size
        while self._size > self.limit and len(self._values) > 1:
            self._size -= self._values.popitem(last=False)[1][1]
        return value


@dataclass(frozen=True, eq=False)
class FileSource:
    """Rows of Parquet files, read on demand: the whole row group, then the row out of it."""

    latest: Sequence[LatestSamples]
    dataset: "Dataset"
    name: str
    """Key of the feature, under which the cache has arrays."""
    table: str
    columns: tuple[str, ...]
    paths: tuple[str, ...]
    """Files."""
    where: np.ndarray
    """Number of the file, its row group, and the row in that, shape [rows, 3], int64."""
    decode: Callable[[pa.RecordBatch, int], np.ndarray]
    """Makes the array of one row of a group."""
    is_image: bool
    """True if all samples of a window have one shape."""
    cache: Cache
    """Arrays and row groups."""
    files: Cache
    """Open files."""

    def load(self, rows: np.ndarray) -> dict[str, Any]:
        """Return the array of each row, a tuple of images or a list of point clouds; they cannot be written.

        Raises:
            InputError: If a file cannot be read.
        """
        found = [self.cache.get((self.name, int(row)), partial(self._row, row)) for row in rows]
        return {"": tuple(found) if self.is_image else found}

    def _row(self, row: int) -> np.ndarray:
        file, group, index = self.where[row].tolist()
        key = (self.table, self.columns, file, group)
        try:
            batch = self.cache.get(key, partial(self._group, file, group))
        except (pa.ArrowException, OSError) as error:
            raise self.dataset.damage(self.table, error) from error
        array = self.decode(batch, index)
        array.flags.writeable = False
        return array

    def _group(self, file: int, group: int) -> pa.RecordBatch:
        path = self.paths[file]
        parquet = self.files.get(path, partial(open_parquet, self.dataset, path))
        table = parquet.read_row_group(group, columns=list(self.columns), use_threads=False)
        return table.combine_chunks().to_batches()[0]


def open_parquet(dataset: "Dataset", path: str) -> pq.ParquetFile:
    """Return an open file of a dataset, mapped into memory where it is local."""
    if dataset.filesystem is None:
        return pq.ParquetFile(path, memory_map=True)
    return pq.ParquetFile(dataset.filesystem.open_input_file(path))


def file_source(
    dataset: "Dataset", feature: Feature, tracks: Sequence[Track], cache: Cache, files: Cache
) -> FileSource:
    """Return the source of the point clouds or images of a feature; only keys are read.

    Raises:
        InputError: If an agent has several sensors and none is named, a column is not one of lists of numbers, or a
            file cannot be read.
    """
    if feature.kind == "points":
        columns, decode = number_columns(feature), partial(decode_points, number_columns(feature))
    elif feature.kind == "rgb":
        columns, decode = ("image",), partial(decode_image, feature.shrink)
    else:
        columns, decode = ("image", "depth_m"), depth_image
    numbers = {track.name: number for number, track in enumerate(tracks)}
    wanted = {track.name[:2] for track in tracks}
    paths: list[str] = []
    found: dict[int, dict[str, list[np.ndarray]]] = {}
    where, count = [np.zeros((0, 3), dtype=np.int64)], 0
    for scenario, weather, _, path in framed_files(dataset, feature.table):
        if (scenario, weather) not in wanted:
            continue
        try:
            with open_parquet(dataset, path) as parquet:
                rows = parquet.read(columns=["frame", "agent", "sensor"], use_threads=False)
                sizes = [parquet.metadata.row_group(g).num_rows for g in range(parquet.metadata.num_row_groups)]
        except (pa.ArrowException, OSError) as error:
            raise dataset.damage(feature.table, error) from error
        frames = rows.column("frame").to_numpy().astype(np.int64)
        group = np.repeat(np.arange(len(sizes)), sizes)
        inner = np.arange(len(frames)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        where.append(np.stack([np.full(len(frames), len(paths)), group, inner], axis=-1).astype(np.int64))
        paths.append(path)
        for agent, sensors in by_sensor(rows).items():
            number = numbers.get((scenario, weather, agent))
            for sensor, some in sensors.items() if number is not None else ():
                pair = np.stack([frames[some], some + count])
                found.setdefault(number, {}).setdefault(sensor, []).append(pair)
        count += len(frames)
    latest, periods = no_samples(tracks), sensor_periods(dataset)
    for number, sensors in found.items():
        track = tracks[number]
        sensor = one_sensor(feature, track, sensors)
        if sensor is not None:
            frames, rows = np.concatenate(sensors[sensor], axis=1)
            order = in_order(frames, np.arange(len(frames)), feature, track)
            latest[number] = find_latest(track, frames[order], rows[order], max_age_of(feature, periods, track, sensor))
    return FileSource(
        latest, dataset, feature.key, feature.table, columns, tuple(paths), np.concatenate(where), decode,
        feature.kind != "points", cache, files,
    )  # fmt: skip


def framed_files(dataset: "Dataset", table: str) -> list[tuple[str, str, int, str]]:
    """Return scenario, weather, first frame and path of every file of a table with frames, in the order of frames.

    Raises:
        InputError: If a file has a name that no file of a dataset has.
    """
    opened = dataset.arrow(table)
    assert isinstance(opened, pds.FileSystemDataset)  # what Dataset.arrow opens
    found = []
    for (scenario, weather), some in framed_parts(opened).items():
        assert weather is not None  # only `path_geometry`, which is no modality, has none
        found += [(scenario, weather, begin, part.path) for begin, part in some]
    return found


def decode_points(columns: tuple[str, ...], batch: pa.RecordBatch, index: int) -> np.ndarray:
    """Return the lists of one row side by side, shape [N, columns], float32; a list that is null is NaN."""
    lists = [batch.column(name)[index] for name in columns]
    count = max((len(one) for one in lists if one.is_valid), default=0)
    array = np.full((count, len(columns)), np.nan, dtype=np.float32)
    for column, one in enumerate(lists):
        if one.is_valid:
            array[:, column] = one.values.to_numpy(zero_copy_only=False)
    return array


def decode_image(shrink: int, batch: pa.RecordBatch, index: int) -> np.ndarray:
    """Return an RGB image, shape [H, W, 3], uint8, its sides divided by `shrink`, rounded up."""
    data = image_bytes(batch, index)
    image = Image.open(io.BytesIO(data))
    size = tuple(-(-side // shrink) for side in image.size)
    image.draft("RGB", size)  # the JPEG decoder halves while it decodes; other files stay as large
    image = image if image.mode == "RGB" else image.convert("RGB")
    return np.asarray(image if image.size == size else image.resize(size, Image.Resampling.BOX))


def depth_image(batch: pa.RecordBatch, index: int) -> np.ndarray:
    """Return a depth image [m], inf for nothing, shape [H, W], float32; unrounded where that is stored."""
    metres = batch.column("depth_m")[index].values
    return decode_metres(image_bytes(batch, index), None if metres is None else metres.to_numpy(zero_copy_only=False))


def image_bytes(batch: pa.RecordBatch, index: int) -> bytes:
    """Return the file in column `image` of one row.

    Raises:
        InputError: If there is none.
    """
    data = batch.column("image").field("bytes")[index].as_py()
    if data is None:
        raise InputError("column image: a row without an image; run mmw verify")
    return data
