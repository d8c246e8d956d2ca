"""Work that does not fit into memory is made in smaller parts, in order; other errors are raised."""

import pytest

from mmw.generation.pipeline import launch_in_parts


def run(count: int, step: int, fits: int, error: Exception) -> tuple[int, list[range], list[tuple[int, int]]]:
    """Return the step at the end, the parts, and what was told; parts of more than `fits` items raise the error."""
    parts: list[range] = []
    told: list[tuple[int, int]] = []

    def make(some: range) -> range:
        if len(some) > fits:
            raise error
        return some

    def keep(some: range, made: range) -> None:
        assert made == some
        parts.append(some)

    return launch_in_parts(range(3, 3 + count), step, make, keep, lambda *full: told.append(full)), parts, told


@pytest.mark.parametrize("error", [MemoryError(), RuntimeError("Failed to allocate 123 bytes on device 'cuda:0'")])
def test_parts_are_halved_until_they_fit(error: Exception) -> None:
    step, parts, told = run(11, 8, 3, error)
    assert (step, told) == (2, [(8, 4), (4, 2)])
    assert [number for part in parts for number in part] == list(range(3, 14))
    assert [len(part) for part in parts] == [2, 2, 2, 2, 2, 1]


def test_what_is_no_full_memory_is_raised() -> None:
    with pytest.raises(RuntimeError, match="illegal address"):
        run(4, 4, 1, RuntimeError("illegal address"))
    with pytest.raises(MemoryError):
        run(4, 4, 0, MemoryError())
