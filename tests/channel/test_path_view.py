"""The view `paths`: the join of `path_gains` and `path_geometry` against rows that were never apart."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

from mmw.channel.links import Links
from mmw.channel.path_view import join_paths, split_columns
from mmw.channel.paths import PathSet
from mmw.channel.rows import path_gain_rows, path_geometry_rows
from mmw.channel.tables import PATH_GAINS, PATH_GEOMETRY, PATHS
from mmw.core.errors import InputError
from mmw.storage.arrow_tables import table_from_columns
from tests.fixtures.antennas import antenna_at
from tests.oracles.channel import channel, driving, solve, traffic
from tests.oracles.path_rows import path_rows, path_table

ANTENNAS = ("roof", "rear", "mast")
AGENTS = ("cav_1", "cav_2", "veh_001", "rsu_1")


@pytest.fixture(scope="module")
def solved() -> tuple[Links, PathSet]:
    """Return links of two frames, both kinds, two carriers, with made-up antennas, and their paths."""
    arrays = traffic(driving(np.arange(4) * 0.01))
    places = {"cav": (0.3, 0.2, 2.5), "rsu": (0.0, 0.0, 1.0)}
    links, paths = solve(arrays, channel(links=("v2i", "v2v"), antennas=antenna_at(places)), "cpu", [1, 2])
    number = np.arange(len(links))
    links = replace(links, tx_antenna=number % 2, rx_antenna=1 + number % 2)
    assert len(paths.carriers_hz) == 2 and len(paths) > 12
    return links, paths


def tables(solved: tuple[Links, PathSet], scenario: str = "street", weather: str = "sunny") -> list[pa.Table]:
    """Return the rows of both tables."""
    gains = {"scenario": scenario, "weather": weather, **path_gain_rows(AGENTS, ANTENNAS, *solved, "sunny")}
    geometry = {"scenario": scenario, **path_geometry_rows(AGENTS, ANTENNAS, *solved)}
    return [table_from_columns("path_gains", gains), table_from_columns("path_geometry", geometry)]


def expected(solved: tuple[Links, PathSet], scenario: str = "street", weather: str = "sunny") -> pa.Table:
    rows = path_rows(AGENTS, *solved, "sunny", ANTENNAS)
    return path_table({"scenario": scenario, "weather": weather, **rows})


def assert_equal(one: pa.Table, other: pa.Table) -> None:
    assert one.schema.equals(other.schema) and one.num_rows == other.num_rows > 0
    for name in one.column_names:
        assert one[name].to_pylist() == other[name].to_pylist(), name


def test_joined_rows_are_those_of_the_paths_bit_for_bit(solved) -> None:
    assert_equal(join_paths(*tables(solved)), expected(solved))


def test_any_order_of_rows_and_several_scenarios_and_weathers(solved) -> None:
    """Rows keep the order of `path_gains`; dictionaries of the parts number the names differently."""
    parts = [tables(solved, scenario, weather) for scenario in ("b", "a") for weather in ("rainy", "sunny")]
    whole = pa.concat_tables(gains for gains, _ in parts)
    geometry = pa.concat_tables([parts[0][1], parts[2][1]])
    rng = np.random.default_rng(4)
    shuffled = whole.take(pa.array(rng.permutation(len(whole))))
    found = join_paths(shuffled, geometry.take(pa.array(rng.permutation(len(geometry)))))
    for name in PATH_GAINS.full_key:
        assert found[name].to_pylist() == shuffled[name].to_pylist()
    rows = pa.concat_tables(expected(solved, s, w) for s in ("b", "a") for w in ("rainy", "sunny"))
    by_key = {tuple(row[name] for name in PATHS.full_key): row for row in rows.to_pylist()}
    assert len(by_key) == len(rows)
    assert all(row == by_key[tuple(row[name] for name in PATHS.full_key)] for row in found.to_pylist())


@pytest.mark.parametrize(
    ("columns", "needs_geometry"),
    [(["a_re", "frame"], False), (["tau_s"], True), (["doppler_hz"], True), (["vertices", "carrier", "a_im"], True)],
)
def test_only_what_columns_need_is_read(solved, columns, needs_geometry) -> None:
    of_gains, of_geometry = split_columns(columns)
    assert bool(of_geometry) == needs_geometry
    gains, geometry = tables(solved)
    geometry = geometry.select(of_geometry) if of_geometry else None
    found = join_paths(gains.select(of_gains), geometry, columns)
    assert found.column_names == columns
    assert_equal(found, expected(solved).select(columns))


def test_geometry_that_is_missing_is_named(solved) -> None:
    gains, geometry = tables(solved)
    with pytest.raises(InputError, match=r"2 rows of path_gains have no row in path_geometry, the first .*'path': 0"):
        join_paths(gains, geometry.slice(1))
    with pytest.raises(InputError, match=f"{len(gains)} rows of path_gains have no row"):
        join_paths(gains, geometry.slice(0, 0))
    assert join_paths(gains.slice(0, 0), geometry).num_rows == 0
    assert_equal(join_paths(gains.slice(3, 5), geometry), expected(solved).slice(3, 5))  # more geometry does no harm


def test_columns_of_the_view_are_those_of_its_tables() -> None:
    stored = {field.name: field for table in (PATH_GAINS, PATH_GEOMETRY) for field in table.columns}
    for field in PATHS.columns:
        assert field.name == "doppler_hz" or stored[field.name].equals(field, check_metadata=True)
    assert set(stored) - {field.name for field in PATHS.columns} == {"range_rate"}
