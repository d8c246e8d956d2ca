"""Group cameras into launches: all RGB cameras of equal settings, and the depth cameras of the same views."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from mmw.core.camera_models import Intrinsics
from mmw.core.recorded_work import Work
from mmw.core.remember import remembered
from mmw.core.transfer import numpy_type
from mmw.kernels.shading import structs as shading
from mmw.scene.device_scene import DeviceScene
from mmw.scene.views import Views, join_views
from mmw.sensors.depth.config import DepthCamera
from mmw.sensors.render.projection import intrinsics_of
from mmw.sensors.render.visibility_buffer import SampleBuffer, trace_samples
from mmw.sensors.rgb.config import RgbCamera

OWN_KEYS = {"name", "on", "mount"}
"""Keys of an RGB camera that may differ within a launch."""

MAX_PIXELS = 32_000_000
"""Pixels of a launch at most: 104 images of 640 x 480, which keep a large GPU busy. Twice as many are no faster and
need twice the memory (`bench/README.md`)."""

BYTES_PER_PIXEL = 1_600
"""Device memory for each pixel of a launch [bytes]: eight times the size of its samples, light and colors, so that
there is room for the scene and everything else. Design value."""

MAX_PIXELS_CPU = 2_000_000
"""The same on a CPU: six images. Design value."""

TRACED_RANGE = 1.001
"""Length of rays over the range of the camera [-]: whether a surface is in range is decided by its depth alone, so that
an image does not depend on which cameras share its rays. Design value."""

Camera = RgbCamera | DepthCamera


@dataclass(frozen=True)
class LaunchCamera:
    """One camera in a launch."""

    sensor: Camera
    rows: np.ndarray
    """Rows of the launch's views that are this camera's, shape [n]."""


@dataclass(frozen=True)
class Launch:
    """Views that are traced together."""

    views: Views
    intrinsics: Intrinsics
    cameras: tuple[LaunchCamera, ...]

    @property
    def pixels(self) -> int:
        """Pixels of all views."""
        return len(self.views) * self.intrinsics.width * self.intrinsics.height

    @property
    def name(self) -> str:
        """Names of its cameras."""
        return ", ".join(camera.sensor.name for camera in self.cameras)

    @property
    def range_m(self) -> float:
        """Longest depth of any of its cameras [m]."""
        return max(camera.sensor.range_m for camera in self.cameras)

    @property
    def rgb(self) -> tuple[LaunchCamera, ...]:
        """Its RGB cameras, which have equal settings."""
        return tuple(camera for camera in self.cameras if isinstance(camera.sensor, RgbCamera))

    @property
    def depth(self) -> tuple[LaunchCamera, ...]:
        """Its depth cameras."""
        return tuple(camera for camera in self.cameras if isinstance(camera.sensor, DepthCamera))

    def views_of(self, camera: LaunchCamera) -> Views:
        """Return the views of one of its cameras."""
        return self._parts[id(camera)]

    @cached_property
    def _parts(self) -> dict[int, Views]:
        return {id(camera): self.views.take(camera.rows) for camera in self.cameras}

    def pieces(self, max_pixels: int) -> Iterator["Launch"]:
        """Yield the launch in pieces of at most so many pixels, or of one view; one piece where there is no view."""
        step = max(max_pixels // (self.intrinsics.width * self.intrinsics.height), 1)
        if len(self.views) <= step:
            yield self
            return
        for begin in range(0, len(self.views), step):
            end = begin + step
            own = tuple(
                LaunchCamera(camera.sensor, camera.rows[(camera.rows >= begin) & (camera.rows < end)] - begin)
                for camera in self.cameras
            )
            yield Launch(self.views.take(slice(begin, end)), self.intrinsics, own)


def trace_launch(
    scene: DeviceScene,
    launch: Launch,
    alpha_cutouts: "shading.AppearanceTable | None",
    **options: Any,
) -> SampleBuffer:
    """Trace the pixels of a launch; see `trace_samples`, which takes the options."""
    range_m = TRACED_RANGE * launch.range_m
    return trace_samples(scene, launch.views, launch.intrinsics, range_m, alpha_cutouts, **options)


def images_of(work: Work, images: wp.array, camera: LaunchCamera) -> np.ndarray:
    """Return one camera's images of those of a launch, on the host, where they stay."""
    rows = camera.rows
    if not len(rows):
        kind, element = numpy_type(images)
        return np.empty((0, *images.shape[1:], *element), dtype=kind)
    begin, end = int(rows.min()), int(rows.max()) + 1
    (found,) = work.to_host([images[begin:end]])
    return found if np.array_equal(rows, np.arange(begin, end)) else found[rows - begin]


def single_launches(camera: Camera, views: Views, device: str) -> Iterator[Launch]:
    """Yield the launches of one camera alone, each as large as a device has memory for."""
    whole = Launch(views, intrinsics_of(camera), (LaunchCamera(camera, np.arange(len(views))),))
    yield from whole.pieces(max_pixels(device))


def max_pixels(device: str) -> int:
    """Return the pixels of a launch that a device has memory for."""
    found = wp.get_device(device)
    return min(MAX_PIXELS, found.total_memory // BYTES_PER_PIXEL) if found.is_cuda else MAX_PIXELS_CPU


def make_launches(cameras: Sequence[Camera], views_of: Callable[[Camera], Views]) -> list[Launch]:
    """Return the launches that cameras need in a batch of frames.

    RGB cameras of equal settings share one; a depth camera joins the first launch of the same intrinsics that has all
    its views, and has its own where there is none. How cameras are grouped changes no pixel.

    Args:
        cameras: The cameras.
        views_of: Returns the views of a camera in the batch.
    """
    launches: list[Launch] = []
    for group in _groups([camera for camera in cameras if isinstance(camera, RgbCamera)]):
        parts = [views_of(camera) for camera in group]
        ends = np.cumsum([len(part) for part in parts])
        own = tuple(
            LaunchCamera(camera, np.arange(end - len(part), end))
            for camera, part, end in zip(group, parts, ends, strict=True)
        )
        launches.append(Launch(join_views(parts), intrinsics_of(group[0]), own))
    for camera in cameras:
        if isinstance(camera, DepthCamera):
            _join(launches, camera, views_of(camera))
    return [_sorted(launch) for launch in launches]


def _groups(cameras: Sequence[RgbCamera]) -> list[list[RgbCamera]]:
    """Return the cameras by their settings, in the order of the first of each."""
    groups: dict[str, list[RgbCamera]] = {}
    for camera in cameras:
        groups.setdefault(settings_of(camera), []).append(camera)
    return list(groups.values())


@remembered()
def settings_of(camera: RgbCamera) -> str:
    """Return the keys that are equal within a launch, as text."""
    return camera.model_dump_json(exclude=OWN_KEYS)


def _join(launches: list[Launch], camera: DepthCamera, views: Views) -> None:
    """Add a depth camera to the launch that sees what it sees, or to the list."""
    intrinsics, wanted = intrinsics_of(camera), _names(views)
    for index, launch in enumerate(launches):
        row_of = {name: row for row, name in enumerate(_names(launch.views))}
        if launch.intrinsics == intrinsics and all(name in row_of for name in wanted):
            joined = LaunchCamera(camera, np.array([row_of[name] for name in wanted], dtype=np.int64))
            launches[index] = replace(launch, cameras=(*launch.cameras, joined))
            return
    launches.append(Launch(views, intrinsics, (LaunchCamera(camera, np.arange(len(views))),)))


def _names(views: Views) -> list[bytes]:
    """Return the key that distinguishes two views."""
    bits = np.ascontiguousarray(views.pose, dtype=np.float64).view(np.int64)
    key = np.column_stack([views.frame, views.ignore_instance, bits])
    return key.view(f"V{key.itemsize * key.shape[1]}")[:, 0].tolist()


def _sorted(launch: Launch) -> Launch:
    """Return the launch with the views of its depth cameras first, so that their images are one piece of memory."""
    is_last = np.ones(len(launch.views), dtype=bool)
    for camera in launch.depth:
        is_last[camera.rows] = False
    order = np.argsort(is_last, kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    own = tuple(LaunchCamera(camera.sensor, place[camera.rows]) for camera in launch.cameras)
    return Launch(launch.views.take(order), launch.intrinsics, own)
