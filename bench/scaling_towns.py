"""Rays in towns of more and more triangles: procedural towns with more blocks, and one in finer and finer triangles.

A larger town shows what a larger map costs: a ray sees no more of it. Finer triangles show what detail costs: rays hit
the same places, in four times as many triangles each time.
"""

import argparse
import gc
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import warp as wp

from bench.rays import Preset, make_views, measure
from bench.scenes import grid_town, with_vehicles
from mmw.core.planar_surfaces import find_surfaces
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData

MAX_SURFACED = 1_000_000
"""Triangles up to which surfaces are found too: seconds on the host per million."""


@dataclass(frozen=True)
class TownPoint:
    """One town."""

    value: int
    """Triangles of the town."""
    rays_per_s: dict[str, float]
    """Kind of rays -> how many a second; town and vehicles, closest hit."""
    hit_share: dict[str, float]
    """Kind of rays -> share of them that hits something."""
    build_s: float
    """From arrays on the host to the scene on the device, trees included [s]."""
    device_gb: float | None
    """Device memory of the scene [GB]; None without a GPU."""
    surfaces_s: float | None
    """Processor time to find the surfaces, which only the radio channel needs [s]; None for a large town."""


def larger_towns(blocks: Sequence[int], frames: int) -> Iterator[SceneData]:
    """Yield towns with 40 vehicles in their middle.

    Args:
        blocks: Blocks of each town along x and along y.
        frames: Frames, in which the vehicles are at other places.
    """
    for count in blocks:
        yield with_vehicles(grid_town(count, with_surfaces=False), frames)


def finer_towns(steps: int, blocks: int, frames: int) -> Iterator[SceneData]:
    """Yield a town with 40 vehicles, and the same again and again with each triangle of the town cut into four.

    Args:
        steps: How many towns.
        blocks: Its blocks along x and along y.
        frames: Frames, in which the vehicles are at other places.
    """
    (town,) = larger_towns([blocks], frames)
    for step in range(steps):
        yield town
        if step + 1 < steps:
            town = subdivided(town)


def subdivided(town: SceneData) -> SceneData:
    """Return a town with each triangle cut into four at the middles of its sides; no vertex is shared."""
    a, b, c = np.moveaxis(town.points[town.faces], 1, 0)
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    corners = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1)
    faces = np.arange(corners.shape[0] * 12, dtype=np.int32).reshape(-1, 3)
    none = np.zeros((0, 3, 2), dtype=np.float32), np.zeros((0, 3, 3), dtype=np.float32)
    material, object_id, surface = (np.repeat(ids, 4) for ids in (town.material, town.object_id, town.surface))
    return replace(
        town, points=corners.reshape(-1, 3), faces=faces, material=material, object_id=object_id, surface=surface,
        uv=none[0], normals=none[1],
    )  # fmt: skip


def measure_town(town: SceneData, presets: Sequence[Preset], repeats: int, device: str) -> TownPoint:
    """Return what rays cost in a town with vehicles; all its frames go in one launch.

    Args:
        town: Town and vehicles.
        presets: Kinds of rays.
        repeats: Timed launches; the median counts.
        device: Warp device.
    """
    surfaces_s = None
    if len(town.faces) <= MAX_SURFACED:
        start = time.process_time()
        find_surfaces(town.points, town.faces, town.object_id, town.material)
        surfaces_s = time.process_time() - start
    frames = len(town.frames)
    gc.collect()
    wp.synchronize_device(device)
    before = device_bytes(device)
    start = time.perf_counter()
    scene = DeviceScene(town, device, frames)
    scene.load_batch(range(frames))
    wp.synchronize_device(device)
    build_s = time.perf_counter() - start
    after = device_bytes(device)
    options = argparse.Namespace(scene="grid", repeats=repeats, block_dim=64, sphere_arm=987)
    found = {
        preset.name: measure(scene, make_views(town, preset, device), preset, "two-level", options)
        for preset in presets
    }
    return TownPoint(
        len(town.faces),
        {name: 1e9 * result.grays_per_s for name, result in found.items()},
        {name: result.hit_share for name, result in found.items()},
        build_s,
        None if before is None or after is None else (after - before) / 1e9,
        surfaces_s,
    )


def device_bytes(device: str) -> int | None:
    """Return how much memory of a GPU is in use, by all processes [bytes]; None for the CPU."""
    found = wp.get_device(device)
    return found.total_memory - found.free_memory if found.is_cuda else None
