"""From sensor samples, as the array sees them, to tokens."""

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

SQUEEZED = 32
"""Channels that are left of a cell before all cells are joined. Design value."""


class SensorReader(nn.Module):
    """Convolutions over a sample, the part around one beam or all of it, and a token of what is left.

    A sample is read together with its difference from a reference, which shows what moves, whatever the place is like.
    """

    def __init__(self, shape: Sequence[int], channels: Sequence[int], width: int, columns: int):
        """Make one.

        Args:
            shape: Channels, rows and columns of a sample.
            channels: Channels of each block; a block halves rows and columns.
            width: Width of a token.
            columns: Columns around the beam that are seen; no less than there are means all of them.
        """
        super().__init__()
        self.columns = min(columns, shape[2])
        widths = [2 * shape[0], *channels]
        self.convolutions = nn.ModuleList(nn.Conv2d(a, b, 3, stride=2) for a, b in pairwise(widths))
        self.norms = nn.ModuleList(nn.GroupNorm(1, width) for width in channels)
        self.squeeze = nn.Conv2d(channels[-1], SQUEEZED, 1)
        with torch.no_grad():
            cells = self._cells(torch.zeros(1, 2 * shape[0], shape[1], self.columns))
        self.join = nn.Linear(cells.shape[1], width)

    def forward(self, samples: Tensor, references: Tensor, center: Tensor) -> Tensor:
        """Return a token a sample, shape [B, S, width].

        Args:
            samples: Shape [B, S, channels, rows, columns], uint8.
            references: Of each sample, or one for all of a window: shape [B, S or 1, channels, rows, columns], uint8.
            center: Column in the middle of what is seen, shape [B].
        """
        seen, usual = (crop(x, center, self.columns).to(self.join.weight.dtype) / 127.5 for x in (samples, references))
        cells = self._cells(torch.cat([seen - 1.0, seen - usual], dim=2).flatten(0, 1))
        return self.join(cells).unflatten(0, samples.shape[:2])

    def _cells(self, x: Tensor) -> Tensor:
        for convolution, norm in zip(self.convolutions, self.norms, strict=True):
            x = functional.gelu(norm(convolution(functional.pad(x, (1, 1, 1, 1), mode="replicate"))))
        return self.squeeze(x).flatten(1)


def crop(samples: Tensor, center: Tensor, columns: int) -> Tensor:
    """Return the columns around one of each window; the last column is a neighbour of the first, as beams are.

    Args:
        samples: Shape [B, ..., rows, all columns].
        center: Column right of the middle, shape [B].
        columns: How many are kept.
    """
    place = (center[:, None] + torch.arange(-(columns // 2), columns - columns // 2, device=center.device)) % (
        samples.shape[-1]
    )
    place = place.view(len(center), *(1,) * (samples.ndim - 2), columns).expand(*samples.shape[:-1], columns)
    return samples.gather(-1, place)
