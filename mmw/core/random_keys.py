"""Derive keys of counter-based random numbers from names, so that noise never depends on order or batches."""

import hashlib
from collections.abc import Iterable

import numpy as np

SEPARATOR = "\x1f"
"""Stands between the parts of the name of a stream."""


def stream_name(*parts: str | int) -> str:
    """Return the name of a stream from its parts, such as (seed, scenario, agent); a part may be such a name itself."""
    return SEPARATOR.join(map(str, parts))


def random_key(*parts: str | int) -> tuple[int, int]:
    """Return the 64-bit key of a stream as two 32-bit words, from the parts of its name.

    Source: BLAKE2b, RFC 7693.
    """
    low, high = stream_keys([stream_name(*parts)])[0].tolist()
    return low, high


def random_keys(parts: Iterable[tuple[str | int, ...]]) -> np.ndarray:
    """Return the keys of several streams for `mmw.kernels.core.noise`, shape [N, 2], uint32."""
    return stream_keys([stream_name(*part) for part in parts])


def stream_keys(names: Iterable[str]) -> np.ndarray:
    """Return the keys of streams by their names (`stream_name`), shape [N, 2], uint32; see `random_key`."""
    digests = [hashlib.blake2b(name.encode(), digest_size=8).digest() for name in names]
    return np.frombuffer(b"".join(digests), dtype="<u4").reshape(-1, 2).astype(np.uint32)
