"""A radar from its configuration to rows: what it detects of traced targets, its maps and its samples."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mmw.config import Config, load_config
from mmw.scene.scene_data import SceneData
from mmw.sensors.radar.capture import capture_radar
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.radar_scenes import watched
from tests.fixtures.scenes import quad_part, two_cars
from tests.fixtures.sensor_runs import captured

RADAR = """
scenarios: [{name: street, town: town03, traffic: {vehicle_count: 3, spawn_center_m: [0, 0, 0], cav_ranks: [1]}}]
weathers: [sunny, heavy_rain]
channel: {enabled: false}
sensors:
  - {type: radar, horizontal_fov_deg: 40, vertical_fov_deg: 10, range_m: 40, azimuth_rays: 120, elevation_rays: 60,
     azimuth_antennas: 8, elevation_antennas: 2, frame_time_s: 320.0e-6, false_alarm_probability: 1.0e-9,
     maps: [range_azimuth, range_doppler], iq: true, mount: {rsu: {position_m: [0, 0, 0]}}}
"""


@pytest.fixture
def config(tmp_path: Path) -> Config:
    (tmp_path / "c.yaml").write_text(RADAR)
    return load_config(tmp_path / "c.yaml")


def plate(name: str, x: float, y: float) -> MeshPart:
    """Return a plate of 0.8 m that faces a radar at the origin."""
    corners = [(x, y - 0.4, -0.4), (x, y - 0.4, 0.4), (x, y + 0.4, 0.4), (x, y + 0.4, -0.4)]
    return quad_part(f"Props/{name}", corners, "metal_pole", "static")


def two_plates(apart: float, frames: int = 1) -> SceneData:
    """Return two plates side by side, 20 m and a bit more ahead."""
    parts = [plate("near", 20.0, -0.5), plate("far", 20.0 + apart, 0.5)]
    return watched(parts, poses=np.zeros((frames, 0, 7)), weathers=("sunny", "heavy_rain"))


def record(config: Config, arrays: SceneData, device: str, batches: list[list[int]], weathers: list[str]) -> dict:
    """Return (weather, table) -> rows of the radar's tables."""
    found = captured(capture_radar, config, arrays, device, batches, weathers)
    return {
        (weather, name): table.to_pylist()
        for weather, tables in found.items()
        for name, table in tables.items()
        if name.startswith("radar")
    }


@pytest.mark.parametrize(("apart", "expected"), [(0.3, 1), (0.7, 2)])
def test_traced_targets_resolve_in_range(device, config, apart, expected):
    """A cell is 0.5 m; the plates share a cell on the other axes."""
    rows = record(config, two_plates(apart), device, [[0]], ["sunny"])["sunny", "radar"]
    assert rows[0]["label"] == [0] * expected
    near, far = 20.0, 20.0 + apart
    if expected == 2:
        assert rows[0]["range"] == pytest.approx([near, far], abs=0.1)
        assert len(set(rows[0]["object_id"])) == 2
    else:
        assert near - 0.1 < rows[0]["range"][0] < far + 0.1
    assert np.abs(rows[0]["velocity"]).max() < 3.0


def test_maps_and_samples_show_the_targets_of_the_detections(device, config):
    found = record(config, two_plates(3.0), device, [[0]], ["sunny"])
    detections = found["sunny", "radar"][0]
    strongest = int(np.argmax(detections["power_db"]))
    for row in found["sunny", "radar_maps"]:
        values = np.array(row["values"]).reshape(row["rows"], row["columns"])
        peak, _ = np.unravel_index(values.argmax(), values.shape)
        assert row["row_first"] + peak * row["row_step"] == pytest.approx(detections["range"][strongest], abs=0.3)
        assert values.max() == pytest.approx(detections["power_db"][strongest], abs=3.1)  # between cells on two axes
    (row,) = found["sunny", "radar_iq"]
    samples = (np.array(row["i"]) + 1j * np.array(row["q"])).reshape(row["antennas"], row["chirps"], row["samples"])
    profile = np.abs(np.fft.fft(samples.sum(axis=(0, 1)))) ** 2
    peaks = np.flatnonzero((profile > np.roll(profile, 1)) & (profile > np.roll(profile, -1)))
    seen = np.sort(peaks[np.argsort(profile[peaks])[-2:]]) * config.sensors[0].range_resolution
    assert seen == pytest.approx([20.0, 23.0], abs=0.3)


def test_batches_and_weathers_do_not_matter(device, config):
    arrays = two_plates(3.0, 3)
    together = record(config, arrays, device, [[0, 1, 2]], ["sunny", "heavy_rain"])
    apart = record(config, arrays, device, [[0], [1], [2]], ["heavy_rain"])
    assert {name for _, name in together} == {"radar", "radar_maps", "radar_iq"}
    assert len(together["sunny", "radar_maps"]) == 6
    for name in ("radar", "radar_maps", "radar_iq"):
        assert together["heavy_rain", name] == apart["heavy_rain", name]
    labels = np.concatenate([row["label"] for row in together["heavy_rain", "radar"]])
    assert {0, 1} <= set(labels.tolist())
    assert together["heavy_rain", "radar"] != together["sunny", "radar"]


MULTIPATH = """
scenarios: [{name: street, town: town03, traffic: {vehicle_count: 3, spawn_center_m: [0, 0, 0], cav_ranks: [1]}}]
weathers: [sunny, heavy_rain]
channel: {enabled: false}
sensors:
  - {type: radar, name: direct, azimuth_rays: 110, elevation_rays: 30, reference_snr_db: 40}
  - {type: radar, name: full, azimuth_rays: 110, elevation_rays: 30, reference_snr_db: 40, multipath: full,
     coherent: true, maps: [range_azimuth]}
  - {type: radar, name: rays, azimuth_rays: 110, elevation_rays: 30, multipath: ground, output: dense}
"""


def test_paths_of_points_are_in_the_table(device, tmp_path):
    """Ghosts are told from echoes of bodies, are no points of them, and do not depend on batches."""
    (tmp_path / "c.yaml").write_text(MULTIPATH)
    config, arrays = load_config(tmp_path / "c.yaml"), two_cars(3)
    arrays = replace(arrays, materials=dict.fromkeys(("sunny", "heavy_rain"), arrays.materials["sunny"]))
    found = captured(capture_radar, config, arrays, device, [[0, 1, 2]], ["sunny", "heavy_rain"])
    apart = captured(capture_radar, config, arrays, device, [[0], [1], [2]], ["sunny", "heavy_rain"])
    for weather, tables in found.items():
        rows = tables["radar"].to_pylist()
        assert rows == apart[weather]["radar"].to_pylist()
        kinds = {row["sensor"]: set() for row in rows}
        for row in rows:
            if row["sensor"] == "direct":
                assert row["path_type"] is None
                continue
            kinds[row["sensor"]] |= set(row["path_type"])
            assert len(row["path_type"]) == row["point_count"] == len(row["range"])
            for object_id, label, kind in zip(row["object_id"], row["label"], row["path_type"], strict=True):
                assert kind == 0 or (label == 0 and object_id >= 0)
        assert kinds["full"] >= {0, 2, 4} and kinds["rays"] >= {0, 1} and max(kinds["rays"]) == 1
        for row in tables["box_visibility"].to_pylist():
            if row["sensor"] != "full":
                continue
            (sample,) = (r for r in rows if (r["frame"], r["sensor"]) == (row["frame"], "full"))
            own = [kind for o, kind in zip(sample["object_id"], sample["path_type"], strict=True)
                   if o == row["object_id"]]  # fmt: skip
            assert row["radar_points"] == own.count(0)
