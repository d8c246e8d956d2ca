"""Recorded work gives what direct work gives, call by call, and launches only to make its record."""

import numpy as np
import pytest
import warp as wp

from mmw.core import recorded_work
from mmw.core.recorded_work import DirectWork, GatheredArrays, NewArrays, RecordedWork, Same, Work

wp.set_module_options({"enable_backward": False})


@wp.struct
class Pair:
    """Two arrays."""

    doubled: wp.array[float]
    scanned: wp.array[int]


@wp.kernel
def double_kernel(
    value: wp.array[float],
    offset: wp.array[wp.vec2],
    # out
    pair_out: Pair,
    sum_out: wp.array[float],
):
    i = wp.tid()
    pair_out.doubled[i] = 2.0 * value[i] + offset[0][1]
    pair_out.scanned[i] = i
    wp.atomic_add(sum_out, 0, value[i])


def run(work: Work, values: np.ndarray, offset: float, launched: list[str], key: object = "k") -> list[np.ndarray]:
    """Return twice the values plus an offset, 0, 0, 1, 3, 6 and so on, and the sum of the values."""

    def launch(arrays: NewArrays, inputs: list[wp.array]) -> GatheredArrays:
        launched.append(str(key))
        count = len(inputs[0])
        pair, total, scan = arrays.struct(Pair, count), arrays.full(1, 0.0, float), arrays.empty(count, int)
        wp.launch(double_kernel, count, inputs, [pair, total], device=work.device)
        wp.utils.array_scan(pair.scanned, scan, inclusive=False)
        return GatheredArrays(arrays, [pair.doubled, scan, total])

    inputs = [(values, wp.float32), (np.array([[0.0, offset]]), wp.vec2)]
    with work.run(key, inputs, launch) as small:
        return work.gathered(small)


def test_replayed_work_is_that_of_direct_work(device: str) -> None:
    rng, launched = np.random.default_rng(3), []
    work, direct = RecordedWork(device), DirectWork(device)
    seen = []
    for step in range(5):
        values = rng.integers(0, 100, 37).astype(np.float64)
        found = run(work, values, step, launched)
        for own, other in zip(found, run(direct, values, step, []), strict=True):
            np.testing.assert_array_equal(own, other)
        np.testing.assert_array_equal(found[0], 2.0 * values + step)
        np.testing.assert_array_equal(found[1], np.cumsum(np.arange(37)) - np.arange(37))
        assert found[2][0] == values.sum()
        seen.append((found[0], found[0].copy()))
    assert launched == ["k", "k"]  # once directly, once for the record
    assert all(np.array_equal(kept, copy) for kept, copy in seen)  # later calls change no result on the host


def test_keys_and_shapes_have_records_of_their_own(device: str) -> None:
    work, launched = RecordedWork(device), []
    for count, key in ((3, "a"), (5, "a"), (3, "b"), (3, "a"), (5, "a"), (3, "a")):
        found = run(work, np.arange(count), 1.0, launched, key)
        np.testing.assert_array_equal(found[0], 2.0 * np.arange(count) + 1.0)
    assert launched == ["a", "a", "b", "a", "a"]
    one, other = [1], [1]
    assert Same(one) == Same(one) != Same(other) and hash(Same(one)) == hash(Same(one)) and Same(one) != one


def test_oldest_records_are_dropped_where_memory_is_full(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorded_work, "KEPT_BYTES", 3000)  # a record of 100 values takes 1.6 kB and more
    work, launched = RecordedWork(device), []
    for key in ("a", "a", "b", "a", "b", "b"):
        run(work, np.arange(100), 0.0, launched, key)
    assert launched == ["a", "a", "b", "a", "b", "b"]  # each drops the other
    monkeypatch.setattr(recorded_work, "KEPT_BYTES", 1 << 20)
    launched.clear()
    for key in ("a", "b", "a", "b"):
        run(work, np.arange(100), 0.0, launched, key)
    assert launched == ["a", "a"]


def test_forgotten_work_is_made_anew(device: str) -> None:
    work, launched = RecordedWork(device), []
    for _ in range(3):
        run(work, np.ones(5), 0.0, launched)
    for other in (work, DirectWork(device)):
        other.forget("k", [(np.ones(5), wp.float32), (np.ones((1, 2)), wp.vec2)])
    run(work, np.ones(5), 0.0, launched)
    assert launched == ["k"] * 3


def test_calls_with_one_key_are_open_at_once(device: str) -> None:
    """Each has arrays of its own, which the next call takes again when the statement has ended."""
    work, launched = RecordedWork(device), []

    def launch(arrays: NewArrays, inputs: list[wp.array]) -> wp.array:
        launched.append(len(launched))
        out = arrays.empty(len(inputs[0]), float)
        wp.copy(out, inputs[0])
        return out

    for step in range(4):
        one, other = (work.run("k", [(np.full(9, step + k), wp.float32)], launch) for k in (0, 10))
        with one as first, other as second:
            assert first.ptr != second.ptr
            assert [values[0] for values in work.to_host([second, first])] == [step + 10, step]
    assert len(launched) == 4
    with pytest.raises(ValueError, match="within"), work.run("k", [(np.zeros(9), wp.float32)], launch):
        raise ValueError("within")
    with work.run("k", [(np.ones(9), wp.float32)], launch) as found:
        assert work.to_host([found])[0][0] == 1.0
    assert len(launched) == 4


def test_a_shape_that_the_key_does_not_name_is_an_error(device: str) -> None:
    work, shapes = RecordedWork(device), iter((3, 4))
    none = [(np.zeros(1), wp.float32)]
    with work.run("k", none, lambda arrays, inputs: arrays.full(next(shapes), 1, int)):
        pass
    again = work.run("k", none, lambda arrays, inputs: arrays.empty(next(shapes), int))
    with pytest.raises(RuntimeError, match=r"array 0 of recorded work: \(4, .*must be part of the key"), again:
        pass
    assert run(work, np.ones(4), 0.0, [])[2][0] == 4.0  # nothing is being recorded any more


def test_work_that_fails_leaves_no_record(device: str) -> None:
    work = RecordedWork(device)

    def fail(arrays: NewArrays, inputs: list[wp.array]) -> None:
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"), work.run("k", [(np.zeros(37), wp.float32)], fail):
        pass
    launched: list[str] = []
    run(work, np.zeros(37), 0.0, launched)
    assert launched == ["k"]


def test_copies_are_queued_behind_the_launches_and_outlive_them(device: str) -> None:
    def launch(arrays: NewArrays, inputs: list[wp.array]) -> wp.array:
        out = arrays.empty(len(inputs[0]), float)
        wp.copy(out, inputs[0])
        return out

    for work in (RecordedWork(device), DirectWork(device)):
        seen = []
        for step in range(4):
            with work.run("k", [(np.full(9, step), wp.float32)], launch) as found:
                copy = work.host_copy([found, found[2:5]])
                seen.append(copy.wait())
            work.host_copy([found]).close()  # a copy that nobody looks at
        assert [[len(values) for values in pair] for pair in seen] == [[9, 3]] * 4
        assert all((values == step).all() for step, pair in enumerate(seen) for values in pair)
