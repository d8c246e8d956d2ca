"""The windows of a dataset and the sample of each frame, against plain loops over the tables."""

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mmw
from mmw.dataset.windows import Feature, Track, WindowSpec, open_windows
from mmw.dataset.windows.channel_sources import one_peer
from mmw.dataset.windows.tracks import find_latest
from tests.fixtures.shards import AGENTS
from tests.fixtures.window_data import FRAMES, TOWNS, WEATHERS, is_there, window_data

PERIOD = {"poses": 1, "imu": 1, "lidar": 1, "rgb": 10, "gnss": 2, "links": 1}
HAVE = {"imu": AGENTS[:3], "gnss": AGENTS[:3], "links": AGENTS[:3]}


def expected(features: list[Feature], past: int, future: int, stride: int, step: int) -> dict:
    """Return scenario, weather, agent and `now` of every window, and the frames of its samples."""
    found = {}
    for scenario in TOWNS:
        for weather in WEATHERS:
            for agent in AGENTS:
                for now in range(0, FRAMES, stride):
                    frames = range(now - (past - 1) * step, now + future * step + 1)
                    if not all(0 <= f < FRAMES and is_there("poses", scenario, agent, f) for f in frames):
                        continue
                    samples = {}
                    for feature in features:
                        wanted = (
                            [now - k * step for k in range(past) if k % feature.every == 0][::-1]
                            if feature.span == "past"
                            else [now + k * step for k in range(1, future + 1) if k % feature.every == 0]
                        )
                        samples[feature.key] = [latest_frame(feature, scenario, agent, frame) for frame in wanted]
                    if all(None not in own for own in samples.values()):
                        found[scenario, weather, agent, now] = samples
    return found


def latest_frame(feature: Feature, scenario: str, agent: str, frame: int) -> int | None:
    """Return the latest frame with a sample that is not too old, without a hole in between."""
    if agent not in HAVE.get(feature.modality, AGENTS):
        return None
    for own in range(frame, max(frame - PERIOD[feature.modality], -1), -1):
        if not is_there("poses", scenario, agent, own):
            return None
        if is_there(feature.table, scenario, agent, own):
            return own
    return None


@settings(max_examples=25, deadline=None)
@given(
    names=st.sets(st.sampled_from(sorted(PERIOD)), min_size=1, max_size=3),
    every=st.integers(1, 12),
    past=st.integers(1, 14),
    future=st.integers(0, 6),
    stride=st.integers(1, 7),
    step=st.integers(1, 3),
)
def test_windows_are_those_of_plain_loops(names, every, past, future, stride, step) -> None:
    features = [Feature(name, every=every, carrier_hz=28e9 if name == "links" else None) for name in sorted(names)]
    if future:
        features.append(Feature("poses", span="future", every=min(every, future)))
    want = expected(features, past, future, stride, step)
    spec = WindowSpec(features, past=past, future=future, stride=stride, step=step)
    if not want:
        with pytest.raises(ValueError, match=r"no window is left|longest unbroken track"):
            open_windows(window_data(), spec)
        return
    windows = open_windows(window_data(), spec)
    assert len(windows) == len(want)
    for index in range(0, len(windows), 7):
        track = windows.tracks[windows.track[index]]
        samples = want[(*track.name, int(windows.now[index]))]
        sample = windows[index]
        for key, frames in samples.items():
            assert sample[f"{key}_frame"].tolist() == frames
        used = [frame for frames in samples.values() for frame in frames]
        begin = int(windows.now[index]) - (past - 1) * step
        assert windows.first[index] == min([begin, *used]) and windows.last[index] == sample["now"] + future * step
        assert (sample["now"], windows.tracks[sample["track"]].name) == (windows.now[index], track.name)
    names_of = [(*windows.tracks[t].name, int(now)) for t, now in zip(windows.track, windows.now, strict=True)]
    assert set(names_of) == set(want)
    assert names_of == sorted(names_of, key=lambda name: (name[0], name[1], name[3], name[2]))


@settings(max_examples=200, deadline=None)
@given(
    there=st.lists(st.booleans(), min_size=1, max_size=30),
    sampled=st.lists(st.booleans(), min_size=30, max_size=30),
    first=st.integers(0, 5),
    max_age=st.integers(0, 12),
)
def test_a_sample_is_the_latest_before_and_never_from_the_future(there, sampled, first, max_age) -> None:
    there = [True, *there, True]
    track = Track("s", "w", "a", "cav", np.flatnonzero(there) + first)
    frames = np.array([f for f in range(first, first + len(there)) if sampled[(f * 7) % 30]], dtype=np.int64)
    found = find_latest(track, frames, frames + 1000, max_age)
    for place, frame in enumerate(range(first, first + len(there))):
        want = -1
        for own in range(frame, frame - max_age - 1, -1):
            if own < first or not there[own - first]:
                break
            if own in frames:
                want = own
                break
        assert found.frame[place] == want and found.row[place] == (want + 1000 if want >= 0 else -1)
        assert found.frame[place] <= frame


def test_images_are_held_for_their_period_and_no_longer() -> None:
    spec = WindowSpec([Feature("rgb")], past=3, stride=1)
    windows = open_windows(window_data(), spec, scenarios=["circle"], weathers=["sunny"], agents=["cav_1"])
    for index in range(len(windows)):
        sample = windows[index]
        wanted = np.arange(sample["now"] - 2, sample["now"] + 1)
        assert (sample["rgb_frame"] == wanted // 10 * 10).all()
    with pytest.raises(ValueError, match=r"no window is left; without frames or samples are .*rgb: 58"):
        one = {"scenarios": ["circle"], "weathers": ["sunny"], "agents": ["cav_1"]}
        open_windows(window_data(), WindowSpec([Feature("rgb", max_age_frames=0)], past=3), **one)


def test_dropped_windows_are_counted_by_reason() -> None:
    spec = WindowSpec(["lidar"], past=2, stride=1)
    windows = open_windows(window_data(), spec, scenarios=["circle"], weathers=["sunny"], agents=["cav_1", "cav_2"])
    # Two of each track's frames begin one; frames 33 and 34 of cav_1 need the sweep that is not there.
    assert windows.dropped == {"frames": 1 + 2, "lidar": 2}
    assert len(windows) == (59 - 2) + (57 - 2)


def test_where_and_select() -> None:
    windows = open_windows(mmw.open(window_data()), WindowSpec(["poses"], past=4, stride=4))
    some = windows.where(scenarios=["slope"], weathers="rainy", agents=["rsu", "cav_1"])
    assert {windows.tracks[t].name for t in some.track} == {("slope", "rainy", "cav_1"), ("slope", "rainy", "rsu_1")}
    assert some[0]["now"] == 4 and len(some) == 2 * 14
    mask = windows.now == 8
    assert (
        len(windows.select(mask)) == mask.sum() and windows.select([3, 1]).now.tolist() == windows.now[[3, 1]].tolist()
    )
    with pytest.raises(ValueError, match="agent bus; there are cav, cav_1"):
        windows.where(agents=["bus"])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Feature("sonar"), "no such modality; they are poses"),
        (lambda: Feature("lidar", span="now"), "past or future"),
        (lambda: Feature("lidar", every=0), "at least 1"),
        (lambda: Feature("rgb", shrink=3), "1, 2, 4 or 8"),
        (lambda: Feature("poses", sensor="imu"), "no use for sensor"),
        (lambda: Feature("lidar", carrier_hz=28e9), "no use for carrier_hz"),
        (lambda: Feature("rgb", columns=("x",)), "no use for columns"),
        (lambda: WindowSpec([], past=1), "features is empty"),
        (lambda: WindowSpec(["poses"], past=0), "past = 0"),
        (lambda: WindowSpec(["poses", "poses"], past=1), "poses, poses_frame would be there twice"),
        (lambda: WindowSpec([Feature("poses", name="now")], past=1), "now would be there twice"),
        (lambda: WindowSpec([Feature("poses", span="future", every=3)], past=1, future=2), "lengthen the future"),
    ],
)
def test_wrong_specs_are_refused(make, message) -> None:
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(
    ("features", "past", "message"),
    [
        (["poses"], 61, "reach over 61 frames; the longest unbroken track has 60"),
        ([Feature("links")], 1, r"the dataset has 4.9e\+09, 2.8e\+10 Hz; name one as `carrier_hz`"),
        ([Feature("beams", carrier_hz=1e9)], 1, r"carrier_hz = 1e\+09"),
        ([Feature("links", carrier_hz=28e9, peer="rsu_9")], 1, "no link of rsu_9"),
        ([Feature("radar")], 1, "has radar, radar_2; name one as `sensor`"),
        ([Feature("lidar", sensor="roof")], 1, "no window is left"),
        ([Feature("imu", columns=("handedness",))], 1, "imu has frame, ax"),
        ([Feature("lidar", columns=("point_count",))], 1, "lidar has x, y, z"),
    ],
)
def test_absent_names_are_refused(features, past, message) -> None:
    with pytest.raises(ValueError, match=message):
        open_windows(window_data(), WindowSpec(features, past=past))


def test_an_absent_table_is_named(tmp_path) -> None:
    for name in ("dataset.json", "_shards", "poses", "sensors"):
        (tmp_path / name).symlink_to(window_data() / name)
    with pytest.raises(ValueError, match=r"Feature\('beams'\) needs table links and paths, which has no file"):
        open_windows(tmp_path, WindowSpec(["beams"], past=1))


def test_without_table_sensors_hold_must_be_given(tmp_path) -> None:
    for name in ("dataset.json", "_shards", "poses", "rgb"):
        (tmp_path / name).symlink_to(window_data() / name)
    with pytest.raises(ValueError, match=r"table sensors has no row for circle cav_1 front, .* give `max_age_frames`"):
        open_windows(tmp_path, WindowSpec(["rgb"], past=1))
    assert len(open_windows(tmp_path, WindowSpec([Feature("rgb", max_age_frames=9)], past=1))) > 0


def test_several_roadside_units_need_a_name() -> None:
    rows = pa.table({"peer": ["rsu_1", "rsu_2", "cav_2"], "link": ["v2i", "v2i", "v2v"]})
    assert (
        one_peer(Feature("links"), rows.slice(1), "s") == "rsu_2"
        and one_peer(Feature("links"), rows.slice(2), "s") is None
    )
    assert one_peer(Feature("links", peer="cav_2"), rows, "s") == "cav_2"
    with pytest.raises(ValueError, match="rsu_1, rsu_2 transmit in s; name one of them as `peer`"):
        one_peer(Feature("links"), rows, "s")
