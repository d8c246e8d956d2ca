"""Poses of traffic at any rate: those of the engine at its own instants, smooth between them."""

import numpy as np
import pytest

from mmw.core.frame_rate import FRAME_RATES, base_frames, instants, pose_stride
from mmw.core.kinematics import differentiate
from mmw.core.transforms import quaternion_from_ypr
from mmw.traffic.demand import VehicleTrack
from mmw.traffic.engine import simulate_traffic
from mmw.traffic.frame_poses import poses_between, sample_tracks
from tests.fixtures.traffic_towns import crossroad, demand

SECONDS = 1.2


def drive(time: np.ndarray) -> np.ndarray:
    """Return a drive with speeds, bends and jerks of traffic, at any times, shape [N, 7]."""
    x, y = 400.0 + 9.0 * time + 0.8 * np.sin(1.7 * time), -200.0 + 3.0 * np.sin(0.9 * time)
    yaw, pitch = 0.6 * np.sin(0.9 * time), 0.02 * np.cos(2.0 * time)
    turns = [quaternion_from_ypr(*angles) for angles in zip(yaw, pitch, 0 * yaw, strict=True)]
    return np.column_stack([x, y, 0.1 * np.cos(time), np.array(turns)])


def at_rate(track: VehicleTrack, rate: int) -> np.ndarray:
    (found,) = sample_tracks([track], round(SECONDS * rate) + 1, rate)
    return found.poses


@pytest.fixture(scope="module")
def engine() -> list[VehicleTrack]:
    """Return vehicles of the IDM engine at 100 Hz."""
    return simulate_traffic(demand(crossroad(), frame_count=base_frames(121, 100), vehicle_count=4)).tracks


@pytest.mark.parametrize("rate", FRAME_RATES)
def test_one_time_is_one_pose_at_every_rate(engine: list[VehicleTrack], rate: int) -> None:
    """The traffic of 1.2 s is made from the same demand at every rate, and its poses agree to the bit."""
    frame_count = int(SECONDS * rate) + 1
    if SECONDS * rate == int(SECONDS * rate):
        assert base_frames(frame_count, rate) == 121
    fine = sample_tracks(engine, 1201, 1000)
    own = sample_tracks(engine, frame_count, rate)
    step = 1000 // (rate * pose_stride(rate))
    for track, all_, base in zip(own, fine, engine, strict=True):
        rows = np.arange(len(track.poses)) * step
        assert np.array_equal(track.poses, all_.poses[rows])
        whole = rows % 10 == 0
        assert whole.any() and np.array_equal(track.poses[whole], base.poses[rows[whole] // 10])
        if all_.waits is not None and base.waits is not None:
            assert np.array_equal(track.waits, base.waits[rows // 10])


def test_positions_between_frames_are_those_of_the_motion() -> None:
    track = VehicleTrack("a", "vehicle", "sedan", "red", drive(np.arange(121) / 100))
    time = np.arange(1201) / 1000
    poses, true = at_rate(track, 1000), drive(time)
    assert np.abs(poses - true)[30:-30].max() < 1e-9 and np.abs(poses - true).max() < 1e-6


def test_velocity_and_acceleration_have_no_steps() -> None:
    track = VehicleTrack("a", "vehicle", "sedan", "red", drive(np.arange(121) / 100))
    motion = differentiate(at_rate(track, 1000), 1e-3)
    time = np.arange(1201) / 1000
    true = np.column_stack([-0.8 * 1.7**2 * np.sin(1.7 * time), -3.0 * 0.9**2 * np.sin(0.9 * time)])
    assert np.abs(motion.acceleration[30:-30, :2] - true[30:-30]).max() < 1e-3
    assert np.abs(np.diff(motion.acceleration[30:-30, :2], axis=0)).max() < 0.01


def test_a_vehicle_at_rest_stays_exactly_at_rest() -> None:
    still = np.tile(drive(np.array([0.3]))[0], (121, 1))
    poses = at_rate(VehicleTrack("a", "vehicle", "sedan", "red", still), 1000)
    assert (poses[:, :3] == still[0, :3]).all() and np.abs(poses - still[0]).max() < 1e-15


def test_absence_ends_with_the_frame_of_the_engine() -> None:
    poses = drive(np.arange(121) / 100)
    poses[:20], poses[60:80] = np.nan, np.nan
    found = at_rate(VehicleTrack("a", "vehicle", "sedan", "red", poses), 1000)
    here = np.isfinite(found).all(axis=1)
    time = np.arange(1201)
    assert np.array_equal(here, ((time >= 200) & (time <= 590)) | (time >= 800))
    assert np.abs(found - drive(time / 1000))[here].max() < 1e-5


def test_short_stays_and_flipped_quaternions() -> None:
    poses = drive(np.arange(3) / 100)
    poses[1, 3:] *= -1.0
    base, part = instants(np.arange(21), 1000)
    found = poses_between(poses, base, part / 10)
    assert np.abs(np.linalg.norm(found[:, 3:], axis=1) - 1.0).max() < 1e-12
    alone = np.full((3, 7), np.nan)
    alone[1] = poses[1]
    assert np.isfinite(poses_between(alone, base, part / 10)).all(axis=1).nonzero()[0].tolist() == [10]
