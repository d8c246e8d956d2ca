"""Open a dataset in DuckDB: a view per table, views that join and unnest them, and channel functions."""

import atexit
import glob
import math
import weakref
from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import pyarrow as pa

from mmw.channel.path_view import held_columns, join_sql
from mmw.channel.tables import PATHS
from mmw.config.sensor_spec import SENSORS
from mmw.core.errors import InputError
from mmw.core.extras import needed_by
from mmw.dataset.beams import BeamSearch, csi_sql
from mmw.storage.finding import one_line
from mmw.storage.schemas import SCHEMA_VERSION
from mmw.storage.shard_writer import TABLE_FILE

if TYPE_CHECKING:
    import duckdb

    from mmw.dataset.dataset import Dataset

LINK_PATHS = """
CREATE OR REPLACE VIEW link_paths AS
SELECT p.*, l.link, l.path_count, l.is_los, l.gain_db AS link_gain_db
FROM paths p JOIN links l USING (scenario, weather, frame, agent, peer, antenna, peer_antenna, carrier)
"""
"""A view with one row per path, with the columns of its link."""


def turned(axis: str, v: str, q: str, *, back: bool = False) -> str:
    """Return SQL for one axis of a vector rotated by a quaternion, or with `back` by its inverse.

    Args:
        axis: x, y or z.
        v: SQL of the vector's components, with `{}` for the axis.
        q: SQL of the quaternion's components, with `{}` for x, y, z or w.
        back: True rotates by the inverse.

    Source: matrix of a unit quaternion, as `mmw.core.transforms.quaternion_to_matrix`.
    """
    n = {name: f"({q.format(name)})" for name in "xyzw"}
    i = "xyz".index(axis)
    j, k = "xyz"[(i + 1) % 3], "xyz"[(i + 2) % 3]
    sign, other = ("+", "-") if back else ("-", "+")
    return (
        f"((1 - 2 * ({n[j]} * {n[j]} + {n[k]} * {n[k]})) * ({v.format(axis)})"
        f" + 2 * ({n[axis]} * {n[j]} {sign} {n['w']} * {n[k]}) * ({v.format(j)})"
        f" + 2 * ({n[axis]} * {n[k]} {other} {n['w']} * {n[j]}) * ({v.format(k)}))"
    )


def _agent_boxes() -> str:
    turn, horizontal = "p.q{}", "cos(b.yaw) * cos(b.pitch) WHEN 'y' THEN sin(b.yaw) * cos(b.pitch)"
    forward = f"CASE '{{}}' WHEN 'x' THEN {horizontal} ELSE -sin(b.pitch) END"
    place = ", ".join(f"{turned(axis, 'b.{0} - p.{0}', turn, back=True)} AS {axis}" for axis in "xyz")
    speed = ", ".join(f"{turned(axis, 'b.v{}', turn, back=True)} AS v{axis}" for axis in "xyz")
    ahead, left = (turned(axis, forward, turn, back=True) for axis in "xy")
    return f"""
CREATE OR REPLACE VIEW agent_boxes AS
SELECT p.scenario, p.weather, p.frame, p.agent, b.object_id, b.category, b.agent AS box_agent,
       b.object_id = p.object_id AS is_self, {place}, atan2({left}, {ahead}) AS yaw,
       b.length, b.width, b.height, {speed}
FROM poses p JOIN boxes b USING (scenario, weather, frame)
"""


AGENT_BOXES = _agent_boxes()
"""A view with one row per agent and box: center, yaw and velocity over ground in the agent's frame, its own too."""


def _sensor_poses() -> str:
    place = ", ".join(f"p.{axis} + {turned(axis, 's.{}', 'p.q{}')} AS {axis}" for axis in "xyz")
    return f"""
CREATE OR REPLACE VIEW sensor_poses AS
SELECT p.scenario, p.weather, p.frame, p.agent, s.sensor, s.type, {place},
       p.qw * s.qx + p.qx * s.qw + p.qy * s.qz - p.qz * s.qy AS qx,
       p.qw * s.qy - p.qx * s.qz + p.qy * s.qw + p.qz * s.qx AS qy,
       p.qw * s.qz + p.qx * s.qy - p.qy * s.qx + p.qz * s.qw AS qz,
       p.qw * s.qw - p.qx * s.qx - p.qy * s.qy - p.qz * s.qz AS qw
FROM poses p JOIN sensors s USING (scenario, agent)
"""


SENSOR_POSES = _sensor_poses()
"""A view with the pose of every sensor and antenna in the world in every frame."""

TRANSFER = ", ".join(f"t_{pair}_{part}" for pair in ("tt", "tp", "pt", "pp") for part in ("re", "im"))

LINK_AT = "scenario, weather, frame, agent, peer, antenna, peer_antenna, carrier"
"""Columns that name a link at a carrier."""

BEAM_INPUTS = f"""
CREATE OR REPLACE VIEW beam_inputs AS
WITH listed AS (
    SELECT {LINK_AT}, list(tau_s ORDER BY path) AS tau_s,
           list(a_re ORDER BY path) AS a_re, list(a_im ORDER BY path) AS a_im,
           flatten(list([{TRANSFER}] ORDER BY path)) AS transfer,
           flatten(list([aod_az, aod_ze, aoa_az, aoa_ze] ORDER BY path)) AS angles,
           list(interactions ORDER BY path) AS interactions, list(vertices ORDER BY path) AS vertices,
           list(first_segment_m ORDER BY path) AS first_segment_m, list(edge ORDER BY path) AS edges,
           list(curvature ORDER BY path) AS curvatures
    FROM paths GROUP BY ALL
)
SELECT {LINK_AT}, carrier_hz, link, is_los, coalesce(tau_s, []) AS tau_s,
       coalesce(a_re, []) AS a_re, coalesce(a_im, []) AS a_im, coalesce(transfer, []) AS transfer,
       coalesce(angles, []) AS angles, coalesce(interactions, []) AS interactions,
       coalesce(vertices, []) AS vertices, coalesce(first_segment_m, []) AS first_segment_m,
       coalesce(edges, []) AS edges, coalesce(curvatures, []) AS curvatures, tx_rotation, rx_rotation
FROM links
JOIN (SELECT scenario, weather, frame, agent AS peer, [qx, qy, qz, qw] AS tx_rotation FROM poses)
    USING (scenario, weather, frame, peer)
JOIN (SELECT scenario, weather, frame, agent, [qx, qy, qz, qw] AS rx_rotation FROM poses)
    USING (scenario, weather, frame, agent)
LEFT JOIN listed USING ({LINK_AT})
"""
"""A view with one row per link and carrier: its paths as lists, empty without any, and the rotations of both ends."""

UNKNOWN = {"first_segment_m": "'NaN'::DOUBLE", "edge": "[]::DOUBLE[]", "curvature": "[]::DOUBLE[]"}
"""Columns of `paths` that datasets before schema 3.2 lack -> SQL of what `beam_inputs` has in their place."""

BEAMS = f"""
CREATE OR REPLACE VIEW beams AS
SELECT * EXCLUDE (pair), pair.rx_beam AS rx_beam, pair.tx_beam AS tx_beam, pair.gain AS gain FROM (
    SELECT {LINK_AT}, carrier_hz, link, is_los,
           best_beam(tau_s, transfer, angles, interactions, vertices, first_segment_m, edges, curvatures, tx_rotation,
                     rx_rotation, carrier_hz) AS pair
    FROM beam_inputs
)
"""
"""A view with the best pair of beams of every link and carrier; -1, -1 and gain 0 without any path."""


def paths_sql(columns: Sequence[str]) -> tuple[str, str]:
    """Return SQL that makes the view `paths`, and the macro `paths_at(scenario, weather, frame)`, see `frame_macro`.

    Args:
        columns: Columns of the view.
    """
    view = join_sql("path_gains", "path_geometry", columns)
    of_frame = join_sql(
        "path_gains_at(in_scenario, in_weather, in_frame)", "path_geometry_at(in_scenario, in_frame)", columns
    )
    macro = "CREATE MACRO paths_at(in_scenario, in_weather, in_frame) AS TABLE"
    return f"CREATE VIEW paths AS {view}", f"{macro} {of_frame}"


VIEWS: dict[str, tuple[tuple[str, ...], str]] = {
    "paths": (("path_gains", "path_geometry"), paths_sql([field.name for field in PATHS.columns])[0]),
    "link_paths": (("links", "paths"), LINK_PATHS),
    "agent_boxes": (("poses", "boxes"), AGENT_BOXES),
    "sensor_poses": (("poses", "sensors"), SENSOR_POSES),
    "beam_inputs": (("links", "paths", "poses"), BEAM_INPUTS),
    "beams": (("links", "paths", "poses"), BEAMS),
}
"""View -> tables and views before it that it needs, and its statement; `paths` of an older schema has fewer columns."""


def point_views() -> dict[str, tuple[tuple[str, ...], str]]:
    """Return, as `VIEWS` does, a view `TABLE_points` for each sensor of points: one row a point, sensor frame.

    A list that is null, such as the power of CARLA's radar, is null at each of its points.
    """
    found = {}
    for spec in SENSORS.values():
        table = spec.tables[0]
        lists = [column.name for column in table.columns if pa.types.is_list(column.type)]
        if spec.kind == "points" and lists:
            columns = ", ".join(f"unnest({name}) AS {name}" for name in lists)
            found[f"{table.name}_points"] = (
                (table.name,),
                f"CREATE OR REPLACE VIEW {table.name}_points AS "
                f"SELECT scenario, weather, frame, agent, sensor, {columns} FROM {table.name}",
            )
    return found


_OPEN: "weakref.WeakSet[Any]" = weakref.WeakSet()
"""Open connections."""


@atexit.register
def _close_all() -> None:
    """Close connections before the interpreter ends: otherwise one with Python functions is reported as leaked."""
    for connection in list(_OPEN):
        connection.close()


def make_connection(dataset: "Dataset", search: BeamSearch | None = None) -> "duckdb.DuckDBPyConnection":
    """Return a connection with the views `VIEWS` and `point_views()`, one a table, and SQL functions.

    The functions are `best_beam`, `csi` and `TABLE_at`.

    Args:
        dataset: The dataset; one that is not local is read through Arrow.
        search: Arrays, codebooks and band of `best_beam`; None for the paper's.

    Raises:
        InputError: If the dataset holds no table, or a file is damaged.
        MissingPackageError: If DuckDB is not installed.
    """
    with needed_by("mmw.dataset.connect"):
        import duckdb
    if not dataset.tables:
        raise InputError(f"{dataset.root}: {dataset.content}")
    connection = duckdb.connect()
    connection.execute("SET parquet_metadata_cache = true")  # a query of one frame reads mostly footers
    for name in dataset.tables:
        names = dataset.check_files(name)
        if dataset.filesystem is not None:
            connection.register(name, dataset.arrow(name))
            continue
        dataset.arrow(name)  # checks the columns of the first file
        files = ", ".join(_quoted(glob.escape(path)) for path in names)
        try:
            connection.execute(
                f"CREATE VIEW {name} AS SELECT * FROM "
                f"read_parquet([{files}], hive_partitioning = true, hive_types_autocast = false)"
            )
        except duckdb.Error as error:
            raise dataset.damage(name, error) from error
        if (spec := dataset.spec(name)).framed:
            connection.execute(frame_macro(name, str(dataset.root), names, by_weather=spec.by_weather))
    made = point_views() | VIEWS
    if dataset.views:
        columns = [field.name for field in PATHS.columns]
        if dataset.info["schema_version"] != SCHEMA_VERSION:
            tables = [dataset.arrow(table).schema.names for table in ("path_gains", "path_geometry")]
            columns = held_columns({name for names in tables for name in names})
            inputs = BEAM_INPUTS
            for name in UNKNOWN.keys() - set(columns):
                inputs = inputs.replace(f"list({name} ORDER", f"list({UNKNOWN[name]} ORDER")
            made["beam_inputs"] = VIEWS["beam_inputs"][0], inputs
        paths, paths_at = paths_sql(columns)
        made["paths"] = VIEWS["paths"][0], paths
        if dataset.filesystem is None:
            connection.execute(paths_at)
    _add_functions(connection, search or BeamSearch())
    for view, (needed, statement) in made.items():
        if set(needed) <= {*dataset.tables, *dataset.views}:
            try:
                connection.execute(statement)
            except duckdb.BinderException as error:
                if dataset.info["schema_version"] == SCHEMA_VERSION:  # an older one lacks columns that a view needs
                    raise InputError(
                        f"{dataset.root}: view {view!r} of {', '.join(needed)} cannot be made ({one_line(error)}); "
                        f"`mmw verify {dataset.root}` names the damaged file"
                    ) from error
    _OPEN.add(connection)
    return connection


def frame_macro(table: str, root: str, files: Sequence[str], *, by_weather: bool = True) -> str:
    """Return SQL that makes `TABLE_at(scenario, weather, frame)`: the rows of one frame, read from one file.

    A query of the view looks into the footer of every file of the weather instead.

    Args:
        table: Table with frames.
        root: Dataset folder.
        files: Paths of its files.
        by_weather: False for a table that is the same in every weather: `TABLE_at(scenario, frame)`.
    """
    weather = "'/weather=' || in_weather || " if by_weather else ""
    folder_sql = f"'scenario=' || in_scenario || {weather}".removesuffix(" || ")
    begins: dict[str, set[int]] = defaultdict(set)
    for file in files:
        if found := TABLE_FILE.search(file):
            begins[found["folder"]].add(int(found["number"]))
    cases = ""
    for folder, numbers in sorted(begins.items()):
        first, last = min(numbers), max(numbers)
        step = math.gcd(*(number - first for number in numbers)) or 1 << 30  # one file has all frames
        number = f"{first} + (in_frame - {first}) // {step} * {step}"
        if len(numbers) != (last - first) // step + 1:  # files in between are not published
            number = f"list_max(list_filter({sorted(numbers)}, lambda number: number <= in_frame))"
        cases += f" WHEN {_quoted(folder)} THEN {number}"
    path = (
        f"{_quoted(glob.escape(root))} || '/{table}/' || {folder_sql} || '/part-' "
        f"|| printf('%06d', CASE {folder_sql}{cases} ELSE -1 END) || '.parquet'"
    )
    return (
        f"CREATE MACRO {table}_at(in_scenario, {'in_weather, ' if by_weather else ''}in_frame) AS TABLE SELECT * FROM "
        f"read_parquet({path}, hive_partitioning = true, hive_types_autocast = false) WHERE frame = in_frame"
    )


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"


def _add_functions(connection: "duckdb.DuckDBPyConnection", search: BeamSearch) -> None:
    lists = "DOUBLE[]"
    of_beams = [lists] * 3 + ["TINYINT[][]", "DOUBLE[][]", lists, "DOUBLE[][]", "DOUBLE[][]", lists, lists, "DOUBLE"]
    functions: dict[str, tuple[Callable, list[str], str]] = {
        "best_beam": (search.sql, of_beams, "STRUCT(rx_beam INTEGER, tx_beam INTEGER, gain DOUBLE)"),
        "csi": (csi_sql, [lists] * 3 + ["DOUBLE", lists], "STRUCT(re DOUBLE[], im DOUBLE[])"),
    }
    for name, (function, parameters, result) in functions.items():
        # Without side effects DuckDB would evaluate it once for each field of the result that a query names.
        connection.create_function(name, function, parameters, result, type="arrow", side_effects=True)
