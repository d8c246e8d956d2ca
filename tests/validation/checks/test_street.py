"""Models of the loss in streets at places where they are known."""

import numpy as np
import pytest

from mmw.validation.checks.street import LOS, NLOS, p1411_loss_db, umi_loss_db


def test_losses_at_100_m_and_28_ghz() -> None:
    """By hand: 42.4 + 29.2 + 30.54, 80 + 10.2 + 34.15, and 32.4 + 42 + 28.94 dB."""
    at = np.array([100.0])
    assert p1411_loss_db(at, 28e9, LOS)[0] == pytest.approx(102.14, abs=0.01)
    assert p1411_loss_db(at, 28e9, NLOS)[0] == pytest.approx(124.35, abs=0.01)
    assert umi_loss_db(at, 28e9)[0] == pytest.approx(103.34, abs=0.01)
