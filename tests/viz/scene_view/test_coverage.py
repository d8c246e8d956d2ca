"""Values of a radio map that views draw."""

import numpy as np
import pytest

from mmw.channel.radio_map.radio_map import RadioMap
from mmw.core.errors import InputError
from mmw.viz.scene_view.coverage import choose_coverage


def test_cells_have_the_values_of_their_strongest_transmitter(street_map: RadioMap) -> None:
    reached = (street_map.path_gain > 0.0).any(axis=0)
    assert 0 < (~reached).sum() < len(reached)
    power_w = street_map.path_gain * np.array([[1.0], [0.1]])
    for metric, expected in (
        ("path_gain", 10.0 * np.log10(street_map.path_gain.max(axis=0)[reached])),
        ("rss", 10.0 * np.log10(power_w.max(axis=0)[reached]) + 30.0),
        ("sinr", 10.0 * np.log10((power_w.max(axis=0) / (power_w.min(axis=0) + street_map.noise_w))[reached])),
    ):
        found = choose_coverage(street_map, metric)
        np.testing.assert_allclose(found.values, expected)
        low, top = found.limits
        assert top == found.values.max() and (found.values < low).mean() == pytest.approx(0.02, abs=0.02)
        assert found.colors.shape == (len(expected), 3)


def test_triangles_cover_the_cells_that_are_reached(street_map: RadioMap) -> None:
    found = choose_coverage(street_map, "rss")
    reached = np.flatnonzero((street_map.path_gain > 0.0).any(axis=0))
    np.testing.assert_array_equal(found.cell, np.repeat(np.arange(len(reached)), 2))
    middle = street_map.surface.corners.mean(axis=1)[reached][found.cell]
    assert (np.abs(found.triangles - middle[:, None]) <= 2.0 + 1e-9).all()  # cells of 4 m


def test_a_metric_that_is_none_is_named(street_map: RadioMap) -> None:
    with pytest.raises(InputError, match="metric = 'joy'; one of path_gain, rss, sinr"):
        choose_coverage(street_map, "joy")
