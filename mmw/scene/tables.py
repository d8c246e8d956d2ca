"""Describe the tables of the world: frames, agents, boxes, and what a scenario is made of."""

import pyarrow as pa

from mmw.storage.table_spec import (
    AGENT,
    F32,
    F64,
    FRAMED,
    I16,
    I32,
    I64,
    NAME,
    OBJECT,
    OWNED,
    SCENARIO,
    SENSOR,
    TEXT,
    WEATHER,
    TableSpec,
    column,
    list_of,
    quaternion,
    xyz,
)

FRAMES = TableSpec(
    "frames",
    "One frame of a scenario in one weather.",
    (
        *FRAMED,
        column("time_s", F64, "s", "time after the start of the scenario"),
        column("cav_count", I16, "count", "connected vehicles in the frame"),
        column("rsu_count", I16, "count", "roadside units in the frame"),
        column("vru_count", I16, "count", "connected vulnerable road users in the frame"),
        column("uav_count", I16, "count", "drones in the frame"),
        column("bs_count", I16, "count", "base stations in the frame"),
        column("vehicle_count", I16, "count", "vehicles in the frame, connected or not, with parked ones and bicycles"),
        column("pedestrian_count", I16, "count", "people on foot in the frame, connected or not"),
        column("seed", I64, "-", "seed of traffic and sensor noise"),
    ),
    ("frame",),
)

POSES = TableSpec(
    "poses",
    "Pose and velocity of one agent.",
    (
        *OWNED,
        column("role", NAME, "", "cav, rsu, vru, uav or bs"),
        OBJECT,
        *xyz("x y z", F64, "m", "{} of the agent's origin (on the ground, between the axles; middle of a uav), world"),
        *quaternion("agent to world (agent: x forward, y left, z up)"),
        *xyz("vx vy vz", F64, "m/s", "{} of the origin's velocity, world frame"),
        *xyz("wx wy wz", F64, "rad/s", "{} of the angular velocity, agent's frame"),
    ),
    ("frame", "agent"),
)

BOXES = TableSpec(
    "boxes",
    "Ground-truth box of one vehicle, person or drone, connected or not.",
    (
        *FRAMED,
        OBJECT,
        column("category", NAME, "", "semantic label, such as car, bus, bicycle, pedestrian or dynamic (a drone)"),
        column("agent", NAME, "", "agent name if the actor is an agent; null otherwise", nullable=True),
        *xyz("x y z", F64, "m", "{} of the box center, world frame"),
        column("yaw", F64, "rad", "turn about z, counter-clockwise from east; applied first (R = Rz Ry Rx)"),
        column("pitch", F64, "rad", "turn about the turned y, nose down positive; applied second"),
        column("roll", F64, "rad", "turn about the turned x; applied last"),
        column("length", F32, "m", "size along the actor's x"),
        column("width", F32, "m", "size along the actor's y"),
        column("height", F32, "m", "size along the actor's z"),
        *xyz("vx vy vz", F64, "m/s", "{} of the velocity of the box center, world frame"),
    ),
    ("frame", "object_id"),
)

BOX_VISIBILITY = TableSpec(
    "box_visibility",
    "What one sensor, or the antenna, of one agent has of one actor. What a sensor sees nothing of has no row; "
    "an antenna has a row for every actor.",
    (
        *OWNED,
        SENSOR,
        OBJECT,
        column("lidar_points", I32, "count", "LiDAR returns on the actor; null for other sensors", nullable=True),
        column("radar_points", I32, "count", "radar points on the actor; null for other sensors", nullable=True),
        column("pixels", I32, "count", "pixels that show the actor; null where it is no camera", nullable=True),
        column(
            "is_los",
            pa.bool_(),
            "",
            "of the antenna: true if nothing else stands on the line to the middle of the box; null for sensors",
            nullable=True,
        ),
        column(
            "blocker_id", I32, "id", "of the antenna: the first object on that line, null if it is free", nullable=True
        ),
    ),
    ("frame", "agent", "sensor", "object_id"),
)

OBJECTS = TableSpec(
    "objects",
    "One object of a scenario: a part of the town, a vehicle or a roadside unit.",
    (
        SCENARIO,
        OBJECT,
        column("prim_path", TEXT, "", "prim path in the scenario's USD stage"),
        column("label", NAME, "", "semantic label, such as building or car"),
        column("tag", pa.uint8(), "id", "CARLA's number of the label"),
        column("actor", NAME, "", "name of the vehicle or roadside unit; null for the static town", nullable=True),
        column("materials", list_of(TEXT), "", "names of the object's materials, rows of `materials`"),
    ),
    ("object_id",),
    framed=False,
)

SENSORS = TableSpec(
    "sensors",
    "One sensor or antenna on one agent, and where it is mounted.",
    (
        SCENARIO,
        AGENT,
        column("sensor", NAME, "", "sensor name"),
        column("type", NAME, "", "lidar, rgb, depth, imu, radar, gnss or antenna"),
        *xyz("x y z", F64, "m", "{} of the mount, agent's frame"),
        *quaternion("sensor to agent (both x forward, y left, z up)"),
        column("fx", F64, "px", "horizontal focal length; null if not a camera", nullable=True),
        column("fy", F64, "px", "vertical focal length; null if not a camera", nullable=True),
        column("cx", F64, "px", "column of the optical axis from the left edge; null if not a camera", nullable=True),
        column("cy", F64, "px", "row of the optical axis from the top edge; null if not a camera", nullable=True),
        column("width", I32, "px", "image width; null if not a camera", nullable=True),
        column("height", I32, "px", "image height; null if not a camera", nullable=True),
        column("lens", NAME, "", "lens model: pinhole, brown_conrady or fisheye; null if not a camera", nullable=True),
        column(
            "coefficients",
            list_of(F64),
            "-",
            "distortion in OpenCV's order: k1 k2 p1 p2 k3 k4 k5 k6 (brown_conrady) or k1 k2 k3 k4 (fisheye), none for "
            "a pinhole; null if not a camera",
            nullable=True,
        ),
        column("params", TEXT, "", "JSON: the sensor's section of the configuration"),
    ),
    ("agent", "sensor"),
    framed=False,
)

MATERIALS = TableSpec(
    "materials",
    "One material of a scenario in one weather.",
    (
        SCENARIO,
        WEATHER,
        column("material_id", I32, "id", "number of the material, equal in all weathers of the scenario"),
        column("name", NAME, "", "name of the USD Material prim"),
        column("model", NAME, "", "itu (a named row), constant (the two numbers below) or function (of the frequency)"),
        column("itu", NAME, "", "row of ITU-R P.2040 or of the paper; null for other models", nullable=True),
        column("relative_permittivity", F64, "-", "real part of the relative permittivity, for constant"),
        column("conductivity", F64, "S/m", "conductivity, for constant"),
        column("thickness", F64, "m", "slab thickness; 0 = half-space"),
        column("scattering", F64, "-", "scattering coefficient, 0 to 1"),
        column("xpd", F64, "-", "cross-polarisation coefficient of scattering, 0 to 1"),
        column("scattering_pattern", NAME, "", "lambertian, directive, backscattering, a registered name, or function"),
        column("alpha_r", I16, "-", "exponent of the lobe around the reflection"),
        column("alpha_i", I16, "-", "exponent of the lobe back to the source"),
        column("lobe_share", F64, "-", "share of the lobe around the reflection, 0 to 1"),
        column("rms_height", F64, "m", "standard deviation of the surface's height, finer than the mesh; 0 = smooth"),
        column(
            "layers",
            list_of(TEXT),
            "",
            "layers in front of the substance, outermost first: row and thickness [m]; `constant`, relative "
            "permittivity, conductivity [S/m] and thickness [m]; or `sheet` and its resistance [ohm/square]",
        ),
        column("medium", NAME, "", "what the surface bounds: solid, or foliage, which waves pass with channel.foliage"),
        column("nonvisual_base", NAME, "", "SimReady non-visual base token"),
        column("lidar_reflectance", F64, "-", "diffuse reflectance at 905 nm, 0 to 1"),
        column("color", list_of(F32), "-", "linear diffuse color: red, green, blue, 0 to 1"),
    ),
    ("weather", "material_id"),
    framed=False,
)

FRAMED_TABLES = (FRAMES, POSES, BOXES, BOX_VISIBILITY)
"""Tables with rows for each frame."""

STATIC_TABLES = (OBJECTS, SENSORS, MATERIALS)
"""Tables of a scenario that no frame changes."""
