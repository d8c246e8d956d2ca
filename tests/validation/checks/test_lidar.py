"""The rows of LiDAR in fog: what was read off the chambers fits together, and another receiver turns rows red."""

import numpy as np
import pytest

from mmw.sensors import Lidar
from mmw.validation import run_checks
from mmw.validation.checks import lidar


def test_half_of_the_rays_lies_between_the_published_shares() -> None:
    visibility, share = zip(*sorted(lidar.CHAMBER_ECHO_SHARE.items()), strict=True)
    assert np.interp(-0.5, -np.array(share), visibility) == pytest.approx(lidar.HALF_M, abs=0.1)
    for points in lidar.CHAMBER_FARTHEST_M.values():
        assert (np.diff([points[value] for value in sorted(points)]) > 0.0).all()
    bright, dark = (lidar.CHAMBER_FARTHEST_M[reflectance] for reflectance in (0.9, 0.1))
    assert all(dark[value] < bright[value] for value in set(bright) & set(dark))


@pytest.mark.parametrize(
    ("optics", "red"),
    [
        ({"overlap_full_m": 1.0, "overlap_exponent": 1.0}, {"lidar.fog_hdl64", "lidar.plate_90_fog_40m"}),
        ({"overlap_full_m": 40.0}, {"lidar.fog_echo_share"}),
        ({"min_power": 0.1 / 10**2}, {"lidar.fog_hdl64", "lidar.plate_10_fog_60m"}),
    ],
    ids=["near", "far", "blunt"],
)
def test_rows_turn_red_with_another_receiver(optics: dict, red: set[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lidar, "CHAMBER", Lidar(detection="absolute", optics=optics))
    checks = [check for check in lidar.CHECKS if check.name in red]
    assert len(checks) == len(red)
    assert not any(result.is_green for result in run_checks(checks, "cpu"))
