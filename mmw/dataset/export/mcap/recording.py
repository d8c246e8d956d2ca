"""MCAP: one recording of ROS 2 messages for each scenario in one weather, which Foxglove and ROS 2 open.

    OUT/SCENARIO_WEATHER.mcap

    /tf                                      tf2_msgs/TFMessage: agents in `world`, sensors on agents, cameras' optical
                                             frames on their sensors
    /boxes                                   visualization_msgs/MarkerArray: a cube an actor
    /AGENT/odometry                          nav_msgs/Odometry
    /AGENT/SENSOR/points                     sensor_msgs/PointCloud2 of LiDARs and radars
    /AGENT/SENSOR/compressed, camera_info    sensor_msgs/CompressedImage, the stored file, and CameraInfo
    /AGENT/SENSOR/imu, fix                   sensor_msgs/Imu, sensor_msgs/NavSatFix
    /AGENT/links/PEER/carrier_28ghz/NAME     std_msgs/Float64 gain_db, mean_delay_s, rms_delay_s, or std_msgs/Int32
                                             path_count

Frames are `world`, AGENT, AGENT/SENSOR and AGENT/SENSOR_optical. Names that ROS 2 does not allow get `_`. Where an
agent has several antennas, theirs are in the topic of a link, before NAME. Time 0 of a scenario is `START_NS`, because
ROS takes a stamp of 0 for `now`. Messages are in the order of their times.

Losses: see `LOSSES`.

Source: the MCAP specification (https://mcap.dev/spec), its registry, REP 103 and REP 105 of ROS.
"""

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mmw.core.errors import InputError
from mmw.dataset import Dataset
from mmw.dataset.export.exporter import Format, Options, Part, Selection, Task, parts
from mmw.dataset.export.mcap import messages
from mmw.dataset.export.mcap.message_definitions import definition, schema_name
from mmw.dataset.export.pinhole import OPTICAL_POSE
from mmw.dataset.export.read_sensors import Block, Row, Sensor, by_frame, pose_of, sensors_of

START_NS = 946_684_800 * 1_000_000_000
"""Time 0 of every scenario: 2000-01-01 00:00 UTC, in Unix time [ns]. Design value."""

LOSSES = (
    "no depth, segmentation, normals, flow, masks and 2-D boxes, no paths, no radar maps and samples of I and Q",
    "true values and biases of IMU and GNSS, satellites, velocities of boxes, the visibility of objects are dropped",
    "links: gain, delays and number of paths alone; a link without a path has its number only",
    "LiDAR: scene flow is dropped; points are those of the sensor at the instant of the frame",
    "covariances are not known: zeros, as ROS says it",
)
"""Losses of the format."""

POINTS = ("object_id", "ring", "label", "return_number", "time_offset")
"""Columns of a LiDAR's points beside x, y, z and intensity."""

LINK_VALUES = {
    "gain_db": "std_msgs/Float64", "mean_delay_s": "std_msgs/Float64", "rms_delay_s": "std_msgs/Float64",
    "path_count": "std_msgs/Int32",
}  # fmt: skip
"""Column of `links` -> message."""

Item = tuple[str, str, dict[str, Any]]
"""Topic, message type and message."""


def plan(dataset: Dataset, selection: Selection, options: Options) -> list[Task]:
    """Return one task a scenario and weather.

    Raises:
        InputError: If nothing is left, or two names are the same in ROS 2.
    """
    tasks = []
    for part in parts(dataset, selection):
        sensors = sensors_of(dataset, part.scenario)
        for kind, names in (("agents", part.agents), *((agent, sensors[agent]) for agent in part.agents)):
            ours = [ros_name(name) for name in names]
            if twice := [name for name in ours if ours.count(name) > 1]:
                raise InputError(f"mcap: {kind}: two have the name {twice[0]} in ROS 2; leave one out by agent=...")
        name = f"{part.scenario}_{part.weather}"
        tasks.append(Task(name, partial(write_recording, dataset, part, sensors, f"{name}.mcap")))
    return tasks


def ros_name(text: str) -> str:
    """Return a name as a token of ROS 2's topics: letters, digits and `_`, no digit first."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", text)
    return f"_{name}" if name[:1].isdigit() else name


def write_recording(dataset: Dataset, part: Part, sensors: dict[str, dict[str, Sensor]], name: str, out: Path) -> None:
    """Write the recording of a scenario in one weather."""
    from mcap_ros2.writer import Writer

    rate_hz = dataset.frame_rate_hz(part.scenario)
    with (out / name).open("wb") as file, Writer(file) as writer:
        schemas: dict[str, Any] = {}
        for block in Block(dataset, part.scenario, part.weather, part.frames).split():
            found = _messages(block, part, sensors, rate_hz)
            for frame in block.frames:
                for topic, kind, message in found.get(frame, ()):
                    if kind not in schemas:
                        schemas[kind] = writer.register_msgdef(schema_name(kind), definition(kind))
                    writer.write_message(topic, schemas[kind], message, log_time=time_ns(frame, rate_hz))


def time_ns(frame: int, rate_hz: int) -> int:
    """Return the time of a frame [ns], in Unix time."""
    return START_NS + frame * 1_000_000_000 // rate_hz


def _messages(block: Block, part: Part, sensors: dict[str, dict[str, Sensor]], rate_hz: int) -> dict[int, list[Item]]:
    """Return the messages of each frame of a block."""
    found: dict[int, list[Item]] = defaultdict(list)
    step = min(np.diff(block.frames), default=1)
    readers = (_poses(block, part, sensors), _clouds(block, part, sensors), _samples(block, part, sensors),
               _links(block, part, sensors))  # fmt: skip
    for frame, rows in block.boxes().items():
        time = time_ns(frame, rate_hz)
        shown = messages.boxes(time, rows, int(step) * 1_000_000_000 // rate_hz)
        found[frame].append(("/boxes", "visualization_msgs/MarkerArray", shown))
    for reader in readers:
        for frame, topic, kind, make in reader:
            found[frame].append((topic, kind, make(time_ns(frame, rate_hz))))
    return found


Made = Iterator[tuple[int, str, str, Any]]
"""Frame, topic, message type, and what makes the message of its time [ns]."""


def _poses(block: Block, part: Part, sensors: dict[str, dict[str, Sensor]]) -> Made:
    """Yield transforms and odometry of the agents."""
    for frame, rows in by_frame(block.rows("poses")).items():
        own = [row for row in rows if row["agent"] in part.agents]
        yield frame, "/tf", "tf2_msgs/TFMessage", partial(_transforms, rows=own, sensors=sensors)
        for row in own:
            name = ros_name(row["agent"])
            made = partial(messages.odometry, row={**row, "agent": name})
            yield frame, f"/{name}/odometry", "nav_msgs/Odometry", made


def _transforms(time: int, rows: Sequence[Row], sensors: dict[str, dict[str, Sensor]]) -> dict[str, Any]:
    found = []
    for row in rows:
        agent = ros_name(row["agent"])
        found.append(messages.transform(time, "world", agent, pose_of(row)))
        for sensor in sensors.get(row["agent"], {}).values():
            frame = f"{agent}/{ros_name(sensor.name)}"
            found.append(messages.transform(time, agent, frame, sensor.mount))
            if sensor.intrinsic is not None:
                found.append(messages.transform(time, frame, f"{frame}_optical", OPTICAL_POSE))
    return {"transforms": found}


def _clouds(block: Block, part: Part, sensors: dict[str, dict[str, Sensor]]) -> Made:
    """Yield the points of LiDARs."""
    for agent in part.agents:
        own = Block(block.dataset, block.scenario, block.weather, block.frames, agent)
        for sensor in sensors[agent].values():
            if sensor.type == "lidar" and "lidar" in block.dataset.tables:
                topic, frame = _place(agent, sensor.name, "points")
                for number, columns in own.sweeps(sensor, POINTS):
                    made = partial(messages.point_cloud, frame=frame, columns=columns)
                    yield number, topic, "sensor_msgs/PointCloud2", made


def _place(agent: str, sensor: str, kind: str) -> tuple[str, str]:
    """Return topic and frame of a sensor."""
    frame = f"{ros_name(agent)}/{ros_name(sensor)}"
    return f"/{frame}/{kind}", frame


def _samples(block: Block, part: Part, sensors: dict[str, dict[str, Sensor]]) -> Made:
    """Yield images, radar points, IMU and GNSS samples."""
    for row in block.rows("rgb", ["agent", "sensor", "image", "format"]):
        if row["agent"] in part.agents:
            topic, frame = _place(row["agent"], row["sensor"], "compressed")
            optical, sensor = f"{frame}_optical", sensors[row["agent"]][row["sensor"]]
            image = partial(messages.image, frame=optical, row=row)
            yield row["frame"], topic, "sensor_msgs/CompressedImage", image
            info = partial(messages.camera_info, frame=optical, sensor=sensor)
            yield row["frame"], f"/{frame}/camera_info", "sensor_msgs/CameraInfo", info
    for row in block.rows("radar"):
        if row["agent"] in part.agents:
            topic, frame = _place(row["agent"], row["sensor"], "points")
            made = partial(messages.point_cloud, frame=frame, columns=messages.radar_points(row))
            yield row["frame"], topic, "sensor_msgs/PointCloud2", made
    for table, kind, name, make in (
        ("imu", "sensor_msgs/Imu", "imu", messages.imu), ("gnss", "sensor_msgs/NavSatFix", "fix", messages.fix),
    ):  # fmt: skip
        for row in block.rows(table):
            if row["agent"] in part.agents:
                topic, frame = _place(row["agent"], row["sensor"], name)
                yield row["frame"], topic, kind, partial(make, frame=frame, row=row)


def _links(block: Block, part: Part, sensors: dict[str, dict[str, Sensor]]) -> Made:
    """Yield the values of the links of the agents."""
    count = {agent: sum(one.type == "antenna" for one in own.values()) for agent, own in sensors.items()}
    keys = ["agent", "peer", "antenna", "peer_antenna", "carrier_hz"]
    for row in block.rows("links", [*keys, *LINK_VALUES]):
        if row["agent"] not in part.agents:
            continue
        carrier = f"{row['carrier_hz'] / 1e9:.9g}ghz".replace(".", "p")
        topic = f"/{ros_name(row['agent'])}/links/{ros_name(row['peer'])}/carrier_{carrier}"
        if max(count.get(row["agent"], 0), count.get(row["peer"], 0)) > 1:
            topic += f"/{ros_name(row['antenna'])}/{ros_name(row['peer_antenna'])}"
        for name, kind in LINK_VALUES.items():
            if row[name] is not None:
                yield row["frame"], f"{topic}/{name}", kind, partial(_number, value=row[name])


def _number(time: int, value: float) -> dict[str, Any]:
    return {"data": value}


FORMAT = Format(
    "mcap", "MCAP recordings of ROS 2 messages, for Foxglove and ROS 2", LOSSES, plan, packages=("mcap_ros2",)
)
