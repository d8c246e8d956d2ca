"""Path finding: occlusion, batches, candidates, coincident surfaces, missing paths, and errors."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from mmw.channel.links import make_links
from mmw.channel.path_solver.candidates import launch_rays
from mmw.channel.path_solver.image_method import trace_paths
from mmw.channel.path_solver.path_names import tell_apart
from mmw.channel.path_solver.search import Search
from mmw.channel.path_solver.solver import launched_rays, solve_paths
from mmw.channel.path_solver.surface_table import make_surface_table
from mmw.channel.paths import PATH_LOS, PATH_SPECULAR, PathSet
from mmw.config import ChannelConfig
from mmw.scene.scene_data import Actor, SceneData
from tests.fixtures.antennas import antenna_at
from tests.fixtures.device_rays import loaded
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
from tests.oracles.channel import brute_force, link_scene, matched, paths_by_interactions, solve
from tests.oracles.tracing import cast_rays

EXHAUSTIVE = ChannelConfig(candidates="exhaustive")
POINTS = {"antennas": antenna_at({"cav": (0.0, 0.0, 0.0), "rsu": (0.0, 0.0, 0.0)})}


def solved(arrays: SceneData, config: ChannelConfig, device: str, frames: Sequence[int] = (0,)) -> PathSet:
    return solve(arrays, config, device, list(frames))[1]


def test_links_are_ordered_by_frame_kind_and_actor() -> None:
    actors = [("cav_1", "cav", -1), ("veh", "vehicle", -1), ("cav_2", "cav", -1), ("rsu_1", "rsu", -1)]
    here = [pose(1, 0), pose(2, 0), pose(3, 0), pose(4, 0)]
    arrays = arrays_from_parts([], actors=actors, poses=np.array([here, [here[0], here[1], ABSENT, here[3]]]))
    links = make_links(arrays, [1, 0], ChannelConfig(links=("v2i", "v2v")))
    assert links.frame.tolist() == [1, 0, 0, 0, 0]
    assert links.batch_index.tolist() == [0, 1, 1, 1, 1]
    assert links.kind.tolist() == [0, 0, 0, 1, 1]
    assert links.tx_actor.tolist() == [3, 3, 3, 0, 2]
    assert links.rx_actor.tolist() == [0, 0, 2, 2, 0]
    np.testing.assert_array_equal(links.tx.position[0], [4, 0, 4])
    np.testing.assert_array_equal(links.rx.position[2], [3, 0, 2.5])


def test_antenna_turns_with_its_agent() -> None:
    arrays = link_scene([], (0, 0), (5, 5, 0, np.pi / 2))
    config = ChannelConfig(antennas=antenna_at({"cav": (1.0, 0.5, 2.0), "rsu": (0, 0, 3.0)}))
    links = make_links(arrays, [0], config)
    np.testing.assert_allclose(links.rx.position[0], [4.5, 6.0, 2.0], atol=1e-12)


def test_vehicle_blocks_only_its_own_frame(device: str) -> None:
    """A truck that stands between the ends in frame 1, beside them in frame 0 and nowhere in frame 2."""
    models = (box_model("truck", (3.0, 8.0, 6.0), (0.0, 0.0, 3.0), material=0),)
    actors = [("truck", "vehicle", 0), ("cav_1", "cav", -1), ("rsu_1", "rsu", -1)]
    ends = [pose(20, 0, 1.5), pose(-20, 0, 1.5)]
    poses = np.array([[pose(0, 30), *ends], [pose(0, 0), *ends], [ABSENT, *ends]])
    arrays = arrays_from_parts([ground_part()], models, actors, poses)
    paths = solved(arrays, ChannelConfig(candidates="exhaustive", **POINTS), device, [0, 1, 2])
    assert paths.count.tolist() == [3, 0, 2]  # in frame 0 the truck's side reflects as well
    assert paths.index.tolist() == [0, 1, 2, 0, 1]
    assert paths.kind.tolist() == [PATH_LOS, PATH_SPECULAR, PATH_SPECULAR, PATH_LOS, PATH_SPECULAR]
    assert paths.object_id.max() == arrays.actors[0].object_id
    on_truck = paths.vertex[paths.object_id == arrays.actors[0].object_id]
    np.testing.assert_allclose(on_truck, [[0.0, 26.0, 1.5]], atol=1e-12)


def test_link_without_any_path(device: str) -> None:
    arrays = link_scene([wall_part("wall", (0.0, -500.0), (0.0, 500.0), 300.0)], (-10, 0), (10, 0))
    for mode in ("exhaustive", "launch"):
        paths = solved(arrays, ChannelConfig(candidates=mode, samples_per_tx=2000), device)
        assert paths.count.tolist() == [0] and len(paths) == 0
        assert paths.a["sunny"].shape == (0, 2) and paths.transfer["sunny"].shape == (0, 2, 2, 2)


def test_scene_without_links(device: str) -> None:
    paths = solved(closed_box(), EXHAUSTIVE, device)
    assert len(paths) == 0 and paths.count.shape == (0,)


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


@pytest.mark.parametrize("seed", range(2))
def test_against_brute_force(seed: int, device: str) -> None:
    """Random triangles and vehicles in any attitude: every triangle mirrored, every segment traced in float64."""
    arrays = ended(random_triangles(seed, 160, vehicles=8))
    links, paths = solve(arrays, ChannelConfig(candidates="exhaustive", **POINTS), device)
    count = 0
    for link in range(len(links)):
        wanted = brute_force(arrays, 0, links.tx.position[link], links.rx.position[link], 1)
        both, _ = matched(paths_by_interactions(paths, link), wanted)
        for steps, p, path in both:
            np.testing.assert_allclose(paths.vertex[p, : len(steps)], path.point[1:-1], atol=1e-6)
        count += len(both)
    assert count > 5


def test_antenna_on_a_surface_is_reciprocal(device: str) -> None:
    """An antenna exactly on the ground has the line of sight, and no reflection by that ground, both directions."""
    poses = np.array([[pose(-20, 0, 0.0), pose(20, 0.3, 1.5)]])
    arrays = arrays_from_parts([ground_part()], actors=[("cav_1", "cav", -1), ("cav_2", "cav", -1)], poses=poses)
    paths = solved(arrays, ChannelConfig(candidates="exhaustive", links=("v2v",), **POINTS), device)
    assert paths.link.tolist() == [0, 1] and paths.kind.tolist() == [PATH_LOS, PATH_LOS]
    assert paths.tau[0] == pytest.approx(paths.tau[1], rel=1e-15)


@pytest.mark.parametrize("lift", [0.0, 1e-5, 2e-3, 5e-3])
def test_marking_on_a_road_reflects_once(lift: float, device: str) -> None:
    """A marking in or just above the plane of its road: one reflection, by the marking."""
    corners = [(-5, -1, lift), (5, -1, lift), (5, 1, lift), (-5, 1, lift)]
    marking = quad_part("Markings/line", corners, "metal_pole", "road_line")
    arrays = link_scene([ground_part(), marking], (-20, 0), (20, 0))
    config = ChannelConfig(candidates="exhaustive", antennas=antenna_at({"cav": (0, 0, 3.0), "rsu": (0, 0, 3.0)}))
    paths = solved(arrays, config, device)
    assert paths.kind.tolist() == [PATH_LOS, PATH_SPECULAR]
    assert arrays.materials["sunny"][paths.material_id[1, 0]].name == "metal_pole"


@pytest.mark.parametrize("lift", [0.0, 5e-4, 1.2e-3, 3e-3])
@pytest.mark.parametrize("far", [450.0, 1900.0])
def test_thin_sheet_far_from_the_origin_reflects_once(far: float, lift: float, device: str) -> None:
    """Far out, where segments start higher above their surface, a sheet on a small plate still hides its reflection."""
    plate = quad_part(
        "plate", [(far - 9, -1, 0), (far + 9, -1, 0), (far + 9, 1, 0), (far - 9, 1, 0)], "asphalt", "road"
    )
    sheet = ground_part(40.0, z=lift, material="metal_pole")
    sheet = replace(sheet, points=sheet.points + np.array([far, 0.0, 0.0]))
    arrays = link_scene([plate, sheet], (far - 9, 0), (far + 9, 0))
    config = ChannelConfig(candidates="exhaustive", antennas=antenna_at({"cav": (0, 0, 1.6), "rsu": (0, 0, 6.0)}))
    paths = solved(arrays, config, device)
    assert paths.kind.tolist() == [PATH_LOS, PATH_SPECULAR]
    if lift > 1e-3:
        assert abs(paths.vertex[1, 0, 2] - lift) < 1e-12  # the sheet's, though the plate is smaller


def test_many_triangles_of_one_plane_reflect_once(device: str) -> None:
    """A road of 50 x 50 cells is one surface, also when the point falls on an edge or a corner of its triangles."""
    for x, y in ((20.0, 0.0), (20.0, 1.0), (21.3, 7.7), (18.0, 18.0)):
        arrays = link_scene([ground_part(50.0, cells=50)], (-20, 0), (x, y, 1.5))
        paths = solved(arrays, EXHAUSTIVE, device)
        assert paths.kind.tolist() == [PATH_LOS, PATH_SPECULAR]


def test_far_town_is_as_exact(device: str) -> None:
    """A town 50 km from the origin gives the same paths as at the origin: rays are traced about its own middle."""
    found = []
    for shift in (0.0, 50_000.0):
        part = ground_part()
        part = replace(part, points=part.points + np.array([shift, shift, 0.0]))
        arrays = link_scene([part], (shift - 20, shift), (shift + 23, shift + 4))
        paths = solved(arrays, ChannelConfig(samples_per_tx=5000), device)
        found.append((paths.kind.tolist(), paths.tau, paths.a["sunny"]))
    assert found[0][0] == found[1][0] == [PATH_LOS, PATH_SPECULAR]
    np.testing.assert_allclose(found[0][1], found[1][1], rtol=1e-10)
    np.testing.assert_allclose(found[0][2], found[1][2], rtol=1e-8)


def test_a_name_belongs_to_a_rank() -> None:
    """Of paths of one name the first follows the strongest where two swap; others keep theirs where the last ends."""
    link, same = np.zeros(3, dtype=int), np.full(3, 7)
    before = tell_apart(same, link, -np.array([3.0, 1.0, 2.0]))
    assert before[0] == 7 and len(np.unique(before)) == 3
    np.testing.assert_array_equal(tell_apart(same, link, -np.array([1.9, 1.0, 2.0])), before[[2, 1, 0]])
    np.testing.assert_array_equal(tell_apart(same[:2], link[:2], -np.array([3.0, 2.0])), before[[0, 2]])
    np.testing.assert_array_equal(tell_apart(same, np.arange(3), -np.arange(3.0)), same)


def test_weathers_share_geometry(device: str) -> None:
    arrays = two_cars(1)
    wet = list(arrays.materials["sunny"])
    wet[0] = wet[1]
    scene = loaded(arrays, device, [0])
    links = make_links(arrays, [0], EXHAUSTIVE)
    paths = solve_paths(scene, links, EXHAUSTIVE, {"sunny": arrays.materials["sunny"], "rainy": tuple(wet)})
    on_ground = paths.material_id[:, 0] == 0
    assert on_ground.any() and not on_ground.all()
    changed = np.abs(paths.a["sunny"] - paths.a["rainy"]).max(axis=1) > 0
    np.testing.assert_array_equal(changed, on_ground)


def test_depth_zero_is_line_of_sight_only(device: str) -> None:
    arrays = two_cars(1)
    scene = loaded(arrays, device, [0])
    config = ChannelConfig(max_depth=0)
    found = trace_paths(Search(scene, make_links(arrays, [0], config), config, make_surface_table(scene)))
    assert len(found) > 0 and (found.order == 0).all() and (found.surface == -1).all() and (found.kind == 0).all()


def test_carrier_without_material_data(device: str) -> None:
    with pytest.raises(ValueError, match=r"weather sunny: material 'asphalt' \(itu_very_dry_ground\): .* 200 GHz"):
        solved(two_cars(1), ChannelConfig(carriers_hz=(200e9,)), device)


def test_links_of_another_batch(device: str) -> None:
    arrays = two_cars(2)
    scene = loaded(arrays, device, [0])
    for frames, message in (([0, 1], "link 1: frame 1 at batch index 1"), ([1], "link 0: frame 1 at batch index 0")):
        with pytest.raises(ValueError, match=message):
            solve_paths(scene, make_links(arrays, frames, EXHAUSTIVE), EXHAUSTIVE, arrays.materials)


@pytest.mark.parametrize("ray_count", [997, 1000, 4096])
def test_every_ray_of_the_lattice_is_launched_once(ray_count: int, device: str) -> None:
    """The surfaces marked are exactly those that the rays of the Fibonacci lattice hit first, cast here in float64."""
    arrays = ended(random_triangles(4, 200, vehicles=6), count=1)
    scene = loaded(arrays, device, [0])
    table, source = make_surface_table(scene), arrays.poses[:, -2, :3]
    search = Search(scene, make_links(arrays, [0], EXHAUSTIVE), EXHAUSTIVE, table)
    seen = launch_rays(search, search.sort(np.zeros(1), source, source).sources, ray_count)[0].numpy()[0]
    index = np.arange(ray_count)
    z, azimuth = 1 - 2 * index / (ray_count - 1), 2 * np.pi * (index * (np.sqrt(5) - 1) / 2 % 1)
    across = np.sqrt(1 - z**2)
    hits = cast_rays(arrays, 0, source[0], np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1))
    wanted = np.bincount(hits.surface[hits.surface >= 0], minlength=len(table))
    assert (seen[wanted > 1] == 1).all() and (wanted > 1).any()  # surfaces hit by one ray only may be hit at an edge
    assert (wanted[seen == 1] > 0).mean() > 0.99


@pytest.mark.parametrize("mode", ["launch", "exhaustive"])
def test_every_transmitter_has_its_own_paths(mode: str, device: str) -> None:
    """Two roadside units and two cars in one solve: the paths of each link are those that it has alone."""
    models = (box_model("sedan", material=3),)
    actors = [("cav_1", "cav", 0), ("cav_2", "cav", 0), ("rsu_1", "rsu", -1), ("rsu_2", "rsu", -1)]
    poses = np.array([[pose(-20, -3), pose(25, 3, yaw=np.pi), pose(0, 9, 5), pose(60, -9, 7)]])
    arrays = street_canyon(models, actors, poses)
    config = ChannelConfig(candidates=mode, samples_per_tx=20_000, max_depth=2, links=("v2i", "v2v"))
    scene = loaded(arrays, device, [0])
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
        if links.kind[link] == 0 or (mode == "exhaustive" and links.tx_actor[link] < links.rx_actor[link]):
            for name in ("path_id", "interaction", "surface", "tau", "theta_t"):
                np.testing.assert_array_equal(getattr(together, name)[own], getattr(alone, name))
            np.testing.assert_array_equal(together.a["sunny"][own], alone.a["sunny"])
        elif mode == "exhaustive":  # read backwards from its reverse
            np.testing.assert_array_equal(together.path_id[own], alone.path_id)
            np.testing.assert_allclose(together.tau[own], alone.tau, rtol=1e-13)
            np.testing.assert_allclose(together.transfer["sunny"][own], alone.transfer["sunny"], rtol=1e-9, atol=1e-15)
        else:  # both ends launch half of the rays, and both directions have what either hit
            assert set(together.path_id[own].tolist()) >= set(alone.path_id[alone.order < 2].tolist())
    if mode == "launch":
        there, back = ((links.kind == 1) & (links.tx_actor == k) for k in (0, 1))
        directions = [together.link == np.flatnonzero(unit)[0] for unit in (there, back)]
        assert directions[0].sum() == directions[1].sum() > 5
        np.testing.assert_allclose(np.sort(together.tau[directions[0]]), np.sort(together.tau[directions[1]]), rtol=0)
