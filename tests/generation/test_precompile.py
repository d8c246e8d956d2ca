"""Kernels that are compiled ahead of a run: those that it launches, and no others."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from filelock import Timeout

from mmw.channel.path_solver.surface_table import group_coplanar
from mmw.config import Config, load_config
from mmw.core.resources import configs_dir
from mmw.generation import precompile
from mmw.generation.precompile import (
    BLOCKS,
    HOST_MODULES,
    SENSORS_ON_HOST,
    compiled_ahead,
    kernel_cache,
    lock_name,
    needed_modules,
)
from mmw.storage.lock import exclusive_lock

KERNELS = Path(__file__).parents[2] / "kernels"
ALWAYS = {"core.instance_bounds", "core.line_of_sight", "core.trace"}
"""Modules that every run needs."""


def config_with(*overrides: str) -> Config:
    return load_config(configs_dir() / "quickstart.yaml", overrides, {})


def test_what_is_needed_follows_the_sensors() -> None:
    lidar = needed_modules(config_with("sensors=[{type: lidar}]", "channel.enabled=false"))
    assert set(lidar) == {*ALWAYS, "lidar.trace", "lidar.returns"}
    radar = needed_modules(config_with("sensors=[{type: radar}]", "channel.enabled=false"))
    on_host = {"radar.thresholds", "radar.estimates"}
    assert set(radar) == {*ALWAYS, "radar.trace", "radar.resolution_cells", *on_host}
    paths = needed_modules(config_with("sensors=[{type: radar, multipath: full}]", "channel.enabled=false"))
    assert set(paths) - set(radar) == {"radar.bounce_paths", "radar.echo_paths", "radar.path_sums"}
    carla = needed_modules(config_with("sensors=[{type: radar, mode: carla}]", "channel.enabled=false"))
    assert set(carla) == {*ALWAYS, "radar.trace"}
    assert {"channel.image_method", "channel.reflection_candidates"} < set(
        needed_modules(config_with("sensors=[{type: imu}]"))
    )
    imu = needed_modules(config_with("sensors=[{type: imu}]", "channel.enabled=false"))
    assert set(imu) == {*ALWAYS, "navigation.imu"}
    gnss = needed_modules(config_with("sensors=[{type: gnss, mode: physical}]", "channel.enabled=false"))
    assert set(gnss) == {*ALWAYS, "navigation.gnss", "core.random_series"}
    assert {*imu, *gnss, *on_host} - ALWAYS == SENSORS_ON_HOST
    everything = needed_modules(config_with())
    assert all((KERNELS / f"{name.replace('.', '/')}.py").is_file() for name in everything)
    assert len(set(everything)) == len(everything)


def test_files_that_cast_rays_are_compiled_for_small_blocks_alone() -> None:
    """With Warp's trees 256 threads keep 64 KiB of stacks in shared memory, more than a block of CUDA may have."""
    asks = {
        ".".join(path.relative_to(KERNELS).with_suffix("").parts)
        for path in KERNELS.rglob("*.py")
        if "mmw.kernels.core.trace import" in path.read_text()
    }
    asks |= {"core.trace", "channel.image_method"}  # of which the latter asks through `kernels/channel/segments.py`
    radars = config_with("sensors=[{type: radar, multipath: full}]")
    needed = asks & {*needed_modules(config_with()), *needed_modules(radars)}
    assert {
        "core.trace",
        "radar.bounce_paths",
        "radar.trace",
        "lidar.trace",
        "core.line_of_sight",
        "camera.visibility",
        "shading.reflections",
        "shading.shadows",
        "channel.image_method",
    } <= needed
    assert {BLOCKS.get(name) for name in needed} == {(64,)}


def test_modules_are_loaded_when_the_futures_are_done() -> None:
    config = config_with("sensors=[{type: imu}]", "channel.enabled=false")
    with (
        exclusive_lock(kernel_cache(), lock_name("core.line_of_sight", None)),
        compiled_ahead(config, "cpu") as futures,
    ):
        time.sleep(0.5)
        assert not all(future.done() for future in futures)  # another worker seems to compile one
    with compiled_ahead(config, "cpu") as futures:
        assert {future.result() for future in futures} == {None}
    for name in ("core.trace", "core.line_of_sight", "core.instance_bounds", *HOST_MODULES, "navigation.imu"):
        assert wp.get_module(f"mmw.kernels.{name}").execs, name


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_surfaces_of_one_plane_are_one_group(side: float) -> None:
    normal = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, side], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    offset = np.array([2.0, 2.0 * side, 2.0, 2.0, 2.01])
    lower = np.array([[0, 0, 2], [5, 0, 2], [2, 0, 0], [9, 0, 2], [0, 0, 2.01]], dtype=np.float64)
    upper = lower + np.where(np.abs(normal) > 0.5, 0.0, 1.0)
    group = group_coplanar(normal, offset, lower, upper, np.ones(5), np.array([0, 0, 0, 1, 0]))
    assert group[0] == group[1] and len(np.unique(group)) == 4


def test_compilers_end_while_one_is_at_a_module_that_another_worker_compiles(monkeypatch: pytest.MonkeyPatch) -> None:
    """The end comes between taking the module and giving it back; a thread that goes on would wait for the other."""
    taken, ending = threading.Event(), threading.Event()

    @contextmanager
    def held(*_: object, **__: object) -> Iterator[None]:
        taken.set()
        assert ending.wait(20.0)
        raise Timeout("another worker")
        yield

    def run() -> None:
        with compiled_ahead(config_with("sensors=[{type: imu}]", "channel.enabled=false"), "cpu"):
            assert taken.wait(20.0)
            threading.Timer(0.3, ending.set).start()

    monkeypatch.setattr(precompile, "exclusive_lock", held)
    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(30.0)
    assert not thread.is_alive()
