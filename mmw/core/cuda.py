"""Call CUDA's driver where Warp has no function."""

import ctypes
import sys

import warp as wp

_BLOCKING_SYNC = 0x04
"""`CU_CTX_SCHED_BLOCKING_SYNC`: CUDA driver API, enum `CUctx_flags`."""


def use_blocking_sync(device: str) -> bool:
    """Let threads that wait for a GPU sleep; to be called before this process first uses the GPU.

    By default they poll as long as there are more cores than contexts (CUDA driver API, `CU_CTX_SCHED_AUTO`), and each
    occupies a core that encoders need. No effect on the CPU.

    Returns:
        Whether the driver supports it; otherwise runs are slower.
    """
    found = wp.get_device(device)
    if not found.is_cuda:
        return True
    driver = ctypes.CDLL("nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1")
    handle = ctypes.c_int()
    failed = driver.cuDeviceGet(ctypes.byref(handle), ctypes.c_int(found.ordinal))
    return not failed and not driver.cuDevicePrimaryCtxSetFlags_v2(handle, ctypes.c_uint(_BLOCKING_SYNC))


def retain_memory(device: str, max_bytes: int) -> None:
    """Reuse freed device memory of this process for new arrays.

    By default CUDA's memory pool returns freed memory to the driver whenever the host waits for the device, and the
    next array is allocated again: 208 RGB images on an H100 took 78 ms this way and 53 ms with retained memory
    (`bench/README.md`). No effect on the CPU.

    Args:
        device: Warp device name.
        max_bytes: Maximum free memory to retain [bytes]; more is returned to the driver.
    """
    if wp.get_device(device).is_cuda and wp.is_mempool_enabled(device):
        wp.set_mempool_release_threshold(device, max_bytes)
