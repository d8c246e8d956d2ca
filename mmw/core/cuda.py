"""Call CUDA's driver where Warp has no function."""

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


def keep_memory(device: str, most_bytes: int) -> None:
    """Let this process keep device memory that its arrays free for the next ones.

    By default the pool of CUDA's driver gives it back whenever the host waits for the device, and the next array pays
    for it again: 208 RGB images on an H100 took 78 ms so and 53 ms with the memory kept (`bench/README.md`). Nothing
    changes on the CPU.

    Args:
        device: Warp device name.
        most_bytes: Memory to keep; what is free beyond it is given back.
    """
    if wp.get_device(device).is_cuda and wp.is_mempool_enabled(device):
        wp.set_mempool_release_threshold(device, most_bytes)
