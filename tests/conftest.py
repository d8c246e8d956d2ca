"""Fixtures for every test."""

import pytest
import warp as wp

wp.config.log_level = wp.LOG_WARNING

DEVICES = ["cpu", *(["cuda:0"] if wp.get_cuda_device_count() else [])]


@pytest.fixture(params=DEVICES)
def device(request: pytest.FixtureRequest) -> str:
    """Name of a Warp device: the CPU always, the first GPU where there is one."""
    return request.param
