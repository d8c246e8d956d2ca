"""Read windows in the order of their files, shuffled by shard and buffer, and divided among workers."""

from collections.abc import Iterator

import numpy as np

from mmw.core.errors import InputError
from mmw.dataset.windows.batch import Ragged, make_batch
from mmw.dataset.windows.windows import Sample, Windows

BUFFER = 64
"""Windows read ahead to draw from. 64 windows with 4 sweeps and 4 images of 640 x 480 that no other window shares need
360 MB, a quarter of it where windows overlap. Design value."""


def stream_order(
    windows: Windows, *, seed: int = 0, epoch: int = 0, worker: int = 0, workers: int = 1, shuffle: bool = True
) -> np.ndarray:
    """Return the numbers of a worker's windows in the order in which they are read, shape [k], int64.

    A shard goes to one worker as a whole, so every window is read once an epoch; the epoch decides the order of shards.

    Args:
        windows: The windows.
        seed: Decides the order together with `epoch`.
        epoch: Number of the round through all windows.
        worker: Number of the worker, 0 to `workers` - 1.
        workers: Workers that share the windows.
        shuffle: False reads shards in their order.

    Raises:
        InputError: If there is no such worker.
    """
    if not 0 <= worker < workers:
        raise InputError(f"stream_order: worker {worker} of {workers}; it is 0 to {workers - 1}")
    shards = np.unique(windows.shard)
    if shuffle:
        shards = np.random.default_rng([seed, epoch]).permutation(shards)
    order = np.argsort(windows.shard, kind="stable")  # windows are sorted by frame, so within a shard too
    begins, ends = (np.searchsorted(windows.shard[order], shards, side=side) for side in ("left", "right"))
    mine = [order[a:b] for a, b in zip(begins[worker::workers], ends[worker::workers], strict=True)]
    return np.concatenate([np.zeros(0, dtype=np.int64), *mine])


def stream_batches(
    windows: Windows,
    size: int,
    *,
    seed: int = 0,
    epoch: int = 0,
    worker: int = 0,
    workers: int = 1,
    shuffle: bool = True,
    buffer: int = BUFFER,
    ragged: Ragged = "pad",
) -> Iterator[Sample]:
    """Yield a worker's windows in batches of a size, each once; the last batch may be smaller.

    Each next window is drawn from `buffer` windows that are read ahead, or without `shuffle` in the order of reading.
    The other arguments are those of `stream_order` and `make_batch`.

    Raises:
        InputError: If there is no such worker, size or buffer is below 1, or a file cannot be read.

    Examples:
        >>> from mmw.dataset.windows import Feature, WindowSpec, open_windows
        >>> spec = WindowSpec(["poses", Feature("lidar", every=2)], past=2, future=1)
        >>> windows = open_windows("out/quickstart", spec, weathers=["sunny"], agents=["cav"])
        >>> batch = next(stream_batches(windows, 4, seed=1))
        >>> batch["poses"].shape, batch["lidar"].shape[:2]
        ((4, 2, 13), (4, 1))
    """
    if buffer < 1 or size < 1:
        raise InputError(f"stream_batches: size = {size}, buffer = {buffer}; both are at least 1")
    order = stream_order(windows, seed=seed, epoch=epoch, worker=worker, workers=workers, shuffle=shuffle)
    rng = np.random.default_rng([seed, epoch, worker])
    waiting: list[Sample] = []
    batch: list[Sample] = []
    room = buffer if shuffle else 1
    for place, index in enumerate(order):
        waiting.append(windows.load(int(index)))
        is_last = place == len(order) - 1
        while len(waiting) >= room or (is_last and waiting):
            batch.append(_draw(waiting, rng))
            if len(batch) == size or (is_last and not waiting):
                yield make_batch(batch, ragged)
                batch = []


def _draw(waiting: list[Sample], rng: np.random.Generator) -> Sample:
    """Remove a random sample and return it."""
    index = int(rng.integers(len(waiting)))
    waiting[index], waiting[-1] = waiting[-1], waiting[index]
    return waiting.pop()
