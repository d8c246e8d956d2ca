"""Predictions without learning: the last beam, a straight line through past angles, the nearest window of training."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from examples.beam_prediction.data import BeamData
from examples.beam_prediction.model import last_beam

JUMP = 3
"""Beams between two frames from which on the path counts as another one. Design value."""

CHUNK = 256
"""Validation windows that are compared with all of training at a time. Design value."""

SOME = 50
"""Step between the windows that give the usual distance. Design value."""


def hold_last(past: Tensor, future: int, beams: int) -> Tensor:
    """Return the last known beam for every future frame, beam 0 where none was known, shape [B, W].

    Args:
        past: Beams of past frames, `beams` for none, shape [B, P].
        future: Frames W.
        beams: Size of the codebook Q.
    """
    return last_beam(past, beams)[0][:, None].expand(-1, future)


def extrapolate(past: Tensor, future: int, beams: int, angles: Tensor | None = None) -> Tensor:
    """Return the beams of a direction extrapolated in a straight line, shape [B, W].

    What grows in a straight line is the electrical angle 2 pi q / Q between neighboring antennas, the sine of the
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
    direction = past.double() if angles is None else angles.double()
    direction = torch.where(is_there, (direction - held[:, :1] + beams / 2) % beams - beams / 2, 0.0)
    is_break = ~(is_there[:, 1:] & is_there[:, :-1]) | (direction.diff(dim=1).abs() >= JUMP)
    since = torch.cat([is_break.flip(1).cumsum(1).flip(1) == 0, torch.ones_like(is_there[:, :1])], dim=1)
    weight = (since & is_there).double()
    time = torch.arange(1 - past.shape[1], 1, device=past.device).double().expand(past.shape)
    count = weight.sum(1, keepdim=True).clamp(min=1)
    middle_t, middle_w = ((weight * x).sum(1, keepdim=True) / count for x in (time, direction))
    spread = (weight * (time - middle_t) ** 2).sum(1, keepdim=True)
    slope = (weight * (time - middle_t) * (direction - middle_w)).sum(1, keepdim=True) / spread.clamp(min=1e-9)
    ahead = torch.arange(1, future + 1, device=past.device).double()
    found = (held + torch.round(middle_w + slope * (ahead - middle_t)).long()) % beams
    return torch.where(spread > 0, found, held)


def recall(data: BeamData, sources: Sequence[str]) -> Tensor:
    """Return the beams that followed in the window of training that is most like each validation window, [n, W].

    Alike are past beams as points on the circle of electrical angles and, with sensors, their latest samples: the sum
    of Euclidean distances, each over what it usually is. This remembers and understands nothing: where it is good, what
    is validated was trained.

    Args:
        data: The data.
        sources: Sensors; without any, beams alone are compared.
    """
    train, val = data.starts["train"], data.starts["val"]
    past = {part: data.batch(starts, ()).beams for part, starts in data.starts.items()}
    points = {part: _points(beams, data.beams) for part, beams in past.items()}
    usual = torch.cdist(points["val"][::SOME], points["train"][::SOME]).mean().clamp(min=1e-9)
    apart = [_sample_distances(data.sensors[source].samples) for source in sources]
    row = [data.sensors[source].row[:, None] for source in sources]
    held = hold_last(past["train"], data.future, data.beams)
    targets = data.targets(train)
    targets = torch.where(targets < 0, held, targets)
    now, chosen = data.past - 1, []
    for starts, own in zip(val.split(CHUNK), points["val"].split(CHUNK), strict=True):
        distance = torch.cdist(own, points["train"]) / usual
        for between, at in zip(apart, row, strict=True):
            distance += between[at[starts + now], at[train + now].T]
        chosen.append(distance.argmin(dim=1))
    return targets[torch.cat(chosen)]


def _points(past: Tensor, beams: int) -> Tensor:
    """Return past beams as points on a circle, its middle for none, shape [B, 2 P]."""
    angle = 2.0 * math.pi * past / beams
    return torch.cat([wave * (past < beams) for wave in (angle.cos(), angle.sin())], dim=1)


def _sample_distances(samples: Tensor) -> Tensor:
    """Return the Euclidean distances between all samples over their mean, shape [N, N]."""
    flat = samples.flatten(1).float()
    distance = torch.cdist(flat, flat)
    return distance / distance.mean().clamp(min=1e-9)
