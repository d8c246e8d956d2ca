"""One world behind every sensor, checked on a real scenario's tables: LiDAR, cameras, radar, radio and boxes agree."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import maximum_filter, minimum_filter

from mmw.cli.run import main
from mmw.config import Config, load_config
from mmw.core.transforms import make_pose, quaternion_from_ypr, transform_points
from mmw.dataset import Dataset, open_dataset
from mmw.dataset.camera_geometry import from_world
from mmw.dataset.frame import Agent, Frame, View
from mmw.scene.prepare import stored_stage
from mmw.scene.reader import read_stage
from mmw.scene.scene_data import SceneData
from tests.fixtures.meshes import distance_to

CONFIG = Path(__file__).parents[2] / "configs" / "quickstart.yaml"
FRAMES = range(3)
MIRROR_M = 0.25
"""How far wing mirrors stick out of a vehicle's box, which is that of its body [m]."""
SENSORS = (Path(__file__).parents[1] / "fixtures" / "data" / "cross_modal_sensors.yaml").read_text()
CAMERAS = [f"cam_{yaw}" for yaw in (0, 90, 180, 270)]
"""Cameras at the place of LiDAR, radar and antenna: what one sees there, the others see."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    root = tmp_path_factory.mktemp("cross") / "d"
    code = main(
        ["--config", str(CONFIG), "--out", str(root), f"frames.count={len(FRAMES)}", f"sensors={SENSORS}",
         "channel.antennas.antenna.mount={cav: {position_m: [0, 0, 2.5]}, rsu: {position_m: [0, 0, 4.0]}}"]
    )  # fmt: skip
    assert code == 0
    return open_dataset(root)


@pytest.fixture(scope="module")
def config(made: Dataset) -> Config:
    return load_config(made.root / "config.yaml")


@pytest.fixture(scope="module")
def frames(made: Dataset, config: Config) -> list[Frame]:
    return [made.frame(config.scenarios[0].name, config.weathers[0], number) for number in FRAMES]


@pytest.fixture(scope="module")
def agents(frames: list[Frame]) -> list[Agent]:
    return [agent for frame in frames for agent in frame.agents.values()]


@pytest.fixture(scope="module")
def arrays(made: Dataset, config: Config) -> SceneData:
    return read_stage(stored_stage(made.root, config.scenarios[0]), FRAMES, config.weathers)


def project(view: View, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return row and column of points of the world, and whether they are in the image and off its border."""
    size = view.camera.intrinsics.width, view.camera.intrinsics.height
    pixels = view.camera.pixels(points)
    inside = ((pixels >= 1) & (pixels < np.array(size) - 1)).all(axis=1)
    column, row = np.where(inside[:, None], pixels, 0).astype(int).T
    return row, column, inside


def is_edge(ids: np.ndarray) -> np.ndarray:
    """Return whether any of a pixel's eight neighbors shows another object."""
    return maximum_filter(ids, 3) != minimum_filter(ids, 3)


def visible(agent: Agent, sensor: str) -> list[dict]:
    rows = agent.frame.rows("box_visibility")
    return [row for row in rows if (row["agent"], row["sensor"]) == (agent.name, sensor)]


def test_lidar_returns_fall_on_pixels_of_their_object(agents: list[Agent]) -> None:
    compared = same = near = 0
    for agent in agents:
        sweep = agent.sweeps["lidar"]
        for view in (agent.views[name] for name in CAMERAS):
            row, column, inside = project(view, sweep.world)
            depth, ids, ahead = view.depth, view.instance, view.camera.depths(sweep.world)
            inner = inside & ~is_edge(ids)[row, column]
            is_same = ids[row, column] == sweep["object_id"]
            compared += int(inner.sum())
            same += int(is_same[inner].sum())
            ok = inner & is_same
            # A pixel is 4 mrad wide, so depths on slanted surfaces differ; on the whole they are the same.
            near += int((np.abs(depth[row, column] - ahead)[ok] < 0.02 + 0.1 * ahead[ok]).sum())
    assert compared > 20_000
    assert same >= 0.995 * compared, (same, compared)
    assert near >= 0.98 * same, (near, same)


def test_boxes_hold_their_lidar_returns(agents: list[Agent]) -> None:
    checked = inside = 0
    for agent in agents:
        sweep = agent.sweeps["lidar"]
        counted = {row["object_id"]: row["lidar_points"] for row in visible(agent, "lidar")}
        for box in agent.frame.rows("boxes"):
            on_it = sweep.world[sweep["object_id"] == box["object_id"]]
            assert counted.get(box["object_id"], 0) == len(on_it)
            turn = quaternion_from_ypr(box["yaw"], box["pitch"], box["roll"])
            local = from_world(make_pose([box[axis] for axis in "xyz"], turn), on_it)
            half = 0.5 * np.array([box["length"], box["width"], box["height"]])
            noise = 0.12  # of the range measurement: 4 sigma of the weakest return
            assert (np.abs(local) <= half + noise + np.array([0.0, MIRROR_M, 0.0])).all(), (agent.name, box)
            inside += int((np.abs(local) <= half + 0.02).all(axis=1).sum())
            checked += len(on_it)
    assert checked > 300 and inside > 0.97 * checked, (inside, checked)


def test_radio_line_of_sight_is_what_the_cameras_see(agents: list[Agent]) -> None:
    """The antenna sees the middle of a box where the camera at its place shows that object in that pixel."""
    seen = hidden = 0
    for agent in agents:
        boxes = {row["object_id"]: row for row in agent.frame.rows("boxes")}
        sights = visible(agent, "antenna")
        ids = np.array([row["object_id"] for row in sights])
        is_los = np.array([row["is_los"] for row in sights])
        blocker = np.array([-1 if row["blocker_id"] is None else row["blocker_id"] for row in sights])
        middle = np.array([[boxes[i][k] for k in "xyz"] for i in ids])
        for view in (agent.views[name] for name in CAMERAS):
            row, column, inside = project(view, middle)
            shown = view.instance[row, column]
            clear = inside & ~is_edge(view.instance)[row, column] & (shown != agent.row["object_id"])
            np.testing.assert_array_equal(shown[clear & is_los], ids[clear & is_los])
            np.testing.assert_array_equal(shown[clear & ~is_los], blocker[clear & ~is_los])
            seen, hidden = seen + int((clear & is_los).sum()), hidden + int((clear & ~is_los).sum())
    assert seen > 30 and hidden > 10


def test_links_have_line_of_sight_where_depth_reaches_the_antenna(agents: list[Agent]) -> None:
    checked = []
    for agent, link in ((one, link) for one in agents for link in one.links):
        antenna = agent.frame.agents[link.peer].sensor_pose("antenna")[None, :3]
        for view in (agent.views[name] for name in CAMERAS):
            (row,), (column,), (inside,) = project(view, antenna)
            if inside:
                around = view.depth[row - 1 : row + 2, column - 1 : column + 2]
                is_free = around > view.camera.depths(antenna)
                if is_free.all() or not is_free.any():  # no edge runs through
                    assert bool(is_free.all()) == link.is_los, (agent.frame.frame, agent.name, link.peer)
                    checked.append(link.is_los)
    assert len(checked) > 12 and True in checked and False in checked


def triangles_of(arrays: SceneData, frame: int) -> dict[int, np.ndarray]:
    """Return the triangles of every vehicle in the world frame, shape [M, 3, 3], by object."""
    found = {}
    for index, actor in enumerate(arrays.actors):
        if actor.model >= 0:
            model = arrays.models[actor.model]
            points = transform_points(arrays.poses[arrays.frame_row(frame), index], model.points)
            found[actor.object_id] = points[model.faces]
    return found


@pytest.mark.parametrize(("sensors", "limit"), [(("exact",), 0.01), (("dense",), 0.01), (("radar", "rear"), 1.5)])
def test_radar_points_lie_on_the_surface_of_their_object(
    frames: list[Frame], arrays: SceneData, sensors: tuple[str, ...], limit: float
) -> None:
    """Rays hit the surface itself; a detection is known to a resolution cell of range and angle."""
    for frame in frames:
        checked, vehicles = 0, triangles_of(arrays, frame.frame)
        for agent, sensor in product(frame.agents.values(), sensors):
            sweep = agent.radars[sensor]
            for object_id in np.unique(sweep["object_id"][np.isin(sweep["object_id"], list(vehicles))]):
                which = np.flatnonzero(sweep["object_id"] == object_id)[:40]
                distance = distance_to(vehicles[int(object_id)], sweep.world[which])
                reach = limit if limit < 0.1 else limit + 0.05 * sweep["range"][which]
                assert (distance < reach).all(), (frame.frame, agent.name, object_id, distance.max())
                checked += len(which)
        assert checked > 60, frame.frame


def test_radar_velocities_are_those_of_the_boxes(frames: list[Frame]) -> None:
    """A dense return of a vehicle moves, along the ray, like its box within what turning and wheels add."""
    checked, frame = 0, frames[1]
    boxes = {row["object_id"]: row for row in frame.rows("boxes")}
    for agent in frame.agents.values():
        sweep = agent.radars["exact"]
        ray = (sweep.world - sweep.pose[:3]) / sweep["range"][:, None]
        for k, object_id in enumerate(sweep["object_id"].tolist()):
            if object_id in boxes and object_id != agent.row["object_id"]:
                relative = [boxes[object_id][f"v{axis}"] - agent.row[f"v{axis}"] for axis in "xyz"]
                assert sweep["velocity"][k] == pytest.approx(float(ray[k] @ relative), abs=2.0)
                checked += 1
    assert checked > 50
