"""Calls that are put off until their results are wanted."""

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from mmw.core.later import Later, start_all


def test_call_is_made_once_when_it_is_asked_for() -> None:
    made: list[int] = []
    with ThreadPoolExecutor(1) as pool:
        one = Later(pool, made.append, 3)
        assert made == [] and not one.done() and one.args == (3,)
        assert one.result() is None and one.result() is None
        one.start()
    assert made == [3]


def test_threads_make_started_calls_and_the_caller_waits_for_them() -> None:
    meeting = threading.Barrier(2, timeout=60.0)
    with ThreadPoolExecutor(2) as pool:
        both = [Later(pool, meeting.wait) for _ in range(2)]
        start_all([*both, "no call"])
        assert sorted(one.result() for one in both) == [0, 1]


def test_error_is_raised_where_the_result_is_asked_for() -> None:
    with ThreadPoolExecutor(1) as pool:
        one = Later(pool, int, "x")
        for _ in range(2):
            with pytest.raises(ValueError, match="invalid literal"):
                one.result()
