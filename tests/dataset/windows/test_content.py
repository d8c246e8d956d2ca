"""Content of windows against the files read directly; streams, batches and damage."""

import itertools
import pickle
import shutil
from pathlib import Path

import numpy as np
import pyarrow.dataset as pds
import pyarrow.fs as pafs
import pytest

import mmw
from mmw.channel import register_pattern, ula
from mmw.channel.antennas.patterns import PATTERNS
from mmw.core.transforms import quaternion_to_matrix
from mmw.dataset import BeamSearch
from mmw.dataset.windows import Feature, Windows, WindowSpec, make_batch, open_windows, stream_batches, stream_order
from mmw.dataset.windows.file_sources import Cache
from mmw.storage.codecs.images import decode_depth, decode_rgb
from mmw.storage.schemas import TABLES
from tests.fixtures.small_dataset import small_dataset
from tests.fixtures.window_data import WEATHERS, row_of, window_data

CSI_HZ = (-1e6, 0.0, 2e6)
TAKES = (
    Feature("poses", span="future", every=2),
    Feature("imu", columns=("gz", "ax")),
    "gnss",
    Feature("links", carrier_hz=28e9),
    Feature("csi", carrier_hz=4.9e9, frequencies_hz=CSI_HZ),
    "boxes",
    Feature("lidar", every=3, columns=("x", "y", "z", "object_id")),
    Feature("radar", sensor="radar_2", columns=("range", "power_db")),
    Feature("rgb", every=3),
    Feature("rgb", every=3, shrink=4, name="small"),
)


@pytest.fixture(scope="module")
def windows() -> Windows:
    return open_windows(window_data(), WindowSpec(TAKES, past=4, future=4, stride=5))


def read(table: str, windows: Windows, index: int):
    """Return the rows of a table of a window's scenario and weather, read by pyarrow alone."""
    track = windows.tracks[windows.track[index]]
    folder = window_data() / table / f"scenario={track.scenario}"
    folder = folder / f"weather={track.weather}" if TABLES[table].by_weather else folder
    return pds.dataset(folder, format="parquet").to_table(), track


def at(rows, track, frames, sensor=None) -> list[dict]:
    """Return the rows of a track's agent in some frames."""
    return [row_of(rows, agent=track.agent, frame=int(f), **({"sensor": sensor} if sensor else {})) for f in frames]


def assert_same(one: dict, other: dict) -> None:
    """Check that two samples hold equal arrays; those of point clouds and boxes are in lists."""
    assert one.keys() == other.keys()
    for key, value in one.items():
        for mine, own in zip(value, other[key], strict=True) if isinstance(value, list) else [(value, other[key])]:
            np.testing.assert_array_equal(mine, own)


@pytest.mark.parametrize("index", [0, 13, 41, -1])
def test_numbers_are_those_of_the_files(windows: Windows, index: int) -> None:
    sample = windows[index]
    rows, track = read("poses", windows, index)
    assert sample["future_poses_frame"].tolist() == [sample["now"] + 2, sample["now"] + 4]
    want = [
        [row[name] for name in windows.spec.all_features[0].picked] for row in at(rows, track, sample["now"] + [2, 4])
    ]
    np.testing.assert_array_equal(sample["future_poses"], np.float32(want))
    past = np.arange(sample["now"] - 3, sample["now"] + 1)
    want = [[row["gz"], row["ax"]] for row in at(read("imu", windows, index)[0], track, past, "imu")]
    np.testing.assert_array_equal(sample["imu"], np.float32(want))
    want = [row["latitude_deg"] for row in at(read("gnss", windows, index)[0], track, past // 2 * 2, "gnss")]
    np.testing.assert_array_equal(sample["gnss"][:, 0], want)
    assert sample["gnss"].dtype == np.float64 and sample["gnss_frame"].tolist() == (past // 2 * 2).tolist()
    rows = read("links", windows, index)[0]
    want = [row_of(rows, agent=track.agent, frame=int(f), carrier_hz=28e9) for f in past]
    names = windows.spec.all_features[3].picked
    np.testing.assert_array_equal(sample["links"], np.array([[r[n] for n in names] for r in want], dtype=np.float32))
    assert track.agent != "cav_3" or (np.isnan(sample["links"][:, 0]).all() and not sample["links"][:, 5].any())


@pytest.mark.parametrize("index", [0, 7, 13])
def test_csi_is_the_sum_over_paths(windows: Windows, index: int) -> None:
    sample = windows[index]
    gains, track = read("path_gains", windows, index)
    gains = gains.to_pandas().astype({"scenario": str, "agent": str, "peer": str})
    geometry = read("path_geometry", windows, index)[0].to_pandas().astype({"scenario": str, "agent": str, "peer": str})
    key = ["scenario", "frame", "agent", "peer", "antenna", "peer_antenna", "path"]
    columns = gains.merge(geometry, on=key, how="left", validate="many_to_one")
    for place, frame in enumerate(sample["csi_frame"]):
        own = (columns["agent"] == track.agent) & (columns["frame"] == frame) & (columns["carrier_hz"] == 4.9e9)
        tau, re, im = (columns[name].to_numpy()[own] for name in ("tau_s", "a_re", "a_im"))
        want = [((re + 1j * im) * np.exp(-2j * np.pi * (4.9e9 + f) * tau)).sum() for f in CSI_HZ]
        np.testing.assert_allclose(sample["csi"][place], [np.real(want), np.imag(want)], atol=1e-5)
    assert sample["csi"].shape == (4, 2, 3) and sample["csi"].dtype == np.float32


@pytest.mark.parametrize("index", [0, 13, -1])
def test_boxes_are_in_the_frame_of_the_agent(windows: Windows, index: int) -> None:
    sample = windows[index]
    rows, track = read("boxes", windows, index)
    poses = at(read("poses", windows, index)[0], track, sample["boxes_frame"])
    for place, pose in enumerate(poses):
        turn = np.array([pose[f"q{axis}"] for axis in "xyzw"])
        to_agent = quaternion_to_matrix(turn / np.linalg.norm(turn)).T
        boxes = [row for row in rows.to_pylist() if row["frame"] == pose["frame"] and row["agent"] != track.agent]
        assert sample["boxes_object_id"][place].tolist() == [row["object_id"] for row in boxes]
        assert (sample["boxes_class"][place] == 14).all() and sample["boxes"][place].shape == (len(boxes), 7)
        for box, row in zip(sample["boxes"][place], boxes, strict=True):
            middle = to_agent @ [row[axis] - pose[axis] for axis in "xyz"]
            cos = np.cos([row["yaw"], row["pitch"]])
            ahead = to_agent @ [cos[0] * cos[1], np.sin(row["yaw"]) * cos[1], -np.sin(row["pitch"])]
            np.testing.assert_allclose(box[:3], middle, rtol=1e-4, atol=1e-5)
            np.testing.assert_array_equal(box[3:6], [row["length"], row["width"], row["height"]])
            assert box[6] == pytest.approx(np.arctan2(ahead[1], ahead[0]), abs=1e-5)


@pytest.mark.parametrize("index", [0, 13, -1])
def test_points_and_images_are_those_of_the_files(windows: Windows, index: int) -> None:
    sample = windows[index]
    rows, track = read("lidar", windows, index)
    for cloud, row in zip(sample["lidar"], at(rows, track, sample["now"] + [-3, 0]), strict=True):
        np.testing.assert_array_equal(cloud, np.float32([row[name] for name in ("x", "y", "z", "object_id")]).T)
    past = np.arange(sample["now"] - 3, sample["now"] + 1)
    for cloud, row in zip(sample["radar_radar_2"], at(read("radar", windows, index)[0], track, past, "radar_2")):  # noqa: B905
        np.testing.assert_array_equal(cloud[:, 0], np.float32(row["range"]))
        assert np.isnan(cloud[:, 1]).all()  # CARLA's radar knows no power
    rows = at(read("rgb", windows, index)[0], track, sample["rgb_frame"], "front")
    want = np.stack([decode_rgb(row["image"]["bytes"]) for row in rows])
    np.testing.assert_array_equal(sample["rgb"], want)
    assert want.shape == (2, 16, 24, 3) and sample["small"].shape == (2, 4, 6, 3)
    mean = want.reshape(2, 4, 4, 6, 4, 3).mean(axis=(2, 4))
    assert np.abs(sample["small"] - mean).max() < 2.0  # the images are blocks of 4 x 4 equal pixels


def test_depth_is_metres() -> None:
    windows = open_windows(window_data(), WindowSpec(["depth"], past=1), agents=["rsu"])
    for index in (0, 1):
        rows, track = read("depth", windows, index)
        row = at(rows, track, windows[index]["depth_frame"], "depth")[0]
        want = decode_depth(row["image"]["bytes"])
        if row["depth_m"] is not None:
            metres = np.float32(row["depth_m"]).reshape(want.shape)
            want = np.where(metres > 0, metres, np.float32(np.inf))
        np.testing.assert_array_equal(windows[index]["depth"][0], want)


def test_beams_are_those_of_the_sql_view_and_are_cached(tmp_path, monkeypatch) -> None:
    spec = WindowSpec(
        [Feature("beams", carrier_hz=28e9), Feature("beams", span="future", carrier_hz=28e9)], past=2, future=1
    )
    windows = open_windows(small_dataset(), spec, cache=tmp_path)
    query = "SELECT weather, agent, frame, rx_beam, tx_beam, gain FROM beams WHERE carrier_hz = 28e9"
    want = {tuple(row[:3]): row[3:] for row in mmw.connect(small_dataset()).sql(query).fetchall()}
    assert len(windows) == 2 * 3 * 2
    for index in range(len(windows)):
        sample, track = windows[index], windows.tracks[windows.track[index]]
        for key in ("beams", "future_beams"):
            rows = [want[track.weather, track.agent, int(frame)] for frame in sample[f"{key}_frame"]]
            assert sample[key].tolist() == [[row[0], row[1]] for row in rows] and sample[key].dtype == np.int64
            np.testing.assert_allclose(sample[f"{key}_gain"], [row[2] for row in rows], rtol=1e-6)
    assert windows.sources["beams"] is windows.sources["future_beams"]  # one search for both
    assert len(list(tmp_path.glob("beams-*.parquet"))) == 2  # weathers

    def fail(*_: object) -> None:
        raise AssertionError("searched again")

    monkeypatch.setattr(BeamSearch, "best", fail)
    cached = open_windows(small_dataset(), spec, cache=tmp_path)
    assert all((cached[n]["beams"] == windows[n]["beams"]).all() for n in range(len(windows)))
    with pytest.raises(AssertionError, match="searched again"):
        other = Feature("beams", carrier_hz=28e9, search=BeamSearch(tx_beams=32))
        open_windows(small_dataset(), WindowSpec([other], past=1), cache=tmp_path)


def test_beams_of_own_patterns_are_not_cached(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A registered name may be another pattern in the next run, and a function has no content to compare."""
    monkeypatch.setattr(PATTERNS, "_added", {})
    register_pattern("mine", lambda theta, phi: np.sin(theta))
    for pattern in ("mine", lambda theta, phi: np.sin(theta)):
        feature = Feature("beams", carrier_hz=28e9, search=BeamSearch(tx_array=ula(64, pattern=pattern)))
        with pytest.raises(ValueError, match="a table, a function or registered cannot be stored in `cache`"):
            open_windows(small_dataset(), WindowSpec([feature], past=1), cache=tmp_path)
    assert not list(tmp_path.iterdir())


def test_samples_are_the_callers_own(windows: Windows) -> None:
    before = windows[0]
    for value in windows[0].values():
        for one in value if isinstance(value, list) else [value]:
            one[...] = 0
    assert_same(windows[0], before)
    shared = windows.load(0)["lidar"][0]
    with pytest.raises(ValueError, match="read-only"):
        shared[0] = 0


def test_windows_travel_to_other_processes(windows: Windows) -> None:
    windows[0]
    other = pickle.loads(pickle.dumps(windows))
    np.testing.assert_array_equal(other[3]["rgb"], windows[3]["rgb"])
    assert other.sources["lidar"].cache is other.sources["rgb"].cache  # one cache for all features


def test_windows_of_a_dataset_that_is_not_local(windows: Windows) -> None:
    tree = pafs.SubTreeFileSystem(str(window_data().parent), pafs.LocalFileSystem())
    other = open_windows(mmw.open("dataset", filesystem=tree), windows.spec)
    assert_same(windows[9], other[9])


def test_the_cache_drops_the_least_recently_used() -> None:
    cache, made = Cache(250), []

    def make(key: int) -> np.ndarray:
        made.append(key)
        return np.zeros(100, dtype=np.uint8)

    for key in (1, 2, 1, 3, 1, 2):
        assert cache.get(key, lambda key=key: make(key)).nbytes == 100
    assert made == [1, 2, 3, 2]


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_every_window_comes_once_an_epoch_in_the_order_of_files(windows: Windows, workers: int) -> None:
    for epoch in (0, 1):
        dealt = [stream_order(windows, seed=2, epoch=epoch, worker=w, workers=workers) for w in range(workers)]
        assert sorted(np.concatenate(dealt).tolist()) == list(range(len(windows)))
        shards = [set(windows.shard[own].tolist()) for own in dealt]
        assert sum(map(len, shards)) == 12  # 3 scenarios, 2 weathers, 2 shards of 30 frames
        for own in dealt:
            of_shard = windows.shard[own]
            assert (np.diff(of_shard) != 0).sum() == max(len(set(of_shard.tolist())) - 1, 0)  # shard after shard
            for shard in set(of_shard.tolist()):
                assert (np.diff(windows.now[own[of_shard == shard]]) >= 0).all()
    orders = {stream_order(windows, seed=s, epoch=e).tobytes() for s, e in itertools.product((0, 1), (0, 1))}
    assert len(orders) == 4
    assert stream_order(windows, shuffle=False).tolist() == list(range(len(windows)))


def test_a_stream_is_shuffled_batched_and_the_same_again(windows: Windows) -> None:
    def names(**options) -> list[tuple[int, int]]:
        batches = list(stream_batches(windows, 8, **options))
        assert all(len(batch["now"]) == 8 for batch in batches[:-1])
        return [pair for b in batches for pair in zip(b["track"].tolist(), b["now"].tolist(), strict=True)]

    want = list(zip(windows.track.tolist(), windows.now.tolist(), strict=True))
    assert names(shuffle=False) == want
    some = names(seed=1, buffer=20)
    assert sorted(some) == sorted(want) and some == names(seed=1, buffer=20) != names(seed=1, epoch=1, buffer=20)
    order = stream_order(windows, seed=1)
    assert some != [want[n] for n in order] == names(seed=1, buffer=1)
    with pytest.raises(ValueError, match="size = 0, buffer = 64"):
        next(stream_batches(windows, 0))
    with pytest.raises(ValueError, match="worker 2 of 2; it is 0 to 1"):
        stream_order(windows, worker=2, workers=2)


def test_batches_pad_or_list(windows: Windows) -> None:
    samples = [windows[n] for n in (0, 5, 9)]
    batch = make_batch(samples)
    counts = [[len(cloud) for cloud in sample["lidar"]] for sample in samples]
    assert batch["lidar_count"].tolist() == counts and batch["lidar"].shape == (3, 2, np.max(counts), 4)
    for window, place in itertools.product(range(3), range(2)):
        count = counts[window][place]
        np.testing.assert_array_equal(batch["lidar"][window, place, :count], samples[window]["lidar"][place])
        assert not batch["lidar"][window, place, count:].any()
    assert batch["boxes_object_id"].shape == (3, 4, 4)
    assert batch["rgb"].shape == (3, 2, 16, 24, 3) and batch["rgb"].dtype == np.uint8
    joined = make_batch([windows.load(n) for n in (0, 5, 9)])
    assert all(np.array_equal(batch[key], joined[key], equal_nan=batch[key].dtype.kind == "f") for key in batch)
    listed = make_batch(samples, "list")
    assert [[len(cloud) for cloud in window] for window in listed["lidar"]] == counts
    ids = make_batch([{"id": [np.arange(2)]}, {"id": [np.arange(1)]}])["id"]
    assert ids.tolist() == [[[0, 1]], [[0, -1]]]
    with pytest.raises(ValueError, match=r"a has shapes \[\(2,\), \(3,\)\]"):
        make_batch([{"a": np.zeros(2)}, {"a": np.zeros(3)}])
    with pytest.raises(ValueError, match="0 samples"):
        make_batch([])


def test_a_damaged_file_is_named(tmp_path) -> None:
    shutil.copytree(window_data(), tmp_path / "d")
    windows = open_windows(tmp_path / "d", WindowSpec(["lidar"], past=1))
    file = tmp_path / "d" / "lidar" / "scenario=circle" / f"weather={WEATHERS[0]}" / "part-000000.parquet"
    data = bytearray(file.read_bytes())
    data[4:4000] = bytes(3996)
    file.write_bytes(data)
    with pytest.raises(ValueError, match=r"part-000000.parquet: cannot be read .* is damaged"):
        windows[0]
    file.write_bytes(b"PAR1")
    with pytest.raises(ValueError, match=r"part-000000.parquet: cannot be read"):
        open_windows(tmp_path / "d", WindowSpec(["lidar"], past=1))
