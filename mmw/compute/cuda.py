"""What Warp leaves to CUDA's driver."""

import ctypes
import sys

import warp as wp

_BLOCKING_SYNC = 0x04
"""`CU_CTX_SCHED_BLOCKING_SYNC`: CUDA driver API, enum `CUctx_flags`."""


def wait_asleep(device: str) -> bool:
    """Let threads of this process that wait for a GPU sleep, before the process first uses it.

    By default they poll as long as there are more cores than contexts (CUDA driver API, `CU_CTX_SCHED_AUTO`), and take
    a core each from the threads that encode. Nothing changes on the CPU.

    Args:
        device: Warp device name.

    Returns:
        Whether the driver did it; where not, runs are slower.
    """
    found = wp.get_device(device)
    if not found.is_cuda:
        return True
    driver = ctypes.CDLL("nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1")
    handle = ctypes.c_int()
    failed = driver.cuDeviceGet(ctypes.byref(handle), ctypes.c_int(found.ordinal))
    return not failed and not driver.cuDevicePrimaryCtxSetFlags_v2(handle, ctypes.c_uint(_BLOCKING_SYNC))
