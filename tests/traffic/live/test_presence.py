"""Actors that leave live traffic and come back: others do not see them while they are away."""

from dataclasses import replace

import numpy as np
import pytest

from mmw.core.constants import FRAME_DT
from mmw.core.errors import InputError
from mmw.core.kinematics import differentiate
from mmw.traffic.live.control import Control
from mmw.traffic.live.live_traffic import LiveTraffic
from mmw.traffic.live.presence import STILL_ROWS
from tests.fixtures.sumo_installed import needs_sumo
from tests.fixtures.traffic_measures import min_gap
from tests.fixtures.traffic_towns import CATALOG, demand, oval

RING = oval()


def on_ring(**options) -> LiveTraffic:
    """Return live traffic of sedans on a circuit, without changes of lanes."""
    sedans = {"sedan": CATALOG["sedan"]}
    defaults = {"vehicle_count": 8, "cav_ranks": (0, 1, 2), "frame_count": 2600, "lane_changes": False}
    return LiveTraffic(demand(RING, catalog=sedans, **(defaults | options)))


def travelled(traffic: LiveTraffic, rows: int) -> np.ndarray:
    """Go on by some rows; return the distance that each actor travels in them, NaN where it is absent [m]."""
    traffic.advance(traffic.rows + rows)
    places = traffic.poses[-rows:, :, :2]
    return np.linalg.norm(np.diff(places, axis=0), axis=2).sum(axis=0)


@pytest.mark.parametrize("engine", ["idm", pytest.param("sumo", marks=needs_sumo)])
def test_others_stand_behind_an_actor_and_drive_on_when_it_is_removed(engine):
    traffic = on_ring(engine=engine)
    traffic.advance(200)
    traffic.command({"cav_1": Control(acceleration_m_s2=-6.0)})
    traffic.advance(1400)
    waiting = travelled(traffic, 50) < 0.01
    assert waiting.sum() >= 2, "a queue"
    place = traffic.poses[-1, 0].copy()
    traffic.remove("cav_1")
    driven = travelled(traffic, 600)
    column = traffic.names.index("cav_1")
    assert np.isnan(traffic.poses[-600:, column]).all() and np.isfinite(traffic.poses[-601]).all()
    assert np.nanmin(driven) > 5.0, "nobody waits any more"
    nearest = np.nanmin(np.linalg.norm(traffic.poses[-600:, 1:, :2] - place[:2], axis=2))
    assert nearest < 1.5, "others pass through its place"
    traffic.close()


@pytest.mark.parametrize("engine", ["idm", pytest.param("sumo", marks=needs_sumo)])
def test_added_actor_stands_where_it_was_put_and_others_stop_for_it(engine):
    traffic = on_ring(engine=engine)
    traffic.advance(200)
    place = traffic.poses[-1, 0].copy()
    traffic.remove("cav_1")
    traffic.advance(700)
    place[0] += 170.0  # ahead of all that drive there
    traffic.add("cav_1", place.tolist())
    traffic.command({"cav_1": Control(pose=place + np.array([1.0, 0, 0, 0, 0, 0, 0]))})
    traffic.advance(2550)
    own = traffic.poses[700:, 0]
    assert (own[:STILL_ROWS] == own[0]).all() and own[0, :3].tolist() == place[:3].tolist()
    assert own[STILL_ROWS, 0] == place[0] + 1.0 and (own[STILL_ROWS:] == own[-1]).all()
    assert (travelled(traffic, 50)[1:] < 0.01).sum() >= 1, "somebody waits behind it"
    assert min_gap([replace(track, poses=track.poses[-20:]) for track in traffic.tracks], CATALOG) > 0.5
    motion = differentiate(traffic.poses[698:703])
    for values in (motion.velocity, motion.acceleration, motion.body_rate):
        assert (values[2, 0] == 0.0).all() and np.isnan(values[1, 0]).all()
    traffic.close()


def test_added_vehicle_can_be_steered_removed_and_added_again():
    traffic = on_ring(vehicle_count=3)
    traffic.advance(200)
    place = traffic.poses[-1, 0].copy()
    traffic.remove("cav_1")
    traffic.advance(210)
    traffic.add("cav_1", [*place[:3], 0.0])
    traffic.command({"cav_1": Control(steering_rad=0.0, acceleration_m_s2=2.0)})
    traffic.advance(310)
    # From rest with a jerk of 5 m/s^3 up to 2 m/s^2 in 0.4 s, after four rows.
    time = 0.96
    expected = 2.0 * time**2 / 2 - 2.0 * 0.4 * time / 2 + 2.0 * 0.4**2 / 6
    assert traffic.poses[-1, 0, 0] - place[0] == pytest.approx(expected, abs=2.0 * time * FRAME_DT)
    with pytest.raises(InputError, match="has left its route"):
        traffic.command({"cav_1": Control(target_speed_m_s=3.0)})
    traffic.remove("cav_1")
    traffic.advance(311)
    traffic.add("cav_1", place.tolist())
    traffic.advance(320)
    assert np.isnan(traffic.poses[310, 0]).all() and np.array_equal(traffic.poses[311, 0, :3], place[:3])


def test_wrong_calls_change_nothing():
    traffic, plain = on_ring(frame_count=400), on_ring(frame_count=400)
    traffic.advance(100)
    for call, text in (
        (lambda: traffic.remove("cav_9"), r"remove 'cav_9': there is no such actor; there are cav_1, .*; name one"),
        (lambda: traffic.add("cav_9", [0, 0, 0, 0]), r"add 'cav_9': there is no such actor"),
        (lambda: traffic.add("cav_1", [0, 0, 0, 0]), r"add 'cav_1': is there already; remove it first"),
        (lambda: traffic.add("cav_1", [0, 0, np.nan, 0]), r"add 'cav_1': pose = .*four x, y, z, yaw, are needed"),
    ):
        with pytest.raises(InputError, match=text):
            call()
    traffic.advance(400)
    plain.advance(400)
    assert traffic.poses.tobytes() == plain.poses.tobytes()


def test_absent_actor_obeys_nothing_and_is_added_a_row_later_at_the_earliest():
    traffic, plain = on_ring(frame_count=400), on_ring(frame_count=400)
    for one in (traffic, plain):
        one.advance(100)
        one.remove("cav_2")
    for call, text in (
        (lambda: traffic.remove("cav_2"), "is absent already; add it first"),
        (lambda: traffic.command({"cav_1": Control(pose=[0, 0, 0, 0]), "cav_2": None}), "is absent; add it first"),
        (lambda: traffic.add("cav_2", [0, 0, 0, 0]), "has just been removed .*; step first"),
    ):
        with pytest.raises(InputError, match=text):
            call()
    for one in (traffic, plain):
        one.advance(101)
    with pytest.raises(InputError, match="seven finite numbers"):
        traffic.add("cav_2", [0, 0, 0, np.inf])
    traffic.advance(400)
    plain.advance(400)
    assert traffic.poses.tobytes() == plain.poses.tobytes()
