"""Rows of tables: link statistics against their definitions, clock times, signs and frames of the columns."""

from dataclasses import replace

import numpy as np
import pytest

from mmw.channel.rows import link_rows
from mmw.config import ChannelConfig
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.kinematics import differentiate
from mmw.core.transforms import conjugate, pose_from_ypr, rotate
from mmw.scene.rows import frame_rows, pose_rows
from mmw.scene.scene_data import SceneData
from tests.fixtures.antennas import antenna_at
from tests.fixtures.scenes import arrays_from_parts, pose, two_cars, wall_part
from tests.oracles.channel import link_scene, solve
from tests.oracles.path_rows import path_rows


def agents_of(arrays: SceneData) -> list[str]:
    return [actor.name for actor in arrays.actors]


def test_times_are_the_nearest_numbers_to_their_decimals() -> None:
    arrays = two_cars(100)
    assert frame_rows(arrays, range(100), 1)["time_s"].tolist() == [float(f"0.{k:02d}") for k in range(100)]


def test_link_statistics_are_those_of_their_paths() -> None:
    arrays = two_cars(3)
    config = ChannelConfig(candidates="exhaustive", links=("v2i",))
    links, paths = solve(arrays, config, "cpu", [1, 2])
    rows = link_rows(agents_of(arrays), ("antenna",), ("v2i",), links, paths, "sunny")
    each = path_rows(agents_of(arrays), links, paths, "sunny")
    assert rows["carrier"].tolist() == [0, 1, 0, 1]
    assert rows["frame"].tolist() == [1, 1, 2, 2] and rows["carrier_hz"].tolist() == [28e9, 4.9e9] * 2
    for k in range(4):
        own = (each["frame"] == rows["frame"][k]) & (each["carrier_hz"] == rows["carrier_hz"][k])
        power = each["a_re"][own] ** 2 + each["a_im"][own] ** 2
        assert rows["path_count"][k] == own.sum() > 2
        assert rows["is_los"][k] == ("los" in each["kind"].to_array()[own])
        assert rows["gain_db"][k].as_py() == pytest.approx(10.0 * np.log10(power.sum()), abs=1e-9)
        for column, mean, spread in (("tau_s", "mean_delay_s", "rms_delay_s"), ("doppler_hz", "", "doppler_spread_hz")):
            values = each[column][own]
            average = np.average(values, weights=power)
            if mean:
                assert rows[mean][k].as_py() == pytest.approx(average, rel=1e-12)
            second = np.average(values**2, weights=power) - average**2
            assert rows[spread][k].as_py() == pytest.approx(np.sqrt(second), rel=1e-3)


def test_link_without_power_has_no_statistics() -> None:
    arrays = link_scene([wall_part("wall", (0.0, -500.0), (0.0, 500.0), 300.0)], (-10, 0), (10, 0))
    solved = solve(arrays, ChannelConfig(candidates="exhaustive"), "cpu")
    rows = link_rows(agents_of(arrays), ("antenna",), ("v2i",), *solved, "sunny")
    assert rows["path_count"].tolist() == [0, 0] and rows["is_los"].tolist() == [False, False]
    for name in ("gain_db", "mean_delay_s", "rms_delay_s", "doppler_spread_hz"):
        assert rows[name].null_count == 2


def test_angles_and_doppler_of_the_line_of_sight() -> None:
    """A CAV that drives east, away from a roadside unit in its south-west: the shift is negative."""
    poses = np.array([[pose(0, 0), pose(30 + 0.2 * k, 30)] for k in range(5)])
    arrays = arrays_from_parts([], actors=[("rsu_1", "rsu", -1), ("cav_1", "cav", -1)], poses=poses)
    config = ChannelConfig(max_depth=0, antennas=antenna_at({"cav": (0, 0, 1.5), "rsu": (0, 0, 5.0)}))
    rows = path_rows(agents_of(arrays), *solve(arrays, config, "cpu", [2]), "sunny")
    away = np.array([30.4, 30.0, -3.5])
    length = np.linalg.norm(away)
    np.testing.assert_allclose(rows["tau_s"], length / SPEED_OF_LIGHT, rtol=1e-14)
    np.testing.assert_allclose(rows["doppler_hz"], -20.0 * away[0] / length / SPEED_OF_LIGHT * rows["carrier_hz"])
    np.testing.assert_allclose(rows["aod_az"], np.arctan2(30.0, 30.4))
    np.testing.assert_allclose(rows["aod_ze"], np.arccos(-3.5 / length))
    np.testing.assert_allclose(rows["aoa_az"], np.arctan2(-30.0, -30.4))
    np.testing.assert_allclose(rows["aoa_ze"], np.arccos(3.5 / length))


def test_angular_velocity_is_in_the_agents_frame_and_velocity_in_the_worlds() -> None:
    """A nose that goes down while it points north: +y in the agent's frame, -x in the world's."""
    t = 0.01 * np.arange(9)
    moving = pose_from_ypr(np.stack([0 * t, 10 * t, 0 * t], axis=1), np.pi / 2, 0.3 * t)
    arrays = replace(two_cars(9), poses=two_cars(9).poses.copy())
    arrays.poses[:, 0] = moving
    motion = differentiate(arrays.poses)
    rows = pose_rows(arrays, [4], motion)
    np.testing.assert_allclose([rows[name][0] for name in ("vx", "vy", "vz")], [0, 10, 0], atol=1e-9)
    rate = [rows[name][0] for name in ("wx", "wy", "wz")]
    np.testing.assert_allclose(rate, [0, 0.3, 0], atol=1e-9)
    np.testing.assert_allclose(motion.world_rate[4, 0], [-0.3, 0, 0], atol=1e-9)
    np.testing.assert_allclose(rotate(conjugate(moving[4, 3:]), motion.world_rate[4, 0]), rate, atol=1e-12)
