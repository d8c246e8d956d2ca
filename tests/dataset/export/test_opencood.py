"""OPV2V as OpenCOOD's own loader reads it, where a developer supplies OpenCOOD: poses, boxes, points, agents, times.

OpenCOOD may not be shipped and is no dependency (its licence); with a checkout and what it imports (torch, open3d):

    PYTHONPATH=/path/to/OpenCOOD pytest tests/dataset/export/test_opencood.py
"""

import importlib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tests.fixtures import export_data as source

pytestmark = pytest.mark.filterwarnings("ignore")  # OpenCOOD leaves its files open

RANGE = [-140.8, -40.0, -3.0, 140.8, 40.0, 1.0]
"""Region in which OpenCOOD looks for vehicles by its configurations: two corners in the LiDAR's frame [m]."""
NEAR_M = 70.0
"""OpenCOOD's range of communication around the ego vehicle [m]."""


def opencood(module: str) -> ModuleType:
    """Return a module of OpenCOOD; skip the test if there is none, or something that it imports is missing."""
    try:
        return importlib.import_module(f"opencood.{module}")
    except ImportError as error:
        pytest.skip(f"OpenCOOD's loader cannot be imported ({error}); give its checkout by PYTHONPATH, with open3d")


def parameters(split: Path, fusion: str) -> dict:
    """Return a configuration for a dataset class of OpenCOOD: voxels of 0.8 m, no augmentation."""
    anchors = {"cav_lidar_range": RANGE, "l": 3.9, "w": 1.6, "h": 1.56, "r": [0, 90], "num": 2}
    size = {"vw": 0.8, "vh": 0.8, "vd": 0.8}
    span = {name: int((RANGE[i + 3] - RANGE[i]) / 0.8) for i, name in enumerate("WHD")}
    return {
        "root_dir": str(split),
        "validate_dir": str(split),
        "data_augment": [],
        "fusion": {"core_method": fusion, "args": []},
        "preprocess": {"core_method": "VoxelPreprocessor", "args": {**size, "T": 32}, "cav_lidar_range": RANGE},
        "postprocess": {
            "core_method": "VoxelPostprocessor",
            "anchor_args": {**anchors, **size, **span},
            "target_args": {"pos_threshold": 0.6, "neg_threshold": 0.45, "score_threshold": 0.25},
            "order": "hwl",
            "max_num": 100,
            "nms_thresh": 0.15,
        },
    }


@pytest.fixture(scope="module")
def split(exported) -> Path:
    opencood("data_utils.datasets")
    return exported("opv2v", {"rate": "50"}) / "train"


@pytest.fixture(scope="module")
def agents() -> dict[str, str]:
    """Folder that an agent is in -> agent, by the objects of the dataset; the roadside unit is -1."""
    found = {str(pose["object_id"]): pose["agent"] for pose in source.rows("poses", frame=0)}
    return {"-1" if agent == "rsu_1" else folder: agent for folder, agent in found.items()}


def build(split: Path, fusion: str, train: bool, visualize: bool = False):
    """Return one of OpenCOOD's datasets."""
    return opencood("data_utils.datasets").build_dataset(parameters(split, fusion), visualize, train)


def to_ego(frame: int, agent: str, ego: str) -> np.ndarray:
    """Return the transform LiDAR of an agent to LiDAR of the ego by our tables, in CARLA's frames."""
    ours = np.linalg.inv(source.sensor_matrix(frame, ego, "lidar")) @ source.sensor_matrix(frame, agent, "lidar")
    return source.FLIP @ ours @ source.FLIP


def boxes_in(frame: int, agent: str, reference: str) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Return what the LiDAR of an agent hits, vehicles but itself, as the reference LiDAR sees it in CARLA's frame.

    Value: center [3] and corners [8, 3] of the box.
    """
    lidar = np.linalg.inv(source.sensor_matrix(frame, reference, "lidar"))
    own = source.row("poses", frame=frame, agent=agent)["object_id"]
    hit = set(source.row("lidar", frame=frame, agent=agent)["object_id"]) - {own}
    found = {}
    for box in source.rows("boxes", frame=frame):
        if box["object_id"] in hit and box["category"] != "pedestrian":
            local = source.move(lidar, source.box_corners(box))
            found[box["object_id"]] = (local.mean(axis=0) * [1, -1, 1], local * [1, -1, 1])
    return found


def test_agents_ego_times_and_distances(split: Path, agents: dict[str, str]) -> None:
    """The ego is cav_1, the roadside unit comes last, every frame of the rate is there."""
    loader = build(split, "LateFusionDataset", train=True)
    assert len(loader) == len(source.IMAGE_FRAMES) and len(loader.scenario_database) == 1
    database = loader.scenario_database[0]
    assert [agents[name] for name in database] == ["cav_1", "cav_2", "cav_3", "rsu_1"]
    assert [content["ego"] for content in database.values()] == [True, False, False, False]
    for content in database.values():
        stamps = [key for key in content if key not in ("ego", "distance_to_ego")]
        assert stamps == [f"{frame:06d}" for frame in source.IMAGE_FRAMES]
        for stamp in stamps:
            assert all(Path(content[stamp][name]).is_file() for name in ("yaml", "lidar"))
            assert Path(content[stamp]["camera0"][0]).is_file()
    loader.retrieve_base_data(1)
    for name, content in database.items():
        gap = source.sensor_matrix(source.IMAGE_FRAMES[1], agents[name], "lidar")[:2, 3]
        gap = gap - source.sensor_matrix(source.IMAGE_FRAMES[1], "cav_1", "lidar")[:2, 3]
        assert content["distance_to_ego"] == pytest.approx(np.linalg.norm(gap), abs=1e-5)


def test_poses_speeds_and_points(split: Path, agents: dict[str, str]) -> None:
    """Each agent's transform to the ego, speed, cameras and points are those of our tables."""
    loader = build(split, "LateFusionDataset", train=False)
    to_world = opencood("utils.transformation_utils").x_to_world
    for index, frame in enumerate(source.IMAGE_FRAMES):
        for name, content in loader.retrieve_base_data(index).items():
            agent, given = agents[name], content["params"]
            assert content["time_delay"] == 0
            pose = source.row("poses", frame=frame, agent=agent)
            np.testing.assert_allclose(given["transformation_matrix"], to_ego(frame, agent, "cav_1"), atol=1e-5)
            np.testing.assert_allclose(
                to_world(given["true_ego_pos"]), source.FLIP @ source.matrix(pose) @ source.FLIP, atol=1e-6
            )
            assert given["ego_speed"] == pytest.approx(3.6 * source.speed(pose), abs=1e-5)
            camera = source.FLIP @ source.sensor_matrix(frame, agent, "front") @ source.FLIP
            np.testing.assert_allclose(to_world(given["camera0"]["cords"]), camera, atol=1e-6)
            sweep = source.row("lidar", frame=frame, agent=agent)
            points = content["lidar_np"]
            np.testing.assert_allclose(points[:, :3], source.cloud(sweep) * [1, -1, 1], rtol=0, atol=1e-6)
            assert np.abs(points[:, 3] - sweep["intensity"]).max() <= 1 / 510 + 1e-6
            boxes = {box["object_id"]: box for box in source.rows("boxes", frame=frame)}
            for number, vehicle in given["vehicles"].items():
                assert vehicle["speed"] == pytest.approx(3.6 * source.speed(boxes[number]), abs=1e-5)


def test_late_fusion_has_every_agents_own_boxes(split: Path, agents: dict[str, str]) -> None:
    """Center, size and heading of every vehicle in the frame of the agent whose LiDAR hits it.

    The roadside unit's LiDAR is more than 3 m above the road, so that OpenCOOD keeps nothing of it here.
    """
    loader, checked = build(split, "LateFusionDataset", train=False), 0
    for index, frame in enumerate(source.IMAGE_FRAMES):
        items = loader[index]
        near = [agent for agent in agents.values() if np.linalg.norm(to_ego(frame, agent, "cav_1")[:2, 3]) < NEAR_M]
        assert {"cav_1" if name == "ego" else agents[name] for name in items} == set(near)
        for name, item in items.items():
            agent = "cav_1" if name == "ego" else agents[name]
            expected = boxes_in(frame, agent, agent)
            checked += check_boxes(item, expected, frame)
            assert item["label_dict"]["pos_equal_one"].any() == bool(item["object_ids"])
    assert checked > 20


def test_intermediate_fusion_has_all_agents_boxes_once(split: Path, agents: dict[str, str]) -> None:
    """Boxes of all agents in the ego's frame, each once, and all points together in it, on them."""
    loader = build(split, "IntermediateFusionDataset", train=True, visualize=True)
    for index, frame in enumerate(source.IMAGE_FRAMES):
        item, expected = loader[index]["ego"], {}
        near = [agent for agent in agents.values() if np.linalg.norm(to_ego(frame, agent, "cav_1")[:2, 3]) < NEAR_M]
        for agent in near:
            expected |= boxes_in(frame, agent, "cav_1")
        assert item["cav_num"] == len(near) > 1
        assert check_boxes(item, expected, frame) > 5
        ours = [
            source.move(to_ego(frame, agent, "cav_1"), source.cloud(source.row("lidar", frame=frame, agent=agent))
                 * [1, -1, 1])
            for agent in near
        ]  # fmt: skip
        everything = np.concatenate(ours)
        for place in item["origin_lidar"][::500, :3]:
            assert np.linalg.norm(everything - place, axis=1).min() < 1e-3


def test_a_batch_of_the_loader(split: Path) -> None:
    """torch's loader collates what the datasets give."""
    torch_data = pytest.importorskip("torch.utils.data")
    loader = build(split, "IntermediateFusionDataset", train=True)
    batches = torch_data.DataLoader(loader, batch_size=2, collate_fn=loader.collate_batch_train, shuffle=False)
    batch = next(iter(batches))["ego"]
    assert batch["record_len"].shape == (2,) and batch["object_bbx_center"].shape == (2, 100, 7)
    assert batch["object_bbx_mask"].sum() > 10 and batch["label_dict"]["pos_equal_one"].sum() > 5


def check_boxes(item: dict, expected: dict[int, tuple[np.ndarray, np.ndarray]], frame: int) -> int:
    """Compare the boxes of a sample with ours; return how many there are.

    OpenCOOD leaves out a vehicle of which a corner is outside of `RANGE`. Its boxes stand upright in the LiDAR's frame.
    """
    found = dict(zip(item["object_ids"], item["object_bbx_center"][item["object_bbx_mask"] == 1], strict=True))
    boxes = {box["object_id"]: box for box in source.rows("boxes", frame=frame)}
    for number, (_, points) in expected.items():
        margin = min((points - RANGE[:3]).min(), (RANGE[3:] - points).min())
        if abs(margin) > 0.5:  # an upright box reaches a little farther than a tilted one
            assert (number in found) == (margin > 0), number
    assert set(found) <= set(expected)
    for number, (x, y, z, height, width, length, yaw) in found.items():
        centre, points = expected[number]
        np.testing.assert_allclose([x, y, z], centre, atol=1e-4)
        tilted = np.array([boxes[number][name] for name in ("length", "width", "height")])
        np.testing.assert_allclose([length, width, height], tilted, rtol=0.03)
        # Rear to front, seen from above: points 4 to 7 are those of x > 0, see tests.fixtures.export_data.corners.
        ahead = (points[4:] - points[:4]).mean(axis=0)
        off = (yaw - np.arctan2(ahead[1], ahead[0]) + np.pi) % (2 * np.pi) - np.pi
        assert abs(off) < 0.02
    return len(found)
