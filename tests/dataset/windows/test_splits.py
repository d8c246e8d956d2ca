"""Splits share no frame, whatever the tracks, windows and shares; and they are the same again."""

import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mmw.dataset.windows import Feature, Windows, WindowSpec, open_windows, shared_frames, split_windows
from tests.fixtures.window_data import TOWNS, WEATHERS, bare_windows, window_data

SHARES = {"train": 0.6, "val": 0.2, "test": 0.2}


def frames_of(windows: Windows) -> set[tuple[str, int]]:
    """Return scenario and number of every frame that windows use, from the frames of their samples."""
    found = set()
    for index in range(len(windows)):
        sample, scenario = windows[index], windows.tracks[windows.track[index]].scenario
        begin, end = sample["now"] - windows.spec.before, sample["now"] + windows.spec.after
        used = {*range(begin, end + 1)}
        used.update(*(value.tolist() for key, value in sample.items() if key.endswith("_frame")))
        found |= {(scenario, frame) for frame in used}
    return found


@st.composite
def many_tracks(draw):
    """Return frames of tracks of several agents and weathers in one or two scenarios, with holes."""
    found = {}
    for scenario in ("a", "b")[: draw(st.integers(1, 2))]:
        length = draw(st.integers(40, 160))
        for weather, agent in itertools.product(("rainy", "sunny"), ("cav_1", "cav_2")):
            begin, end = sorted((draw(st.integers(0, length)), draw(st.integers(0, length))))
            hole = draw(st.integers(0, length))
            frames = [frame for frame in range(begin, end + 1) if frame != hole]
            if frames:
                found[scenario, weather, agent] = frames
    return found


@settings(max_examples=150, deadline=None)
@given(
    frames=many_tracks(),
    past=st.integers(0, 6),
    max_age=st.integers(0, 5),
    future=st.integers(0, 4),
    shares=st.lists(st.floats(0.1, 1.0), min_size=2, max_size=4),
    seed=st.integers(0, 5),
    gap=st.none() | st.integers(0, 10),
    blocks=st.integers(1, 3),
)
def test_parts_by_track_share_no_frame_and_keep_their_distance(
    frames, past, max_age, future, shares, seed, gap, blocks
) -> None:
    assume(frames)
    windows = bare_windows(frames, past, max_age, future)
    assume(len(windows))
    parts = dict(zip("pqrs", shares, strict=False))
    try:
        split = split_windows(windows, "track", parts, seed=seed, gap=gap, blocks=blocks)
    except ValueError as error:
        assert "gets no window" in str(error)
        return
    distance = past + max_age + future + 1 if gap is None and (windows.now % 2).any() else (gap or 0)
    for one, other in itertools.combinations(split.values(), 2):
        assert shared_frames(one, other) == []
        for scenario in "ab":
            sides = []
            for part in (one, other):
                own = part.of_track(lambda track: track.scenario) == scenario
                spans = zip(part.first[own], part.last[own], strict=True)
                sides.append(np.array([frame for first, last in spans for frame in range(first, last + 1)]))
            if all(map(len, sides)):
                assert np.abs(sides[0][:, None] - sides[1]).min() > distance
    again = split_windows(windows, "track", parts, seed=seed, gap=gap, blocks=blocks)
    for part, some in split.items():
        assert (some.now == again[part].now).all() and (some.track == again[part].track).all()
        known = set(zip(windows.track.tolist(), windows.now.tolist(), strict=True))
        assert known >= set(zip(some.track.tolist(), some.now.tolist(), strict=True))


@settings(max_examples=12, deadline=None)
@given(
    by=st.sampled_from(["track", "scenario", "town"]),
    every=st.integers(1, 4),
    past=st.integers(1, 4),
    stride=st.integers(1, 4),
    seed=st.integers(0, 9),
)
def test_no_frame_of_a_read_window_is_in_two_parts(by, every, past, stride, seed) -> None:
    spec = WindowSpec(["gnss", Feature("rgb", every=every)], past=past, stride=stride)
    parts = {"train": 0.5, "test": 0.5} if by == "town" else SHARES
    windows = open_windows(window_data(), spec, agents=["cav_1", "cav_2"])
    gap = None if by != "track" else 3
    split = split_windows(windows, by, parts, seed=seed, gap=gap)
    sets = {name: frames_of(part) for name, part in split.items()}
    for one, other in itertools.combinations(sets, 2):
        assert not sets[one] & sets[other]
        assert shared_frames(split[one], split[other]) == []
    if by != "track":
        assert sum(map(len, split.values())) == len(windows)


def test_all_agents_and_weathers_of_a_frame_go_together() -> None:
    windows = open_windows(window_data(), WindowSpec(["poses"], past=3, future=1))
    split = split_windows(windows, "track", {"train": 3, "test": 1}, seed=1)
    for part in split.values():
        for scenario in TOWNS:
            own = part.select(part.of_track(lambda track: track.scenario) == scenario)
            nows = {
                (track.weather, track.agent): set(own.now[own.track == number].tolist())
                for number, track in enumerate(own.tracks)
                if track.scenario == scenario and track.agent != "cav_2"
            }
            assert (
                len(nows) == 6
                and len({frozenset(some) for some in nows.values()}) == 1
                and min(map(len, nows.values()))
            )
    sizes = {name: len(part) for name, part in split.items()}
    assert 2.0 < sizes["train"] / sizes["test"] < 4.5


@pytest.mark.parametrize("blocks", [1, 2])
def test_parts_by_time_are_in_their_order(blocks: int) -> None:
    """Between the last frame of a block and the first of the next there are `gap` that no part uses."""
    gap = 3
    windows = open_windows(window_data(), WindowSpec(["poses"], past=2))
    split = split_windows(windows, "time", SHARES, gap=gap, blocks=blocks, seed=5)
    for scenario in TOWNS:
        used = {}
        for name, part in split.items():
            own = part.of_track(lambda track: track.scenario) == scenario
            spans = zip(part.first[own], part.last[own], strict=True)
            used |= {int(frame): name for first, last in spans for frame in range(first, last + 1)}
        frames = sorted(used)
        changes = [(one, other) for one, other in itertools.pairwise(frames) if used[one] != used[other]]
        assert [used[frames[0]], *(used[other] for _, other in changes)] == [*SHARES] * blocks
        assert min(other - one for one, other in changes) > gap
    assert all((split_windows(windows, "time", SHARES, gap=gap, blocks=blocks)[name].now == part.now).all()
               for name, part in split.items())  # fmt: skip


def test_seeds_differ_and_blocks_multiply() -> None:
    windows = open_windows(window_data(), WindowSpec(["poses"], past=2))
    firsts = {split_windows(windows, "track", SHARES, seed=seed)["test"].now.tobytes() for seed in range(8)}
    assert len(firsts) > 2
    one = split_windows(windows, "track", SHARES, seed=3, gap=2, blocks=2)["val"]
    own = np.unique(one.now[one.of_track(lambda track: track.scenario) == "slope"])
    assert (np.diff(own) > 1).sum() == 1  # two blocks with frames of other parts between them


def test_parts_by_weather_share_the_geometry() -> None:
    windows = open_windows(window_data(), WindowSpec(["poses"], past=2))
    split = split_windows(windows, "weather", {"train": ["sunny"], "test": "rainy"})
    assert {split["train"].tracks[t].weather for t in split["train"].track} == {"sunny"}
    assert {split["test"].tracks[t].weather for t in split["test"].track} == {"rainy"}
    assert len(shared_frames(*split.values())) == 60 * len(TOWNS)
    # Both at once: other frames and another weather.
    blocks = split_windows(windows, "track", {"train": 1, "test": 1})
    train, test = blocks["train"].where(weathers=["sunny"]), blocks["test"].where(weathers=["rainy"])
    assert len(train) and len(test) and shared_frames(train, test) == []


def test_by_town_and_scenario() -> None:
    windows = open_windows(window_data(), WindowSpec(["poses"], past=2))
    split = split_windows(windows, "town", {"train": ["town03"], "test": ["town05"]})
    names = {name: {part.tracks[t].scenario for t in part.track} for name, part in split.items()}
    assert names == {"train": {"circle", "slope"}, "test": {"crossing"}}
    split = split_windows(windows, "scenario", SHARES, seed=4)
    names = [{part.tracks[t].scenario for t in part.track} for part in split.values()]
    assert sorted(map(len, names)) == [1, 1, 1] and set.union(*names) == set(TOWNS)
    split = split_windows(windows, "scenario", {"train": ["circle"]})
    assert len(split["train"]) == (windows.of_track(lambda track: track.scenario) == "circle").sum()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"by": "agent"}, "by = 'agent'; it is track"),
        ({"parts": {}}, "0 parts; both are needed"),
        ({"parts": {"train": 0.5, "test": ["circle"]}}, "mix shares and names"),
        ({"parts": {"train": 1.0, "test": 0.0}}, "each is above 0"),
        ({"parts": {"train": ["circle"]}}, "by track needs shares"),
        ({"gap": -1}, "gap = -1"),
        ({"blocks": 0}, "blocks = 0"),
        ({"gap": 30}, "part 'train' gets no window"),
        ({"by": "scenario", "gap": 3}, "by scenario has no use for them"),
        ({"by": "town"}, r"3 parts of 2 names \(town03, town05\)"),
        ({"by": "weather", "parts": {"train": ["sunny"], "test": ["snowy"]}}, "weather snowy is not there"),
        ({"by": "weather", "parts": {"train": ["sunny"], "test": ["sunny"]}}, "in two parts; there are rainy, sunny"),
    ],
)
def test_wrong_splits_are_refused(arguments, message) -> None:
    windows = open_windows(window_data(), WindowSpec(["poses"], past=2), weathers=WEATHERS)
    with pytest.raises(ValueError, match=message):
        split_windows(windows, **{"by": "track", "parts": SHARES, **arguments})
