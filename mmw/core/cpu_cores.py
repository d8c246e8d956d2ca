"""Count processor cores, and limit the threads of libraries in workers."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

LIBRARY_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""Environment variables that set the number of threads of the libraries below NumPy."""


def cores() -> int:
    """Return the number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def single_threaded_libraries() -> Iterator[None]:
    """Let processes that start within the block do linear algebra on the calling thread.

    Workers share the cores; each would start a thread per core, and OpenBLAS's threads spin for a while after a call.
    Variables that the user has set do not change.
    """
    missing = [name for name in LIBRARY_THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(missing, "1"))
    try:
        yield
    finally:
        for name in missing:
            del os.environ[name]
