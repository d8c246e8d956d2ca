"""Read one frame, stored or simulated: agents with their samples, boxes and radio links, decoded at their first use."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from functools import cached_property, partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa

from mmw.channel.path_table import CarrierPaths
from mmw.channel.tables import LINKS
from mmw.config.sensor_spec import SENSORS, SensorSpec
from mmw.core.errors import InputError
from mmw.core.frame_rate import seconds
from mmw.core.registry import load_reference
from mmw.dataset.camera_geometry import Camera, box_corners, known_intrinsics, poses_from_rows
from mmw.dataset.column_arrays import arrays_of
from mmw.dataset.link import LINK_FIELDS, Link
from mmw.dataset.point_cloud import PointCloud, SampledCloud, has_points
from mmw.dataset.sample_rows import Row, rows_of_table, stored_image
from mmw.dataset.sensor_poses import SensorPoses, mounted_sensors, sensors_of_types
from mmw.dataset.table_reader import TableReader
from mmw.storage.codecs.images import (
    Stored,
    decode_flow,
    decode_instance,
    decode_metres,
    decode_normals,
    decode_rgb,
    decode_semantic,
)
from mmw.storage.parquet_schema import arrow_schema
from mmw.storage.schemas import TABLES, views, views_of

PosedAgent = tuple[str, str, np.ndarray, Callable[[], Row]]
"""Name, role and pose of an agent, and what returns its row of table `poses`."""


@dataclass(frozen=True)
class View:
    """A camera of one agent at one instant; images are decoded at each use, None where there is none."""

    frame: "Frame"
    agent: str
    sensor: str
    _row: Row = field(repr=False, compare=False)
    _placed: SensorPoses = field(repr=False, compare=False)

    @cached_property
    def camera(self) -> Camera:
        """Projects points of the world to pixels and back."""
        return Camera(known_intrinsics(self._row), self._placed.of(self.agent, self.sensor, self.frame.sensor_rows))

    def _image(self, table: str, column: str, decode: Callable[[Stored], np.ndarray]) -> np.ndarray | None:
        row = self.frame.row_of(table, self.agent, self.sensor)
        return None if row is None or row[column] is None else decode(stored_image(row[column]))

    @property
    def rgb(self) -> np.ndarray | None:
        """sRGB colors, shape [H, W, 3], uint8."""
        return self._image("rgb", "image", decode_rgb)

    @property
    def depth(self) -> np.ndarray | None:
        """Depth along the optical axis [m], inf for nothing, shape [H, W], float32; unrounded where that is stored."""
        row = self.frame.row_of("depth", self.agent, self.sensor)
        return (
            None if row is None or row["image"] is None else decode_metres(stored_image(row["image"]), row["depth_m"])
        )

    @property
    def instance(self) -> np.ndarray | None:
        """Object in each pixel, -1 for nothing, shape [H, W], int32."""
        return self._image("segmentation", "instance", decode_instance)

    @property
    def semantic(self) -> np.ndarray | None:
        """CARLA's number of the class in each pixel, shape [H, W], uint8."""
        return self._image("segmentation", "semantic", decode_semantic)

    @property
    def normals(self) -> np.ndarray | None:
        """Unit normals in the sensor frame, zero for nothing, shape [H, W, 3], float32."""
        return self._image("normals", "image", decode_normals)

    @property
    def flow(self) -> np.ndarray | None:
        """Optical flow to the next frame [px], u to the right and v down, NaN for none, shape [H, W, 2], float32."""
        return self._image("flow", "image", decode_flow)


@dataclass(frozen=True)
class Boxes:
    """Boxes of all vehicles and people, N rows, world frame."""

    columns: dict[str, np.ndarray]
    """Columns of table `boxes`, shape [N] each."""

    def __len__(self) -> int:
        return len(self.columns["object_id"])

    def __getitem__(self, column: str) -> np.ndarray:
        return self.columns[column]

    @property
    def corners(self) -> np.ndarray:
        """Corners in the world [m], shape [N, 8, 3], see `mmw.dataset.camera_geometry.CORNERS`."""
        return box_corners(self.columns)


@dataclass(frozen=True)
class Agent:
    """One connected vehicle or roadside unit at one instant."""

    frame: "Frame"
    name: str
    role: str
    """`cav` or `rsu`."""
    pose: np.ndarray
    """Agent to world, shape [7]."""
    _make_row: Callable[[], Row] = field(repr=False, compare=False)
    _placed: SensorPoses = field(repr=False, compare=False)

    @cached_property
    def row(self) -> Row:
        """Its row of table `poses`: velocity, angular velocity, object_id."""
        return self._make_row()

    def sensor_pose(self, sensor: str) -> np.ndarray:
        """Return the pose of one of its sensors, or of its `antenna`, in the world, shape [7].

        Raises:
            InputError: If it has no such sensor.
        """
        self._mount(sensor)
        return self._placed.of(self.name, sensor, self.frame.sensor_rows)

    @cached_property
    def sensors(self) -> dict[str, Row]:
        """Sensor -> its row of table `sensors`."""
        return dict(mounted_sensors(self.frame.sensor_rows).get(self.name, {}))

    def sensor(self, name: str) -> Any:
        """Return the sample of one of its sensors in this frame; None if there is none.

        A sensor of points gives a `PointCloud`, a camera a `View`, any other sensor the columns of its row as
        attributes, also where the package of the sensor is not installed.

        Raises:
            InputError: If it has no such sensor, or neither an installed package nor a table knows its type.
        """
        mount = self._mount(name)
        type_ = mount["type"]
        spec = SENSORS.get(type_)
        if spec is None and type_ in self.frame.data.tables:  # the primary table has the name of the type
            row = self.frame.row_of(type_, self.name, name)
            return None if row is None else SimpleNamespace(**row)
        spec = spec or sensor_spec(mount)
        if spec.decode:
            return load_reference(spec.decode)(self, name)
        row = self.frame.row_of(spec.tables[0].name, self.name, name)
        if row is None:
            return None
        if spec.kind != "points":
            return SimpleNamespace(**row)
        columns = {column: value for column, value in row.items() if isinstance(value, np.ndarray)}
        if not has_points(columns):
            return SimpleNamespace(**row)
        return SampledCloud(self.name, name, columns, partial(self._placed.of, self.name, name, self.frame.sensor_rows))

    def samples(self, type_: str) -> dict[str, Any]:
        """Return the samples of its sensors of a type in this frame by name, as `sensor` does; those that there are."""
        names = sensors_of_types(self.frame.sensor_rows).get((self.name, type_))
        if names is None:
            return {}
        self.frame.prepare_samples(self.name, names)
        return {name: sample for name in names if (sample := self.sensor(name)) is not None}

    @cached_property
    def sweeps(self) -> dict[str, PointCloud]:
        """LiDAR -> its sweep."""
        return self.samples("lidar")

    @cached_property
    def radars(self) -> dict[str, PointCloud]:
        """Radar -> its points."""
        return self.samples("radar")

    @cached_property
    def views(self) -> dict[str, View]:
        """Camera -> its images and projection; cameras without an image in this frame project all the same."""
        return {
            sensor: View(self.frame, self.name, sensor, row, self._placed)
            for sensor, row in self.sensors.items()
            if row["fx"] is not None
        }

    @cached_property
    def links(self) -> tuple[Link, ...]:
        """The links in which it is the receiver."""
        return tuple(link for link in self.frame.links if link.agent == self.name)

    def _mount(self, sensor: str) -> Row:
        if sensor not in self.sensors:
            raise InputError(f"sensor {sensor!r}: {self.name} has {', '.join(self.sensors) or 'none'}; name one")
        return self.sensors[sensor]


@dataclass(frozen=True)
class Frame:
    """One frame of one scenario in one weather. Tables are read at their first use and stay with the frame.

    Examples:
        >>> import mmw
        >>> frame = mmw.open_dataset("out/quickstart").frame("town03_roundabout", "sunny", 0)
        >>> agent = frame.agents["cav_1"]
        >>> agent.role, agent.pose.shape, agent.views["front"].rgb.shape[-1]
        ('cav', (7,), 3)
        >>> [(link.peer, link.carrier_hz, link.is_los) for link in agent.links]
        [('rsu_1', 28000000000.0, True), ('rsu_1', 4900000000.0, True)]
    """

    data: TableReader
    """The dataset, or the tables of a simulated frame."""
    scenario: str
    weather: str
    frame: int
    _tables: dict[str, pa.Table] = field(default_factory=dict, init=False, compare=False, repr=False)

    @property
    def time_s(self) -> float:
        """Time after the start of the scenario [s]."""
        return float(seconds(self.frame, self.data.frame_rate_hz(self.scenario)))

    @cached_property
    def row(self) -> Row:
        """Row of table `frames`.

        Raises:
            InputError: If the dataset has no such frame.
        """
        rows = self.rows("frames")
        if not rows:
            known = self.data.read("frames", columns=["scenario", "weather", "frame"])
            names = sorted(set(zip(*(known.column(i).to_pylist() for i in (0, 1)), strict=True)))
            first, last = (f(known.column("frame").to_pylist()) for f in (min, max))
            listed = ", ".join(f"{scenario} {weather}" for scenario, weather in names[:8])
            raise InputError(
                f"{self.data.root}: has no frame {self.frame} of {self.scenario} {self.weather}; it has frames "
                f"{first} to {last} of {listed}{' and more' if len(names) > 8 else ''}; name one of these"
            )
        return rows[0]

    def table(self, name: str) -> pa.Table:
        """Return the rows of a table or view in this frame; none if the dataset has no such table.

        Raises:
            InputError: If the name is no table's, or a file is damaged.
        """
        if name not in (*self.data.tables, *views_of(self.data.tables)):
            return arrow_schema(views().get(name, name)).empty_table()
        if name not in self._tables:
            frames = range(self.frame, self.frame + 1)
            weather = self.weather if name not in TABLES or TABLES[name].by_weather else None
            self._tables[name] = self.data.read(name, scenario=self.scenario, weather=weather, frames=frames)
        return self._tables[name]

    def rows(self, table: str) -> list[Row]:
        """Return the rows of a table as mappings; lists of numbers are arrays."""
        return rows_of_table(self.table(table))

    def row_of(self, table: str, agent: str, sensor: str) -> Row | None:
        """Return the row of one sensor in a table; None if there is none."""
        found = self.table(table)
        names = [found.column(name).to_pylist() for name in ("agent", "sensor")]
        for index, pair in enumerate(zip(*names, strict=True)):
            if pair == (agent, sensor):
                return rows_of_table(found.slice(index, 1))[0]
        return None

    def trace(self, *tables: str) -> None:
        """Trace what some tables hold, or all for none, at once, in a live simulation; a stored frame has them already.

        It is faster than one look after the other: cameras share launches and rays.

        Raises:
            InputError: If there is no such table, or the simulation is closed.
        """

    def prepare_samples(self, agent: str, sensors: Collection[str]) -> None:
        """Make the samples of some sensors of an agent, where they are not stored, before they are read one by one."""

    def paths(self, carrier_hz: float) -> CarrierPaths:
        """Return the paths of all links of this frame at a carrier [Hz].

        Raises:
            InputError: If the frame has no paths at this carrier.
        """
        return CarrierPaths.from_table(self.table("paths"), carrier_hz, self.table("links"))

    @cached_property
    def sensor_rows(self) -> list[Row]:
        """Rows of table `sensors` of the scenario."""
        if "sensors" not in self.data.tables:
            return []
        return self.data.read("sensors", scenario=self.scenario).to_pylist()

    def posed_agents(self) -> list[PosedAgent]:
        """Return the agents that are there, by their names."""
        rows = self.rows("poses")
        posed = zip(rows, poses_from_rows(rows), strict=True)
        return [(row["agent"], row["role"], pose, partial(dict, row)) for row, pose in posed]

    @cached_property
    def agents(self) -> dict[str, Agent]:
        """Name -> agent, connected vehicles and roadside units that are there."""
        posed, own = self.posed_agents(), object.__new__(type(self))
        own.__dict__.update(self.__dict__)  # agents of this very frame would keep it from being freed at once
        placed = SensorPoses({name: pose for name, _, pose, _ in posed})
        return {name: Agent(own, name, role, pose, row, placed) for name, role, pose, row in posed}

    @cached_property
    def boxes(self) -> Boxes:
        """Boxes of all vehicles and people."""
        return Boxes(arrays_of(self.table("boxes")))

    @cached_property
    def links(self) -> tuple[Link, ...]:
        """All links at all carriers, those without any path too."""
        paths = arrays_of(self.table("paths"))
        found = []
        for row in self.rows("links"):
            is_own = np.ones(len(paths["frame"]), dtype=bool)
            for name in LINKS.key:
                is_own &= paths[name] == row[name]
            own = {name: values[is_own] for name, values in paths.items()}
            found.append(Link(**{name: row[name] for name in LINK_FIELDS}, paths=own))
        return tuple(found)


def sensor_spec(row: Row) -> SensorSpec:
    """Return the kind of sensor of a row of table `sensors`.

    Raises:
        InputError: If no installed package provides its type.
    """
    if row["type"] not in SENSORS:
        raise InputError(
            f"sensor {row['sensor']!r}: its type {row['type']!r} is not known here; install the package that made this "
            "dataset"
        )
    return SENSORS[row["type"]]


def camera_view(agent: Agent, sensor: str) -> View:
    """Return the images and the projection of a camera.

    Raises:
        InputError: If table `sensors` has no intrinsic parameters of it.
    """
    if sensor not in agent.views:
        raise InputError(f"sensor {sensor!r}: fx of {agent.name} is null in table sensors; a camera needs a number")
    return agent.views[sensor]
