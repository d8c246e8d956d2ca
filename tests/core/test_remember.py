"""Results that are remembered by the objects that they follow from."""

import pytest

from mmw.core.remember import remembered


def test_result_is_made_once_for_an_object_and_its_further_arguments() -> None:
    made: list[tuple[list[int], str]] = []

    @remembered()
    def first(values: list[int], name: str) -> int:
        """Return the first number."""
        made.append((values, name))
        return values[0]

    one, equal = [1], [1]
    assert [first(one, "a"), first(one, "a"), first(one, "b"), first(equal, "a")] == [1, 1, 1, 1]
    assert made == [(one, "a"), (one, "b"), (equal, "a")]
    assert first.__doc__ == "Return the first number."


def test_oldest_result_goes_first_and_another_object_is_never_taken_for_it() -> None:
    count = [0]

    @remembered(size=2)
    def number(_: list[int]) -> int:
        count[0] += 1
        return count[0]

    kept = [[k] for k in range(3)]
    assert [number(values) for values in kept] == [1, 2, 3]
    assert [number(kept[2]), number(kept[1]), number(kept[0])] == [3, 2, 4]
    for _ in range(100):  # lists that are freed at once may have the same address
        before = count[0]
        assert number([0]) == before + 1


def test_keywords_are_refused_as_they_are_no_part_of_the_key() -> None:
    @remembered()
    def scaled(values: list[int], factor: int) -> list[int]:
        return [factor * value for value in values]

    with pytest.raises(TypeError, match=r"scaled\(\) takes no keywords: factor; give them by position"):
        scaled([1], factor=2)
