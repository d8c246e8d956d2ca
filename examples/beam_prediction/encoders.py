"""From sensor samples, as the array sees them, to tokens."""

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

PROFILE = 8
"""Numbers that are left of a column before all columns are joined. Design value."""

REACH = 5
"""Columns that a number of the profile is made of. Design value."""


class SensorReader(nn.Module):
    """Convolutions over a sample, the part around one beam or all of it, a profile along the beams, and a token of it.

    A sample is read together with its difference from a reference, which shows what moves, whatever the place is like.
    Rows are joined and columns are kept, so the same weights find a vehicle in every direction, to a part of a beam.
    """

    def __init__(self, shape: Sequence[int], channels: Sequence[int], width: int, columns: int):
        """Make one.

        Args:
            shape: Channels, rows and columns of a sample.
            channels: Channels of each block; a block halves the rows, the first one the columns too.
            width: Width of a token.
            columns: Columns around the beam that are seen; no less than there are means all of them.
        """
        super().__init__()
        self.columns = min(columns, shape[2])
        self.cells = self.columns // 2
        widths = [2 * shape[0], *channels]
        first = nn.Conv2d(widths[0], widths[1], (3, 4), stride=2)  # four columns, so that left and right are alike
        rest = (nn.Conv2d(a, b, 3, stride=(2, 1)) for a, b in pairwise(widths[1:]))
        self.convolutions = nn.ModuleList([first, *rest])
        self.norms = nn.ModuleList(nn.GroupNorm(1, width) for width in channels)
        hidden = 8 * PROFILE
        self.profile = nn.Sequential(
            nn.Conv1d(2 * channels[-1] + 1, hidden, REACH, padding=REACH // 2),
            nn.GELU(),
            nn.Conv1d(hidden, PROFILE, REACH, padding=REACH // 2),
        )
        self.join = nn.Linear(PROFILE * self.cells, width)

    def forward(self, samples: Tensor, references: Tensor, center: Tensor, hint: Tensor) -> Tensor:
        """Return a token a sample, shape [B, S, width].

        Args:
            samples: Shape [B, S, channels, rows, columns], uint8.
            references: Of each sample, or one for all of a window: shape [B, S or 1, channels, rows, columns], uint8.
            center: Column in the middle of what is seen, shape [B].
            hint: What the beams say about each cell, shape [B, S, cells].
        """
        seen, usual = (crop(x, center, self.columns).to(self.join.weight.dtype) / 127.5 for x in (samples, references))
        x = torch.cat([seen - 1.0, seen - usual], dim=2).flatten(0, 1)
        for convolution, norm in zip(self.convolutions, self.norms, strict=True):
            x = functional.gelu(norm(convolution(functional.pad(x, (1, 1, 1, 1), mode="replicate"))))
        joined = torch.cat([x.amax(dim=2), x.mean(dim=2), hint.flatten(0, 1)[:, None].to(x.dtype)], dim=1)
        return self.join(self.profile(joined).flatten(1)).unflatten(0, samples.shape[:2])


def crop(samples: Tensor, center: Tensor, columns: int) -> Tensor:
    """Return the columns around one of each window; the last column is a neighbor of the first, as beams are.

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
