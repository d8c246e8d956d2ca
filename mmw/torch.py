"""Windows for PyTorch: a map-style and a streaming dataset, and a collate function, on `mmw.dataset.windows`.

from torch.utils.data import DataLoader
from mmw.torch import WindowDataset, collate
loader = DataLoader(WindowDataset(windows), batch_size=32, shuffle=True, collate_fn=collate)
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from mmw.core.errors import InputError
from mmw.core.extras import needed_by
from mmw.dataset.windows import Windows, make_batch, stream_batches, stream_order
from mmw.dataset.windows.batch import Ragged
from mmw.dataset.windows.stream import BUFFER

with needed_by("mmw.torch (mmw.dataset.windows gives NumPy arrays without it)"):
    import torch
    from torch.utils.data import Dataset, IterableDataset, get_worker_info

__all__ = ["WindowDataset", "WindowStream", "collate", "to_tensors"]

Tensors = dict[str, Any]
"""Key -> tensor, or lists of tensors where their lengths differ."""


class WindowDataset(Dataset):
    """Windows by their number, for `DataLoader(..., shuffle=True, collate_fn=collate)` and any sampler.

    Examples:
        >>> from mmw.dataset.windows import Feature, WindowSpec, open_windows
        >>> spec = WindowSpec(["poses", Feature("lidar", every=2)], past=2, future=1)
        >>> windows = open_windows("out/quickstart", spec, weathers=["sunny"], agents=["cav"])
        >>> from torch.utils.data import DataLoader
        >>> loader = DataLoader(WindowDataset(windows), batch_size=2, shuffle=True, collate_fn=collate)
        >>> next(iter(loader))["poses"].shape
        torch.Size([2, 2, 13])
    """

    def __init__(self, windows: Windows, transform: Callable[[Tensors], Any] | None = None):
        """Make a dataset of windows.

        Args:
            windows: Result of `open_windows` or `split_windows`.
            transform: Called with every window; the dataset gives its result.
        """
        self.windows = windows
        self.transform = transform

    def __len__(self) -> int:
        """Return the number of windows."""
        return len(self.windows)

    def __getitem__(self, index: int) -> Any:
        """Return one window; point clouds and boxes are lists of tensors.

        Raises:
            IndexError: If there is no such window.
        """
        if not -len(self) <= index < len(self):
            raise IndexError(f"window {index}; there are {len(self)}")
        sample = to_tensors(self.windows[index])
        return sample if self.transform is None else self.transform(sample)


class WindowStream(IterableDataset):
    """Batches of windows in the order of the files, shuffled by shard and buffer, for `DataLoader(batch_size=None)`.

    Windows that overlap share what is read and decoded. Every window comes once an epoch, whatever the number of
    workers and ranks: a shard goes to one worker of one rank as a whole.

    Examples:
        >>> from mmw.dataset.windows import Feature, WindowSpec, open_windows
        >>> spec = WindowSpec(["poses", Feature("lidar", every=2)], past=2, future=1)
        >>> windows = open_windows("out/quickstart", spec, weathers=["sunny"], agents=["cav"])
        >>> from torch.utils.data import DataLoader
        >>> stream = WindowStream(windows, batch_size=2, seed=0)
        >>> for epoch in range(2):
        ...     stream.set_epoch(epoch)  # another order
        ...     for batch in DataLoader(stream, batch_size=None):
        ...         points = batch["lidar"]  # [B, T, N, 4], zeros behind batch["lidar_count"]
        >>> points.ndim
        4
    """

    def __init__(
        self,
        windows: Windows,
        batch_size: int,
        *,
        seed: int = 0,
        shuffle: bool = True,
        buffer: int = BUFFER,
        ragged: Ragged = "pad",
        rank: int = 0,
        ranks: int = 1,
        transform: Callable[[Tensors], Any] | None = None,
    ):
        """Make a stream of windows.

        Args:
            windows: Result of `open_windows` or `split_windows`.
            batch_size: Windows in a batch; the last one of each worker may be smaller.
            seed: Seed of the order of shards and windows.
            shuffle: False gives them in the order of the files.
            buffer: Windows that each worker reads ahead and draws from.
            ragged: Treatment of point clouds and boxes, see `collate`.
            rank: Number of this process in distributed training.
            ranks: Processes in distributed training; they get whole shards, so their counts differ.
            transform: Called with every batch; the dataset gives its result.

        Raises:
            InputError: If there is no such rank, or a size is below 1.
        """
        if not 0 <= rank < ranks or min(buffer, batch_size) < 1:
            sizes = f"rank {rank} of {ranks}, batch_size {batch_size}, buffer {buffer}"
            raise InputError(f"WindowStream: {sizes}; rank is 0 to ranks - 1, the sizes at least 1")
        self.windows = windows
        self.batch_size, self.seed, self.shuffle, self.buffer = batch_size, seed, shuffle, buffer
        self.ragged: Ragged = ragged
        self.rank, self.ranks = rank, ranks
        self.transform = transform
        # Shared, so that persistent workers see the next epoch.
        self._epoch = torch.zeros((), dtype=torch.int64).share_memory_()

    def set_epoch(self, epoch: int) -> None:
        """Choose the order of the next round; call it before each one."""
        self._epoch.fill_(epoch)

    def window_count(self) -> int:
        """Return the number of windows of this rank in this epoch, with any number of workers."""
        order = stream_order(
            self.windows, seed=self.seed, epoch=int(self._epoch), worker=self.rank, workers=self.ranks,
            shuffle=self.shuffle,
        )  # fmt: skip
        return len(order)

    def __iter__(self) -> Iterator[Any]:
        """Yield the batches of this worker of this rank."""
        info = get_worker_info()
        worker, workers = (0, 1) if info is None else (info.id, info.num_workers)
        batches = stream_batches(
            self.windows, self.batch_size, seed=self.seed, epoch=int(self._epoch),
            worker=worker * self.ranks + self.rank, workers=workers * self.ranks, shuffle=self.shuffle,
            buffer=self.buffer, ragged=self.ragged,
        )  # fmt: skip
        for batch in batches:
            tensors = to_tensors(batch)
            yield tensors if self.transform is None else self.transform(tensors)


def collate(samples: Sequence[Tensors], ragged: Ragged = "pad") -> Tensors:
    """Return a batch of windows of a `WindowDataset`; `ragged` is that of `mmw.dataset.windows.make_batch`.

    Raises:
        InputError: If there is no sample, tensors of one key differ in shape, or `ragged` is unknown.
    """
    return to_tensors(make_batch([{key: _to_arrays(value) for key, value in one.items()} for one in samples], ragged))


def to_tensors(sample: dict[str, Any]) -> Tensors:
    """Return a sample or batch of `Windows` as tensors of the same memory and type; lists stay lists."""
    return {key: _to_tensors(value) for key, value in sample.items()}


def _to_tensors(value: Any) -> Any:
    return [_to_tensors(one) for one in value] if isinstance(value, list) else torch.from_numpy(np.asarray(value))


def _to_arrays(value: Any) -> Any:
    return [_to_arrays(one) for one in value] if isinstance(value, list) else value.numpy()
