"""Windows of past and future frames for learning, as NumPy arrays, and splits without leaks. `mmw.torch` wraps them.

from mmw.dataset.windows import Feature, WindowSpec, open_windows, split_windows
spec = WindowSpec([Feature("beams", carrier_hz=28e9), "poses"], past=5, future=1)
parts = split_windows(open_windows("out/quickstart", spec), by="track", parts={"train": 0.8, "test": 0.2})
"""

from mmw.dataset.windows.batch import make_batch
from mmw.dataset.windows.splits import shared_frames, split_windows
from mmw.dataset.windows.stream import stream_batches, stream_order
from mmw.dataset.windows.tracks import Track
from mmw.dataset.windows.window_spec import Feature, WindowSpec, modalities
from mmw.dataset.windows.windows import Windows, open_windows

__all__ = [
    "Feature", "Track", "WindowSpec", "Windows", "make_batch", "modalities", "open_windows", "shared_frames",
    "split_windows", "stream_batches", "stream_order",
]  # fmt: skip
