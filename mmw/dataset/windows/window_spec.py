"""Specification of windows: the lengths of past and future, and the features of their frames."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from mmw.channel.response import subcarrier_frequencies
from mmw.config.sensor_spec import SENSORS, Modality
from mmw.core.errors import InputError
from mmw.dataset.beams import BeamSearch

OWN_MODALITIES: dict[str, Modality] = {
    "poses": Modality("poses", "numbers", ("x", "y", "z", "qx", "qy", "qz", "qw", "vx", "vy", "vz", "wx", "wy", "wz")),
    "links": Modality(
        "links", "numbers", ("gain_db", "mean_delay_s", "rms_delay_s", "doppler_spread_hz", "is_los", "path_count")
    ),
    "beams": Modality("paths", "beams"),
    "csi": Modality("paths", "csi"),
    "boxes": Modality("boxes", "boxes"),
}
"""Name -> modality without a sensor."""


def modalities() -> dict[str, Modality]:
    """Return every modality by its name: those of no sensor, and those of the registered types of sensors.

    Examples:
        >>> modalities()["lidar"].columns
        ('x', 'y', 'z', 'intensity')
    """
    return OWN_MODALITIES | {name: spec.window for name, spec in SENSORS.items() if spec.window is not None}


WITH_LINK = ("links", "beams", "csi")
"""Modalities of a radio link, in which the agent is the receiver."""

CSI_HZ = tuple(subcarrier_frequencies(64, 120e3).tolist())
"""Frequencies of `csi` unless others are given: 64 subcarriers, 120 kHz apart. Design value."""


@dataclass(frozen=True, eq=False)
class Feature:
    """One modality of a window, with its own rate.

    Raises:
        InputError: If the modality is not known, or has no use for an option that is given.

    Examples:
        >>> Feature("rgb", sensor="front", every=10).key
        'rgb_front'
        >>> Feature("beams", span="future", carrier_hz=28e9).key
        'future_beams'
    """

    modality: str
    """A name of `modalities()`."""
    span: Literal["past", "future"] = "past"
    """`past` ends with the frame `now`; `future` begins with the first frame after it."""
    every: int = 1
    """Steps between samples, counted from `now`: of 40 past frames 10 gives now - 30, now - 20, now - 10 and now."""
    sensor: str | None = None
    """Sensor name; None is the only one that the table has of an agent."""
    columns: tuple[str, ...] | None = None
    """Number columns instead of the modality's own; of point clouds its lists."""
    max_age_frames: int | None = None
    """Largest age of a sample at its frame [frames]; None: up to the sensor's period, 0 without a sensor."""
    peer: str | None = None
    """Transmitter of the link; None is the only roadside unit of the scenario."""
    antenna: str | None = None
    """Antenna of the agent; None is the only one that its links have."""
    peer_antenna: str | None = None
    """Antenna of the transmitter; None is the only one."""
    carrier_hz: float | None = None
    """Carrier of the link [Hz]; None is the only one of the dataset."""
    search: BeamSearch = field(default_factory=BeamSearch)
    """Arrays, codebooks and band of the beam search, of `beams`."""
    frequencies_hz: tuple[float, ...] = CSI_HZ
    """Frequencies of `csi`, counted from the carrier [Hz]."""
    shrink: Literal[1, 2, 4, 8] = 1
    """Divisor of width and height of `rgb`: a JPEG file is then decoded at that size, which is faster."""
    name: str | None = None
    """Key in a sample; None makes `lidar`, `rgb_front`, `future_beams`."""

    def __post_init__(self) -> None:
        where = f"Feature({self.modality!r})"
        if self.modality in SENSORS and SENSORS[self.modality].window is None:
            raise InputError(
                f"{where}: sensor type {self.modality!r} has no modality; set `SensorSpec.window` in its package "
                f"({SENSORS.owner(self.modality)}), or name one of {', '.join(modalities())}"
            )
        if self.modality not in modalities():
            raise InputError(f"{where}: no such modality; they are {', '.join(modalities())}; name one of them")
        if self.span not in ("past", "future"):
            raise InputError(f"{where}: span = {self.span!r}; it is past or future")
        if self.every < 1 or (self.max_age_frames is not None and self.max_age_frames < 0):
            raise InputError(
                f"{where}: every = {self.every}, max_age_frames = {self.max_age_frames}; every is at least 1, "
                "max_age_frames 0"
            )
        if self.shrink not in (1, 2, 4, 8):
            raise InputError(f"{where}: shrink = {self.shrink}; it is 1, 2, 4 or 8")
        kind = modalities()[self.modality].kind
        uses = {
            "sensor": (self.sensor is not None, self.modality in SENSORS),
            "peer": (self.peer is not None, self.modality in WITH_LINK),
            "antenna": (self.antenna is not None, self.modality in WITH_LINK),
            "peer_antenna": (self.peer_antenna is not None, self.modality in WITH_LINK),
            "carrier_hz": (self.carrier_hz is not None, self.modality in WITH_LINK),
            "columns": (self.columns is not None, kind in ("numbers", "points")),
            "shrink": (self.shrink != 1, kind == "rgb"),
        }
        for option, (is_given, has_use) in uses.items():
            if is_given and not has_use:
                raise InputError(f"{where}: has no use for {option}; leave it out")

    @property
    def key(self) -> str:
        """Its key in a sample."""
        if self.name is not None:
            return self.name
        return "_".join((["future"] if self.span == "future" else []) + [self.modality] + [self.sensor or ""]).strip(
            "_"
        )

    def shares_source_with(self, other: "Feature") -> bool:
        """Return whether both read the same samples, whatever their frames."""
        names = (
            "modality", "sensor", "columns", "max_age_frames", "peer", "antenna", "peer_antenna", "carrier_hz",
            "search", "frequencies_hz", "shrink",
        )  # fmt: skip
        return all(getattr(self, name) == getattr(other, name) for name in names)

    @property
    def table(self) -> str:
        """Table that it is read from."""
        return modalities()[self.modality].table

    @property
    def kind(self) -> str:
        """Kind of array that its rows become."""
        return modalities()[self.modality].kind

    @property
    def picked(self) -> tuple[str, ...]:
        """Columns in the order of the array's last axis."""
        return self.columns if self.columns is not None else modalities()[self.modality].columns


@dataclass(frozen=True, eq=False)
class WindowSpec:
    """Windows of P past and W future frames; the last past frame is `now`.

    Raises:
        InputError: If a length is too small, there is no feature, or two keys are equal.

    Examples:
        >>> spec = WindowSpec(["poses", Feature("lidar", every=2)], past=4)
        >>> [spec.offsets(feature).tolist() for feature in spec.all_features]
        [[-3, -2, -1, 0], [-2, 0]]
    """

    features: Sequence[Feature | str]
    """Features of a window; a text is `Feature(text)`."""
    past: int
    """Past frames P, `now` included."""
    future: int = 0
    """Future frames W."""
    stride: int = 1
    """There is a window for every `now` that is a multiple of it, so those of all agents and weathers coincide."""
    step: int = 1
    """Frames from one frame of a window to the next; all frames in between must be there too."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "features", tuple(f if isinstance(f, Feature) else Feature(f) for f in self.features))
        if self.past < 1 or self.future < 0 or self.stride < 1 or self.step < 1:
            sizes = f"past = {self.past}, future = {self.future}, stride = {self.stride}, step = {self.step}"
            raise InputError(f"WindowSpec: {sizes}; future is at least 0, the others 1")
        if not self.features:
            raise InputError("WindowSpec: features is empty; name some, such as Feature('beams')")
        own = [feature.key for feature in self.all_features]
        keys = ["now", "track", *own, *(f"{key}_frame" for key in own)]
        twice = sorted({key for key in keys if keys.count(key) > 1})
        if twice:
            raise InputError(f"WindowSpec: {', '.join(twice)} would be there twice; give one Feature another name")
        for feature in self.all_features:
            if feature.span == "future" and feature.every > self.future:
                raise InputError(
                    f"WindowSpec: {feature.key} has one sample in {feature.every} frames, the future {self.future} "
                    "frames; lengthen the future or lower `every`"
                )

    @property
    def all_features(self) -> tuple[Feature, ...]:
        """`features`, none of them a text."""
        return tuple(feature for feature in self.features if isinstance(feature, Feature))

    @property
    def before(self) -> int:
        """Frames from the first past frame to `now`."""
        return (self.past - 1) * self.step

    @property
    def after(self) -> int:
        """Frames from `now` to the last future frame."""
        return self.future * self.step

    def offsets(self, feature: Feature) -> np.ndarray:
        """Return the frames that a feature has samples for, counted from `now`, growing, shape [T], int64."""
        if feature.span == "future":
            return np.arange(feature.every, self.future + 1, feature.every) * self.step
        return -np.arange(0, self.past, feature.every)[::-1] * self.step
