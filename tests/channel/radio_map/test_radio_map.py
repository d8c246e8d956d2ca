"""RSS, SINR, association, distribution, positions and cells of finished maps, against brute force."""

import numpy as np
import pytest

from mmw.channel.radio_map.measurement_surface import MeasurementSurface, mesh_surface, plane_grid
from mmw.channel.radio_map.radio_map import BOLTZMANN, RadioMap, RadioMapConfig
from mmw.channel.radio_map.table import RADIO_MAP
from mmw.channel.radio_map.transmitters import Transmitters
from mmw.config import ChannelConfig
from mmw.core.errors import InputError
from tests.oracles.radio_map import CARRIER, UPRIGHT

PLACES = np.array([[0.0, 0.0, 10.0], [30.0, 5.0, 8.0], [-20.0, -9.0, 4.0]])

CHANNEL = ChannelConfig(carriers_hz=(CARRIER,))


def random_map(surface: MeasurementSurface, seed: int = 1) -> RadioMap:
    """Return a map of three transmitters with random gains, a tenth of them 0, and all of them in the first cell."""
    rng = np.random.default_rng(seed)
    gain = 10.0 ** rng.uniform(-12, -7, (3, len(surface))) * (rng.random((3, len(surface))) > 0.1)
    gain[:, 0] = 0.0
    tx = Transmitters(("a", "b", "c"), PLACES, np.tile(np.eye(3), (3, 1, 1)), np.array([44.0, 20.0, 37.0]))
    return RadioMap(tx, surface, RadioMapConfig(CHANNEL), gain)


def uneven() -> MeasurementSurface:
    """Return a bent sheet of triangles of very different size."""
    x, y = np.meshgrid([0.0, 1.0, 5.0, 6.0, 20.0], [0.0, 0.5, 8.0, 9.0], indexing="ij")
    points = np.stack([x, y, 0.3 * x + 0.02 * x * y], axis=-1).reshape(-1, 3)
    first = (np.arange(4)[:, None] * 4 + np.arange(3)).ravel()
    faces = np.concatenate([np.stack([first, first + 4, first + 5], 1), np.stack([first, first + 5, first + 1], 1)])
    return mesh_surface(points, faces)


def test_received_power_interference_and_server() -> None:
    """Two transmitters and four cells, by hand."""
    tx = Transmitters(("a", "b"), np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)), np.array([30.0, 20.0]))
    surface = plane_grid((0, 0, 0), (4, 1), 1.0)
    gain = np.array([[1e-9, 1e-9, 0.0, 0.0], [1e-8, 1e-7, 1e-9, 0.0]])
    result = RadioMap(tx, surface, RadioMapConfig(CHANNEL, bandwidth_hz=20e6, temperature_k=290.0), gain)
    noise = BOLTZMANN * 290.0 * 20e6
    assert 10 * np.log10(noise) + 30 == pytest.approx(-100.96, abs=0.01)  # -173.98 dBm/Hz + 73.01 dB
    np.testing.assert_allclose(result.rss_dbm, [[-60, -60, -np.inf, -np.inf], [-60, -50, -70, -np.inf]])
    np.testing.assert_allclose(result.received_w, [[1e-9, 1e-9, 0, 0], [1e-9, 1e-8, 1e-10, 0]])
    expected = [[1e-9 / (1e-9 + noise), 1e-9 / (1e-8 + noise)], [1e-9 / (1e-9 + noise), 1e-8 / (1e-9 + noise)]]
    np.testing.assert_allclose(result.sinr_db[:, :2], 10 * np.log10(expected))
    np.testing.assert_allclose(result.sinr_db[1, 2], 10 * np.log10(1e-10 / noise))
    assert np.isneginf(result.sinr_db[:, 3]).all()
    assert np.isneginf(result.sinr_db[0, 2])
    np.testing.assert_array_equal(result.tx_association, [0, 1, 1, -1])


def test_metrics_of_one_and_of_all_transmitters() -> None:
    result = random_map(plane_grid((0, 0, 1.5), (20, 6), 1.0))
    for metric, values in (("path_gain", result.path_gain_db), ("rss", result.rss_dbm), ("sinr", result.sinr_db)):
        np.testing.assert_array_equal(result.metric_db(metric, "b"), values[1])
        np.testing.assert_array_equal(result.metric_db(metric), values.max(axis=0))
    best = result.tx_association
    for cell, row in enumerate(result.rss_dbm.T):
        assert best[cell] == (int(np.argmax(row)) if np.isfinite(row).any() else -1)
    assert best[0] == -1 and set(best.tolist()) == {-1, 0, 1, 2}
    np.testing.assert_array_equal(result.cell_areas, 1.0)
    np.testing.assert_array_equal(result.cell_centers, result.surface.center)


def test_a_plane_has_rows_and_columns() -> None:
    result = random_map(plane_grid((0, 0, 1.5), (20, 6), 2.0))
    grid = result.as_grid(result.path_gain)
    assert grid.shape == (3, 3, 10)
    places = result.as_grid(result.cell_centers.T)
    np.testing.assert_allclose(places[:, 2, 7], [5.0, 2.0, 1.5])
    np.testing.assert_array_equal(grid[:, 2, 7], result.path_gain[:, 27])
    np.testing.assert_array_equal(result.as_grid(result.tx_association).ravel(), result.tx_association)


def test_distribution_counts_cells_by_area() -> None:
    result = random_map(uneven())
    for tx in (None, "c"):
        values, probability = result.cdf("rss", tx)
        metric = result.metric_db("rss", tx)
        share = [result.cell_areas[metric <= value].sum() / result.cell_areas.sum() for value in values]
        np.testing.assert_allclose(probability, share)
        assert (np.diff(values) > 0).all() and probability[-1] == pytest.approx(1.0)
        assert np.isfinite(values).all() and probability[0] > result.cell_areas[0] / result.cell_areas.sum()
    nothing = RadioMap(result.transmitters, result.surface, result.config, np.zeros_like(result.path_gain))
    assert [len(part) for part in nothing.cdf("sinr")] == [0, 0]


def test_positions_are_uniform_over_the_area_that_fits() -> None:
    result = random_map(uneven())
    server, cells = result.tx_association, np.arange(len(result.surface))
    distance = np.linalg.norm(result.cell_centers[:, None] - PLACES, axis=2)
    for options, fits in (
        ({}, server >= 0),
        ({"tx_association": "c"}, server == 2),
        ({"min_value_db": -65.0}, (server >= 0) & (result.rss_dbm[server, cells] >= -65.0)),
        ({"metric": "sinr", "max_value_db": 30.0}, (server >= 0) & (result.sinr_db[server, cells] <= 30.0)),
        ({"metric": "path_gain", "min_value_db": -100.0, "max_value_db": -80.0},
         (server >= 0) & (np.abs(result.path_gain_db[server, cells] + 90.0) <= 10.0)),
        ({"min_distance_m": 9.0, "max_distance_m": 22.0},
         (server >= 0) & (np.abs(distance[cells, server] - 15.5) <= 6.5)),
    ):  # fmt: skip
        assert 0 < fits.sum() < len(cells)
        positions = result.sample_positions(20_000, **options)
        assert positions.shape == (20_000, 3)
        drawn = np.bincount(result.rx_cell_indices(positions, max_distance_m=1e-6), minlength=len(cells))
        expected = 20_000 * np.where(fits, result.cell_areas, 0.0) / result.cell_areas[fits].sum()
        assert (drawn[~fits] == 0).all()
        assert (np.abs(drawn - expected) <= 5 * np.sqrt(expected)).all()
    inside = positions[result.rx_cell_indices(positions) == int(np.argmax(drawn))]
    corners = result.surface.corners[int(np.argmax(drawn))]
    weights = np.linalg.lstsq(np.vstack([corners.T, np.ones(3)]), np.vstack([inside.T, np.ones(len(inside))]))[0]
    np.testing.assert_allclose(weights.mean(axis=1), 1 / 3, atol=0.02)  # uniform in a triangle: mean and variance
    np.testing.assert_allclose(weights.var(axis=1), 1 / 18, atol=0.004)
    again = [result.sample_positions(5, seed=seed) for seed in (7, 7, 8)]
    assert np.array_equal(again[0], again[1]) and not np.array_equal(again[0], again[2])
    assert result.sample_positions(0).shape == (0, 3)


def brute_cell(surface: MeasurementSurface, place: np.ndarray, reach: float) -> int:
    """Return the nearest cell over which a point is, by the barycentric coordinates of its foot on every triangle."""
    triangles = surface.corners.reshape(-1, 3)[surface.faces]
    edges, away = triangles[:, 1:] - triangles[:, :1], place - triangles[:, 0]
    weights = np.linalg.solve(edges @ edges.swapaxes(1, 2), (edges @ away[:, :, None]))[..., 0]
    off = np.linalg.norm(away - np.einsum("fk,fkx->fx", weights, edges), axis=1)
    over = (weights >= -1e-9).all(axis=1) & (weights.sum(axis=1) <= 1 + 1e-9) & (off <= reach)
    return int(surface.cell_of_face[np.argmin(np.where(over, off, np.inf))]) if over.any() else -1


@pytest.mark.parametrize("name", ["mesh", "plane", "upright"])
def test_cells_of_positions(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    surface = {
        "mesh": uneven(),
        "plane": plane_grid((8.0, 4.0, 1.0), (20.0, 9.0), 1.5),
        "upright": plane_grid((8.0, 4.0, 1.0), (8.0, 6.0), 1.0, UPRIGHT),
    }[name]
    rng, result = np.random.default_rng(5), random_map(surface)
    low, high = surface.corners.min(axis=(0, 1)) - 1.0, surface.corners.max(axis=(0, 1)) + 1.0
    places = np.concatenate([rng.uniform(low, high, (250, 3)), surface.center])
    for reach in (0.5, 3.0):
        expected = [brute_cell(surface, place, reach) for place in places]
        np.testing.assert_array_equal(result.rx_cell_indices(places, max_distance_m=reach), expected)
        assert 0.01 < np.mean(np.array(expected[:250]) < 0) < 0.999
        assert expected[250:] == list(range(len(surface)))
    monkeypatch.setattr("mmw.channel.radio_map.cell_points.PAIRS_AT_ONCE", 50)
    np.testing.assert_array_equal(result.rx_cell_indices(places, max_distance_m=3.0), expected)
    assert result.rx_cell_indices(surface.center[3]) == 3
    assert result.rx_cell_indices(np.zeros((0, 3))).shape == (0,)


def test_table() -> None:
    result = random_map(uneven())
    table = result.to_table()
    assert table.column_names == [field.name for field in RADIO_MAP.columns]
    assert table.num_rows == 3 * len(result.surface)
    row = table.slice(len(result.surface) + 5, 1).to_pylist()[0]
    assert (row["transmitter"], row["cell"]) == ("b", 5)
    assert [row[axis] for axis in "xyz"] == result.cell_centers[5].tolist()
    values = (row["path_gain_db"], row["rss_dbm"], row["sinr_db"], row["area_m2"])
    expected = [getattr(result, name)[1, 5] for name in ("path_gain_db", "rss_dbm", "sinr_db")]
    assert [None if value is None else value for value in values[:3]] == expected
    assert values[3] == result.cell_areas[5]
    assert table.column("sinr_db").null_count == int((result.path_gain == 0).sum()) > 3


def test_mistakes_are_named() -> None:
    result = random_map(uneven())
    nothing = RadioMap(result.transmitters, result.surface, result.config, np.zeros_like(result.path_gain))
    for call, part in (
        (lambda: result.metric_db("snr"), "metric = 'snr'; one of path_gain, rss, sinr is needed"),
        (lambda: result.cdf("rssi"), "metric = 'rssi'"),
        (lambda: result.cdf(tx="d"), "no transmitter 'd'; it has a, b, c"),
        (lambda: result.as_grid(result.path_gain), "only the cells of a plane"),
        (lambda: random_map(plane_grid((0, 0, 0), (4, 4), 1.0)).as_grid(np.zeros(5)), "needs 16 cells"),
        (lambda: result.sample_positions(-1), "count = -1"),
        (lambda: result.sample_positions(2.5), "count = 2.5"),  # pyright: ignore[reportArgumentType]
        (lambda: result.sample_positions(5, metric="power"), "metric = 'power'"),
        (lambda: result.sample_positions(5, tx_association="d"), "no transmitter 'd'"),
        (lambda: result.sample_positions(5, min_value_db=np.nan), "min_value_db = nan"),
        (lambda: result.sample_positions(5, min_value_db=500.0), "min_value_db = 500.0.*those left have"),
        (lambda: result.sample_positions(5, max_distance_m=0.1), "max_distance_m = 0.1"),
        (lambda: nothing.sample_positions(5), "none has a signal"),
        (lambda: result.rx_cell_indices([0.0, 1.0]), r"positions of shape \(2,\)"),
        (lambda: result.rx_cell_indices([[0.0, 1.0, np.nan]]), "finite numbers"),
        (lambda: result.rx_cell_indices([[0.0, 1.0, 2.0]], max_distance_m=-1.0), "max_distance_m = -1"),
        (lambda: result.plot("power"), "metric = 'power'"),
    ):
        with pytest.raises(InputError, match=part):
            call()
