"""Sources of features that stay in memory: numbers and boxes."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import pyarrow as pa

from mmw.config.sensor_spec import SENSORS
from mmw.core.errors import InputError
from mmw.core.transforms import normalize
from mmw.dataset.camera_geometry import POSE_COLUMNS, from_world
from mmw.dataset.frame import sensor_spec
from mmw.dataset.windows.tracks import LatestSamples, Track, find_latest, groups
from mmw.dataset.windows.window_spec import Feature, modalities
from mmw.storage.schemas import table_spec
from mmw.usd.semantics import CARLA_TAG

if TYPE_CHECKING:
    from mmw.dataset import Dataset

KEYS = ("scenario", "weather", "frame", "agent")


class Source(Protocol):
    """Source of the samples of a feature; rows count the samples of all tracks."""

    @property
    def latest(self) -> Sequence[LatestSamples]:
        """Sample of each frame, one entry per track."""
        ...

    def load(self, rows: np.ndarray) -> dict[str, Any]:
        """Return the samples of rows, by the suffix of the feature's key: an array with one entry per row, a tuple of
        images, or a list of arrays whose lengths differ."""
        ...


@dataclass(frozen=True, eq=False)
class RowSource:
    """Arrays with one row a sample."""

    latest: Sequence[LatestSamples]
    arrays: dict[str, np.ndarray]
    """Suffix of the feature's key -> values, shape [rows, ...]."""

    def load(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Return the values of rows, shape [T, ...] each."""
        return {name: values[rows] for name, values in self.arrays.items()}


@dataclass(frozen=True, eq=False)
class BoxSource:
    """Boxes of other actors in the frame of the agent; a row is a frame of a track."""

    latest: Sequence[LatestSamples]
    pose: np.ndarray
    """Pose of the agent, shape [rows, 7], float64."""
    own: np.ndarray
    """`object_id` of the agent, shape [rows], int64."""
    span: np.ndarray
    """First and one past the last box of the row's frame, shape [rows, 2], int64."""
    place: np.ndarray
    """Center of each box in the world [m], shape [boxes, 3], float64."""
    forward: np.ndarray
    """Direction of the box's x in the world, shape [boxes, 3], float64."""
    size: np.ndarray
    """Length, width, height [m], shape [boxes, 3], float32."""
    object_id: np.ndarray
    """Shape [boxes], int64."""
    tag: np.ndarray
    """CARLA's number of the class, shape [boxes], int64."""

    def load(self, rows: np.ndarray) -> dict[str, list[np.ndarray]]:
        """Return boxes [N, 7], ids [N] and classes [N] of each row; without the agent's own box.

        A box is x, y, z, length, width, height [m] and yaw [rad], center and yaw in the agent's frame.
        """
        found: dict[str, list[np.ndarray]] = {"": [], "_object_id": [], "_class": []}
        for row in rows:
            some = np.arange(*self.span[row])
            some = some[self.object_id[some] != self.own[row]]
            turned = from_world(np.concatenate([np.zeros(3), self.pose[row, 3:]]), self.forward[some])
            yaw = np.arctan2(turned[:, 1], turned[:, 0])[:, None]
            values = np.hstack([from_world(self.pose[row], self.place[some]), self.size[some], yaw])
            found[""].append(values.astype(np.float32))
            found["_object_id"].append(self.object_id[some])
            found["_class"].append(self.tag[some])
        return found


def parts_of(tracks: Sequence[Track]) -> Iterable[tuple[str, str, dict[str, int]]]:
    """Yield scenario, weather, and the number of the track of each agent in it."""
    found: dict[tuple[str, str], dict[str, int]] = {}
    for number, track in enumerate(tracks):
        found.setdefault((track.scenario, track.weather), {})[track.agent] = number
    for (scenario, weather), agents in found.items():
        yield scenario, weather, agents


def no_samples(tracks: Sequence[Track]) -> list[LatestSamples]:
    """Return `LatestSamples` without any sample for every track."""
    none = np.zeros(0, dtype=np.int64)
    return [find_latest(track, none, none, 0) for track in tracks]


def sensor_periods(dataset: "Dataset") -> dict[tuple[str, str, str], int]:
    """Return the frames from one sample to the next of every scenario, agent and sensor in table `sensors`.

    Raises:
        InputError: If no installed package provides a sensor's type.
    """
    if "sensors" not in dataset.tables:
        return {}
    rows = dataset.read("sensors", columns=["scenario", "agent", "sensor", "type", "params"]).to_pylist()
    found = {}
    for row in rows:
        if row["type"] == "antenna":
            continue
        section = sensor_spec(row).config.model_validate_json(row["params"])
        rate_hz = dataset.frame_rate_hz(row["scenario"])
        found[row["scenario"], row["agent"], row["sensor"]] = section.period_frames(rate_hz)
    return found


def max_age_of(feature: Feature, periods: Mapping[tuple[str, str, str], int], track: Track, sensor: str) -> int:
    """Return the frames that a sample of a sensor may be older than its frame.

    Raises:
        InputError: If the sensor is not among `sensor_periods`, and `max_age_frames` is not given.
    """
    if feature.max_age_frames is not None:
        return feature.max_age_frames
    key = track.scenario, track.agent, sensor
    if key not in periods:
        raise InputError(
            f"Feature({feature.modality!r}): table sensors has no row for {' '.join(key)}, which would give its "
            "sampling rate; give `max_age_frames`"
        )
    return periods[key] - 1


def one_sensor(feature: Feature, track: Track, known: Iterable[str]) -> str | None:
    """Return the sensor of an agent that a feature is read from; None if it has none.

    Raises:
        InputError: If there are several, and none is named.
    """
    names = sorted(known)
    if feature.sensor is not None:
        return feature.sensor if feature.sensor in names else None
    if len(names) > 1:
        raise InputError(
            f"Feature({feature.modality!r}): {track.agent} of {track.scenario} has {', '.join(names)}; name one "
            "as `sensor`"
        )
    return names[0] if names else None


def number_columns(feature: Feature) -> tuple[str, ...]:
    """Return the columns of a feature of kind numbers or points.

    Raises:
        InputError: If one is not in the table, or its values are no numbers (points: no lists of numbers).
    """
    types = {}
    for column in table_spec(feature.table).columns:
        value = column.type
        if feature.kind == "points":
            value = value.value_type if pa.types.is_list(value) else pa.null()
        if pa.types.is_floating(value) or pa.types.is_integer(value) or pa.types.is_boolean(value):
            types[column.name] = value
    wrong = [name for name in feature.picked if name not in types]
    if wrong or not feature.picked:
        raise InputError(
            f"Feature({feature.modality!r}): columns {wrong or 'none'}; {feature.table} has {', '.join(types)}; name "
            "some"
        )
    return feature.picked


def number_source(dataset: "Dataset", feature: Feature, tracks: Sequence[Track]) -> RowSource:
    """Return the numbers of poses, links or a scalar sensor, one row a sample; nulls are NaN.

    Raises:
        InputError: If a column is not one of numbers, or an agent has several sensors and none is named.
    """
    columns, has_sensor = number_columns(feature), feature.modality in SENSORS
    dtype = np.dtype(modalities()[feature.modality].dtype)
    latest, found, count = no_samples(tracks), [np.zeros((0, len(columns)), dtype=dtype)], 0
    periods = sensor_periods(dataset)
    names = list(dict.fromkeys([*KEYS, *(["sensor"] if has_sensor else []), *columns]))
    for scenario, weather, agents in parts_of(tracks):
        rows = dataset.read(feature.table, columns=names, scenario=scenario, weather=weather)
        frames = rows.column("frame").to_numpy().astype(np.int64)
        values = stacked(rows, columns, dtype)
        by_agent = by_sensor(rows) if has_sensor else {a: {"": r} for (a,), r in groups(rows, ("agent",)).items()}
        for agent, number in agents.items():
            track = tracks[number]
            sensor = one_sensor(feature, track, by_agent.get(agent, {}))
            if sensor is not None:
                some = in_order(frames, by_agent[agent][sensor], feature, track)
                max_age = max_age_of(feature, periods, track, sensor) if has_sensor else feature.max_age_frames or 0
                latest[number] = find_latest(track, frames[some], some + count, max_age)
        found.append(values)
        count += len(values)
    return RowSource(latest, {"": np.concatenate(found)})


def by_sensor(rows: pa.Table) -> dict[str, dict[str, np.ndarray]]:
    """Return the row numbers of every sensor of every agent."""
    found: dict[str, dict[str, np.ndarray]] = {}
    for (agent, sensor), some in groups(rows, ("agent", "sensor")).items():
        found.setdefault(agent, {})[sensor] = some
    return found


def in_order(frames: np.ndarray, rows: np.ndarray, feature: Feature, track: Track) -> np.ndarray:
    """Return rows of one track, sorted by frame.

    Raises:
        InputError: If a frame has more than one.
    """
    some = rows[np.argsort(frames[rows], kind="stable")]
    if (np.diff(frames[some]) == 0).any():
        where = " ".join(track.name)
        raise InputError(f"table {feature.table}: {where} has two rows in one frame; run mmw verify")
    return some


def stacked(rows: pa.Table, columns: Sequence[str], dtype: "np.dtype | type") -> np.ndarray:
    """Return number columns side by side, shape [rows, columns]; nulls are NaN."""
    values = np.empty((rows.num_rows, len(columns)), dtype=dtype)
    for index, name in enumerate(columns):
        values[:, index] = rows.column(name).to_numpy()
    return values


def box_source(dataset: "Dataset", tracks: Sequence[Track], feature: Feature) -> BoxSource:
    """Return the boxes of every frame of every track; a frame without any box has no sample."""
    latest, count, boxes = no_samples(tracks), 0, 0
    parts: dict[str, list[np.ndarray]] = {}
    pose_columns = [*KEYS, "object_id", *POSE_COLUMNS]
    columns = ["frame", "object_id", "category", "x", "y", "z", "yaw", "pitch", "length", "width", "height"]

    def add(name: str, values: np.ndarray) -> None:
        parts.setdefault(name, []).append(values)

    for scenario, weather, agents in parts_of(tracks):
        rows = dataset.read("boxes", columns=columns, scenario=scenario, weather=weather)
        frames = rows.column("frame").to_numpy().astype(np.int64)
        order = np.argsort(frames, kind="stable")
        frames = frames[order]
        kinds = rows.column("category").cast(pa.string()).to_pylist()
        yaw, pitch = (rows.column(name).to_numpy()[order] for name in ("yaw", "pitch"))
        add("place", stacked(rows, ("x", "y", "z"), np.float64)[order])
        add("forward", np.stack([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)], axis=-1))
        add("size", stacked(rows, ("length", "width", "height"), np.float32)[order])
        add("object_id", rows.column("object_id").to_numpy()[order].astype(np.int64))
        add("tag", np.array([CARLA_TAG[kind] for kind in kinds], dtype=np.int64)[order])
        poses = dataset.read("poses", columns=pose_columns, scenario=scenario, weather=weather)
        own_frames = poses.column("frame").to_numpy().astype(np.int64)
        span = np.stack([np.searchsorted(frames, own_frames, side=side) for side in ("left", "right")], axis=-1)
        add("span", span + boxes)
        pose = stacked(poses, POSE_COLUMNS, np.float64)
        add("pose", np.hstack([pose[:, :3], normalize(pose[:, 3:])]))
        add("own", poses.column("object_id").to_numpy().astype(np.int64))
        for (agent,), some in groups(poses, ("agent",)).items():
            if agent in agents:
                track = tracks[agents[agent]]
                some = in_order(own_frames, some[span[some, 1] > span[some, 0]], feature, track)
                latest[agents[agent]] = find_latest(track, own_frames[some], some + count, feature.max_age_frames or 0)
        boxes += len(frames)
        count += poses.num_rows
    return BoxSource(latest, **{name: np.concatenate(values) for name, values in parts.items()})
