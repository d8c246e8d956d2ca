"""Derive keys of counter-based random numbers from names, so that noise never depends on order or batches."""

import hashlib
from collections.abc import Iterable

import numpy as np


def random_key(*parts: str | int) -> tuple[int, int]:
    """Return the 64-bit key of a stream as two 32-bit words, from its name, such as (seed, scenario, agent).

    Source: BLAKE2b, RFC 7693.
    """
    digest = hashlib.blake2b("\x1f".join(map(str, parts)).encode(), digest_size=8).digest()
    return int.from_bytes(digest[:4], "little"), int.from_bytes(digest[4:], "little")


def random_keys(parts: Iterable[tuple[str | int, ...]]) -> np.ndarray:
    """Return the keys of several streams for `mmw.kernels.core.noise`, shape [N, 2], uint32."""
    return np.array([random_key(*part) for part in parts], dtype=np.uint32).reshape(-1, 2)
