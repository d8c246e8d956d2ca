"""Make all images of a launch on the device, in one sequence of kernels that waits for nothing and can be recorded."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from collections.abc import Hashable, Mapping
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.core.recorded_work import DirectWork, GatheredArrays, NewArrays, Same
from mmw.core.remember import remembered
from mmw.kernels.camera.depth import DepthImages
from mmw.scene.scene_data import Actor
from mmw.scene.views import VIEW_TYPES, views_struct
from mmw.sensors.batch import Batch
from mmw.sensors.camera_group.launches import Launch, settings_of, trace_launch
from mmw.sensors.depth.config import DepthCamera
from mmw.sensors.ground_truth.boxes_2d import VisiblePixels, count_pixels, object_places
from mmw.sensors.ground_truth.visibility import boxed_actors, object_ids
from mmw.sensors.render.jpeg import CodedImages, code_images, read_files
from mmw.sensors.render.optical_flow import image_motion
from mmw.sensors.render.row_lists import RowLists
from mmw.sensors.render.visibility_buffer import EXTRA_OFFSETS, SampleBuffer, depth_images
from mmw.sensors.rgb.config import RgbCamera
from mmw.sensors.rgb.frame_inputs import FrameArrays
from mmw.sensors.rgb.simulate import RgbImages, RgbRenderer

BATCH_FIELDS = ("instances", "group_root", "instance_pose", "instance_velocity", "instance_rate", "instance_present")
"""Arrays of `structs.Scene` that each batch writes: a record finds them where they were."""


@dataclass(frozen=True)
class RangeNeeds:
    """Needs of the cameras of one range, beside color."""

    range_m: float
    """Longest depth [m]."""
    with_metres: bool
    """Unrounded depths."""
    with_objects: bool
    """The object in each pixel."""
    with_boxes: bool
    """Pixels of each boxed actor."""


@dataclass(frozen=True)
class LaunchImages:
    """Images of all views of a launch."""

    depth: Mapping[float, DepthImages]
    """Range [m] -> depth and objects, on the device, for the ranges that need them."""
    visible: Mapping[float, VisiblePixels]
    """Range [m] -> pixels of the boxed actors, on the host, for the ranges that record boxes."""
    rgb: Mapping[str, RgbImages]
    """Weather -> pictures, on the device; nothing without RGB cameras or views."""
    exposure: Mapping[str, np.ndarray]
    """Weather -> exposure of each picture, on the host."""
    files: Mapping[str, list[bytes]]
    """Weather -> JPEG file of each picture, where the device makes them; else nothing."""
    normals: wp.array | None
    """Normals, on the device; None where they are not recorded."""
    flow: wp.array | None
    """Optical flow, on the device; None where it is not recorded."""


@dataclass(frozen=True)
class _Launched:
    """Results of a launch on the device."""

    depth: dict[float, DepthImages]
    rgb: dict[str, RgbImages]
    coded: list[CodedImages]
    """Files of the pictures of each weather, or nothing."""
    normals: wp.array | None
    flow: wp.array | None
    lists: RowLists | None
    small: GatheredArrays
    """Counts of the lists, exposures, spans of files, and what `count_pixels` finds for each range with boxes."""


def range_needs(launch: Launch) -> tuple[RangeNeeds, ...]:
    """Return what the cameras of a launch need beside color, by range."""
    needs = []
    for range_m in sorted({camera.sensor.range_m for camera in launch.cameras}):
        sensors = [camera.sensor for camera in launch.cameras if camera.sensor.range_m == range_m]
        depth = [sensor for sensor in sensors if isinstance(sensor, DepthCamera)]
        with_boxes = any(sensor.boxes_2d for sensor in sensors)
        with_objects = with_boxes or any(sensor.segmentation for sensor in sensors)
        if depth or with_objects:
            with_metres = any(sensor.format == "float32" for sensor in depth)
            needs.append(RangeNeeds(range_m, with_metres, with_objects, with_boxes))
    return tuple(needs)


class StartedImages(AbstractContextManager["StartedImages"]):
    """Images of a launch that the device works on; those on the device hold until the end of a `with` statement."""

    def __init__(self, batch: Batch, launch: Launch, keys: Mapping[str, np.ndarray]) -> None:
        """Start the launches.

        Args:
            batch: The scenario and its device.
            launch: The views.
            keys: Weather -> random numbers of each view, shape [A, 2], uint32.
        """
        self._task = _Task(batch, launch, keys)
        # An empty record cannot be replayed.
        self._work = batch.work if len(launch.views) else DirectWork(batch.scene.device)
        self._running = ExitStack()
        self._start()

    def _start(self) -> None:
        self._key = self._task.key
        self._made = self._running.enter_context(self._work.run(self._key, self._task.inputs, self._task.launch))

    def wait(self) -> LaunchImages:
        """Return the images once the device has made them; it makes them again where a list had no room."""
        task, work = self._task, self._work
        while True:
            made = self._made
            (block,) = work.to_host([made.small.block])
            small = iter(made.small.on_host(block))
            if made.lists is None or made.lists.fit(next(small)):
                break
            work.forget(self._key, task.inputs)
            self._running.close()
            self._start()
        exposure = {weather: next(small) for weather in made.rgb}
        files = read_files(made.coded, [next(small) for _ in made.coded], work) if made.coded else []
        visible = {
            needs.range_m: VisiblePixels.of(next(small), next(small), next(small))
            for needs in task.needs
            if needs.with_boxes
        }
        by_weather = dict(zip(made.rgb, files, strict=False))
        return LaunchImages(made.depth, visible, made.rgb, exposure, by_weather, made.normals, made.flow)

    def __exit__(self, *error: object) -> None:
        """Give the arrays on the device back."""
        self._running.close()


class _Task:
    """The launches of one `Launch`, and what they depend on."""

    def __init__(self, batch: Batch, launch: Launch, keys: Mapping[str, np.ndarray]) -> None:
        """Gather the inputs."""
        self._scene, self._launch, self._cutouts = batch.scene.optical, launch, batch.alpha_cutouts
        self.needs = range_needs(launch)
        places = _places(batch.arrays.actors)
        self._wanted = len(boxed_actors(batch.arrays.actors))
        views = launch.views
        self._scene.check_loaded("view", views.batch_index, views.frame)
        self.inputs = [*views.values(self._scene.origin), (places, wp.int32)]
        self._config, self._renderer, self._values = None, None, None
        if launch.rgb and len(views):
            self._config = next(camera.sensor for camera in launch.cameras if isinstance(camera.sensor, RgbCamera))
            self._renderer = batch.rgb_camera(self._config.debug)
            self._values = self._renderer.frame_values(self._scene, views, self._config, keys, batch.motion)
            self.inputs += self._values.inputs

    @property
    def key(self) -> Hashable:
        """All that decides what `launch` does, beside the inputs."""
        scene, launch = self._scene, self._launch
        memory = tuple(getattr(scene.struct, name).ptr for name in BATCH_FIELDS)
        batch = Same(scene.struct), memory, scene.batch_size, scene.arrays.rate_hz
        own = len(launch.views), self._wanted, self.needs
        camera = launch.intrinsics, launch.range_m, Same(self._cutouts)
        if self._config is None or self._renderer is None or self._values is None:
            return batch, own, camera
        values = self._values
        settings = settings_of(self._config), values.weathers, values.suns, values.rooms
        return batch, own, camera, settings, Same(self._renderer), self._renderer.list_shares.key

    def launch(self, arrays: NewArrays, inputs: list[wp.array]) -> _Launched:
        """Launch all kernels."""
        scene, launch, renderer = self._scene, self._launch, self._renderer
        own = len(VIEW_TYPES)
        views, places, frame = views_struct(inputs[:own]), inputs[own], inputs[own + 1 :]
        lists, further = None, 0
        if renderer is not None and self._config is not None:
            lists = RowLists(arrays, renderer.list_shares, launch.pixels)
            extras = len(EXTRA_OFFSETS[self._config.samples])
            further = extras * lists.room("edges", launch.pixels) if extras else 0
        buffer = trace_launch(scene, launch, self._cutouts, arrays=arrays, on_device=views, further=further)
        depth, visible = {}, []
        for needs in self.needs:
            images = depth_images(
                buffer, range_m=needs.range_m, with_metres=needs.with_metres, with_objects=needs.with_objects
            )
            depth[needs.range_m] = images
            if needs.with_boxes:
                visible += count_pixels(images.object_id, places, self._wanted, arrays)
        rgb, coded, normals, flow = {}, [], None, None
        if renderer is not None and lists is not None:
            rgb, coded, normals, flow = self._render(renderer, buffer, FrameArrays(*frame), lists)
        exposures = [images.exposure for images in rgb.values()]
        counts = [] if lists is None else [lists.counts]
        small = GatheredArrays(arrays, [*counts, *exposures, *(some.spans for some in coded), *visible])
        return _Launched(depth, rgb, coded, normals, flow, lists, small)

    def _render(
        self, renderer: RgbRenderer, buffer: SampleBuffer, frame: FrameArrays, lists: RowLists
    ) -> tuple[dict[str, RgbImages], list[CodedImages], wp.array | None, wp.array | None]:
        """Return pictures, their files where the device makes them, normals and flow."""
        config, values = self._config, self._values
        assert config is not None and values is not None
        rgb, coded = renderer.pictures(buffer, config, values, frame, lists), []
        if config.format == "jpeg" and makes_files(buffer.scene.device):
            settings = config.jpeg_quality, config.jpeg_subsampling
            coded = [code_images(images.rgb, *settings, lists) for images in rgb.values()]
        normals = renderer.normals(buffer) if config.normals else None
        rate_hz = buffer.scene.arrays.rate_hz
        flow = image_motion(buffer, frame.twists, 1.0 / rate_hz) if config.flow else None
        return rgb, coded, normals, flow


def makes_files(device: str) -> bool:
    """Return whether a device makes JPEG files itself: a GPU, many at a time, rather than the cores beside it."""
    return wp.get_device(device).is_cuda


@remembered()
def _places(actors: tuple[Actor, ...]) -> np.ndarray:
    """Return the place of each object among the boxed actors, -1 for the others, shape [objects], int32."""
    return object_places(object_ids(actors)[boxed_actors(actors)])
