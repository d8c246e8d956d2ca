"""Choose some frames of many, and say so."""

import math


def sample_range(frames: range, max_count: int) -> range:
    """Return every n-th frame, so that there are no more than `max_count`."""
    return frames[:: max(1, math.ceil(len(frames) / max_count))]


def sampled(frames: range) -> str:
    """Return what a note says of it: every frame, or every 5th frame."""
    if frames.step == 1:
        return "every frame"
    ending = {1: "st", 2: "nd", 3: "rd"}.get(frames.step % 10 if frames.step // 10 % 10 != 1 else 0, "th")
    return f"every {frames.step}{ending} frame"
