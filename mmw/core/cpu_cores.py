"""How many processor cores there are, and how many threads the libraries of a worker start."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

LIBRARY_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""Environment variables by which the libraries below NumPy are told how many threads to start."""


def cores() -> int:
    """Return the processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def one_thread_a_library() -> Iterator[None]:
    """Let processes that start within the block do linear algebra on the thread that asks for it.

    Workers share the cores; each would start a thread for every core, and OpenBLAS's spin for some ms after each call.
    What the user has set stays.
    """
    missing = [name for name in LIBRARY_THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(missing, "1"))
    try:
        yield
    finally:
        for name in missing:
            del os.environ[name]
