"""Memory of a live simulation whose frames are looked at and dropped: it holds the motion, and nothing of them."""

import gc
import tracemalloc
import weakref
from collections.abc import Iterator

import numpy as np
import pytest

import mmw
from mmw import Control
from mmw.dataset.point_cloud import PointCloud
from tests.fixtures.live_config import SENSORS, TRAFFIC

CHANGES = [
    "frames.count=60",
    "scenarios.town03_roundabout.traffic.vehicle_count=9",
    "sensors=[{type: lidar, on: [cav_1], channels: 8, points_per_channel: 60}, {type: imu}, {type: gnss}, "
    "{type: depth, on: [cav_1], width_px: 24, height_px: 16}]",
]


@pytest.fixture
def without_collector() -> Iterator[None]:
    """Turn off what frees objects that refer to each other."""
    gc.disable()
    yield
    gc.enable()


@pytest.mark.usefixtures("without_collector")
def test_a_frame_ends_with_its_last_reference() -> None:
    """Its arrays are page-locked memory of a GPU, which the next frame uses again."""
    seen: list[weakref.ref] = []
    clouds: list[PointCloud] = []  # kept ones do not keep it
    with mmw.Simulation(mmw.load_config("quickstart", CHANGES), mode="live", device="cpu") as simulation:
        for _ in range(2):
            frame = simulation.step()
            agent = frame.agents["cav_1"]
            assert len(agent.sensor("lidar")) and agent.views and frame.agents["cav_1"] is agent
            clouds.append(agent.sensor("lidar"))
            assert agent.frame == frame and agent.frame.table("lidar") is frame.table("lidar")
            frame.paths(28e9)
            seen += [weakref.ref(frame), weakref.ref(frame.data), weakref.ref(agent)]
            del frame, agent
        assert [one() for one in seen] == [None] * 6
    assert all(len(cloud.points) and np.isfinite(cloud.world).all() for cloud in clouds)


@pytest.mark.usefixtures("without_collector")
def test_steps_with_everything_leave_no_circles_of_references() -> None:
    """Recorded launches aside, whose ctypes refer to each other in Warp."""
    config = mmw.load_config("quickstart", ["frames.count=60", SENSORS, *TRAFFIC])
    with mmw.Simulation(config, mode="live", device="cpu") as simulation:
        for step in range(5):
            if step == 2:  # what the first steps make is kept
                gc.collect()
            frame = simulation.step()
            frame.trace()
            for agent in frame.agents.values():
                for sensor in config.sensors:
                    agent.samples(sensor.type)
            assert len(frame.boxes) and len(frame.paths(28e9))
        del frame, agent
        gc.set_debug(gc.DEBUG_SAVEALL)
        try:
            gc.collect()
            left = [one for one in gc.garbage if type(one).__module__.startswith(("mmw", "numpy", "pyarrow"))]
        finally:
            gc.set_debug(0)
            gc.garbage.clear()
        assert left == []


@pytest.mark.usefixtures("without_collector")
def test_the_frames_of_worlds_end_with_the_step() -> None:
    seen: list[weakref.ref] = []
    with mmw.BatchedSimulation(mmw.load_config("quickstart", CHANGES), 2, device="cpu") as simulation:
        for _ in range(2):
            frame = simulation.step()[1]
            assert simulation.present[1] is frame and len(frame.agents["cav_1"].sensor("lidar"))
            assert simulation.table("lidar").num_rows == 2 and len(simulation.paths(28e9))
            seen += [weakref.ref(frame), weakref.ref(frame.data)]
            del frame
        simulation.step()
        simulation.table("poses")
        assert [one() for one in seen] == [None] * 4


@pytest.mark.slow
def test_steps_with_random_controls_keep_the_motion_alone() -> None:
    """A pose has 7 numbers of 8 B, and an array some 100 B around it; a frame with its sweep has more than 10 kB.

    What is remembered of a scene may still grow a little: 0.5 to 1.3 kB a frame were seen beside the motion.
    """
    generator, sizes = np.random.default_rng(0), {}
    with mmw.Simulation(mmw.load_config("quickstart", CHANGES), mode="live", device="cpu") as simulation:
        simulation.reset()
        tracemalloc.start()
        for step in range(46):
            speeds = generator.uniform(0.0, 15.0, 3)
            frame = simulation.step({f"cav_{k + 1}": Control(target_speed_m_s=float(v)) for k, v in enumerate(speeds)})
            for name in ("lidar", "imu", "gnss", "depth", "boxes", "links"):
                assert frame.table(name).num_rows > 0
            values = [frame.table("imu")[axis].to_numpy() for axis in ("ax", "ay", "az", "gx", "gy", "gz")]
            assert np.isfinite(values).all() and np.isfinite(frame.boxes["vx"]).all()
            if step in (20, 45):
                gc.collect()
                sizes[step] = tracemalloc.get_traced_memory()[0]
        tracemalloc.stop()
    growth = (sizes[45] - sizes[20]) / 25
    assert growth < 2 * (9 * 7 * 8) + 3000
