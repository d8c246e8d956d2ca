"""Links that buildings block, in a shipped town."""

import numpy as np
import pytest

from mmw.validation.blocked_links import REACH_M, blocked_links


@pytest.mark.slow
def test_links_behind_buildings_lose_more_than_free_space(device: str) -> None:
    distance, loss, share = blocked_links("town03_five_way", 28e9, device)
    assert len(distance) > 20
    assert distance.min() > REACH_M[0] and distance.max() < REACH_M[1] + 2.0  # both antennas differ in height
    heard = np.isfinite(loss)
    free = 20.0 * np.log10(4.0 * np.pi * distance * 28e9 / 299792458.0)
    assert (loss[heard] > free[heard] - 3.0).all()
    assert ((share[heard] >= 0.0) & (share[heard] <= 1.0)).all()
    assert np.isnan(share[~heard]).all()
