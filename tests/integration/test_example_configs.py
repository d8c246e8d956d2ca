"""Examples of configurations do what they say, in small."""

from pathlib import Path

import numpy as np
import pytest

from mmw.cli.run import main
from mmw.core.transforms import invert, transform_points
from mmw.dataset import open_dataset
from mmw.generation.verification.completeness import check_plan, read_plan
from mmw.storage.store import store_of

pytestmark = pytest.mark.slow


def made(name: str, folder: Path, *changes: str) -> Path:
    """Run one frame of an example and return its dataset."""
    assert main(["--config", name, "frames.count=1", *changes, "--out", str(folder / name), "--device", "cpu"]) == 0
    store = store_of(folder / name)
    config, findings = read_plan(store)
    assert config is not None and not findings and not check_plan(store, config)
    return folder / name


def test_wet_brick_town(tmp_path: Path) -> None:
    root = made("wet_brick_town", tmp_path, "channel.diffuse_samples=100", "sensors=[]")
    data = open_dataset(root)
    names = {name for row in data.read("objects", columns=["label", "materials"]).to_pylist()
             if row["label"] == "building" for name in row["materials"]}  # fmt: skip
    rows = [row for row in data.read("materials").to_pylist() if row["name"] in names and row["scattering"] == 0.3]
    assert {row["weather"] for row in rows} == {"sunny", "rainy"}
    for row in rows:
        assert row["thickness"] == 0.2 and row["scattering_pattern"] == "directive"
        assert (row["model"], row["relative_permittivity"]) == (
            ("itu", 1.0) if row["weather"] == "sunny" else ("constant", 6.0)
        )
    kinds = {row["kind"] for row in data.read("paths", columns=["kind"]).to_pylist()}
    assert "diffuse" in kinds
    assert "finds nothing" not in (root / "README.md").read_text()


def test_street_140ghz(tmp_path: Path) -> None:
    root = made("street_140ghz", tmp_path, "channel.samples_per_tx=100_000")
    links = open_dataset(root).read("links").to_pylist()
    gains = {ghz: [row["gain_db"] for row in links if row["carrier_hz"] == ghz * 1e9] for ghz in (28, 60, 140)}
    assert all(len(values) == 4 for values in gains.values())  # two CAVs in two weathers
    best = {ghz: max(value for value in values if value is not None) for ghz, values in gains.items()}
    assert best[28] > best[60] > best[140]
    card = (root / "README.md").read_text()
    assert "at 140 GHz: extrapolated from 29.5 GHz with the exponents of its last row" in card
    assert "(itu_brick) at 60 GHz: interpolated between 40 and 110 GHz" in card
    assert "28 GHz:" not in card


def test_gnss_multipath(tmp_path: Path) -> None:
    data = open_dataset(made("gnss_multipath", tmp_path))
    rows = data.read("gnss_satellites").to_pylist()
    assert {row["agent"] for row in rows} == {"cav_1", "cav_2", "cav_3"}
    assert {row["is_los"] for row in rows} == {True, False}
    fixes = data.read("gnss").to_pylist()
    assert sum(row["sensor"] == "gnss_open" for row in fixes) == 3
    tracked = [row["agent"] for row in rows if row["is_tracked"]]
    assert all(tracked.count(row["agent"]) >= 4 for row in fixes if row["sensor"] == "gnss")


def test_sectors_60ghz(tmp_path: Path) -> None:
    """Each sector has links; the strongest is that which looks at the vehicle, and a downlink is as strong as its
    uplink."""
    data = open_dataset(made("sectors_60ghz", tmp_path, "channel.samples_per_tx=50_000", "weathers=[sunny]"))
    sectors = {f"sector_{number}" for number in (1, 2, 3)}
    rows = data.read("links").to_pylist()
    down = [row for row in rows if row["link"] == "v2i"]
    assert {(row["peer"], row["peer_antenna"], row["agent"], row["antenna"]) for row in down} == {
        ("rsu_1", sector, cav, "roof") for sector in sectors for cav in ("cav_1", "cav_2")
    }
    up = {row["peer"]: row for row in rows if row["link"] == "uplink"}
    assert {(row["agent"], row["antenna"]) for row in up.values()} == {("rsu_1", "sector_1")} and len(up) == 2
    for row in down:
        if row["peer_antenna"] == "sector_1":
            assert abs(row["gain_db"] - up[row["agent"]]["gain_db"]) < 1e-6
    mounts = {row["sensor"]: row for row in data.read("sensors").to_pylist() if row["agent"] == "rsu_1"}
    assert sectors <= set(mounts) and mounts["sector_2"]["qz"] == pytest.approx(0.866, abs=0.01)
    frame = data.frame("sectors_60ghz", "sunny", 0)
    for cav in ("cav_1", "cav_2"):
        gains = {row["peer_antenna"]: row["gain_db"] for row in down if row["agent"] == cav}
        target = frame.agents[cav].sensor_pose("roof")[:3]
        unit = frame.agents["rsu_1"]
        ahead = {name: transform_points(invert(unit.sensor_pose(name)), target) for name in sectors}
        assert max(gains, key=gains.__getitem__) == max(
            sectors, key=lambda name: ahead[name][0] / np.linalg.norm(ahead[name])
        )


def test_v2v_only(tmp_path: Path) -> None:
    data = open_dataset(made("v2v_only", tmp_path, "channel.samples_per_tx=20_000"))
    cavs = {f"cav_{number}" for number in (1, 2, 3, 4)}
    pairs = [(row["agent"], row["peer"]) for row in data.read("links").to_pylist()]
    assert sorted(pairs) == sorted((one, other) for one in cavs for other in cavs if one != other)
    assert {row["agent"] for row in data.read("poses").to_pylist()} == cavs
    assert {row["agent"] for row in data.read("lidar").to_pylist()} == cavs


def test_bus_and_truck(tmp_path: Path) -> None:
    data = open_dataset(made("bus_and_truck", tmp_path))
    rows = {(row["agent"], row["sensor"]): row for row in data.read("sensors").to_pylist()}
    heights = {agent: rows[agent, "lidar"]["z"] for agent in ("cav_1", "cav_2", "cav_3", "rsu_1")}
    assert heights == {"cav_1": 3.6, "cav_2": 4.0, "cav_3": 2.5, "rsu_1": 4.0}
    assert {agent: rows[agent, "antenna"]["z"] for agent in heights} == heights
    assert [key for key in rows if key[1] == "rear"] == [("cav_1", "rear")]
    assert {row["agent"] for row in data.read("rgb").to_pylist()} == {"cav_1"}
    boxes = {row["object_id"]: row for row in data.read("boxes").to_pylist()}
    bus, truck, car = (
        boxes[row["object_id"]]["height"]
        for row in sorted(data.read("poses").to_pylist(), key=lambda row: row["agent"])
        if row["agent"].startswith("cav")
    )
    assert bus > 2.8 and truck > 2.8 and car < 2.5


def test_pedestrian_with_phone(tmp_path: Path) -> None:
    data = open_dataset(made("pedestrian_with_phone", tmp_path))
    (frame,) = data.read("frames").to_pylist()
    counts = {name: frame[f"{name}_count"] for name in ("cav", "rsu", "vru", "uav", "bs", "pedestrian")}
    assert counts == {"cav": 1, "rsu": 1, "vru": 3, "uav": 0, "bs": 1, "pedestrian": 12}
    poses = {row["agent"]: row for row in data.read("poses").to_pylist()}
    assert {name: row["role"] for name, row in poses.items()} == {
        "cav_1": "cav", "rsu_1": "rsu", "bs_1": "bs", "vru_1": "vru", "vru_2": "vru", "vru_3": "vru",
    }  # fmt: skip
    assert poses["bs_1"]["z"] > 10.0  # on a roof
    boxes = {row["agent"]: row["category"] for row in data.read("boxes").to_pylist() if row["agent"]}
    assert boxes == {"cav_1": "car", "vru_1": "pedestrian", "vru_2": "pedestrian", "vru_3": "bicycle"}
    for table in ("imu", "gnss"):
        assert {row["agent"] for row in data.read(table, columns=["agent"]).to_pylist()} == {"vru_1", "vru_2", "vru_3"}
    links = {(row["link"], row["peer"], row["agent"]): row for row in data.read("links").to_pylist()}
    phones = ("vru_1", "vru_2", "vru_3")
    wanted = {(link, peer, phone) for link, peer in (("i2p", "rsu_1"), ("v2p", "cav_1"), ("downlink", "bs_1"))
              for phone in phones}  # fmt: skip
    assert set(links) == wanted | {("d2d", one, other) for one in phones for other in phones if one != other}
    assert any(row["is_los"] for row in links.values()) and any(row["path_count"] for row in links.values())
    assert all(
        row["is_los"] is not None for row in data.read("box_visibility").to_pylist() if row["sensor"] == "antenna"
    )


def test_drone(tmp_path: Path) -> None:
    data = open_dataset(made("drone", tmp_path, "frames.start=15"))
    (pose,) = [row for row in data.read("poses").to_pylist() if row["role"] == "uav"]
    assert pose["agent"] == "uav_1" and 15.0 < pose["z"] < 25.0
    assert np.hypot(pose["vx"], pose["vy"]) > 2.0 and abs(pose["qx"]) + abs(pose["qy"]) > 0.01  # it flies, tilted
    cloud = data.frame("drone", "sunny", 15).agents["uav_1"].sweeps["lidar"]
    assert len(cloud) > 10_000 and np.median(cloud.world[:, 2]) < 1.0  # the street below
    (box,) = [row for row in data.read("boxes").to_pylist() if row["agent"] == "uav_1"]
    assert box["category"] == "dynamic" and box["length"] < 0.6
    assert {row["agent"] for row in data.read("rgb", columns=["agent"]).to_pylist()} == {"uav_1"}
    for row in data.read("links").to_pylist():
        assert (row["link"], row["peer"], row["agent"], row["is_los"]) == ("a2g", "rsu_1", "uav_1", True)
