"""Bytes without a trace: a guess from the radio paths of the shipped scenarios."""

from itertools import pairwise

from mmw.channel.path_solver.scatter_paths import KEPT_SHARE, UNEQUAL_STRENGTHS
from mmw.config import load_config
from mmw.generation.estimate import GAIN_BYTES, GEOMETRY_BYTES, frame_cost

COUNTS = {"cav": 1, "rsu": 1, "vehicles": 1, "boxes": 0}


def paths(*changes: str) -> float:
    """Return how many more paths a link has than with the preset `paper`, at one carrier, in one weather."""
    sizes = []
    for own in ((), changes):
        fixed = ("sensors=[]", "weathers=[sunny]", "channel.carriers_hz=[28e9]", "channel.links=[v2i]")
        config = load_config("town03_roundabout", [*fixed, *own])
        sizes.append(frame_cost(config, COUNTS, config.scenarios[0])[1])
    return (sizes[1] - sizes[0]) / (GAIN_BYTES + GEOMETRY_BYTES)


def test_a_smaller_dynamic_range_leaves_fewer_paths() -> None:
    ranges = ("null", "80", "60", "40", "20")
    for depth in (1, 2, 3):
        given = ("channel.physics=standard", f"channel.max_depth={depth}")
        found = [paths(*given, f"channel.dynamic_range_db={value}") for value in ranges]
        assert all(one >= other > 0 for one, other in pairwise(found)), (depth, found)
    assert paths("channel.physics=standard", "channel.max_depth=0") == 0


def test_a_larger_error_leaves_fewer_diffuse_paths() -> None:
    """A link keeps at most so many, whatever its depth; without mirrors and edges there are no others."""
    sizes = []
    for error_db in (0.1, 0.5, 3.0):
        given = ("channel.diffuse_reflection=true", f"channel.diffuse_error_db={error_db}")
        most = KEPT_SHARE * UNEQUAL_STRENGTHS / (10.0 ** (error_db / 10.0) - 1.0) ** 2
        found = [paths(*given, f"channel.max_depth={depth}") for depth in (1, 8)]
        assert 0 < found[0] <= found[1] <= most + 7  # one more mirror reflection for each order
        sizes.append(found[1])
    assert sizes[0] > 10 * sizes[1] > 100 * sizes[2]
