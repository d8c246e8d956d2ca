"""The LiDAR section of the configuration: tables of elevations, sectors, optics, and what is refused."""

import numpy as np
import pytest

from mmw.sensors import Lidar
from mmw.sensors.lidar.optics import PRESETS
from mmw.sensors.lidar.scan_pattern import lidar_pattern


def test_table_of_elevations_is_the_pattern() -> None:
    table = (15.0, 1.0, 0.0, -0.5, -25.0)
    config = Lidar(elevations_deg=table, points_per_channel=12)
    assert (config.channels, config.upper_fov_deg, config.lower_fov_deg) == (5, 15.0, -25.0)
    elevation = np.degrees(np.arcsin(lidar_pattern(config)[:, 2]))
    np.testing.assert_allclose(elevation, np.repeat(table, 12), atol=1e-6)
    again = Lidar(**config.model_dump())
    assert again == config


def test_sector_is_about_forward() -> None:
    pattern = lidar_pattern(Lidar(horizontal_fov_deg=120.0, points_per_channel=60))
    azimuth = np.degrees(np.arctan2(pattern[:, 1], pattern[:, 0]))
    assert azimuth.max() == pytest.approx(60.0) and azimuth.min() == pytest.approx(-58.0)


def test_optics_override_the_preset() -> None:
    optics = Lidar(preset="modern64", optics={"min_power": 1e-5, "pulse_s": 3e-9}).lidar_optics()
    assert (optics.min_power, optics.pulse_s) == (1e-5, 3e-9)
    assert optics.divergence == PRESETS["modern64"].divergence
    assert Lidar().lidar_optics() == PRESETS["hdl64"]
    assert Lidar().mode == "physical" and Lidar().returns == "strongest"
