"""Check the limit of address space, before libraries are loaded that crash where it is too small."""

import sys

MIN_BYTES = 1_000_000_000
"""Address space that a command needs to import its libraries [bytes]. Measured: `mmw status` takes 0.9 GB on two cores;
with less, OpenBLAS and pyarrow end the process with a segmentation fault."""

MIN_TRACING_BYTES = 3_000_000_000
"""The same for a command that traces rays on a CPU [bytes]. Measured: the smallest run works with 3.0 GB on two cores;
with 2.5 GB libraries abort (`std::bad_alloc`), with 1.5 GB Warp cannot be loaded."""

TRACING = ("run", "regenerate", "radiomap", "render")
"""Commands that always trace rays."""


def address_space_problem(command: str) -> str | None:
    """Return why a command cannot work within the address space of this process; None if it can, or nobody knows."""
    if sys.platform == "win32":
        return None
    import resource

    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    needed = MIN_TRACING_BYTES if command in TRACING else MIN_BYTES
    if limit == resource.RLIM_INFINITY or limit >= needed:
        return None
    return (
        f"the address space is limited to {limit / 1e9:.2f} GB (ulimit -v); mmw {command} needs {needed / 1e9:.0f} GB "
        "or more; raise the limit (ulimit -v unlimited), and limit memory by a cgroup instead"
    )
