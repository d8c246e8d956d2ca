"""Town03 with traffic: LiDAR, depth, radio paths and IMU against float64 oracles on the shipped assets."""

import numpy as np
import pytest

from mmw.channel.links import make_links
from mmw.channel.path_solver.solver import solve_paths
from mmw.channel.paths import PATH_LOS
from mmw.config import ChannelConfig, MountConfig, TrafficConfig
from mmw.core.kinematics import differentiate
from mmw.core.mesh import separate
from mmw.core.resources import town_path
from mmw.core.transforms import angle_between, compose, pose_from_mount, pose_from_ypr
from mmw.scene.device_scene import DeviceScene
from mmw.scene.reader import read_stage
from mmw.scene.scene_data import SceneData
from mmw.scene.stage.compose import compose_scenario
from mmw.scene.views import Views, make_views
from mmw.sensors import DepthCamera, Lidar
from mmw.sensors.imu.simulate import integrate_imu, measure
from mmw.sensors.lidar.scan_pattern import lidar_pattern
from mmw.sensors.lidar.simulate import trace_lidar_hits
from mmw.sensors.render.projection import intrinsics_of
from mmw.traffic.demand import TrafficDemand, VehicleTrack
from mmw.traffic.idm.simulation import simulate_idm
from mmw.traffic.roads.town_asset import open_town
from mmw.usd.vehicle_catalog import load_catalog
from tests.fixtures.antennas import antenna_at
from tests.fixtures.device_rays import loaded
from tests.fixtures.meshes import edge_distance
from tests.fixtures.traced_depth import pixel_rays, traced_depth
from tests.oracles.tracing import OracleScene, cast_rays, is_ambiguous, oracle_scene, sensor_rays

FRAMES = [0, 250, 500, 1000]
"""Frames that are compared: the first and the last of ten seconds, and two between."""
RAYS = 300
TOUCH_M = 1e-3
"""A leg may meet another surface this close to its end, where both surfaces meet, and is still clear [m]."""


@pytest.fixture(scope="module")
def tracks() -> list[VehicleTrack]:
    """Drive six vehicles for ten seconds at the roundabout, three of them connected."""
    town = open_town(town_path("town03"))
    traffic = TrafficConfig(vehicle_count=6, spawn_center_m=(-0.5, -0.5, 0.0), cav_ranks=(0, 2, 4), warmup_s=5.0)
    return simulate_idm(TrafficDemand(town, traffic, load_catalog(), frame_count=1001, seed=7)).tracks


@pytest.fixture(scope="module")
def arrays(tracks: list[VehicleTrack], tmp_path_factory: pytest.TempPathFactory) -> SceneData:
    """Return the compared frames of the scenario's stage, written and read back, under their own numbers."""
    path = compose_scenario(
        tmp_path_factory.mktemp("town03") / "stage.usdc",
        town_path=town_path("town03"), tracks=tracks, catalog=load_catalog(),
        rsus=[("rsu_1", pose_from_ypr((13.5, -29.5, 0.0), np.radians(115.0)))], sensors=(), weather="sunny", meta={},
    )  # fmt: skip
    return read_stage(path, range(1001), ["sunny"])


@pytest.fixture(scope="module")
def scene(arrays: SceneData) -> DeviceScene:
    return loaded(arrays, "cpu", FRAMES)


def assert_equals_oracle(
    arrays: SceneData,
    views: Views,
    direction_s: np.ndarray,
    t_max: np.ndarray,
    found_t: np.ndarray,
    found: np.ndarray,
) -> None:
    """Compare `RAYS` random rays with brute force: every return within 1 mm and on the same object.

    Args:
        arrays: The scene.
        views: A views.
        direction_s: Unit directions, sensor frame, shape [R, 3].
        t_max: Range of each ray [m], shape [R].
        found_t: Distances to be tested [m], inf for none, shape [A, R].
        found: Objects to be tested, -1 for none, shape [A, R].
    """
    rng = np.random.default_rng(3)
    view, ray = rng.integers(len(views), size=RAYS), rng.integers(len(direction_s), size=RAYS)
    returns = 0
    for frame in FRAMES:
        here = np.flatnonzero(views.frame[view] == frame)
        rays = [sensor_rays(views.pose[view[k]], direction_s[ray[k]][None]) for k in here]
        origin, direction = (np.concatenate(column) for column in zip(*rays, strict=True))
        wanted = cast_rays(arrays, frame, origin, direction)
        is_near = wanted.t < t_max[ray[here]]
        t, object_id = np.where(is_near, wanted.t, np.inf), np.where(is_near, wanted.object_id, -1)
        own_t, own = found_t[view[here], ray[here]], found[view[here], ray[here]]
        with np.errstate(invalid="ignore"):
            odd = np.flatnonzero((own != object_id) | (np.abs(own_t - t) > 1e-3))
        if len(odd):
            doubt = is_ambiguous(arrays, frame, origin[odd], direction[odd], np.inf)
            doubt |= np.abs(wanted.t[odd] - t_max[ray[here]][odd]) < 1e-3
            assert doubt.all(), (own_t[odd], t[odd], own[odd], object_id[odd])
        assert len(odd) <= 0.01 * RAYS
        returns += int(is_near.sum())
    assert len(set(views.actor[view].tolist())) > 2 and returns > RAYS // 2


def test_lidar_equals_the_oracle(arrays: SceneData, scene: DeviceScene) -> None:
    config = Lidar()
    views = make_views(arrays, FRAMES, config)
    hits = trace_lidar_hits(scene, views, config)
    pattern = lidar_pattern(config)
    found_t, found = hits.rays.range.numpy(), hits.rays.object_id.numpy()
    assert_equals_oracle(arrays, views, pattern, np.full(len(pattern), config.range_m), found_t, found)


def test_depth_equals_the_oracle(arrays: SceneData, scene: DeviceScene) -> None:
    config = DepthCamera(
        on=("cav", "rsu"), width_px=160, height_px=120, mount={"cav": MountConfig(position_m=(1.5, 0, 2.6))}
    )
    views, images = make_views(arrays, FRAMES, config), traced_depth(arrays, scene.device, config, FRAMES)
    rays = pixel_rays(intrinsics_of(config))
    stretch = 1.0 / rays[:, 0]
    assert_equals_oracle(
        arrays, views, rays, config.range_m * stretch,
        images.depth_m.reshape(len(views), -1) * stretch, images.object_id.reshape(len(views), -1),
    )  # fmt: skip


def test_radio_paths_equal_brute_force(arrays: SceneData, scene: DeviceScene) -> None:
    """Every triangle mirrors the transmitter, both legs are traced in float64: the same surfaces, the same points."""
    high = {"cav": (0.0, 0.0, 5.0), "rsu": (0.0, 0.0, 14.0)}  # above the roofs of vehicles, for more reflections
    config = ChannelConfig(candidates="exhaustive", links=("v2i", "v2v"), antennas=antenna_at(high))
    links = make_links(arrays, FRAMES, config)
    paths = solve_paths(scene, links, config, arrays.materials)
    reflections = 0
    for frame in FRAMES:
        oracle = oracle_scene(arrays, frame)
        here = np.flatnonzero(links.frame == frame)
        for link in here[np.argsort(paths.count[here], kind="stable")][[0, -4, -3, -2, -1]]:  # poor and rich
            tx, rx = links.tx.position[link], links.rx.position[link]
            own = paths.link == link
            assert is_clear(arrays, frame, tx, rx[None], np.array([-1]))[0] == (PATH_LOS in paths.kind[own])
            wanted = mirror_points(arrays, frame, oracle, tx, rx)
            own &= paths.kind != PATH_LOS
            assert set(paths.surface[own, 0].tolist()) <= set(wanted)
            points = paths.vertex[own, 0]
            for surface, point in wanted.items():  # of coincident surfaces one reflects, at the same point
                assert len(points) and np.linalg.norm(points - point, axis=1).min() < 1e-3, (link, surface, point)
            for surface, point in zip(paths.surface[own, 0].tolist(), points, strict=True):
                np.testing.assert_allclose(point, wanted[surface], rtol=0.0, atol=1e-9)
            reflections += len(points)
    assert reflections > 6


def mirror_points(
    arrays: SceneData, frame: int, oracle: OracleScene, tx: np.ndarray, rx: np.ndarray
) -> dict[int, np.ndarray]:
    """Return surface -> point of all reflections from tx to rx, by the image method on every triangle."""
    mesh = separate(oracle.corners)
    normal, area = mesh.normals, mesh.areas
    heights = [np.einsum("mx,mx->m", normal, end - oracle.corners[:, 0]) for end in (tx, rx)]
    kept = np.flatnonzero((heights[0] * heights[1] > 0.0) & (area > 0.0))
    image = tx - 2.0 * heights[0][kept, None] * normal[kept]
    point = image + (heights[0][kept] / (heights[0][kept] + heights[1][kept]))[:, None] * (rx - image)
    is_in = edge_distance(point, oracle.corners[kept], normal[kept]) > -1e-9
    kept, point = kept[is_in], point[is_in]
    for end in (tx, rx):
        clear = is_clear(arrays, frame, end, point, oracle.surface[kept])
        kept, point = kept[clear], point[clear]
    return dict(zip(oracle.surface[kept].tolist(), point, strict=True))


def is_clear(arrays: SceneData, frame: int, start: np.ndarray, ends: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Return whether rays from one start to each end meet nothing before it but the surface `own`, shape [R]."""
    leg = ends - start
    length = np.linalg.norm(leg, axis=1)
    hits = cast_rays(arrays, frame, start, leg / length[:, None])
    return (hits.t > length - TOUCH_M) | (hits.surface == own)


@pytest.mark.parametrize("mount", [pose_from_mount((0, 0, 0)), pose_from_mount((1.2, -0.4, 1.6), 30.0, 5.0, -3.0)])
def test_imu_integrates_back_to_the_track(tracks: list[VehicleTrack], mount: np.ndarray) -> None:
    """Ten seconds of every vehicle, as stored on the stage (float32 rotations): 1 cm and 0.01 degrees."""
    driven = 0.0
    for track in tracks[:3]:
        poses = track.poses[:1000].copy()
        poses[:, 3:] = poses[:, 3:].astype(np.float32)
        sensor = compose(poses, mount)
        accel, gyro = measure(poses, mount)
        found, _ = integrate_imu(accel, gyro, sensor[0], differentiate(sensor).velocity[0])
        assert np.linalg.norm(found[:, :3] - sensor[:, :3], axis=1).max() < 0.01
        assert np.degrees(angle_between(found[:, 3:], sensor[:, 3:])).max() < 0.01
        driven += float(np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1).sum())
    assert driven > 50.0  # they did move
