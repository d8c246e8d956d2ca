"""Views and functions of a connection, against NumPy on the tables themselves."""

import subprocess
import sys
from pathlib import Path

import duckdb
import numpy as np
import pytest

import mmw
from mmw.channel import (
    CarrierPaths,
    apply_arrays,
    beam_gains,
    best_beams,
    dft_codebook,
    frequency_response,
    rotations_from_poses,
    subcarrier_frequencies,
    ula,
)
from mmw.core.transforms import compose, invert, pose_from_ypr, rotate
from mmw.dataset import BeamSearch, Dataset, connect
from mmw.dataset.beams import plain_paths
from tests.fixtures.small_dataset import small_dataset

POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")


@pytest.fixture(scope="module")
def data() -> Dataset:
    return mmw.open(small_dataset())


@pytest.fixture(scope="module")
def connection(data: Dataset) -> duckdb.DuckDBPyConnection:
    return data.connect()


def rows_of(connection: duckdb.DuckDBPyConnection, query: str) -> list[dict]:
    return connection.sql(query).to_arrow_table().to_pylist()


def pose_of(row: dict) -> np.ndarray:
    return np.array([row[name] for name in POSE])


def test_boxes_in_the_frame_of_an_agent(data: Dataset, connection: duckdb.DuckDBPyConnection) -> None:
    found = rows_of(connection, "SELECT * FROM agent_boxes WHERE weather = 'rainy' AND frame = 2")
    boxes = {row["object_id"]: row for row in data.read("boxes", weather="rainy", frames=range(2, 3)).to_pylist()}
    poses = {row["agent"]: row for row in data.read("poses", weather="rainy", frames=range(2, 3)).to_pylist()}
    assert len(found) == len(boxes) * len(poses) > 50
    for row in found:
        box, pose = boxes[row["object_id"]], poses[row["agent"]]
        middle = pose_from_ypr([box[axis] for axis in "xyz"], box["yaw"], box["pitch"], box["roll"])
        local = compose(invert(pose_of(pose)), middle)
        np.testing.assert_allclose([row[axis] for axis in "xyz"], local[:3], atol=1e-9)
        ahead = rotate(local[3:], [1.0, 0.0, 0.0])
        assert np.cos(row["yaw"] - np.arctan2(ahead[1], ahead[0])) == pytest.approx(1.0, abs=1e-12)
        speed = rotate(invert(pose_of(pose))[3:], [box[f"v{axis}"] for axis in "xyz"])
        np.testing.assert_allclose([row[f"v{axis}"] for axis in "xyz"], speed, atol=1e-9)
        assert row["is_self"] == (box["agent"] == row["agent"]) and row["box_agent"] == box["agent"]


def test_poses_of_sensors(data: Dataset, connection: duckdb.DuckDBPyConnection) -> None:
    found = rows_of(connection, "SELECT * FROM sensor_poses WHERE weather = 'sunny' AND frame = 1")
    mounts = data.read("sensors").to_pylist()
    poses = {row["agent"]: pose_of(row) for row in data.read("poses", weather="sunny", frames=range(1, 2)).to_pylist()}
    expected = {(row["agent"], row["sensor"]): compose(poses[row["agent"]], pose_of(row)) for row in mounts}
    assert len(found) == len(expected)
    for row in found:
        np.testing.assert_allclose(pose_of(row), expected[row["agent"], row["sensor"]], atol=1e-12)


def test_paths_with_their_links(data: Dataset, connection: duckdb.DuckDBPyConnection) -> None:
    paths, joined = (connection.sql(f"SELECT count(*) FROM {name}").fetchall()[0] for name in ("paths", "link_paths"))
    assert paths == joined
    query = """SELECT max(abs(g - link_gain_db)), count(*) FROM (
        SELECT 10 * log10(sum(a_re ** 2 + a_im ** 2)) AS g, link_gain_db, count(*) AS n, path_count FROM link_paths
        GROUP BY scenario, weather, frame, agent, peer, carrier_hz, link_gain_db, path_count) WHERE n = path_count"""
    worst, links = connection.sql(query).fetchall()[0]
    assert worst < 1e-9 and (links,) == connection.sql("SELECT count(*) FROM links WHERE path_count > 0").fetchall()[0]


@pytest.mark.parametrize("search", [None, BeamSearch(ula(8), ula(4), 16, 8, subcarriers=32, spacing_hz=1e6)])
def test_best_beams_are_those_of_the_recipe(data: Dataset, search: BeamSearch | None) -> None:
    """Against the steps of docs/guides/csi.md, link by link."""
    found = rows_of(connect(data.root, search=search), "SELECT * FROM beams")
    by_key = {tuple(row[n] for n in ("weather", "frame", "agent", "peer", "carrier_hz")): row for row in found}
    assert len(by_key) == len(found) == data.arrow("links").count_rows()
    search = search or BeamSearch()
    tx, rx = search.tx_array, search.rx_array
    books = dft_codebook(tx, search.tx_beams), dft_codebook(rx, search.rx_beams)
    poses = data.read("poses")
    for carrier in (4.9e9, 28e9):
        paths = data.paths(carrier)
        assert isinstance(paths, CarrierPaths) and paths.link_count == len(found) // 2
        turns = [rotations_from_poses(poses, paths, end) for end in ("tx", "rx")]
        a = apply_arrays(paths, tx, rx, carrier, *turns)
        frequencies = subcarrier_frequencies(search.subcarriers, search.spacing_hz)
        h = frequency_response(a, paths, frequencies, carrier, average=True, normalize_delays=True)
        best = best_beams(beam_gains(h, *books))
        for link, key in enumerate(paths.keys):
            row = by_key[(*[key[name] for name in ("weather", "frame", "agent", "peer")], carrier)]
            assert (row["rx_beam"], row["tx_beam"]) == (best.rx_beam[link], best.tx_beam[link])
            assert row["gain"] == pytest.approx(best.gain[link], rel=1e-9)


def test_distance_does_not_dim_a_beam() -> None:
    """Subcarriers of a path that comes late must not cancel: the receiver is synchronised."""
    count, transfer = 3, np.tile([1e-4, 0, 0, 0, 0, 0, 0, 0], (3, 1))
    angle = np.tile([0.3, np.pi / 2, -2.0, np.pi / 2], (3, 1))
    paths = plain_paths(28e9, count, np.arange(count), np.array([0.0, 1e-7, 8e-7]), transfer, angle)
    turn = np.tile(np.eye(3), (count, 1, 1))
    found = BeamSearch(wavefront="plane").best(paths, turn, turn)
    assert len(set(found.rx_beam)) == len(set(found.tx_beam)) == 1
    np.testing.assert_allclose(found.gain, found.gain[0], rtol=1e-9)
    assert found.gain[0] > 10**-0.78 * 64 * 16 * 1e-8  # at worst half a beam aside at both ends, 3.9 dB each


def test_a_link_without_path_has_no_beam(connection: duckdb.DuckDBPyConnection) -> None:
    query = """SELECT best_beam([]::DOUBLE[], []::DOUBLE[], []::DOUBLE[], []::TINYINT[][], []::DOUBLE[][], []::DOUBLE[],
        []::DOUBLE[][], []::DOUBLE[][], [0.0, 0, 0, 1], [0.0, 0, 0, 1], 28e9) AS b,
        csi([]::DOUBLE[], []::DOUBLE[], []::DOUBLE[], 28e9, [0.0, 1e6]) AS h"""
    (beam, h) = connection.sql(query).fetchall()[0]
    assert beam == {"rx_beam": -1, "tx_beam": -1, "gain": 0.0} and h == {"re": [0.0, 0.0], "im": [0.0, 0.0]}


def test_csi_is_the_sum_over_the_paths(data: Dataset, connection: duckdb.DuckDBPyConnection) -> None:
    frequencies = [-1e6, 0.0, 2.5e6]
    rows = rows_of(connection, f"SELECT *, csi(tau_s, a_re, a_im, carrier_hz, {frequencies}) AS h FROM beam_inputs")
    assert len(rows) == data.arrow("links").count_rows()
    for row in rows:
        a, tau = np.array(row["a_re"]) + 1j * np.array(row["a_im"]), np.array(row["tau_s"])
        turn = np.exp(-2j * np.pi * np.outer(row["carrier_hz"] + np.array(frequencies), tau))
        h = np.array(row["h"]["re"]) + 1j * np.array(row["h"]["im"])
        np.testing.assert_allclose(h, turn @ a, atol=1e-9 * np.abs(a).sum() + 1e-30)


def test_a_connection_ends_without_output() -> None:
    """DuckDB reports a connection with Python functions that is open at the end as leaked; ours are closed before."""
    code = f"import mmw; connection = mmw.connect({str(small_dataset())!r}); connection.sql('SELECT 1').fetchall()"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2]
    )
    assert done.stdout == "" and "leak" not in done.stderr
