"""Windows for PyTorch: a map-style and a streaming dataset, and a collate function, on `mmw.dataset.windows`.

from torch.utils.data import DataLoader
from mmw.torch import WindowDataset, collate
loader = DataLoader(WindowDataset(windows), batch_size=32, shuffle=True, collate_fn=collate)
"""

from mmw.core.extras import needed_by as _needed_by

with _needed_by("mmw.torch (mmw.dataset.windows gives NumPy arrays without it)"):
    import torch as _torch  # noqa: F401

from mmw.torch.data import WindowDataset, WindowStream, collate, to_tensors

__all__ = ["WindowDataset", "WindowStream", "collate", "to_tensors"]
