"""Every table of a dataset: the name, type, unit and meaning of each column, in this one place.

A table is either *framed* (one file a shard, `TABLE/scenario=S/weather=W/part-FFFFFF.parquet`) or *static* (one file a
scenario, `TABLE/scenario=S/part-000000.parquet`). Key columns are stored in the files as well as in the folder names,
as `dictionary<int32, string>`: a single file explains itself and every reader agrees on the type.

Conventions of all columns: world frame x east, y north, z up; metres, seconds, radians; zenith angles from +z, azimuths
from +x counter-clockwise; a quaternion rotates from the named frame to the world (mounts: to the agent). `agent` owns
the row and is the receiver of `links` and `paths`; `peer` is the transmitter.
"""

from dataclasses import dataclass

import pyarrow as pa

SCHEMA_VERSION = "1.0"
"""Major number: readers must change. Minor number: columns or tables were added."""

DEPTH_STEP_M = 0.01
"""Metres in one count of a stored depth image."""

TEXT = pa.string()
NAME = pa.dictionary(pa.int32(), pa.string())
"""Type of names; an int32 index is what pyarrow infers for partition folders."""
IMAGE = pa.struct([pa.field("bytes", pa.binary()), pa.field("path", pa.string())])
"""An encoded image, as Hugging Face datasets spell it."""
I8, I16, I32, I64, F32, F64 = pa.int8(), pa.int16(), pa.int32(), pa.int64(), pa.float32(), pa.float64()


def _list(element: pa.DataType) -> pa.DataType:
    return pa.list_(pa.field("element", element, nullable=False))


def _column(name: str, type_: pa.DataType, unit: str, doc: str, *, nullable: bool = False) -> pa.Field:
    return pa.field(name, type_, nullable=nullable, metadata={"unit": unit, "doc": doc} if unit else {"doc": doc})


def _xyz(names: str, type_: pa.DataType, unit: str, doc: str) -> list[pa.Field]:
    """Return one column for each of the space-separated names; `{}` in the text becomes the axis."""
    return [_column(name, type_, unit, doc.format(axis)) for name, axis in zip(names.split(), "xyz", strict=True)]


def _quaternion(doc: str) -> list[pa.Field]:
    return [_column(f"q{axis}", F64, "-", f"{axis} part of the unit quaternion {doc}") for axis in "xyzw"]


@dataclass(frozen=True)
class TableSpec:
    """One table."""

    name: str
    doc: str
    """What one row is, in one sentence."""
    columns: tuple[pa.Field, ...]
    key: tuple[str, ...]
    """Columns that together name a row; rows are sorted by them, in this order."""
    framed: bool = True
    """True: a file a shard. False: a file a scenario."""
    frames_per_group: int = 0
    """Frames in one Parquet row group, what a reader must fetch for one row; 0 leaves groups of 65,536 rows."""
    level: int = 3
    """zstd level."""


_SCENARIO = _column("scenario", NAME, "", "scenario name")
_WEATHER = _column("weather", NAME, "", "weather name, a variant of the town")
_FRAME = _column("frame", I32, "1/100 s", "frame number; time is frame / 100 s after the start of the scenario")
_AGENT = _column("agent", NAME, "", "agent that owns the row: a CAV such as cav_1, or an RSU such as rsu_1")
_SENSOR = _column("sensor", NAME, "", "sensor name; joins `sensors` on (scenario, agent, sensor)")
_OBJECT = _column("object_id", I32, "id", "object, a row of `objects`; one number for the object in every table")
_FRAMED = (_SCENARIO, _WEATHER, _FRAME)
_OWNED = (*_FRAMED, _AGENT)
_LINK = (
    *_OWNED,
    _column("peer", NAME, "", "transmitter of the link; `agent` is the receiver"),
    _column("carrier_hz", F64, "Hz", "carrier frequency"),
)
_NO_PATH = "; null where the link has no path"

_FRAMES = TableSpec(
    "frames",
    "One frame of a scenario in one weather.",
    (
        *_FRAMED,
        _column("time_s", F64, "s", "time after the start of the scenario"),
        _column("cav_count", I16, "count", "connected vehicles in the frame"),
        _column("rsu_count", I16, "count", "roadside units in the frame"),
        _column("vehicle_count", I16, "count", "vehicles in the frame, connected or not, parked ones included"),
        _column("pedestrian_count", I16, "count", "people in the frame"),
        _column("seed", I64, "-", "seed of traffic and sensor noise"),
    ),
    ("frame",),
)
_POSES = TableSpec(
    "poses",
    "Pose and velocity of one agent.",
    (
        *_OWNED,
        _column("role", NAME, "", "cav or rsu"),
        _OBJECT,
        *_xyz("x y z", F64, "m", "{} of the agent's origin (on the ground, midway between the axles), world frame"),
        *_quaternion("agent to world (agent: x forward, y left, z up)"),
        *_xyz("vx vy vz", F64, "m/s", "{} of the origin's velocity, world frame"),
        *_xyz("wx wy wz", F64, "rad/s", "{} of the angular velocity, agent's frame"),
    ),
    ("frame", "agent"),
)
_BOXES = TableSpec(
    "boxes",
    "Ground-truth box of one vehicle, connected or not.",
    (
        *_FRAMED,
        _OBJECT,
        _column("category", NAME, "", "semantic label, such as car, truck or bus"),
        _column("agent", NAME, "", "agent name if the vehicle is connected; null otherwise", nullable=True),
        *_xyz("x y z", F64, "m", "{} of the box centre, world frame"),
        _column("yaw", F64, "rad", "turn about z, counter-clockwise from east; applied first (R = Rz Ry Rx)"),
        _column("pitch", F64, "rad", "turn about the turned y, nose down positive; applied second"),
        _column("roll", F64, "rad", "turn about the turned x; applied last"),
        _column("length", F32, "m", "size along the vehicle's x"),
        _column("width", F32, "m", "size along the vehicle's y"),
        _column("height", F32, "m", "size along the vehicle's z"),
        *_xyz("vx vy vz", F64, "m/s", "{} of the velocity of the box centre, world frame"),
    ),
    ("frame", "object_id"),
)
_BOX_VISIBILITY = TableSpec(
    "box_visibility",
    "One vehicle that one LiDAR sweep has returns from; a vehicle without a return has no row.",
    (
        *_OWNED,
        _SENSOR,
        _OBJECT,
        _column("lidar_points", I32, "count", "returns on the vehicle, 1 or more"),
    ),
    ("frame", "agent", "sensor", "object_id"),
)
_IMU = TableSpec(
    "imu",
    "One sample of an inertial measurement unit, in the sensor's frame.",
    (
        *_OWNED,
        _SENSOR,
        *_xyz("ax ay az", F32, "m/s^2", "measured specific force along the sensor's {}; +9.81 on z at rest"),
        *_xyz("gx gy gz", F32, "rad/s", "measured angular rate about the sensor's {}"),
        *_xyz("ax_true ay_true az_true", F64, "m/s^2", "noise-free specific force along the sensor's {}"),
        *_xyz("gx_true gy_true gz_true", F64, "rad/s", "noise-free angular rate about the sensor's {}"),
    ),
    ("frame", "agent", "sensor"),
)
_LIDAR = TableSpec(
    "lidar",
    "One LiDAR sweep: the returns of one whole turn; rays without a return are left out.",
    (
        *_OWNED,
        _SENSOR,
        _column("point_count", I32, "count", "returns in the sweep, the length of the lists"),
        *_xyz("x y z", _list(F32), "m", "{} of each return, sensor frame, on a grid of 1/1024 m"),
        _column("intensity", _list(F32), "-", "returned intensity, 0 to 1, on a grid of 1/256"),
        _column("ring", _list(pa.uint8()), "index", "laser channel of each return, 0 the highest"),
        _column("object_id", _list(I32), "id", "object that each return lies on, a row of `objects`"),
    ),
    ("frame", "agent", "sensor"),
    frames_per_group=1,
    level=1,
)
_DEPTH = TableSpec(
    "depth",
    "One depth image.",
    (
        *_OWNED,
        _SENSOR,
        _column(
            "image",
            IMAGE,
            "cm",
            "16-bit PNG of depth along the optical axis; metres = value * 0.01; 0 = no return",
            nullable=True,
        ),
    ),
    ("frame", "agent", "sensor"),
    frames_per_group=4,
    level=1,
)
_LINKS = TableSpec(
    "links",
    "One radio link at one carrier; a link without any path has a row that says so.",
    (
        *_LINK,
        _column("link", NAME, "", "v2i (from an RSU) or v2v (between CAVs)"),
        _column("path_count", I32, "count", "paths found, 0 or more"),
        _column("is_los", pa.bool_(), "", "true if the line of sight is free"),
        _column("gain_db", F64, "dB", "10 log10 of the sum of |a|^2 over the paths" + _NO_PATH, nullable=True),
        _column("mean_delay_s", F64, "s", "mean of tau weighted by |a|^2" + _NO_PATH, nullable=True),
        _column("rms_delay_s", F64, "s", "standard deviation of tau weighted by |a|^2" + _NO_PATH, nullable=True),
        _column(
            "doppler_spread_hz", F64, "Hz", "standard deviation of Doppler weighted by |a|^2" + _NO_PATH, nullable=True
        ),
    ),
    ("frame", "agent", "peer", "carrier_hz"),
)
_PATHS = TableSpec(
    "paths",
    "One propagation path of one radio link at one carrier.",
    (
        *_LINK,
        _column("path", I32, "index", "number of the path in its link, from 0; equal for all carriers and weathers"),
        _column(
            "path_id", I64, "id", "the same in every frame, carrier and weather; a diffuse path lives in one frame"
        ),
        _column("kind", NAME, "", "los, specular, transmission, diffuse or diffraction: the last of these on its way"),
        _column("order", I8, "count", "interactions on the way"),
        _column("tau_s", F64, "s", "absolute delay: path length over the speed of light"),
        *(
            _column(
                f"a_{part}",
                F64,
                "-",
                f"{word} part of the coefficient, antenna patterns included, exp(-j 2 pi f tau) not",
            )
            for part, word in (("re", "real"), ("im", "imaginary"))
        ),
        *(
            _column(
                f"t_{to}{of}_{part}",
                F64,
                "-",
                f"{word} part of the transfer from the {name[of]} field at departure to the "
                f"{name[to]} field at arrival, antenna patterns and exp(-j 2 pi f tau) not included",
            )
            for name in ({"t": "theta (zenith)", "p": "phi (azimuth)"},)
            for to, of in ("tt", "tp", "pt", "pp")
            for part, word in (("re", "real"), ("im", "imaginary"))
        ),
        _column("aod_az", F64, "rad", "azimuth of departure from `peer`, world frame, -pi to pi"),
        _column("aod_ze", F64, "rad", "zenith angle of departure from `peer`, world frame, 0 to pi"),
        _column("aoa_az", F64, "rad", "azimuth of arrival at `agent`, towards the last vertex, world frame, -pi to pi"),
        _column(
            "aoa_ze", F64, "rad", "zenith angle of arrival at `agent`, towards the last vertex, world frame, 0 to pi"
        ),
        _column("doppler_hz", F64, "Hz", "Doppler shift; positive while the path gets shorter"),
        *(
            _column(f"{name}_db", F32, "dB", f"loss by {word} that a and t hold; 10^(dB/20) times them is without it")
            for name, word in (("rain", "rain"), ("fog", "fog"), ("gas", "oxygen and water vapour"))
        ),
        _column(
            "interactions", _list(I8), "-", "each interaction: 1 specular, 2 diffuse, 4 transmission, 8 diffraction"
        ),
        _column(
            "vertices", _list(F64), "m", "x, y, z of each interaction in turn, from `peer` to `agent`, world frame"
        ),
        _column("objects", _list(I32), "id", "object of each interaction, a row of `objects`"),
        _column("materials", _list(I32), "id", "material of each interaction, a row of `materials`"),
        _column(
            "surfaces",
            _list(I32),
            "id",
            "surface (of a diffraction: edge) of each interaction, the same in every frame",
        ),
    ),
    ("frame", "agent", "peer", "carrier_hz", "path"),
)
_OBJECTS = TableSpec(
    "objects",
    "One object of a scenario: a part of the town, a vehicle or a roadside unit.",
    (
        _SCENARIO,
        _OBJECT,
        _column("prim_path", TEXT, "", "prim path in the scenario's USD stage"),
        _column("label", NAME, "", "semantic label, such as building or car"),
        _column("tag", pa.uint8(), "id", "CARLA's number of the label"),
        _column("actor", NAME, "", "name of the vehicle or roadside unit; null for the static town", nullable=True),
        _column("materials", _list(TEXT), "", "names of the object's materials, rows of `materials`"),
    ),
    ("object_id",),
    framed=False,
)
_SENSORS = TableSpec(
    "sensors",
    "One sensor or antenna on one agent, and where it is mounted.",
    (
        _SCENARIO,
        _AGENT,
        _column("sensor", NAME, "", "sensor name"),
        _column("type", NAME, "", "lidar, depth, imu or antenna"),
        *_xyz("x y z", F64, "m", "{} of the mount, agent's frame"),
        *_quaternion("sensor to agent (both x forward, y left, z up)"),
        _column("fx", F64, "px", "horizontal focal length; null if not a camera", nullable=True),
        _column("fy", F64, "px", "vertical focal length; null if not a camera", nullable=True),
        _column("cx", F64, "px", "column of the optical axis from the left edge; null if not a camera", nullable=True),
        _column("cy", F64, "px", "row of the optical axis from the top edge; null if not a camera", nullable=True),
        _column("width", I32, "px", "image width; null if not a camera", nullable=True),
        _column("height", I32, "px", "image height; null if not a camera", nullable=True),
        _column("params", TEXT, "", "JSON: the sensor's section of the configuration"),
    ),
    ("agent", "sensor"),
    framed=False,
)
_MATERIALS = TableSpec(
    "materials",
    "One material of a scenario in one weather.",
    (
        _SCENARIO,
        _WEATHER,
        _column("material_id", I32, "id", "number of the material, equal in all weathers of the scenario"),
        _column("name", NAME, "", "name of the USD Material prim"),
        _column("model", NAME, "", "itu (a named row) or constant (the two numbers below)"),
        _column("itu", NAME, "", "row of ITU-R P.2040 or of the paper; null for constant", nullable=True),
        _column("relative_permittivity", F64, "-", "real part of the relative permittivity, for constant"),
        _column("conductivity", F64, "S/m", "conductivity, for constant"),
        _column("thickness", F64, "m", "slab thickness; 0 = half-space"),
        _column("scattering", F64, "-", "scattering coefficient, 0 to 1"),
        _column("xpd", F64, "-", "cross-polarisation coefficient of scattering, 0 to 1"),
        _column("scattering_pattern", NAME, "", "lambertian, directive or backscattering"),
        _column("alpha_r", I16, "-", "exponent of the lobe around the reflection"),
        _column("alpha_i", I16, "-", "exponent of the lobe back to the source"),
        _column("lobe_share", F64, "-", "share of the lobe around the reflection, 0 to 1"),
        _column("nonvisual_base", NAME, "", "SimReady non-visual base token"),
        _column("lidar_reflectance", F64, "-", "diffuse reflectance at 905 nm, 0 to 1"),
        _column("color", _list(F32), "-", "linear diffuse colour: red, green, blue, 0 to 1"),
    ),
    ("weather", "material_id"),
    framed=False,
)

TABLES: dict[str, TableSpec] = {
    spec.name: spec
    for spec in (
        _FRAMES, _POSES, _BOXES, _BOX_VISIBILITY, _IMU, _LIDAR, _DEPTH, _LINKS, _PATHS, _OBJECTS, _SENSORS, _MATERIALS,
    )
}  # fmt: skip
"""Every table by name, in the order of the documentation."""


def table_spec(name: str) -> TableSpec:
    """Return a table's specification.

    Raises:
        ValueError: If no table has this name; the message lists those that exist.
    """
    if name not in TABLES:
        raise ValueError(f"table {name!r} is not known; the tables are {', '.join(TABLES)}; name one of them")
    return TABLES[name]


def column_text(field: pa.Field) -> dict[str, str]:
    """Return a column's `unit` (absent where it has none) and `doc`."""
    return {key.decode(): value.decode() for key, value in (field.metadata or {}).items()}
