"""Mutate bytes, text, trees of values and XML; every choice is drawn from a seeded generator."""

import copy
import json
import random
import re
from collections.abc import Callable, Sequence
from typing import Any

NUMBERS = (
    "nan", "inf", "-inf", "1e999", "-1e308", "1e38", "1e300", "1e-300", "0", "-0.0", "-1", "1", "2", "0.5",
    "1e6", "1e9",
    "1e12", "2147483647", "2147483648", "-2147483649", "4294967296", "9223372036854775808", "9" * 60, "9" * 500, "0x10",
    "1_000", "٣", "1,5", "", "abc",
)  # fmt: skip
"""Numbers as text, and what stands where a number should."""

VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2, 7, 0.5, -0.0, 1e-300, 1e38, 1e300, -1e308, 10**9, 2**31, 2**63, 10**30,
    float("nan"), float("inf"), float("-inf"), "", " ", "a", "nan", "1", "../../x", "/", "a/b", "x" * 300,
    "é\u200b\U0001f697",
    "$x", "%s{}", [], [0], [None], [[]], [1, 2, 3], [float("nan")] * 3, [1e300] * 3, {}, {"": 1}, {"a": {}},
    {"type": "lidar"},
    [{}], list(range(50)),
)  # fmt: skip
"""Values that a configuration or a JSON file should not have, and some that it may."""

_NUMBER = re.compile(r"(?<![A-Za-z_])[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_ATTRIBUTE = re.compile(r'(?<==")[^"]*(?=")')


def mutate_bytes(rng: random.Random, data: bytes) -> bytes:
    """Return bytes with some flipped, removed, repeated or inserted."""
    for _ in range(rng.choice((1, 1, 2, 4, 16))):
        size = len(data)
        at = rng.randrange(size + 1)
        end = min(size, at + rng.choice((1, 2, 4, 8, 64, 512)))
        piece = data[at:end]
        new = rng.choice(
            (
                bytes(byte ^ (1 << rng.randrange(8)) for byte in piece),
                b"",
                piece * 2,
                rng.randbytes(len(piece)),
                rng.choice((b"\x00", b"\xff")) * len(piece),
                rng.randbytes(4) + piece,
            )
        )
        data = data[:at] + new + data[end:]
        if rng.random() < 0.05:
            data = data[: rng.randrange(len(data) + 1)]
    return data


def mutate_text(rng: random.Random, text: str) -> str:
    """Return text with numbers, words, attributes, lines or characters changed."""
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        text = rng.choice(_TEXT_CHANGES)(rng, text)
    return text


def _change_match(pattern: re.Pattern[str], choose: Callable[[random.Random, str], str]) -> Callable:
    def change(rng: random.Random, text: str) -> str:
        found = list(pattern.finditer(text))
        if not found:
            return text
        match = rng.choice(found)
        return text[: match.start()] + choose(rng, match[0]) + text[match.end() :]

    return change


def _number(rng: random.Random, old: str) -> str:
    return rng.choice((rng.choice(NUMBERS), f"-{old}", f"{old}0000", f"{old}e9", f"{old}e-9"))


def _word(rng: random.Random, old: str) -> str:
    return rng.choice(("", old * 2, old[::-1], old.swapcase(), "null", "x", "../x", "é", "def", "true"))


def _attribute(rng: random.Random, old: str) -> str:
    return rng.choice((*NUMBERS, "", f"{old} {old}", f"-{old}", f"{old}{old}", "$x", "../../x", "&amp;"))


def _lines(rng: random.Random, text: str) -> str:
    lines = text.splitlines(keepends=True)
    if not lines:
        return text
    at = rng.randrange(len(lines))
    end = min(len(lines), at + rng.choice((1, 1, 2, 5, 20)))
    block = lines[at:end]
    new = rng.choice(([], block * 2, block * 20, block[::-1], [rng.choice(lines)]))
    return "".join(lines[:at] + new + lines[end:])


def _characters(rng: random.Random, text: str) -> str:
    at = rng.randrange(len(text) + 1)
    new = rng.choice(
        ('"', "'", "<", ">", "{", "}", "[", "]", "(", ")", ":", ",", "&", "#", "\n", "\t", "\x00", "\ufeff")
    )
    return text[:at] + new + text[at + rng.randrange(2) :]


def _repeat(rng: random.Random, text: str) -> str:
    """Open something many times, and maybe close it: deep nesting."""
    start, end = rng.choice(
        (("[", "]"), ("{a: ", "}"), ("(", ")"), ("<a>", "</a>"), ("<shape type='merge'>", "</shape>"))
    )
    count, at = rng.choice((50, 500, 5_000, 50_000)), rng.randrange(len(text) + 1)
    return text[:at] + start * count + rng.choice(("", end * count)) + text[at:]


_TEXT_CHANGES: tuple[Callable[[random.Random, str], str], ...] = (
    *(_change_match(_NUMBER, _number),) * 8,
    *(_change_match(_WORD, _word),) * 4,
    *(_change_match(_ATTRIBUTE, _attribute),) * 6,
    *(_lines,) * 5,
    *(_characters,) * 3,
    _repeat,
)


def mutate_tree(rng: random.Random, tree: Any, values: Sequence[Any] = VALUES) -> Any:
    """Return a tree of lists and maps with some values replaced, removed, repeated, renamed or nested; in place."""
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        places = list(_places(tree))
        if not places:
            return copy.deepcopy(rng.choice(values))
        holder, key = rng.choice(places)
        kind = rng.random()
        if kind < 0.6:
            holder[key] = copy.deepcopy(rng.choice(values))  # else later changes reach the values, and other cases
        elif kind < 0.7 and isinstance(holder[key], int | float):
            holder[key] = holder[key] * rng.choice((-1, 1e-9, 1e3, 1e6, 1e12))
        elif kind < 0.8:
            del holder[key]
        elif kind < 0.87 and isinstance(holder, dict):
            holder[str(key) + rng.choice(("_", "é", "", "s"))] = holder.pop(key)
        elif kind < 0.94:
            other, at = rng.choice(places)
            holder[key] = json.loads(json.dumps(other[at])) if at in _keys(other) else None
        else:
            holder[key] = rng.choice(([holder[key]], {"a": holder[key]}, [holder[key]] * 3, str(holder[key])))
    return tree


def _keys(holder: Any) -> Any:
    return holder if isinstance(holder, dict) else range(len(holder))


def _places(tree: Any) -> list[tuple[Any, Any]]:
    found, todo = [], [tree]
    while todo:
        holder = todo.pop()
        if isinstance(holder, dict | list):
            keys = list(holder) if isinstance(holder, dict) else list(range(len(holder)))
            found += [(holder, key) for key in keys]
            todo += [holder[key] for key in keys]
    return found
