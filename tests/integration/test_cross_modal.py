"""One world behind every sensor, checked on a real scenario's tables: LiDAR, cameras, radar, radio and boxes agree."""

import io
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from mmw.cli.run import main
from mmw.config import load_config
from mmw.core.transforms import compose, invert, make_pose, quaternion_from_ypr, rotate, transform_points
from mmw.dataset import Dataset, open_dataset
from mmw.scene.prepare import stored_stage
from mmw.scene.reader import read_stage
from mmw.scene.scene_data import SceneData
from mmw.storage.codecs.images import decode_depth

CONFIG = Path(__file__).parents[2] / "configs" / "quickstart.yaml"
FRAMES = range(3)
MIRROR_M = 0.25
"""How far wing mirrors stick out of a vehicle's box, which is that of its body [m]."""
AGENTS = ("cav_1", "cav_2", "cav_3", "rsu_1")
PLACE = "{cav: {position_m: [0, 0, 2.5], yaw_deg: YAW}, rsu: {position_m: [0, 0, 4.0], yaw_deg: YAW}}"
CAMERAS = {f"cam_{yaw}": yaw for yaw in (0, 90, 180, 270)}
"""Cameras at the place of LiDAR, radar and antenna: what one sees there, the others see."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    root = tmp_path_factory.mktemp("cross") / "d"
    here = {name: PLACE.replace("YAW", str(yaw)) for name, yaw in CAMERAS.items()}
    cameras = ", ".join(
        f"{{type: depth, name: {name}, on: [cav, rsu], mount: {place}, fov_deg: 92, width_px: 480, height_px: 480, "
        "segmentation: true}"
        for name, place in here.items()
    )
    radars = ", ".join(
        f"{{type: radar, name: {name}, on: [cav, rsu], mount: {PLACE.replace('YAW', yaw)}, {rest}}}"
        for name, yaw, rest in (
            ("exact", "0", "mode: compat"),
            ("dense", "0", "output: dense"),
            ("radar", "0", "output: detections"),
            ("rear", "180", "output: detections"),
        )
    )
    sensors = f"[{{type: lidar, points_per_channel: 360}}, {cameras}, {radars}]"
    code = main(
        ["--config", str(CONFIG), "--out", str(root), f"frames.count={len(FRAMES)}", f"sensors={sensors}",
         "channel.antenna_position_m={cav: [0, 0, 2.5], rsu: [0, 0, 4.0]}"]
    )  # fmt: skip
    assert code == 0
    return open_dataset(root)


@pytest.fixture(scope="module")
def arrays(made: Dataset) -> SceneData:
    config = load_config(made.root / "config.yaml")
    return read_stage(stored_stage(made.root, config.scenarios[0]), FRAMES, config.weathers)


def rows(made: Dataset, table: str, frame: int, agent: str | None = None, **where: str) -> list[dict]:
    found = made.read(table, frames=range(frame, frame + 1), agent=agent).to_pylist()
    return [row for row in found if all(row[key] == value for key, value in where.items())]


def sensor_pose(made: Dataset, frame: int, agent: str, sensor: str) -> np.ndarray:
    (pose,) = rows(made, "poses", frame, agent)
    mount = next(r for r in made.read("sensors", agent=agent).to_pylist() if r["sensor"] == sensor)
    keys = ("x", "y", "z", "qx", "qy", "qz", "qw")
    return compose(np.array([pose[k] for k in keys]), np.array([mount[k] for k in keys]))


def camera_images(made: Dataset, frame: int, agent: str, camera: str) -> tuple[np.ndarray, np.ndarray]:
    """Depth [m] and object id (-1 for the sky) of one view, shape [H, W] each."""
    (depth,) = rows(made, "depth", frame, agent, sensor=camera)
    (segments,) = rows(made, "segmentation", frame, agent, sensor=camera)
    instance = np.asarray(Image.open(io.BytesIO(segments["instance"]["bytes"]))).astype(np.int64) - 1
    return decode_depth(depth["image"]["bytes"]), instance


def project(made: Dataset, agent: str, camera: str, point_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row and column of points in the sensor frame, and whether they are in the image."""
    mount = next(r for r in made.read("sensors", agent=agent).to_pylist() if r["sensor"] == camera)
    depth = np.where(point_s[:, 0] > 0.05, point_s[:, 0], np.nan)
    u = mount["cx"] - mount["fx"] * point_s[:, 1] / depth
    v = mount["cy"] - mount["fy"] * point_s[:, 2] / depth
    inside = (u >= 1) & (v >= 1) & (u < mount["width"] - 1) & (v < mount["height"] - 1)
    column, row = (np.where(inside, w, 0).astype(int) for w in (u, v))
    return row, column, inside


def is_edge(ids: np.ndarray) -> np.ndarray:
    """Whether any of a pixel's eight neighbours shows another object."""
    edge = np.zeros(ids.shape, dtype=bool)
    for dv in (-1, 0, 1):
        for du in (-1, 0, 1):
            edge |= np.roll(ids, (dv, du), (0, 1)) != ids
    return edge


def test_lidar_returns_fall_on_pixels_of_their_object(made: Dataset) -> None:
    compared = same = near = 0
    for frame in FRAMES:
        for agent in AGENTS:
            (sweep,) = rows(made, "lidar", frame, agent)
            points = np.stack([np.array(sweep[k]) for k in "xyz"], axis=1)
            thing = np.array(sweep["object_id"])
            world = transform_points(sensor_pose(made, frame, agent, "lidar"), points)
            for camera in CAMERAS:
                local = transform_points(invert(sensor_pose(made, frame, agent, camera)), world)
                row, column, inside = project(made, agent, camera, local)
                depth, ids = camera_images(made, frame, agent, camera)
                inner = inside & ~is_edge(ids)[row, column]
                found = ids[row, column]
                compared += int(inner.sum())
                same += int((found[inner] == thing[inner]).sum())
                ok = inner & (found == thing)
                # A pixel is 4 mrad wide, so depths on slanted surfaces differ; on the whole they are the same.
                near += int((np.abs(depth[row, column] - local[:, 0])[ok] < 0.02 + 0.1 * local[:, 0][ok]).sum())
    assert compared > 20_000
    assert same >= 0.995 * compared, (same, compared)
    assert near >= 0.98 * same, (near, same)


def test_boxes_hold_their_lidar_returns(made: Dataset) -> None:
    checked = inside = 0
    for frame in FRAMES:
        boxes = {row["object_id"]: row for row in rows(made, "boxes", frame)}
        for agent in AGENTS:
            (sweep,) = rows(made, "lidar", frame, agent)
            points = np.stack([np.array(sweep[k]) for k in "xyz"], axis=1)
            world = transform_points(sensor_pose(made, frame, agent, "lidar"), points)
            thing = np.array(sweep["object_id"])
            counted = {
                row["object_id"]: row["lidar_points"]
                for row in rows(made, "box_visibility", frame, agent, sensor="lidar")
            }
            for object_id, box in boxes.items():
                on_it = world[thing == object_id]
                assert counted.get(object_id, 0) == len(on_it)
                middle = np.array([box[k] for k in "xyz"])
                local = transform_points(
                    invert(make_pose(middle, quaternion_from_ypr(box["yaw"], box["pitch"], box["roll"]))), on_it
                )
                half = 0.5 * np.array([box["length"], box["width"], box["height"]])
                noise = 0.12  # of the range measurement: 4 sigma of the weakest return
                assert (np.abs(local) <= half + noise + np.array([0.0, MIRROR_M, 0.0])).all(), (frame, agent, object_id)
                inside += int((np.abs(local) <= half + 0.02).all(axis=1).sum())
                checked += len(on_it)
    assert checked > 300 and inside > 0.97 * checked, (inside, checked)


def test_radio_line_of_sight_is_what_the_cameras_see(made: Dataset) -> None:
    """The antenna sees the middle of a box where the camera at its place shows that object in that pixel."""
    seen = hidden = 0
    for frame in FRAMES:
        boxes = {row["object_id"]: row for row in rows(made, "boxes", frame)}
        own = {row["agent"]: key for key, row in boxes.items() if row["agent"]}
        for agent in AGENTS:
            sights = rows(made, "box_visibility", frame, agent, sensor="antenna")
            ids = np.array([row["object_id"] for row in sights])
            is_los = np.array([row["is_los"] for row in sights])
            blocker = np.array([-1 if row["blocker_id"] is None else row["blocker_id"] for row in sights])
            middle = np.array([[boxes[i][k] for k in "xyz"] for i in ids])
            for camera in CAMERAS:
                local = transform_points(invert(sensor_pose(made, frame, agent, camera)), middle)
                row, column, inside = project(made, agent, camera, local)
                _, image = camera_images(made, frame, agent, camera)
                shown = image[row, column]
                clear = inside & ~is_edge(image)[row, column] & (shown != own.get(agent, -2))
                np.testing.assert_array_equal(shown[clear & is_los], ids[clear & is_los])
                np.testing.assert_array_equal(shown[clear & ~is_los], blocker[clear & ~is_los])
                seen, hidden = seen + int((clear & is_los).sum()), hidden + int((clear & ~is_los).sum())
    assert seen > 30 and hidden > 10


def test_links_have_line_of_sight_where_depth_reaches_the_antenna(made: Dataset) -> None:
    checked = []
    for frame in FRAMES:
        for link in rows(made, "links", frame):
            antenna = sensor_pose(made, frame, link["peer"], "antenna")[:3]
            for camera in CAMERAS:
                pose = sensor_pose(made, frame, link["agent"], camera)
                local = transform_points(invert(pose), antenna[None])
                row, column, inside = project(made, link["agent"], camera, local)
                if inside[0]:
                    depth, _ = camera_images(made, frame, link["agent"], camera)
                    around = depth[row[0] - 1 : row[0] + 2, column[0] - 1 : column[0] + 2]
                    is_free = around > local[0, 0]
                    if is_free.all() or not is_free.any():  # no edge runs through
                        assert bool(is_free.all()) == link["is_los"], (frame, link["agent"], link["peer"])
                        checked.append(link["is_los"])
    assert len(checked) > 12 and True in checked and False in checked


def triangles_of(arrays: SceneData, frame: int) -> dict[int, np.ndarray]:
    """The triangles of every vehicle in the world frame, shape [M, 3, 3], by object."""
    found = {}
    for index, actor in enumerate(arrays.actors):
        if actor.model >= 0:
            model = arrays.models[actor.model]
            points = transform_points(arrays.poses[arrays.frame_row(frame), index], model.points)
            found[actor.object_id] = points[model.faces]
    return found


def distance_to(triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distance of each point to the nearest of some triangles [m]."""
    nearest = []
    for point in points:
        on_them = trimesh.triangles.closest_point(triangles, np.broadcast_to(point, (len(triangles), 3)))
        nearest.append(np.linalg.norm(on_them - point, axis=1).min())
    return np.array(nearest)


def points_of_radar(row: dict) -> np.ndarray:
    distance, azimuth, elevation = (np.array(row[k]) for k in ("range", "azimuth", "elevation"))
    across = distance * np.cos(elevation)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), distance * np.sin(elevation)], axis=1)


@pytest.mark.parametrize(("sensors", "limit"), [(("exact",), 0.01), (("dense",), 0.01), (("radar", "rear"), 1.5)])
def test_radar_points_lie_on_the_surface_of_their_object(
    made: Dataset, arrays: SceneData, sensors: tuple[str, ...], limit: float
) -> None:
    """Rays hit the surface itself; a detection is known to a resolution cell of range and angle."""
    for frame in FRAMES:
        checked, vehicles = 0, triangles_of(arrays, frame)
        for agent, sensor in product(AGENTS, sensors):
            (sweep,) = rows(made, "radar", frame, agent, sensor=sensor)
            points, thing = points_of_radar(sweep), np.array(sweep["object_id"])
            world = transform_points(sensor_pose(made, frame, agent, sensor), points)
            for object_id in np.unique(thing[np.isin(thing, list(vehicles))]):
                which = np.flatnonzero(thing == object_id)[:40]
                distance = distance_to(vehicles[int(object_id)], world[which])
                reach = limit if limit < 0.1 else limit + 0.05 * np.array(sweep["range"])[which]
                assert (distance < reach).all(), (frame, agent, object_id, distance.max())
                checked += len(which)
        assert checked > 60, frame


def test_radar_velocities_are_those_of_the_boxes(made: Dataset) -> None:
    """A dense return of a vehicle moves, along the ray, like its box within what turning and wheels add."""
    checked = 0
    for agent in AGENTS:
        (sweep,) = rows(made, "radar", 1, agent, sensor="exact")
        (pose,) = rows(made, "poses", 1, agent)
        boxes = {row["object_id"]: row for row in rows(made, "boxes", 1)}
        sensor = sensor_pose(made, 1, agent, "exact")
        ray = points_of_radar(sweep) / np.array(sweep["range"])[:, None]
        ray = rotate(np.broadcast_to(sensor[3:], (len(ray), 4)), ray)
        for k, object_id in enumerate(sweep["object_id"]):
            if object_id in boxes and boxes[object_id]["agent"] != agent:
                other = np.array([boxes[object_id][f"v{axis}"] for axis in "xyz"])
                relative = other - np.array([pose[f"v{axis}"] for axis in "xyz"])
                expected = float(relative @ ray[k])
                assert sweep["velocity"][k] == pytest.approx(expected, abs=2.0)
                checked += 1
    assert checked > 50
