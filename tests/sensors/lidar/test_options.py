"""The LiDAR section of the configuration: tables of elevations, sectors, optics, and what is refused."""

import numpy as np
import pytest
from pydantic import ValidationError

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


def test_256_channels_fit_a_ring() -> None:
    assert Lidar(channels=256).channels == 256
    with pytest.raises(ValidationError, match="256"):
        Lidar(channels=257)


def test_optics_override_the_preset() -> None:
    optics = Lidar(preset="modern64", optics={"min_power": 1e-5, "pulse_s": 3e-9}).lidar_optics()
    assert (optics.min_power, optics.pulse_s) == (1e-5, 3e-9)
    assert optics.divergence == PRESETS["modern64"].divergence
    assert Lidar().lidar_optics() == PRESETS["hdl64"]
    assert Lidar().mode == "physical" and Lidar().returns == "strongest"


@pytest.mark.parametrize(("keys", "message"), [
    ({"horizontal_fov_deg": 0}, "greater than 0"),
    ({"horizontal_fov_deg": 361}, "less than or equal to 360"),
    ({"channels": 4, "elevations_deg": (2, 0, -5)}, "holds 3 elevations and channels = 4"),
    ({"elevations_deg": ()}, "elevations_deg is empty"),
    ({"elevations_deg": (0.0,) * 257}, "at most 256 items"),
    ({"elevations_deg": (0.0, 1.0)}, "sort the table from top to bottom"),
    ({"elevations_deg": (95.0, 1.0)}, "-90 to 90 is needed"),
    ({"elevations_deg": (5.0, 1.0), "upper_fov_deg": 2.0}, "leave the two limits out"),
    ({"upper_fov_deg": -30.0}, "swap them"),
    ({"preset": "hdl128"}, "'hdl64', 'modern64', 'nir1550' or 'lisa'"),
    ({"mode": "carla"}, "'compat' or 'physical'"),
    ({"returns": "first"}, "'strongest', 'last' or 'dual'"),
    ({"points_per_channel": 0}, "greater than or equal to 1"),
    ({"range_m": -1}, "greater than 0"),
    ({"range_m": 0.9}, "no more than the nearest echo"),
    ({"detection_margin_db": -3}, "greater than or equal to 0"),
    ({"optics": {"min_power": -1}}, "min_power = -1.0"),
    ({"optics": {"divergence": -0.001}}, "divergence = -0.001"),
    ({"optics": {"overlap_full_m": 0.1}}, "overlap_full_m"),
    ({"optics": {"wavelength_nm": 1064}}, "905 or 1550"),
    ({"optics": {"nearest": 2}}, "Extra inputs"),
    ({"carla": {"noise_stddev": -0.1}}, "greater than or equal to 0"),
    ({"carla": {"dropoff_zero_intensity": 1.5}}, "less than or equal to 1"),
    ({"deskew": True}, "set rolling, or drop deskew"),
    ({"rolling": True, "scene_flow": True}, "needs deskew: true"),
    ({"mode": "compat", "returns": "dual"}, "one return a ray"),
])  # fmt: skip
def test_bad_values_are_refused(keys: dict, message: str) -> None:
    with pytest.raises(ValidationError) as caught:
        Lidar(**keys)
    assert message in str(caught.value)
