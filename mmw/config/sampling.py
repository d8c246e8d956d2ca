"""Instants at which a sensor or the radio channel samples: a rate with a phase, or a list of times."""

from itertools import pairwise
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, SerializerFunctionWrapHandler, field_validator, model_serializer, model_validator

from mmw.config.section import Section
from mmw.core.errors import InputError
from mmw.core.frame_rate import MILLISECONDS

RATE_TOLERANCE = 1e-3
"""Largest relative difference between a rate and the nearest whole part of the frame rate: 33.33 Hz is every third
frame. Design value."""

TIME_TOLERANCE = 1e-6
"""Largest distance of a time from a frame [frames], for rounded decimals. Design value."""

UNSET: dict[str, Any] = {"rate_hz": None, "phase_s": 0.0, "sample_times_s": ()}
"""Keys of this section and their values where they are not given."""


class Sampling(Section):
    """A section with samples of its own: some of the frames, independent of those of other sections."""

    rate_hz: float | None = Field(
        default=None,
        gt=0,
        le=MILLISECONDS,
        description="samples a second, `frames.rate_hz` / n; every frame by default [Hz]",
    )
    phase_s: float = Field(
        default=0.0, ge=0, description="time of the first sample of the scenario, on a frame, below 1 / `rate_hz` [s]"
    )
    sample_times_s: tuple[float, ...] = Field(
        default=(), description="times of the samples in place of `rate_hz` and `phase_s`, each on a frame (list) [s]"
    )

    @field_validator("sample_times_s")
    @classmethod
    def _in_order(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if any(later <= earlier for earlier, later in pairwise(value)) or min(value, default=0) < 0:
            raise InputError(f"{list(value)}: growing times from 0 on are needed; sort them, each once")
        return value

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if self.sample_times_s and (self.phase_s or self.rate_hz is not None):
            other = "phase_s" if self.phase_s else "rate_hz"
            raise InputError(f"sample_times_s and {other} are both given; the times are all samples; leave out one")
        return self

    @model_serializer(mode="wrap")
    def _without_defaults(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Put these keys last, without those that are not given: the hash of older configurations stays."""
        data: dict[str, Any] = handler(self)
        own = {key: data.pop(key) for key in UNSET if key in data}
        return {**data, **{key: value for key, value in own.items() if (value or None) is not None}}

    def with_rate(self, frame_rate_hz: int) -> Self:
        """Return the section with its rate written out where it samples every frame."""
        if self.rate_hz is not None or self.sample_times_s:
            return self
        return self.model_copy(update={"rate_hz": float(frame_rate_hz)})

    def period_frames(self, frame_rate_hz: int) -> int:
        """Return the frames from one sample to the next; 1 with a list of times, each of which stands for itself."""
        return 1 if self.rate_hz is None else round(frame_rate_hz / self.rate_hz)

    def interval_s(self, frame_rate_hz: int) -> float:
        """Return the time from one sample to the next [s]; that of a frame with a list of times."""
        return self.period_frames(frame_rate_hz) / frame_rate_hz

    def is_due(self, frames: ArrayLike, frame_rate_hz: int) -> np.ndarray:
        """Return which of the frames have a sample, shape [F], bool."""
        frames = np.asarray(frames, dtype=np.int64)
        if self.sample_times_s:
            return np.isin(frames, np.round(np.array(self.sample_times_s) * frame_rate_hz).astype(np.int64))
        return frames % self.period_frames(frame_rate_hz) == round(self.phase_s * frame_rate_hz)

    def takes_all(self, frame_rate_hz: int) -> bool:
        """Return whether every frame has a sample."""
        return not self.sample_times_s and self.period_frames(frame_rate_hz) == 1

    def check_frames(self, where: str, frames: range, frame_rate_hz: int) -> None:
        """Check that the samples fall on frames of a scenario.

        Args:
            where: Key of the section, for the message.
            frames: Frames of the scenario.
            frame_rate_hz: Their rate.

        Raises:
            InputError: If the rate does not divide that of the frames, the phase is not shorter than a period, or a
                time is not on a frame of the scenario.
        """
        if self.rate_hz is not None:
            _check_rate(where, self.rate_hz, frame_rate_hz)
        for key, times in (("phase_s", (self.phase_s,)), ("sample_times_s", self.sample_times_s)):
            for time in times:
                _check_on_frame(f"{where}.{key}", time, frame_rate_hz)
        period = self.period_frames(frame_rate_hz)
        if round(self.phase_s * frame_rate_hz) >= period:
            raise InputError(
                f"{where}.phase_s = {self.phase_s:g}: the first sample is within the first period, "
                f"{period / frame_rate_hz:g} s; give 0 to {(period - 1) / frame_rate_hz:g}"
            )
        for time in self.sample_times_s:
            if round(time * frame_rate_hz) not in frames:
                first, last = frames[0] / frame_rate_hz, frames[-1] / frame_rate_hz
                raise InputError(
                    f"{where}.sample_times_s holds {time:g}: the frames are from {first:g} to {last:g} s; give one of "
                    "these times, or lengthen frames"
                )


def _check_rate(where: str, rate_hz: float, frame_rate_hz: int) -> None:
    period = frame_rate_hz / rate_hz
    if round(period) and abs(period - round(period)) <= RATE_TOLERANCE * period:
        return
    if period < 1.0:
        raise InputError(
            f"{where}.rate_hz = {rate_hz:g}: samples fall on frames, {frame_rate_hz} a second; give at most "
            f"{frame_rate_hz}, or raise frames.rate_hz"
        )
    nearest = [f"{frame_rate_hz / n:g}" for n in (int(period), int(period) + 1)]
    raise InputError(
        f"{where}.rate_hz = {rate_hz:g}: samples fall on frames, {frame_rate_hz} a second, and {rate_hz:g} Hz does not "
        f"divide them; give {' or '.join(nearest)}"
    )


def _check_on_frame(where: str, time_s: float, frame_rate_hz: int) -> None:
    position = time_s * frame_rate_hz
    if abs(position - round(position)) > TIME_TOLERANCE:
        nearest = [f"{frame / frame_rate_hz:.9g}" for frame in (int(position), int(position) + 1)]
        raise InputError(
            f"{where} = {time_s:g}: frames are {frame_rate_hz} a second, and none is then; give {' or '.join(nearest)}"
        )
