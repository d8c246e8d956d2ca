"""Sensor features, made once: sweeps and images as the array of their agent sees them.

A linear array tells directions apart by u = y / r alone, and beam q looks to u = -2 q / Q (modulo 2). So a feature has
columns that are fractions of beams, for LiDAR and cameras alike, and what is q beams away is q times as many columns
away, wherever the beam looks. Rows are distances of a LiDAR and elevations of a camera. Ahead (x > 0) and behind have
the same u; they lie one above the other.
"""

import functools
from collections.abc import Iterator

import numpy as np
import pyarrow as pa

from examples.beam_prediction.config import FeatureConfig
from mmw.core.transforms import rotate
from mmw.dataset import Dataset
from mmw.dataset.camera_geometry import Camera, intrinsics_from_row, pose_from_row
from mmw.dataset.windows import Feature, Windows, WindowSpec, open_windows, stream_batches
from mmw.storage.codecs.images import decode_rgb, encode_rgb

LOWEST_M, HEIGHT_STEP_M = -12.0, 0.0625
"""Height of value 1 over the LiDAR [m], and one step. The 16 m hold the foot of a mast and the cars around it, walls up
to a few meters over the sensor, and streets that rise or fall by 10 %. Design values."""

SPAN_STEP_M = 4.0 / 255
"""Step of the span of a cell, from its lowest to its highest return [m]. A car spans 1.5 m, a street none: cars stand
out of 255 steps. Design value."""

COUNT_STEPS = 36.0
"""Steps of a doubling of the returns in a cell: 255 is 135 returns. Design value."""

HIGHEST, LOWEST = 0.15, -0.65
"""Upper and lower edge of a camera's rows, as z / r. Design values: cars are below the horizon of a mast."""

SHRINK = 2
"""Divisor of an image's sides before it is sampled: a column is then one or two pixels wide. Design value."""

JPEG_QUALITY = 90
"""Of images in the cache. Design value."""

BATCH = 8
"""Samples that are read at once. Design value."""


def column_of(u: np.ndarray, columns: int) -> np.ndarray:
    """Return the column of directions; column 0 begins at beam 0, where u = 0.

    Args:
        u: y / r of the directions, -1 to 1.
        columns: Columns of all beams.
    """
    return np.floor(np.mod(-u / 2.0, 1.0) * columns).astype(np.int64) % columns


def lidar_view(points: np.ndarray, config: FeatureConfig, columns: int) -> np.ndarray:
    """Return a sweep by beam and distance.

    Args:
        points: x, y, z of each return, in axes of the agent, from the LiDAR [m], shape [N, 3].
        config: Distances.
        columns: Columns of all beams.

    Returns:
        The highest return of each cell in steps of `HEIGHT_STEP_M` (0: no return), its span in steps of `SPAN_STEP_M`,
        and the logarithm of the number of returns, shape [3, 2 ranges, columns], uint8. The upper half is ahead, the
        lower half behind.
    """
    points = points.astype(np.float64)
    (x, y, z), r = (points[:, axis] for axis in range(3)), np.linalg.norm(points, axis=1)
    row = np.floor(r * (config.ranges / config.range_m)).astype(np.int64)
    is_inside = (row < config.ranges) & (r > 0)
    row = row + config.ranges * (x < 0)
    cell = (row * columns)[is_inside] + column_of(y[is_inside] / r[is_inside], columns)
    size = 2 * config.ranges * columns
    count = np.bincount(cell, minlength=size)
    top, bottom = np.full(size, -np.inf), np.full(size, np.inf)
    np.maximum.at(top, cell, z[is_inside])
    np.minimum.at(bottom, cell, z[is_inside])
    top, bottom = np.where(count > 0, top, LOWEST_M), np.where(count > 0, bottom, LOWEST_M)
    height = np.where(count > 0, np.clip(np.rint((top - LOWEST_M) / HEIGHT_STEP_M) + 1, 1, 255), 0)
    span = np.minimum(np.rint((top - bottom) / SPAN_STEP_M), 255)
    density = np.minimum(np.rint(COUNT_STEPS * np.log2(1 + count)), 255)
    return np.stack([height, span, density]).astype(np.uint8).reshape(3, 2 * config.ranges, columns)


def camera_pixels(camera: Camera, elevations: int, columns: int) -> np.ndarray:
    """Return the pixel of an image, its sides divided by `SHRINK`, that each cell of a camera's view shows.

    Args:
        camera: The camera, its pose that on its agent.
        elevations: Rows of each half.
        columns: Columns of all beams.

    Returns:
        Row and column, -1 where the camera does not look, shape [2 elevations, columns, 2], int64; the half ahead is
        the upper one.
    """
    w = HIGHEST + (LOWEST - HIGHEST) * (np.arange(elevations)[:, None] + 0.5) / elevations
    u = np.mod(1.0 - 2.0 * (np.arange(columns)[None] + 0.5) / columns, 2.0) - 1.0
    forward = np.sqrt(np.maximum(1.0 - u * u - w * w, 0.0))
    halves = []
    for side in (1.0, -1.0):
        direction = np.stack(np.broadcast_arrays(side * forward, u, w), axis=-1)
        place = np.asarray(camera.pixels(camera.pose[:3] + direction))
        is_seen = (camera.is_inside(place) & (forward > 0))[..., None]
        pixel = np.floor(np.where(is_seen, place, 0.0) / SHRINK).astype(np.int64)[..., ::-1]
        halves.append(np.where(is_seen, pixel, -1))
    return np.concatenate(halves)


def camera_view(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Return an image by beam and elevation, 0 where the camera does not look, shape [rows, columns, 3], uint8.

    Args:
        image: Shape [H, W, 3], uint8.
        pixels: What `camera_pixels` returns.
    """
    row, column = np.moveaxis(pixels, -1, 0)
    return image[row, column] * (row >= 0)[..., None].astype(np.uint8)


def sensor_windows(
    dataset: Dataset, scenario: str, weather: str, source: str, modality: str, config: FeatureConfig
) -> Windows:
    """Return one window for each sample of a sensor that is kept, of agents with the role of the source only.

    Args:
        dataset: The dataset.
        scenario: Scenario.
        weather: Weather.
        source: role/sensor.
        modality: `lidar` or `camera`.
        config: How often a sample is kept.

    Raises:
        InputError: If no agent has the sensor.
    """
    role, sensor = source.split("/")
    if modality == "lidar":
        feature = Feature("lidar", sensor=sensor, columns=("x", "y", "z"), max_age_frames=0, name="sample")
    else:
        feature = Feature("rgb", sensor=sensor, shrink=SHRINK, max_age_frames=0, name="sample")
    spec = WindowSpec([feature], past=1, stride=config.every_frames)
    return open_windows(dataset, spec, scenarios=[scenario], weathers=[weather], agents=[role])


def part_features(
    dataset: Dataset, scenario: str, weather: str, source: str, modality: str, config: FeatureConfig, columns: int
) -> pa.Table:
    """Return the features of one sensor in one scenario and weather, every sample read once, file by file.

    Returns:
        Columns `agent`, `frame`, `data`: the bytes of `lidar_view`, or `camera_view` as a JPEG file.

    Raises:
        InputError: As `sensor_windows`.
    """
    windows = sensor_windows(dataset, scenario, weather, source, modality, config)
    mounts = {row["agent"]: row for row in dataset.read("sensors", scenario=scenario).to_pylist()
              if row["sensor"] == source.split("/")[1]}  # fmt: skip

    @functools.cache
    def pixels_of(agent: str) -> np.ndarray:
        camera = Camera(intrinsics_from_row(mounts[agent]), pose_from_row(mounts[agent]))
        return camera_pixels(camera, config.elevations, columns)

    rows: dict[str, list] = {"agent": [], "frame": [], "data": []}
    for agent, frame, sample in _samples(windows):
        if modality == "lidar":
            data = lidar_view(rotate(pose_from_row(mounts[agent])[3:], sample), config, columns).tobytes()
        else:
            data = encode_rgb(camera_view(sample, pixels_of(agent)), "jpeg", JPEG_QUALITY)
        for name, value in zip(rows, (agent, frame, data), strict=True):
            rows[name].append(value)
    return pa.table(rows, schema=pa.schema([("agent", pa.string()), ("frame", pa.int64()), ("data", pa.binary())]))


def feature_arrays(data: list[bytes], modality: str, config: FeatureConfig, columns: int) -> np.ndarray:
    """Return features of the cache as the network reads them, shape [samples, channels, rows, columns], uint8."""
    if modality == "lidar":
        return np.frombuffer(b"".join(data), dtype=np.uint8).reshape(-1, 3, 2 * config.ranges, columns)
    return np.stack([decode_rgb(one) for one in data]).transpose(0, 3, 1, 2)


def _samples(windows: Windows) -> Iterator[tuple[str, int, np.ndarray]]:
    """Yield agent, frame and array of every sample, in the order of the files."""
    for batch in stream_batches(windows, BATCH, shuffle=False, ragged="list"):
        for track, frame, window in zip(batch["track"].tolist(), batch["now"].tolist(), batch["sample"], strict=True):
            yield windows.tracks[track].agent, frame, window[0]
