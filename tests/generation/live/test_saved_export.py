"""A live episode in the format of other tools: recordings hold what was seen, and nothing is overwritten unasked."""

import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mmw
from mmw import Control
from mmw.core.errors import InputError, MissingPackageError
from mmw.dataset.export.mcap.recording import START_NS

BRAKING = [{"cav_1": Control(acceleration_m_s2=-3.0)}, {}, {"cav_2": Control(steering_rad=0.2)}, {}, {}, {}]


@pytest.fixture(scope="module")
def live() -> Iterator[mmw.Simulation]:
    """Return a live simulation of two CAVs with a small LiDAR and an IMU, and a roadside unit."""
    lidar = "{type: lidar, on: [cav_1], channels: 4, points_per_channel: 30}"
    config = mmw.load_config("quickstart", ["frames.count=30", f"sensors=[{lidar}, {{type: imu, on: [cav_2]}}]"])
    with mmw.Simulation(config, mode="live", device="cpu") as simulation:
        yield simulation


def messages(path: Path) -> dict[str, dict[int, Any]]:
    """Return the messages of a recording by topic and frame."""
    reader, found = pytest.importorskip("mcap_ros2.reader"), defaultdict(dict)
    for one in reader.read_ros2_messages(str(path)):
        found[one.channel.topic][round((one.log_time_ns - START_NS) / 1e7)] = one.ros_msg
    return found


@pytest.mark.slow
def test_recording_holds_what_was_driven_and_seen(live: mmw.Simulation, tmp_path: Path) -> None:
    frames = [live.reset(), *(live.step(controls) for controls in BRAKING)]
    out = live.save(tmp_path / "mcap", format="mcap")
    assert out == tmp_path / "mcap" and [path.name for path in tmp_path.iterdir()] == ["mcap"]
    (path,) = out.glob("*.mcap")
    assert path.name == f"{live.scenario}_{live.weather}.mcap"
    topics = messages(path)
    assert list(topics["/tf"]) == [frame.frame for frame in frames] == list(range(1, 8))
    for frame in frames:
        row = frame.agents["cav_1"].pose
        place = topics["/cav_1/odometry"][frame.frame].pose.pose.position
        assert (place.x, place.y, place.z) == tuple(row[:3])
        cloud = topics["/cav_1/lidar/points"][frame.frame]
        points = (
            np.frombuffer(bytes(cloud.data), np.uint8).reshape(-1, cloud.point_step)[:, :12].copy().view(np.float32)
        )
        assert np.array_equal(points, frame.agents["cav_1"].sensor("lidar").points)
        ax = topics["/cav_2/imu/imu"][frame.frame].linear_acceleration.x
        assert ax == float(frame.agents["cav_2"].sensor("imu").ax)
    gains = topics["/cav_1/links/rsu_1/carrier_28ghz/gain_db"]
    seen = {
        frame.frame: link.gain_db
        for frame in frames
        for link in frame.agents["cav_1"].links
        if link.peer == "rsu_1" and link.carrier_hz == 28e9 and link.gain_db is not None
    }
    assert {frame: one.data for frame, one in gains.items()} == seen and seen

    driven = path.read_bytes()
    with pytest.raises(InputError, match=r"mcap: holds an export; give another folder, or overwrite=True"):
        live.save(out, format="mcap")
    live.reset()
    for controls in BRAKING:
        live.step(controls)
    live.save(out, format="mcap", overwrite=True)
    assert path.read_bytes() == driven, "the same controls give the same bytes"
    live.reset()
    live.step()
    live.save(out, format="mcap", overwrite=True)
    assert list(messages(path)["/tf"]) == [1, 2]


def test_what_cannot_be_saved_is_refused_before_anything_is_traced(
    live: mmw.Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    live.reset()
    with pytest.raises(InputError, match=r"save: format = 'rosbag': there are dataset, deepmimo, .*mcap.*name one"):
        live.save(tmp_path / "out", format="rosbag")
    with pytest.raises(InputError, match="written to a local folder"):
        live.save("s3://bucket/out", format="mcap")
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "one.jpg").write_bytes(b"")
    for overwrite in (False, True):
        with pytest.raises(InputError, match="photos: holds files that are no export"):
            live.save(tmp_path / "photos", format="mcap", overwrite=overwrite)
    monkeypatch.setitem(sys.modules, "mcap_ros2", None)
    with pytest.raises(MissingPackageError, match=r"mmw export mcap needs the package mcap_ros2, .*\[mcap\]"):
        live.save(tmp_path / "out", format="mcap")
    assert [path.name for path in tmp_path.rglob("*")] == ["photos", "one.jpg"]
