"""Predictions without learning: the last beam, and a straight line through the angles of the past frames."""

import torch
from torch import Tensor

from examples.beam_prediction.model import last_beam

JUMP = 3
"""Beams between two frames from which on the path has changed and older frames tell nothing. Design value."""


def hold_last(past: Tensor, future: int, beams: int) -> Tensor:
    """Return the last known beam for every future frame, beam 0 where none was known, shape [B, W].

    Args:
        past: Beams of past frames, `beams` for none, shape [B, P].
        future: Frames W.
        beams: Size of the codebook Q.
    """
    return last_beam(past, beams)[0][:, None].expand(-1, future)


def extrapolate(past: Tensor, future: int, beams: int, angles: Tensor | None = None) -> Tensor:
    """Return the beams of a direction that goes on as it did, shape [B, W].

    What grows in a straight line is the electrical angle 2 pi q / Q between neighbouring antennas, the sine of the
    azimuth. A least-squares line goes through all past frames since the beam last jumped; of fewer than two frames the
    last beam stays.

    Args:
        past: Beams of past frames, `beams` for none, shape [B, P].
        future: Frames W.
        beams: Size of the codebook.
        angles: Past directions to a part of a beam, shape [B, P]; None: those of the beams.
    """
    held = hold_last(past, future, beams)
    is_there = past < beams
    way = past.double() if angles is None else angles.double()
    way = torch.where(is_there, (way - held[:, :1] + beams / 2) % beams - beams / 2, 0.0)
    is_break = ~(is_there[:, 1:] & is_there[:, :-1]) | (way.diff(dim=1).abs() >= JUMP)
    since = torch.cat([is_break.flip(1).cumsum(1).flip(1) == 0, torch.ones_like(is_there[:, :1])], dim=1)
    weight = (since & is_there).double()
    time = torch.arange(1 - past.shape[1], 1, device=past.device).double().expand(past.shape)
    count = weight.sum(1, keepdim=True).clamp(min=1)
    middle_t, middle_w = ((weight * x).sum(1, keepdim=True) / count for x in (time, way))
    spread = (weight * (time - middle_t) ** 2).sum(1, keepdim=True)
    slope = (weight * (time - middle_t) * (way - middle_w)).sum(1, keepdim=True) / spread.clamp(min=1e-9)
    ahead = torch.arange(1, future + 1, device=past.device).double()
    found = (held + torch.round(middle_w + slope * (ahead - middle_t)).long()) % beams
    return torch.where(spread > 0, found, held)
