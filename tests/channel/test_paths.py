"""Path finding: occlusion, batches, candidates, coincident surfaces, missing paths, and errors."""

from dataclasses import replace

import numpy as np
import pytest

from mmw.channel.links import LINK_V2I, LINK_V2V, make_links
from mmw.channel.path_solver.candidates import launch_rays
from mmw.channel.path_solver.image_method import trace_paths
from mmw.channel.path_solver.solver import launched_rays, solve_paths
from mmw.channel.path_solver.surface_table import make_surface_table
from mmw.channel.paths import PATH_LOS, PATH_SPECULAR, PathSet
from mmw.config import ChannelConfig
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import Actor, SceneData
from tests.fixtures.scenes import (
    ABSENT,
    arrays_from_parts,
    box_model,
    closed_box,
    ground_part,
    pose,
    quad_part,
    random_triangles,
    street_canyon,
    two_cars,
    wall_part,
)
from tests.oracles.tracing import cast_rays, oracle_scene

EXHAUSTIVE = ChannelConfig(candidates="exhaustive")
POINTS = {"antenna_position_m": {"cav": (0.0, 0.0, 0.0), "rsu": (0.0, 0.0, 0.0)}}


GEOMETRY = (
    "kind", "order", "interaction", "surface", "object_id", "material_id", "vertex", "normal", "tau",
    "theta_t", "phi_t", "theta_r", "phi_r", "range_rate", "path_id",
)  # fmt: skip


def solve(arrays: SceneData, config: ChannelConfig, device: str, frames: list[int]) -> PathSet:
    scene = DeviceScene(arrays, device, 8)
    scene.load_batch(frames)
    return solve_paths(scene, make_links(arrays, frames, config), config, arrays.materials)


def identities(paths: PathSet) -> set[tuple[int, int]]:
    return set(zip(paths.link.tolist(), paths.surface[:, 0].tolist(), strict=True))


def test_links_are_ordered_by_frame_kind_and_actor() -> None:
    actors = [("cav_1", "cav", -1), ("veh", "vehicle", -1), ("cav_2", "cav", -1), ("rsu_1", "rsu", -1)]
    here = [pose(1, 0), pose(2, 0), pose(3, 0), pose(4, 0)]
    arrays = arrays_from_parts([], actors=actors, poses=np.array([here, [here[0], here[1], ABSENT, here[3]]]))
    links = make_links(arrays, [1, 0], ChannelConfig(links=("v2i", "v2v")))
    assert links.frame.tolist() == [1, 0, 0, 0, 0]
    assert links.slot.tolist() == [0, 1, 1, 1, 1]
    assert links.kind.tolist() == [LINK_V2I, LINK_V2I, LINK_V2I, LINK_V2V, LINK_V2V]
    assert links.tx_actor.tolist() == [3, 3, 3, 0, 2]
    assert links.rx_actor.tolist() == [0, 0, 2, 2, 0]
    np.testing.assert_array_equal(links.tx.position[0], [4, 0, 4])
    np.testing.assert_array_equal(links.rx.position[2], [3, 0, 2.5])


def test_antenna_turns_with_its_agent() -> None:
    arrays = arrays_from_parts(
        [],
        actors=[("rsu_1", "rsu", -1), ("cav_1", "cav", -1)],
        poses=np.array([[pose(0, 0), pose(5, 5, 0, np.pi / 2)]]),
    )
    config = ChannelConfig(antenna_position_m={"cav": (1.0, 0.5, 2.0), "rsu": (0, 0, 3.0)})
    links = make_links(arrays, [0], config)
    np.testing.assert_allclose(links.rx.position[0], [4.5, 6.0, 2.0], atol=1e-12)


def test_vehicle_blocks_only_its_own_frame(device: str) -> None:
    """A truck that stands between the ends in frame 1, beside them in frame 0 and nowhere in frame 2."""
    models = (box_model("truck", (3.0, 8.0, 6.0), (0.0, 0.0, 3.0), material=0),)
    actors = [("truck", "vehicle", 0), ("cav_1", "cav", -1), ("rsu_1", "rsu", -1)]
    ends = [pose(20, 0, 1.5), pose(-20, 0, 1.5)]
    poses = np.array([[pose(0, 30), *ends], [pose(0, 0), *ends], [ABSENT, *ends]])
    arrays = arrays_from_parts([ground_part()], models, actors, poses)
    paths = solve(arrays, ChannelConfig(candidates="exhaustive", **POINTS), device, [0, 1, 2])
    assert paths.count.tolist() == [3, 0, 2]  # in frame 0 the truck's side reflects as well
    assert paths.index.tolist() == [0, 1, 2, 0, 1]
    assert paths.kind.tolist() == [PATH_LOS, PATH_SPECULAR, PATH_SPECULAR, PATH_LOS, PATH_SPECULAR]
    assert paths.object_id.max() == arrays.actors[0].object_id
    on_truck = paths.vertex[paths.object_id == arrays.actors[0].object_id]
    np.testing.assert_allclose(on_truck, [[0.0, 26.0, 1.5]], atol=1e-12)


def test_link_without_any_path(device: str) -> None:
    arrays = arrays_from_parts(
        [wall_part("wall", (0.0, -500.0), (0.0, 500.0), 300.0)],
        actors=[("rsu_1", "rsu", -1), ("cav_1", "cav", -1)],
        poses=np.array([[pose(-10, 0), pose(10, 0)]]),
    )
    for mode in ("exhaustive", "launch"):
        paths = solve(arrays, ChannelConfig(candidates=mode, rays=2000), device, [0])
        assert paths.count.tolist() == [0] and len(paths) == 0
        assert paths.a["sunny"].shape == (0, 2) and paths.transfer["sunny"].shape == (0, 2, 2, 2)


def test_scene_without_links(device: str) -> None:
    paths = solve(closed_box(), EXHAUSTIVE, device, [0])
    assert len(paths) == 0 and paths.count.shape == (0,)


def test_batch_does_not_change_a_bit(device: str) -> None:
    arrays = two_cars(5)
    config = ChannelConfig(rays=20_000, links=("v2i", "v2v"))
    together = solve(arrays, config, device, [0, 1, 2, 3, 4])
    again = solve(arrays, config, device, [4, 2, 0, 1, 3])
    for frame in range(5):
        alone = solve(arrays, config, device, [frame])
        for batch, slot in ((together, frame), (again, [4, 2, 0, 1, 3].index(frame))):
            rows = batch.link == slot  # one link a frame
            assert rows.sum() == len(alone) > 1
            for name in GEOMETRY:
                np.testing.assert_array_equal(getattr(batch, name)[rows], getattr(alone, name))
            np.testing.assert_array_equal(batch.a["sunny"][rows], alone.a["sunny"])
            np.testing.assert_array_equal(batch.transfer["sunny"][rows], alone.transfer["sunny"])


def test_launched_candidates_are_a_subset(device: str, record_property) -> None:
    """What rays find is what there is; the share that 10^5 rays miss is reported, and small."""
    found, missed = 0, 0
    for seed in range(3):
        arrays = ended(random_triangles(seed, 200, vehicles=6, frames=2))
        every = identities(solve(arrays, ChannelConfig(candidates="exhaustive", **POINTS), device, [0, 1]))
        launched = identities(solve(arrays, ChannelConfig(rays=100_000, **POINTS), device, [0, 1]))
        assert launched <= every
        found, missed = found + len(every), missed + len(every - launched)
    record_property("share_missed", missed / found)
    assert found > 30 and missed <= 0.02 * found


def ended(arrays: SceneData, count: int = 8) -> SceneData:
    """Return a scene with a transmitter and `count` receivers at random points added."""
    rng = np.random.default_rng(7)

    def end(name: str, role: str) -> Actor:
        return Actor(name, role, f"/World/{name}", -1, 1000, (0.0,) * 3, (0.0,) * 3, "static")

    poses = np.zeros((len(arrays.frames), count + 1, 7))
    poses[..., 6] = 1.0
    poses[..., :3] = rng.uniform(-12, 12, (count + 1, 3))
    actors = (*arrays.actors, end("rsu_1", "rsu"), *(end(f"cav_{k}", "cav") for k in range(count)))
    return replace(arrays, actors=actors, poses=np.concatenate([arrays.poses, poses], axis=1))


def test_against_brute_force(device: str) -> None:
    """Random triangles and vehicles in any attitude: every triangle mirrored, every leg traced in float64."""
    for seed in range(2):
        arrays = ended(random_triangles(seed, 160, vehicles=8))
        config = ChannelConfig(candidates="exhaustive", **POINTS)
        paths, links = solve(arrays, config, device, [0]), make_links(arrays, [0], config)
        scene = oracle_scene(arrays, 0)
        for link in range(len(links)):
            tx, rx = links.tx.position[link], links.rx.position[link]
            clear, sure = legs_are_clear(arrays, tx[None], rx[None], np.array([-1]))
            assert not sure[0] or clear[0] == (PATH_LOS in paths.kind[paths.link == link])
            normal = np.cross(scene.corners[:, 1] - scene.corners[:, 0], scene.corners[:, 2] - scene.corners[:, 0])
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
            heights = np.einsum("mx,kmx->km", normal, np.stack([tx, rx])[:, None] - scene.corners[None, :, 0])
            image = tx - 2 * heights[0][:, None] * normal
            share = heights[0] / (heights[0] + heights[1])
            point = image + share[:, None] * (rx - image)
            margin = edge_distance(point, scene.corners, normal)
            able = (heights[0] * heights[1] > 0) & (margin > -1e-4)
            clear_t, sure_t = legs_are_clear(arrays, point, np.broadcast_to(tx, point.shape), scene.surface)
            clear_r, sure_r = legs_are_clear(arrays, point, np.broadcast_to(rx, point.shape), scene.surface)
            sure = sure_t & sure_r & (np.abs(margin) > 1e-4) & (np.abs(heights).min(axis=0) > 1e-3)
            own = set(paths.surface[(paths.link == link) & (paths.kind == PATH_SPECULAR), 0].tolist())
            wanted = set(scene.surface[able & clear_t & clear_r & sure].tolist())
            doubtful = set(scene.surface[able & ~sure].tolist())
            assert wanted <= own
            assert own <= wanted | doubtful


def edge_distance(point: np.ndarray, corners: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return how far points lie inside their triangles [m], negative outside, shape [M]."""
    inside = []
    for k in range(3):
        edge = corners[:, (k + 1) % 3] - corners[:, k]
        inward = np.cross(normal, edge)
        inward /= np.linalg.norm(inward, axis=1, keepdims=True)
        inside.append(np.einsum("mx,mx->m", inward, point - corners[:, k]))
    return np.min(inside, axis=0)


def legs_are_clear(
    arrays: SceneData, start: np.ndarray, end: np.ndarray, own: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return whether float64 rays from start to end meet nothing but `own`, and whether that is beyond doubt.

    In doubt is a leg whose answer changes when its end is moved by 0.1 mm.
    """
    rng, answers = np.random.default_rng(0), []
    for shift in (0.0, 1e-4, 1e-4, 1e-4):
        leg = end + shift * rng.normal(size=end.shape) - start
        length = np.linalg.norm(leg, axis=1)
        direction = leg / length[:, None]
        hits = cast_rays(arrays, 0, start + 1e-4 * direction, direction)
        blocked = (hits.t < length - 2e-4) & (hits.surface != own)
        answers.append(~blocked)
    return answers[0], np.all(np.array(answers) == answers[0], axis=0)


def test_antenna_on_a_surface_sees_the_same_as_it_is_seen(device: str) -> None:
    """An antenna exactly on the ground has the line of sight, and no reflection by that ground, both ways."""
    poses = np.array([[pose(-20, 0, 0.0), pose(20, 0.3, 1.5)]])
    arrays = arrays_from_parts([ground_part()], actors=[("cav_1", "cav", -1), ("cav_2", "cav", -1)], poses=poses)
    paths = solve(arrays, ChannelConfig(candidates="exhaustive", links=("v2v",), **POINTS), device, [0])
    assert paths.link.tolist() == [0, 1] and paths.kind.tolist() == [PATH_LOS, PATH_LOS]
    assert paths.tau[0] == pytest.approx(paths.tau[1], rel=1e-15)


@pytest.mark.parametrize("lift", [0.0, 1e-5, 2e-3, 5e-3])
def test_marking_on_a_road_reflects_once(lift: float, device: str) -> None:
    """A marking in or just above the plane of its road: one reflection, by the marking."""
    corners = [(-5, -1, lift), (5, -1, lift), (5, 1, lift), (-5, 1, lift)]
    marking = quad_part("Markings/line", corners, "metal_pole", "road_line")
    actors = [("rsu_1", "rsu", -1), ("cav_1", "cav", -1)]
    arrays = arrays_from_parts([ground_part(), marking], actors=actors, poses=np.array([[pose(-20, 0), pose(20, 0)]]))
    config = ChannelConfig(candidates="exhaustive", antenna_position_m={"cav": (0, 0, 3.0), "rsu": (0, 0, 3.0)})
    paths = solve(arrays, config, device, [0])
    assert paths.kind.tolist() == [PATH_LOS, PATH_SPECULAR]
    assert arrays.materials["sunny"][paths.material_id[1, 0]].name == "metal_pole"


@pytest.mark.parametrize("lift", [0.0, 5e-4, 1.2e-3, 3e-3])
@pytest.mark.parametrize("far", [450.0, 1900.0])
def test_thin_sheet_far_from_the_origin_reflects_once(far: float, lift: float, device: str) -> None:
    """Far out, where legs start higher above their surface, a sheet on a small plate still hides its reflection."""
    plate = quad_part(
        "plate", [(far - 9, -1, 0), (far + 9, -1, 0), (far + 9, 1, 0), (far - 9, 1, 0)], "asphalt", "road"
    )
    sheet = ground_part(40.0, z=lift, material="metal_pole")
    sheet = replace(sheet, points=sheet.points + np.array([far, 0.0, 0.0]))
    actors = [("rsu_1", "rsu", -1), ("cav_1", "cav", -1)]
    arrays = arrays_from_parts([plate, sheet], actors=actors, poses=np.array([[pose(far - 9, 0), pose(far + 9, 0)]]))
    config = ChannelConfig(candidates="exhaustive", antenna_position_m={"cav": (0, 0, 1.6), "rsu": (0, 0, 6.0)})
    paths = solve(arrays, config, device, [0])
    assert paths.kind.tolist() == [PATH_LOS, PATH_SPECULAR]
    if lift > 1e-3:
        assert abs(paths.vertex[1, 0, 2] - lift) < 1e-12  # the sheet's, though the plate is smaller


def test_many_triangles_of_one_plane_reflect_once(device: str) -> None:
    """A road of 50 x 50 cells is one surface, also when the point falls on an edge or a corner of its triangles."""
    actors = [("rsu_1", "rsu", -1), ("cav_1", "cav", -1)]
    for x, y in ((20.0, 0.0), (20.0, 1.0), (21.3, 7.7), (18.0, 18.0)):
        arrays = arrays_from_parts(
            [ground_part(50.0, cells=50)], actors=actors, poses=np.array([[pose(-20, 0), pose(x, y, 1.5)]])
        )
        paths = solve(arrays, EXHAUSTIVE, device, [0])
        assert paths.kind.tolist() == [PATH_LOS, PATH_SPECULAR]


def test_far_town_is_as_exact(device: str) -> None:
    """A town 50 km from the origin gives the same paths as at the origin: rays are traced about its own middle."""
    found = []
    for shift in (0.0, 50_000.0):
        part = ground_part()
        part = type(part)(part.path, part.points + np.array([shift, shift, 0.0]), part.faces, part.material, part.label)
        actors = [("rsu_1", "rsu", -1), ("cav_1", "cav", -1)]
        poses = np.array([[pose(shift - 20, shift), pose(shift + 23, shift + 4)]])
        paths = solve(arrays_from_parts([part], actors=actors, poses=poses), ChannelConfig(rays=5000), device, [0])
        found.append((paths.kind.tolist(), paths.tau, paths.a["sunny"]))
    assert found[0][0] == found[1][0] == [PATH_LOS, PATH_SPECULAR]
    np.testing.assert_allclose(found[0][1], found[1][1], rtol=1e-10)
    np.testing.assert_allclose(found[0][2], found[1][2], rtol=1e-8)


def test_weathers_share_geometry(device: str) -> None:
    arrays = two_cars(1)
    wet = list(arrays.materials["sunny"])
    wet[0] = wet[1]
    scene = DeviceScene(arrays, device, 1)
    scene.load_batch([0])
    links = make_links(arrays, [0], EXHAUSTIVE)
    paths = solve_paths(scene, links, EXHAUSTIVE, {"sunny": arrays.materials["sunny"], "rainy": tuple(wet)})
    on_ground = paths.material_id[:, 0] == 0
    assert on_ground.any() and not on_ground.all()
    changed = np.abs(paths.a["sunny"] - paths.a["rainy"]).max(axis=1) > 0
    np.testing.assert_array_equal(changed, on_ground)


def test_depth_zero_is_line_of_sight_only(device: str) -> None:
    arrays = two_cars(1)
    scene = DeviceScene(arrays, device, 1)
    scene.load_batch([0])
    config = ChannelConfig(max_depth=0)
    found = trace_paths(scene, make_links(arrays, [0], config), config, make_surface_table(scene))
    assert len(found) > 0 and (found.order == 0).all() and (found.surface == -1).all() and (found.kind == 0).all()


def test_carrier_without_material_data(device: str) -> None:
    with pytest.raises(ValueError, match=r"weather sunny: material 'asphalt' \(itu_very_dry_ground\): .* 60 GHz"):
        solve(two_cars(1), ChannelConfig(carriers_hz=(60e9,)), device, [0])


def test_links_of_another_batch(device: str) -> None:
    arrays = two_cars(2)
    scene = DeviceScene(arrays, device, 1)
    scene.load_batch([0])
    for frames, message in (([0, 1], "link 1: frame 1 in slot 1"), ([1], "link 0: frame 1 in slot 0")):
        with pytest.raises(ValueError, match=message):
            solve_paths(scene, make_links(arrays, frames, EXHAUSTIVE), EXHAUSTIVE, arrays.materials)


@pytest.mark.parametrize("ray_count", [997, 1000, 4096])
def test_every_ray_of_the_lattice_is_launched_once(ray_count: int, device: str) -> None:
    """The surfaces marked are exactly those that the rays of the Fibonacci lattice meet first, cast here in float64."""
    arrays = ended(random_triangles(4, 200, vehicles=6), count=1)
    scene = DeviceScene(arrays, device, 1)
    scene.load_batch([0])
    table, source = make_surface_table(scene), arrays.poses[:, -2, :3]
    seen = launch_rays(scene, np.zeros(1, np.int32), source, ray_count, table)[0].numpy()[0]
    index = np.arange(ray_count)
    z, azimuth = 1 - 2 * index / (ray_count - 1), 2 * np.pi * (index * (np.sqrt(5) - 1) / 2 % 1)
    across = np.sqrt(1 - z**2)
    hits = cast_rays(arrays, 0, source[0], np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1))
    wanted = np.bincount(hits.surface[hits.surface >= 0], minlength=len(table))
    assert (seen[wanted > 1] == 1).all() and (wanted > 1).any()  # surfaces met by one ray only may be met at an edge
    assert (wanted[seen == 1] > 0).mean() > 0.99


@pytest.mark.parametrize("mode", ["launch", "exhaustive"])
def test_every_transmitter_has_its_own_paths(mode: str, device: str) -> None:
    """Two roadside units and two cars in one solve: the paths of each link are those that it has alone."""
    models = (box_model("sedan", material=3),)
    actors = [("cav_1", "cav", 0), ("cav_2", "cav", 0), ("rsu_1", "rsu", -1), ("rsu_2", "rsu", -1)]
    poses = np.array([[pose(-20, -3), pose(25, 3, yaw=np.pi), pose(0, 9, 5), pose(60, -9, 7)]])
    arrays = street_canyon(models, actors, poses)
    config = ChannelConfig(candidates=mode, rays=20_000, max_depth=2, links=("v2i", "v2v"))
    scene = DeviceScene(arrays, device, 1)
    scene.load_batch([0])
    links = make_links(arrays, [0], config)
    assert len(links) == 6 and {(2, 0), (3, 0), (2, 1), (3, 1), (0, 1), (1, 0)} == set(
        zip(links.tx_actor.tolist(), links.rx_actor.tolist(), strict=True)
    )
    assert launched_rays(links, config) == (2 * 20_000 + 2 * 10_000 if mode == "launch" else 0)
    together = solve_paths(scene, links, config, arrays.materials)
    assert len(set(together.path_id.tolist())) == len(together) and (together.count > 3).all()
    for link in range(len(links)):
        alone = solve_paths(scene, links.take(np.array([link])), config, arrays.materials)
        own = together.link == link
        if links.kind[link] == LINK_V2I or (mode == "exhaustive" and links.tx_actor[link] < links.rx_actor[link]):
            for name in ("path_id", "interaction", "surface", "tau", "theta_t"):
                np.testing.assert_array_equal(getattr(together, name)[own], getattr(alone, name))
            np.testing.assert_array_equal(together.a["sunny"][own], alone.a["sunny"])
        elif mode == "exhaustive":  # read backwards from its reverse
            np.testing.assert_array_equal(together.path_id[own], alone.path_id)
            np.testing.assert_allclose(together.tau[own], alone.tau, rtol=1e-13)
            np.testing.assert_allclose(together.transfer["sunny"][own], alone.transfer["sunny"], rtol=1e-9, atol=1e-15)
        else:  # both ends launch half of the rays, and both directions have what either met
            assert set(together.path_id[own].tolist()) >= set(alone.path_id[alone.order < 2].tolist())
    if mode == "launch":
        there, back = ((links.kind == LINK_V2V) & (links.tx_actor == k) for k in (0, 1))
        ways = [together.link == np.flatnonzero(way)[0] for way in (there, back)]
        assert ways[0].sum() == ways[1].sum() > 5
        np.testing.assert_allclose(np.sort(together.tau[ways[0]]), np.sort(together.tau[ways[1]]), rtol=0)
