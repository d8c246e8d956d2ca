"""Make ROS 2 messages of rows, as the dictionaries that `mcap_ros2.writer` encodes.

Axes are those of REP 103, which the dataset has too: x forward, y left, z up; in optical frames x right, y down, z
forward.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mmw.core.transforms import quaternion_from_ypr, quaternion_to_matrix
from mmw.dataset.export.read_sensors import Row, Sensor, pose_of

Message = dict[str, Any]

POINT_TYPES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
"""Type of a column -> `datatype` of `sensor_msgs/PointField`."""

LENSES = {"pinhole": "plumb_bob", "brown_conrady": "rational_polynomial", "fisheye": "equidistant"}
"""Our lens -> `distortion_model` of `sensor_msgs/CameraInfo`, whose coefficients are in OpenCV's order too.

Source: sensor_msgs, `distortion_models.hpp`."""

IMU_TO_RIGHT = np.array([[1.0, -1.0, 1.0], [-1.0, 1.0, -1.0]])
"""Factors of a force and of a rate from y right to y left: a mirrored vector, and a mirrored axial one."""

RADAR_VALUES = ("velocity", "power_db", "snr_db", "rcs_dbsm")
"""Columns of a radar's points beside x, y, z and object_id."""

CUBE, ADD = 1, 0
"""`type` and `action` of `visualization_msgs/Marker`."""

COLORS = {
    "car": (0.20, 0.45, 0.90), "truck": (0.55, 0.30, 0.80), "bus": (0.90, 0.60, 0.10), "pedestrian": (0.90, 0.20, 0.30),
    "bicycle": (0.15, 0.70, 0.40),
}  # fmt: skip
"""Category -> color of its boxes, 0 to 1; design values."""
OTHER_COLOR, ALPHA = (0.6, 0.6, 0.6), 0.5


def header(time_ns: int, frame: str) -> Message:
    """Return a `std_msgs/Header`."""
    return {"stamp": duration(time_ns), "frame_id": frame}


def duration(time_ns: int) -> Message:
    """Return a `builtin_interfaces/Time` or `Duration`."""
    return {"sec": time_ns // 1_000_000_000, "nanosec": time_ns % 1_000_000_000}


def transform(time_ns: int, parent: str, child: str, pose: np.ndarray) -> Message:
    """Return a `geometry_msgs/TransformStamped` of a pose [7], child to parent."""
    return {
        "header": header(time_ns, parent), "child_frame_id": child,
        "transform": {"translation": _xyz(pose[:3]), "rotation": _xyzw(pose[3:])},
    }  # fmt: skip


def odometry(time_ns: int, row: Row) -> Message:
    """Return the `nav_msgs/Odometry` of a row of `poses`; its twist is in the agent's frame, as REP 103 asks for."""
    pose = pose_of(row)
    own = quaternion_to_matrix(pose[3:]).T @ np.array([row["vx"], row["vy"], row["vz"]])
    rate = np.array([row["wx"], row["wy"], row["wz"]])
    return {
        "header": header(time_ns, "world"), "child_frame_id": row["agent"],
        "pose": {"pose": _pose(pose), "covariance": [0.0] * 36},
        "twist": {"twist": {"linear": _xyz(own), "angular": _xyz(rate)}, "covariance": [0.0] * 36},
    }  # fmt: skip


def point_cloud(time_ns: int, frame: str, columns: Mapping[str, np.ndarray]) -> Message:
    """Return a `sensor_msgs/PointCloud2` of columns of one length, in their types."""
    types = [(name, column.dtype.newbyteorder("<")) for name, column in columns.items()]
    count = len(next(iter(columns.values())))
    points = np.zeros(count, dtype=types)
    for name, column in columns.items():
        points[name] = column
    offsets = points.dtype.fields or {}
    fields = [
        {"name": name, "offset": offsets[name][1], "datatype": POINT_TYPES[kind.str[1:]], "count": 1}
        for name, kind in types
    ]
    size = points.dtype.itemsize
    return {
        "header": header(time_ns, frame), "height": 1, "width": count, "fields": fields, "is_bigendian": False,
        "point_step": size, "row_step": size * count, "data": points.tobytes(), "is_dense": True,
    }  # fmt: skip


def radar_points(row: Row) -> dict[str, np.ndarray]:
    """Return the columns of the points of a row of `radar`; a column that the sensor does not have is left out."""
    distance, azimuth, elevation = (np.array(row[name], dtype=float) for name in ("range", "azimuth", "elevation"))
    across = distance * np.cos(elevation)
    found = {
        "x": across * np.cos(azimuth), "y": across * np.sin(azimuth), "z": distance * np.sin(elevation),
        **{name: np.array(row[name]) for name in RADAR_VALUES if row[name] is not None},
    }  # fmt: skip
    return {name: column.astype(np.float32) for name, column in found.items()} | {
        "object_id": np.array(row["object_id"], dtype=np.int32)
    }


def image(time_ns: int, frame: str, row: Row) -> Message:
    """Return the `sensor_msgs/CompressedImage` of a row of `rgb`: the stored file."""
    return {"header": header(time_ns, frame), "format": row["format"], "data": row["image"]["bytes"]}


def camera_info(time_ns: int, frame: str, sensor: Sensor) -> Message:
    """Return the `sensor_msgs/CameraInfo` of a camera: OpenCV's, whose pixel 0 has its middle, not its edge, at 0."""
    assert sensor.intrinsic is not None
    matrix = sensor.intrinsic - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
    coefficients = list(sensor.coefficients) or [0.0] * 5
    width, height = sensor.size
    return {
        "header": header(time_ns, frame), "height": height, "width": width, "distortion_model": LENSES[sensor.lens],
        "d": coefficients, "k": matrix.ravel().tolist(), "r": np.eye(3).ravel().tolist(),
        "p": np.column_stack([matrix, np.zeros(3)]).ravel().tolist(), "binning_x": 0, "binning_y": 0,
    }  # fmt: skip


def imu(time_ns: int, frame: str, row: Row) -> Message:
    """Return the `sensor_msgs/Imu` of a row of `imu`, without an orientation, which its covariance says by -1."""
    force, rate = np.array([[row[f"{kind}{axis}"] for axis in "xyz"] for kind in "ag"], dtype=float) * (
        IMU_TO_RIGHT if row["handedness"] == "left" else 1.0
    )
    return {
        "header": header(time_ns, frame), "orientation": _xyzw((0.0, 0.0, 0.0, 1.0)),
        "orientation_covariance": [-1.0] + [0.0] * 8, "angular_velocity": _xyz(rate),
        "angular_velocity_covariance": [0.0] * 9, "linear_acceleration": _xyz(force),
        "linear_acceleration_covariance": [0.0] * 9,
    }  # fmt: skip


def fix(time_ns: int, frame: str, row: Row) -> Message:
    """Return the `sensor_msgs/NavSatFix` of a row of `gnss`: a fix by GPS, whose covariance is not known."""
    return {
        "header": header(time_ns, frame), "status": {"status": 0, "service": 1}, "latitude": row["latitude_deg"],
        "longitude": row["longitude_deg"], "altitude": row["altitude_m"], "position_covariance": [0.0] * 9,
        "position_covariance_type": 0,
    }  # fmt: skip


def boxes(time_ns: int, rows: Sequence[Row], shown_ns: int) -> Message:
    """Return the `visualization_msgs/MarkerArray` of rows of `boxes`, shown for a time [ns]."""
    markers = []
    for row in rows:
        color = COLORS.get(row["category"], OTHER_COLOR)
        turn = quaternion_from_ypr(row["yaw"], row["pitch"], row["roll"])
        markers.append({
            "header": header(time_ns, "world"), "ns": row["category"], "id": row["object_id"], "type": CUBE,
            "action": ADD, "pose": {"position": _xyz([row[axis] for axis in "xyz"]), "orientation": _xyzw(turn)},
            "scale": _xyz([row["length"], row["width"], row["height"]]),
            "color": dict(zip("rgba", (*color, ALPHA), strict=True)), "lifetime": duration(shown_ns),
            "text": row["agent"] or "",
        })  # fmt: skip
    return {"markers": markers}


def _pose(pose: np.ndarray) -> Message:
    return {"position": _xyz(pose[:3]), "orientation": _xyzw(pose[3:])}


def _xyz(values: Sequence[float] | np.ndarray) -> Message:
    return {axis: float(value) for axis, value in zip("xyz", values, strict=True)}


def _xyzw(values: Sequence[float] | np.ndarray) -> Message:
    return {axis: float(value) for axis, value in zip("xyzw", values, strict=True)}
