"""Group cameras into launches: all RGB cameras of equal settings, and the depth cameras of the same views."""

from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

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

T = TypeVar("T")

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
    kept: dict[str, Any] = field(default_factory=dict, compare=False, repr=False)
    """Values that follow from its cameras and their agents, by name; launches of other frames (`at`) share them."""

    def at(self, frame: np.ndarray, pose: np.ndarray) -> "Launch":
        """Return the launch of the same cameras on the same agents in other frames, see `Views`."""
        views = replace(self.views, frame=frame, pose=pose)
        return Launch(views, self.intrinsics, self.cameras, self.kept)

    def recall(self, name: str, make: Callable[[], T]) -> T:
        """Return what follows from its cameras and their agents, made once for all frames."""
        if name not in self.kept:
            self.kept[name] = make()
        return self.kept[name]

    @property
    def pixels(self) -> int:
        """Pixels of all views."""
        return len(self.views) * self.intrinsics.width * self.intrinsics.height

    @property
    def name(self) -> str:
        """Names of its cameras."""
        return self.recall("name", lambda: ", ".join(camera.sensor.name for camera in self.cameras))

    @property
    def range_m(self) -> float:
        """Longest depth of any of its cameras [m]."""
        return self.recall("range", lambda: max(camera.sensor.range_m for camera in self.cameras))

    @property
    def rgb(self) -> tuple[LaunchCamera, ...]:
        """Its RGB cameras, which have equal settings."""
        return self.recall("rgb", lambda: tuple(one for one in self.cameras if isinstance(one.sensor, RgbCamera)))

    @property
    def depth(self) -> tuple[LaunchCamera, ...]:
        """Its depth cameras."""
        return self.recall("depth", lambda: tuple(one for one in self.cameras if isinstance(one.sensor, DepthCamera)))

    @property
    def rgb_config(self) -> RgbCamera | None:
        """Settings of its RGB cameras; None without any."""
        sensors = (camera.sensor for camera in self.cameras)
        return self.recall("config", lambda: next((one for one in sensors if isinstance(one, RgbCamera)), None))

    def views_of(self, camera: LaunchCamera) -> Views:
        """Return the views of one of its cameras."""
        return self.views.take(camera.rows)

    def pieces(self, max_pixels: int) -> Iterator["Launch"]:
        """Yield the launch in pieces of at most so many pixels, or of one view; one piece where there is no view."""
        for _, piece in self.parts(max_pixels):
            yield piece

    def parts(self, max_pixels: int) -> Iterator[tuple[slice, "Launch"]]:
        """Yield the rows of each of the `pieces`, and the piece."""
        step = max(max_pixels // (self.intrinsics.width * self.intrinsics.height), 1)
        if len(self.views) <= step:
            yield slice(None), self
            return
        for begin in range(0, len(self.views), step):
            end = begin + step
            own = tuple(
                LaunchCamera(camera.sensor, camera.rows[(camera.rows >= begin) & (camera.rows < end)] - begin)
                for camera in self.cameras
            )
            yield slice(begin, end), Launch(self.views.take(slice(begin, end)), self.intrinsics, own)


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
    (found,) = work.to_host([images[part_of(camera)]])
    return own_images(found, camera)


def part_of(camera: LaunchCamera) -> slice:
    """Return the part of the views of a launch that has all views of one of its cameras, which has some."""
    return slice(int(camera.rows.min()), int(camera.rows.max()) + 1)


def own_images(found: np.ndarray, camera: LaunchCamera) -> np.ndarray:
    """Return one camera's images of those of its part of a launch."""
    rows = camera.rows - camera.rows.min()
    return found if np.array_equal(rows, np.arange(len(found))) else found[rows]


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
    parts = [views_of(camera) for camera in cameras]
    every = join_views(parts)
    return [Launch(every.take(one.rows), one.intrinsics, one.cameras) for one in _grouped(cameras, parts, every)]


KEPT_LAYOUTS = 16
"""Sets of cameras and agents of which launches are kept; design value."""


class KeptLaunches:
    """Launches of cameras in pieces; what follows from cameras and agents is kept while both stay the same."""

    def __init__(self) -> None:
        """Hold none yet."""
        self._known: OrderedDict[tuple[int, ...], _Layout] = OrderedDict()

    def pieces(self, cameras: Sequence[Camera], parts: Sequence[Views], max_pixels: int) -> list[list[Launch]]:
        """Return the pieces of each of `make_launches`.

        Args:
            cameras: The cameras.
            parts: Their views; they have the same agents where they have the same arrays of agents and places in the
                batch, as those of `mmw.scene.views.SensorViews`.
            max_pixels: Most pixels of a piece.
        """
        key = max_pixels, *map(id, cameras), *(id(array) for own in parts for array in (own.actor, own.batch_index))
        frame, pose = (np.concatenate([getattr(own, name) for own in parts]) for name in ("frame", "pose"))
        layout = self._known.get(key)
        if layout is None or not layout.fits(pose):
            layout = self._known[key] = _layout(cameras, parts, max_pixels)
            while len(self._known) > KEPT_LAYOUTS:
                self._known.popitem(last=False)
        return [[piece.at(frame[rows], pose[rows]) for rows, piece in own] for own in layout.pieces]


@dataclass(frozen=True)
class _Layout:
    """Launches of some cameras with views of some agents."""

    owners: Any
    """Objects that the key of the layout names by their identity, so that they stay."""
    groups: list["_Group"]
    pieces: list[list[tuple[np.ndarray, Launch]]]
    """Rows of the views of each piece among those of all cameras, and a launch of its cameras."""

    def fits(self, pose: np.ndarray) -> bool:
        """Return whether depth cameras still see what the cameras see whose launches they have joined.

        `pose` are the poses of the views of all cameras, shape [n, 7].
        """
        return all(np.array_equal(pose[one.own], pose[one.shared]) for one in self.groups if len(one.own))


def _layout(cameras: Sequence[Camera], parts: Sequence[Views], max_pixels: int) -> _Layout:
    """Return the launches of cameras, see `KeptLaunches.pieces`."""
    every = join_views(parts)
    layout = _Layout((tuple(cameras), tuple(parts)), _grouped(cameras, parts, every), [])
    for one in layout.groups:
        whole = Launch(every.take(one.rows), one.intrinsics, one.cameras)
        layout.pieces.append([(one.rows[own], piece) for own, piece in whole.parts(max_pixels)])
    return layout


@dataclass(frozen=True)
class _Group:
    """Cameras of a launch; rows are those of the views of all cameras, one camera after the other."""

    rows: np.ndarray
    """Rows of its views, shape [A]."""
    intrinsics: Intrinsics
    cameras: tuple[LaunchCamera, ...]
    own: np.ndarray
    """Rows of the views of depth cameras that have joined, shape [n]."""
    shared: np.ndarray
    """Rows of the views that are traced for these, shape [n]."""


NO_ROWS = np.zeros(0, dtype=np.int64)


def _grouped(cameras: Sequence[Camera], parts: Sequence[Views], every: Views) -> list[_Group]:
    """Return the launches of `make_launches`, given the views of each camera and of all of them."""
    ends = np.cumsum([len(part) for part in parts], dtype=np.int64)
    rows_of = {id(one): np.arange(end - len(part), end) for one, part, end in zip(cameras, parts, ends, strict=True)}
    groups: list[_Group] = []
    for alike in _alike([camera for camera in cameras if isinstance(camera, RgbCamera)]):
        rows = [rows_of[id(camera)] for camera in alike]
        places = np.split(np.arange(sum(map(len, rows))), np.cumsum([len(own) for own in rows])[:-1])
        own = tuple(LaunchCamera(camera, place) for camera, place in zip(alike, places, strict=True))
        groups.append(_Group(np.concatenate(rows), intrinsics_of(alike[0]), own, NO_ROWS, NO_ROWS))
    names = _names(every)
    for camera in cameras:
        if isinstance(camera, DepthCamera):
            _join(groups, camera, rows_of[id(camera)], names)
    return [_sorted(group) for group in groups]


def _alike(cameras: Sequence[RgbCamera]) -> list[list[RgbCamera]]:
    """Return the cameras by their settings, in the order of the first of each."""
    groups: dict[str, list[RgbCamera]] = {}
    for camera in cameras:
        groups.setdefault(settings_of(camera), []).append(camera)
    return list(groups.values())


@remembered()
def settings_of(camera: RgbCamera) -> str:
    """Return the keys that are equal within a launch, as text."""
    return camera.model_dump_json(exclude=OWN_KEYS)


def _join(groups: list[_Group], camera: DepthCamera, rows: np.ndarray, names: Sequence[bytes]) -> None:
    """Add a depth camera to the launch that sees what it sees, or to the list.

    Args:
        groups: The launches so far.
        camera: The depth camera.
        rows: Rows of its views.
        names: `_names` of all views.
    """
    intrinsics, wanted = intrinsics_of(camera), [names[row] for row in rows]
    for index, group in enumerate(groups):
        place_of = {names[row]: place for place, row in enumerate(group.rows)}
        if group.intrinsics == intrinsics and all(name in place_of for name in wanted):
            places = np.array([place_of[name] for name in wanted], dtype=np.int64)
            groups[index] = replace(
                group,
                cameras=(*group.cameras, LaunchCamera(camera, places)),
                own=np.concatenate([group.own, rows]),
                shared=np.concatenate([group.shared, group.rows[places]]),
            )
            return
    groups.append(_Group(rows, intrinsics, (LaunchCamera(camera, np.arange(len(rows))),), NO_ROWS, NO_ROWS))


def _names(views: Views) -> list[bytes]:
    """Return the key that distinguishes two views."""
    bits = np.ascontiguousarray(views.pose, dtype=np.float64).view(np.int64)
    key = np.column_stack([views.frame, views.ignore_instance, bits])
    return key.view(f"V{key.itemsize * key.shape[1]}")[:, 0].tolist()


def _sorted(group: _Group) -> _Group:
    """Return the launch with the views of its depth cameras first, so that their images are one piece of memory."""
    is_last = np.ones(len(group.rows), dtype=bool)
    for camera in group.cameras:
        if isinstance(camera.sensor, DepthCamera):
            is_last[camera.rows] = False
    order = np.argsort(is_last, kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    own = tuple(LaunchCamera(camera.sensor, place[camera.rows]) for camera in group.cameras)
    return replace(group, rows=group.rows[order], cameras=own)
