"""Copies of a dataset: the measure sees which drives repeat each other, and varied start positions make fewer do."""

import re

import numpy as np
import pytest

from bench.copies import distances, main

pytestmark = pytest.mark.slow  # whoever uses mmw can do without its benchmarks


def test_distance_to_the_nearest_drive_of_another_copy() -> None:
    here, beside, away, near_it = (
        np.full((1, 4, 2), place) for place in ((0.0, 0.0), (3.0, 4.0), (0.0, 9.0), (0.0, 8.0))
    )
    copies = [np.concatenate([here, away]), beside, near_it]
    np.testing.assert_allclose(distances(copies)[:, 0], [5, 1, 5, 1])
    assert distances(copies).shape == (4, 4)


def test_varied_start_positions_make_copies_differ(capsys: pytest.CaptureFixture[str]) -> None:
    config = ["--config", "town07_crossroad", "--seeds", "2", "frames.count=100"]
    shares = []
    for changes in (
        [],
        ["scenarios.*.traffic.cav_pool=20", "scenarios.*.traffic.warmup_s={seed}"],
        ["vary={spawn: {}}"],
    ):
        main([*config, *changes])
        found = re.search(r"6 CAVs of 2 copies: (\d+) % of their frames within 3 m", capsys.readouterr().out)
        assert found
        shares.append(int(found[1]))
    assert shares[0] > 50 > shares[1] and shares[2] < 20
