"""nuScenes: thirteen JSON tables, and the sweeps and images that they name.

    OUT/v1.0-mmw/*.json                              the tables; tokens are hashes of the keys, the same every time
    OUT/v1.0-mmw/splits.json                         scenes of each split, for the development kit's evaluations
    OUT/samples/LIDAR_TOP/SCENE__LIDAR_TOP__T.pcd.bin  float32 x, y, z, intensity (0 to 255), ring (0 the highest)
    OUT/samples/CAM_FRONT/SCENE__CAM_FRONT__T.jpg    the stored image; a camera NAME is CAM_NAME
    OUT/sweeps/...                                   the same between samples
    OUT/maps/TOKEN.png                               black: the format needs a map, and there is none

A scene is one agent of a scenario in one weather: the ego vehicle, or a roadside unit. Samples come at `rate`, sweeps
between them at `sweeps`. T is in microseconds. Every scenario in a weather begins a multiple of 10,000 s later than the
first, and each further agent of it 1 us later, because the development kit sorts scenes by their times. The global
frame is the dataset's world (x east, y north, z up), the ego frame the agent's (x forward, y left, z up, on the ground
midway between the axles), the LiDAR's the sensor's; a camera's is optical (x right, y down, z forward). Rotations are
quaternions (w, x, y, z), sizes are (width, length, height).

A vehicle or person with a return in a LiDAR or radar of the agent, or a pixel in a camera, is annotated. Its visibility
compares, in the camera that sees the largest share, the rectangle of its visible pixels with the one that the image
frames; level `unknown` (token 0, not in nuScenes) says that no camera frames it in that sample.

Keys that begin with `mmw_` are ours: they lead back to the dataset.

Losses: see `LOSSES`.

Source: H. Caesar et al., "nuScenes: A multimodal dataset for autonomous driving", CVPR 2020, and the schema of its
development kit.
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from mmw.core.errors import InputError
from mmw.dataset import Dataset
from mmw.dataset.export.exporter import Format, Option, Options, Selection, Task, frame_steps, parts, require
from mmw.dataset.export.nuscenes.tables import LIDAR, Scene, channel_of, suffix_of, write_tables
from mmw.dataset.export.read_sensors import Block, pick_sensor, sensors_of
from mmw.dataset.export.write_files import write_file

LOSSES = (
    "no radio, radar points, depth, IMU, GNSS, segmentation, normals, flow and 2-D boxes",
    "no map: the masks are black and small; draw with underlay_map=False",
    "VRUs, drones and base stations without a LiDAR have no scene",
    "one agent a scene: what agents see of each other joins by mmw_object_id and mmw_frame alone",
    "samples at `rate`, 2 Hz by default, sweeps at `sweeps`, 10 Hz by default, not 100 Hz",
    "object, label, time and number of a LiDAR return are dropped; one LiDAR an agent",
    "objects that no sensor of the agent has a sample of are not annotated",
    "a camera is a pinhole: lens distortion stays in the image, its coefficients are in mmw_coefficients alone",
    "velocities: readers difference the places of annotations",
)
"""Losses of the format."""

OPTIONS = (
    Option("rate", "2", "samples a second [Hz]; a divisor of 100"),
    Option("sweeps", "10", "sweeps a second between the samples [Hz]; a divisor of 100"),
    Option("lidar", "", "LiDAR that becomes LIDAR_TOP, where an agent has several"),
    Option("val", "", "scenarios and weathers of split mmw_val, comma-separated; the others are mmw_train"),
)

SPACING_US = 10_000_000_000
"""From scenario to scenario [us], more than any lasts; design value."""


def plan(dataset: Dataset, selection: Selection, options: Options) -> list[Task]:
    """Return one task a scene and second for its files, and one for the tables.

    Raises:
        InputError: If a table or a LiDAR is missing, or nothing is left.
    """
    require(dataset, "nuscenes", "lidar", "boxes", "box_visibility", "sensors")
    key_parts = parts(dataset, selection, frame_steps(dataset, "nuscenes", "rate", options), carrying=("lidar",))
    sweeps = frame_steps(dataset, "nuscenes", "sweeps", options)
    between = {
        (part.scenario, part.weather): part.frames for part in parts(dataset, selection, sweeps, carrying=("lidar",))
    }
    scenes, tasks = [], []
    for number, part in enumerate(key_parts):
        sensors = sensors_of(dataset, part.scenario)
        frames = tuple(sorted({*part.frames, *between.get((part.scenario, part.weather), ())}))
        for index, agent in enumerate(part.agents):
            lidar = pick_sensor(sensors[agent], agent, "lidar", options["lidar"], "nuscenes: lidar=")
            cameras = {name: sensor for name, sensor in sensors[agent].items() if sensor.type == "rgb"}
            scene = Scene(
                dataset, part.scenario, part.weather, agent, part.frames, frames, lidar, cameras,
                number * SPACING_US + index,
            )  # fmt: skip
            scenes.append(scene)
            for block in scene.block(frames).split():
                tasks.append(Task(f"{scene.name}_{block.frames[0]:06d}", partial(_write, block, scene)))
    return [*tasks, Task("tables", partial(write_tables, scenes, _held_out(scenes, options["val"])))]


def _held_out(scenes: Sequence[Scene], text: str) -> tuple[str, ...]:
    """Return the scenarios and weathers of a list that is separated by commas.

    Raises:
        InputError: If one is not exported, or nothing is left to train with.
    """
    names = tuple(name for name in text.split(",") if name)
    known = dict.fromkeys([scene.scenario for scene in scenes] + [scene.weather for scene in scenes])
    if unknown := [name for name in names if name not in known]:
        raise InputError(
            f"nuscenes: val={text}: {unknown[0]!r} is no scenario or weather of the export; there are "
            f"{', '.join(known)}; name some of these"
        )
    if names and all({scene.scenario, scene.weather} & {*names} for scene in scenes):
        raise InputError(f"nuscenes: val={text}: holds every scene, so mmw_train is empty; name fewer")
    return names


def _write(block: Block, scene: Scene, out: Path) -> None:
    """Write sweeps and images of some frames of a scene."""
    for frame, cloud in block.sweeps(scene.lidar, ("ring",)):
        points = np.stack([cloud["x"], cloud["y"], cloud["z"], 255.0 * cloud["intensity"], cloud["ring"]], axis=-1)
        write_file(out / scene.file(LIDAR, frame, "pcd.bin"), points.astype("<f4").tobytes())
    for row in block.rows("rgb", ["sensor", "image", "format"]):
        write_file(out / scene.file(channel_of(row["sensor"]), row["frame"], suffix_of(row)), row["image"]["bytes"])


FORMAT = Format("nuscenes", "nuScenes-style JSON tables, sweeps and images", LOSSES, plan, options=OPTIONS)
