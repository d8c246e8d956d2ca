"""Name the kind of processor, as far as the bits of results depend on it."""

import platform
from functools import cache
from pathlib import Path

SIMD = (
    ("AVX-512", {"avx512f", "avx512bw", "avx512dq", "avx512vl"}),
    ("AVX2", {"avx2", "fma"}),
    ("AVX", {"avx"}),
    ("SSE4.2", {"sse4_2"}),
    ("SVE", {"sve"}),
    ("NEON", {"asimd"}),
)
"""Level -> required flags of Linux, widest first: those that NumPy, the C library and the kernels' compiler query."""

NUMBERS = {"cpu family": "family", "model": "model", "CPU implementer": "implementer", "CPU part": "part"}
"""Key of Linux's `cpuinfo` -> its label; several models may share a name."""

CPU_INFO = Path("/proc/cpuinfo")


@cache
def cpu_kind() -> str:
    """Return model and SIMD level, such as `AMD EPYC (family 25, model 17, AVX-512)`.

    Two machines of one kind give the same bits. The number of cores is not a part of it: no result depends on it.
    """
    try:
        text = CPU_INFO.read_text()
    except OSError:  # not Linux
        text = ""
    return parse_cpu_info(text) or platform.processor() or platform.machine()


def parse_cpu_info(info: str) -> str:
    """Return model and SIMD level of the first processor in Linux's `cpuinfo`; empty if it lists none."""
    first = info.strip().partition("\n\n")[0]
    rows = {name.strip(): value.strip() for name, _, value in (line.partition(":") for line in first.splitlines())}
    flags = set((rows.get("flags") or rows.get("Features") or "").split())
    level = next((name for name, needed in SIMD if needed <= flags), "")
    numbers = [f"{name} {rows[key]}" for key, name in NUMBERS.items() if key in rows]
    name = rows.get("model name") or (platform.machine() if numbers else "")
    details = ", ".join([*numbers, *([level] if level else [])])
    return f"{name} ({details})" if name and details else name
