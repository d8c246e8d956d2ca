"""Make all images of a launch on the device, in one sequence of kernels that waits for nothing and can be recorded."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from collections.abc import Hashable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, closing
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from mmw.core.recorded_work import DirectWork, GatheredArrays, NewArrays, Same
from mmw.kernels.camera.depth import DepthImages
from mmw.kernels.shading import structs as shading
from mmw.scene.views import VIEW_TYPES, views_struct
from mmw.sensors.batch import Batch
from mmw.sensors.camera_group.launches import Launch, LaunchCamera, own_images, part_of, settings_of, trace_launch
from mmw.sensors.depth.config import DepthCamera
from mmw.sensors.ground_truth.boxes_2d import count_pixels, object_places
from mmw.sensors.ground_truth.visibility import boxed_actors, object_ids
from mmw.sensors.render.jpeg import CodedFiles, CodedImages, code_images, file_bytes, read_files
from mmw.sensors.render.optical_flow import image_motion
from mmw.sensors.render.row_lists import RowLists
from mmw.sensors.render.visibility_buffer import EXTRA_OFFSETS, SampleBuffer, depth_images
from mmw.sensors.rgb.config import RgbCamera
from mmw.sensors.rgb.frame_inputs import FrameArrays
from mmw.sensors.rgb.simulate import RgbImages, RgbRenderer

AHEAD = 1.25
"""Bytes of files that are copied to the host ahead, over those of the frame before: images change little between
frames. Design value."""

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
    depth_cm: Mapping[int, np.ndarray]
    """Place of a depth camera in the launch -> its depths [cm], on the host, shape [n, H, W], uint16."""
    visible: Mapping[float, list[np.ndarray]]
    """Range [m] -> what `count_pixels` found of the boxed actors, on the host, for the ranges that record boxes."""
    rgb: Mapping[str, RgbImages]
    """Weather -> pictures, on the device; nothing without RGB cameras or views."""
    exposure: Mapping[str, np.ndarray]
    """Weather -> exposure of each picture, on the host."""
    files: Mapping[str, CodedFiles]
    """Weather -> JPEG file of each picture, where the device makes them; else nothing."""
    normals: wp.array | None
    """Normals, on the device; None where they are not recorded."""
    flow: wp.array | None
    """Optical flow, on the device; None where it is not recorded."""


@dataclass
class _Launched:
    """Results of a launch on the device."""

    depth: dict[float, DepthImages]
    depth_cm: dict[int, wp.array]
    """Place of a depth camera in the launch -> the depths of its part of the views, see `_depth`."""
    rgb: dict[str, RgbImages]
    coded: list[CodedImages]
    """Files of the pictures of each weather, or nothing."""
    normals: wp.array | None
    flow: wp.array | None
    lists: RowLists | None
    small: GatheredArrays
    """Counts of the lists, exposures, spans of files, and what `count_pixels` finds for each range with boxes."""
    ahead: tuple[int, ...] = ()
    """Bytes of the files of each weather that are copied to the host before it is known how many there are."""

    @cached_property
    def copied(self) -> list[Any]:
        """Arrays that are copied to the host: depths, and what is expected of the files."""
        bodies = [some.body[:count] for some, count in zip(self.coded, self.ahead, strict=False)]
        return [*self.depth_cm.values(), *bodies]

    def look_ahead(self, spans: Sequence[np.ndarray]) -> None:
        """Expect files of the size that they have now, given their spans."""
        needed = [file_bytes(span) for span in spans]
        ahead = self.ahead or [0] * len(needed)
        if any(not count <= known <= 2 * AHEAD * count for count, known in zip(needed, ahead, strict=True)):
            self.ahead = tuple(
                min(round(AHEAD * count), len(some.body)) for count, some in zip(needed, self.coded, strict=True)
            )
            self.__dict__.pop("copied", None)


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
            launch: The views, in frames that are loaded.
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
        self._copy = self._running.enter_context(closing(self._work.host_copy(self._made.copied)))

    def wait(self) -> LaunchImages:
        """Return the images once the device has made them; it makes them again where a list had no room."""
        task, work = self._task, self._work
        while True:
            made, copied = self._made, self._copy.wait()
            small = iter(work.gathered(made.small))
            if made.lists is None or made.lists.fit(next(small)):
                break
            work.forget(self._key, task.inputs)
            self._running.close()
            self._start()
        exposure = {weather: next(small) for weather in made.rgb}
        spans = [next(small) for _ in made.coded]
        visible = {needs.range_m: [next(small) for _ in range(3)] for needs in task.needs if needs.with_boxes}
        cameras = ((place, task.cameras[place]) for place in made.depth_cm)
        depth_cm = {place: own_images(found, one) for (place, one), found in zip(cameras, copied, strict=False)}
        files = read_files(made.coded, spans, work, copied[len(made.depth_cm) :])
        made.look_ahead(spans)
        by_weather = dict(zip(made.rgb, files, strict=False))
        return LaunchImages(made.depth, depth_cm, visible, made.rgb, exposure, by_weather, made.normals, made.flow)

    def __exit__(self, *error: object) -> None:
        """Give the arrays on the device back."""
        self._running.close()


@dataclass(frozen=True)
class _Fixed:
    """Constants of the launches of some cameras on some agents, in all frames."""

    needs: tuple[RangeNeeds, ...]
    places: wp.array
    """From `object_places`."""
    wanted: int
    """Actors with boxes."""
    cutouts: "shading.AppearanceTable | None"
    config: RgbCamera | None
    """Settings of the RGB cameras; None without any, or without views."""
    renderer: RgbRenderer | None
    """Renders their pictures."""
    key: Hashable
    """Distinguishes the launches from others, beside the scene."""


def _fixed(batch: Batch, launch: Launch) -> _Fixed:
    actors, device = batch.arrays.actors, batch.scene.device
    held = "places of boxed actors", id(actors), device
    if held not in batch.cache:
        wanted = boxed_actors(actors)
        places = wp.array(object_places(object_ids(actors)[wanted]), dtype=wp.int32, device=device)
        batch.cache[held] = actors, places, len(wanted)
    _, places, wanted = batch.cache[held]
    needs, cutouts = range_needs(launch), batch.alpha_cutouts
    config = launch.rgb_config if len(launch.views) else None
    renderer = None if config is None else batch.rgb_camera(config.debug)
    settings = None if config is None else settings_of(config)
    own = (
        len(launch.views),
        wanted,
        Same(places),
        needs,
        tuple((k, one.start, one.stop) for k, _, one in _depth(launch)),
    )
    camera = launch.intrinsics, launch.range_m, Same(cutouts), settings, Same(renderer)
    return _Fixed(needs, places, wanted, cutouts, config, renderer, (own, camera))


class _Task:
    """The launches of one `Launch`, and what they depend on."""

    def __init__(self, batch: Batch, launch: Launch, keys: Mapping[str, np.ndarray]) -> None:
        """Gather the inputs."""
        self._scene, self._launch = batch.scene.optical, launch
        seed = batch.config.seed_of_scene
        self._fixed = launch.recall(f"fixed by seed {seed}", lambda: _fixed(batch, launch))
        self.inputs, self._values = launch.views.values(self._scene.origin), None
        config, renderer = self._fixed.config, self._fixed.renderer
        if config is not None and renderer is not None:
            self._values = renderer.frame_values(self._scene, launch.views, config, keys, batch.motion)
            self.inputs += self._values.inputs

    @property
    def needs(self) -> tuple[RangeNeeds, ...]:
        """Needs of the cameras beside color, by range."""
        return self._fixed.needs

    @property
    def cameras(self) -> tuple[LaunchCamera, ...]:
        """The cameras."""
        return self._launch.cameras

    @property
    def key(self) -> Hashable:
        """All that decides what `launch` does, beside the inputs."""
        scene, fixed, values = self._scene, self._fixed, self._values
        memory = tuple(getattr(scene.struct, name).ptr for name in BATCH_FIELDS)
        batch = Same(scene.struct), memory, scene.batch_size, scene.arrays.rate_hz, fixed.key
        if values is None or fixed.renderer is None:
            return batch
        return batch, values.weathers, values.suns, values.rooms, fixed.renderer.list_shares.key

    def launch(self, arrays: NewArrays, inputs: list[wp.array]) -> _Launched:
        """Launch all kernels."""
        scene, launch, fixed = self._scene, self._launch, self._fixed
        own = len(VIEW_TYPES)
        views, frame = views_struct(inputs[:own]), inputs[own:]
        lists, further = None, 0
        if fixed.renderer is not None and fixed.config is not None:
            lists = RowLists(arrays, fixed.renderer.list_shares, launch.pixels)
            extras = len(EXTRA_OFFSETS[fixed.config.samples])
            further = extras * lists.room("edges", launch.pixels) if extras else 0
        buffer = trace_launch(scene, launch, fixed.cutouts, arrays=arrays, on_device=views, further=further)
        depth, visible = {}, []
        for needs in self.needs:
            images = depth_images(
                buffer, range_m=needs.range_m, with_metres=needs.with_metres, with_objects=needs.with_objects
            )
            depth[needs.range_m] = images
            if needs.with_boxes:
                visible += count_pixels(images.object_id, fixed.places, fixed.wanted, arrays)
        rgb, coded, normals, flow = {}, [], None, None
        if fixed.renderer is not None and lists is not None:
            rgb, coded, normals, flow = self._render(fixed.renderer, buffer, FrameArrays(*frame), lists)
        exposures = [images.exposure for images in rgb.values()]
        counts = [] if lists is None else [lists.counts]
        small = GatheredArrays(arrays, [*counts, *exposures, *(some.spans for some in coded), *visible])
        depth_cm = {place: depth[one.sensor.range_m].depth[part] for place, one, part in _depth(launch)}
        return _Launched(depth, depth_cm, rgb, coded, normals, flow, lists, small)

    def _render(
        self, renderer: RgbRenderer, buffer: SampleBuffer, frame: FrameArrays, lists: RowLists
    ) -> tuple[dict[str, RgbImages], list[CodedImages], wp.array | None, wp.array | None]:
        """Return pictures, their files where the device makes them, normals and flow."""
        config, values = self._fixed.config, self._values
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


def _depth(launch: Launch) -> Iterator[tuple[int, LaunchCamera, slice]]:
    """Yield the depth cameras of a launch that have views: place among its cameras, camera, and its part of the views.

    The views of depth cameras are the first ones, so that those of each camera lie close together, though in any order.
    """
    for place, camera in enumerate(launch.cameras):
        if isinstance(camera.sensor, DepthCamera) and len(camera.rows):
            yield place, camera, part_of(camera)
