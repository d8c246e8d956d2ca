"""Define the ROS 2 messages of a recording: those of ROS 2 Humble and later, so that its tools know them.

Source: packages std_msgs, geometry_msgs, sensor_msgs, nav_msgs and visualization_msgs of ros2/common_interfaces,
tf2_msgs of ros2/geometry2; their fields, without constants and comments. The MCAP format registry
(https://mcap.dev/spec/registry) says how definitions are joined in a schema of encoding `ros2msg`.
"""

import re

FIELDS = {
    "std_msgs/Header": "builtin_interfaces/Time stamp|string frame_id",
    "std_msgs/Float64": "float64 data",
    "std_msgs/Int32": "int32 data",
    "std_msgs/ColorRGBA": "float32 r|float32 g|float32 b|float32 a",
    "geometry_msgs/Point": "float64 x|float64 y|float64 z",
    "geometry_msgs/Vector3": "float64 x|float64 y|float64 z",
    "geometry_msgs/Quaternion": "float64 x|float64 y|float64 z|float64 w",
    "geometry_msgs/Pose": "geometry_msgs/Point position|geometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose|float64[36] covariance",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear|geometry_msgs/Vector3 angular",
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist|float64[36] covariance",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation|geometry_msgs/Quaternion rotation",
    "geometry_msgs/TransformStamped": "std_msgs/Header header|string child_frame_id|geometry_msgs/Transform transform",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "nav_msgs/Odometry": "std_msgs/Header header|string child_frame_id|geometry_msgs/PoseWithCovariance pose|"
    "geometry_msgs/TwistWithCovariance twist",
    "sensor_msgs/PointField": "string name|uint32 offset|uint8 datatype|uint32 count",
    "sensor_msgs/PointCloud2": "std_msgs/Header header|uint32 height|uint32 width|sensor_msgs/PointField[] fields|"
    "bool is_bigendian|uint32 point_step|uint32 row_step|uint8[] data|bool is_dense",
    "sensor_msgs/CompressedImage": "std_msgs/Header header|string format|uint8[] data",
    "sensor_msgs/RegionOfInterest": "uint32 x_offset|uint32 y_offset|uint32 height|uint32 width|bool do_rectify",
    "sensor_msgs/CameraInfo": "std_msgs/Header header|uint32 height|uint32 width|string distortion_model|float64[] d|"
    "float64[9] k|float64[9] r|float64[12] p|uint32 binning_x|uint32 binning_y|sensor_msgs/RegionOfInterest roi",
    "sensor_msgs/Imu": "std_msgs/Header header|geometry_msgs/Quaternion orientation|"
    "float64[9] orientation_covariance|geometry_msgs/Vector3 angular_velocity|float64[9] angular_velocity_covariance|"
    "geometry_msgs/Vector3 linear_acceleration|float64[9] linear_acceleration_covariance",
    "sensor_msgs/NavSatStatus": "int8 status|uint16 service",
    "sensor_msgs/NavSatFix": "std_msgs/Header header|sensor_msgs/NavSatStatus status|float64 latitude|"
    "float64 longitude|float64 altitude|float64[9] position_covariance|uint8 position_covariance_type",
    "visualization_msgs/UVCoordinate": "float32 u|float32 v",
    "visualization_msgs/MeshFile": "string filename|uint8[] data",
    "visualization_msgs/Marker": "std_msgs/Header header|string ns|int32 id|int32 type|int32 action|"
    "geometry_msgs/Pose pose|geometry_msgs/Vector3 scale|std_msgs/ColorRGBA color|builtin_interfaces/Duration lifetime|"
    "bool frame_locked|geometry_msgs/Point[] points|std_msgs/ColorRGBA[] colors|string texture_resource|"
    "sensor_msgs/CompressedImage texture|visualization_msgs/UVCoordinate[] uv_coordinates|string text|"
    "string mesh_resource|visualization_msgs/MeshFile mesh_file|bool mesh_use_embedded_materials",
    "visualization_msgs/MarkerArray": "visualization_msgs/Marker[] markers",
    "builtin_interfaces/Time": "int32 sec|uint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec|uint32 nanosec",
}
"""Message -> its fields, separated by `|`."""

SEPARATOR = "=" * 80


def schema_name(message: str) -> str:
    """Return the name of a message's schema, such as `sensor_msgs/msg/Imu` of `sensor_msgs/Imu`."""
    return message.replace("/", "/msg/")


def definition(message: str) -> str:
    """Return the definition of a message followed by those of all messages that it holds."""
    needed = [message]
    for one in needed:  # grows while it is walked
        held = re.findall(r"(\w+/\w+)", FIELDS[one])
        needed += [name for name in dict.fromkeys(held) if name not in needed]
    texts = [FIELDS[message].replace("|", "\n")]
    texts += [f"{SEPARATOR}\nMSG: {name}\n" + FIELDS[name].replace("|", "\n") for name in needed[1:]]
    return "\n".join(texts) + "\n"
