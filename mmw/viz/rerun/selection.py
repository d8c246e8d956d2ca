"""Select the part of a dataset to show: one scenario in one weather, some frames, some agents."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mmw.core.errors import InputError
from mmw.dataset import Dataset

MAX_FRAMES = 200
"""Frames that are shown if none are named: every one, or every 10th, 100th, ..., so that there are no more. Four sweeps
and images a frame are about 2 MB: some 0.4 GB then. Design value."""


@dataclass(frozen=True)
class Scope:
    """Selection to show; everything is in the dataset."""

    data: Dataset
    scenario: str
    weather: str
    frames: tuple[int, ...]
    """Frames in order, all in the dataset."""
    agents: tuple[str, ...]
    """Agents whose sensors are shown, and whose links as receivers."""
    notes: tuple[str, ...] = ()
    """Choices made by default, one line each."""

    @property
    def span(self) -> range:
        """All frame numbers from the first to the last."""
        return range(self.frames[0], self.frames[-1] + 1)


def choose_scope(
    data: Dataset, *, scenario: str = "", weather: str = "", frames: range | None = None, agents: Sequence[str] = ()
) -> Scope:
    """Return a part of a dataset that exists.

    Args:
        data: The dataset.
        scenario: Scenario; the first of the configuration that has rows, if empty.
        weather: Weather; the first of the configuration that has rows of the scenario, if empty.
        frames: Frames, those of the dataset count; None chooses all, or every 10th, 100th, ... of
            them, see `MAX_FRAMES`.
        agents: Agents; all if empty.

    Raises:
        InputError: If the dataset holds no frame, or not the selection.
    """
    if "frames" not in data.tables:
        raise InputError(f"{data.root}: holds no frames yet; run mmw.run first, then view it")
    config = data.info["config"]
    known = data.numpy("frames", columns=["scenario", "weather", "frame"])
    scenario = _choose(data, "scenario", scenario, [one["name"] for one in config["scenarios"]], known["scenario"])
    is_own = known["scenario"] == scenario
    weather = _choose(data, "weather", weather, config["weathers"], known["weather"][is_own])
    there = np.unique(known["frame"][is_own & (known["weather"] == weather)])
    notes = []
    if frames is None:
        step = 1
        while len(there) > step * MAX_FRAMES:
            step *= 10
        wanted = there[there % step == there[0] % step] if step > 1 else there
        if step > 1:
            notes.append(f"{len(wanted)} of {len(there)} frames, every {step}th; --frames shows others")
    else:
        wanted = there[np.isin(there, np.array(frames))]
        if not len(wanted):
            raise InputError(
                f"{data.root}: {scenario} {weather} has none of the frames {frames.start}:{frames.stop}:{frames.step}; "
                f"it has {there[0]} to {there[-1]}; name some of these"
            )
    return Scope(
        data, scenario, weather, tuple(int(frame) for frame in wanted),
        _agents(data, scenario, weather, wanted, agents), tuple(notes),
    )  # fmt: skip


def _choose(data: Dataset, kind: str, given: str, order: Sequence[str], there: np.ndarray) -> str:
    names = [name for name in order if name in set(there)]
    names += sorted(set(there) - set(names))
    if given and given not in names:
        raise InputError(f"{data.root}: has no {kind} {given!r}; it has {', '.join(names)}; name one of these")
    return given or names[0]


def _agents(data: Dataset, scenario: str, weather: str, frames: np.ndarray, given: Sequence[str]) -> tuple[str, ...]:
    if "poses" not in data.tables:
        raise InputError(
            f"{data.root}: has no table poses, and nothing can be placed without it; make the dataset again"
        )
    span = range(int(frames[0]), int(frames[-1]) + 1)
    found = data.numpy("poses", columns=["agent"], scenario=scenario, weather=weather, frames=span)["agent"]
    names = sorted(set(found))
    unknown = [name for name in given if name not in names]
    if unknown:
        raise InputError(f"{data.root}: has no agent {unknown[0]!r}; it has {', '.join(names)}; name some of these")
    return tuple(name for name in names if not given or name in given)
