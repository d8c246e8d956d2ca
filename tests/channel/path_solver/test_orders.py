"""Specular reflections of any order: brute force, closed forms, and every split of the work."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mmw.channel.links import make_links
from mmw.channel.path_solver import (
    candidate_list,
    candidate_output,
    candidates,
    mirrored_patches,
    patch_rays,
    scatter_paths,
)
from mmw.channel.path_solver.found_geometry import found_geometry
from mmw.channel.path_solver.solver import solve_paths, trace_links
from mmw.channel.path_solver.surface_table import make_surface_table
from mmw.channel.paths import PATH_DIFFRACTION, PATH_DIFFUSE, PATH_LOS, PATH_SPECULAR, PATH_TRANSMISSION, PathSet
from mmw.config import ChannelConfig
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.planar_surfaces import find_surfaces
from mmw.core.transforms import make_pose, pose_from_ypr, rotate
from mmw.physics.materials.material import Material, RadioMaterial
from mmw.scene.scene_data import Prototype, SceneData
from tests.fixtures.antennas import antenna_at
from tests.fixtures.device_rays import loaded
from tests.fixtures.scenes import (
    ABSENT,
    arrays_from_parts,
    box_mesh,
    box_model,
    box_part,
    ground_part,
    quad_part,
    wall_part,
)
from tests.oracles import channel as oracle
from tests.oracles.channel import DRIVING

HYPOTHESIS = settings(
    max_examples=6, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
RADIO = {
    "stone": RadioMaterial("constant", relative_permittivity=5.2, conductivity=0.4),
    "copper": RadioMaterial("constant", conductivity=1e7),
    "pane": RadioMaterial("constant", relative_permittivity=6.3, conductivity=0.03, thickness=0.006),
    "board": RadioMaterial("constant", relative_permittivity=2.7, conductivity=0.02, thickness=0.013),
}
MATERIALS = oracle.radio_materials(RADIO)
CORNERS = [[(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)][i] for i in (0, 1, 3, 2, 4, 5, 7, 6)]
SIDES = ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (3, 2, 6, 7), (0, 3, 7, 4), (1, 2, 6, 5))


def room(
    seed: int, materials: dict[str, Material], *, is_open: bool = False, filled: bool = True, receivers: int = 2
) -> SceneData:
    """Return a room of any size and attitude with a slanted panel, and a box that has another pose in each frame."""
    rng = np.random.default_rng(seed)
    size, names = rng.uniform([4, 5, 3], [9, 12, 6]), list(materials)
    turn = rng.normal(size=4)
    turn /= np.linalg.norm(turn)
    corner = rotate(turn, (np.array(CORNERS) - 0.5) * size)
    sides = [side for k, side in enumerate(SIDES) if not is_open or k != seed % 6]
    walls = [corner[list(side)] for side in sides]
    if filled:  # two surfaces in one plane
        a, b, c, d = walls.pop()
        walls += [[a, 0.6 * a + 0.4 * b, 0.6 * d + 0.4 * c, d], [0.6 * a + 0.4 * b, b, c, 0.6 * d + 0.4 * c]]
    parts = [quad_part(f"Buildings/side_{k}", wall, str(rng.choice(names)), "building") for k, wall in enumerate(walls)]
    models, actors, poses = [], [], []
    place = rng.uniform(-0.42, 0.42, (receivers + 1, 3)) * size
    if filled:
        edge = rng.uniform(0.5, 1.5, (2, 3)) * [[1], [1]]
        middle = rng.uniform(-0.25, 0.25, 3) * size
        panel = [middle - edge[0] - edge[1], middle + edge[0] - edge[1], middle + edge[0] + edge[1]]
        panel = rotate(turn, np.array([*panel, middle - edge[0] + edge[1]]))
        parts.append(quad_part("Props/panel", panel, str(rng.choice(names)), "static"))
        points, faces = box_mesh(rng.uniform(0.6, 1.8, 3))
        ids = np.full(len(faces), rng.integers(len(names)), dtype=np.int32)
        models.append(Prototype("box", points, faces, ids, find_surfaces(points, faces, np.zeros_like(ids), ids)))
        actors.append(("veh_001", "vehicle", 0))
        turns = rng.normal(size=(2, 4))
        poses.append(
            make_pose(
                rotate(turn, rng.uniform(-0.3, 0.3, (2, 3)) * size), turns / np.linalg.norm(turns, axis=1)[:, None]
            )
        )
    actors += [("rsu_1", "rsu", -1), *((f"cav_{k}", "cav", -1) for k in range(receivers))]
    poses += [np.tile(pose_from_ypr(rotate(turn, p), *rng.uniform(-1, 1, 3)), (2, 1)) for p in place]
    return arrays_from_parts(parts, models, actors, np.stack(poses, axis=1), materials=materials)


def check_against_brute_force(
    arrays: SceneData, depth: int, device: str, *, refraction: bool = False
) -> tuple[int, int]:
    """Compare every path of both frames with the oracle; return how many were compared and how many are in doubt."""
    links, paths = oracle.solve(arrays, oracle.channel(max_depth=depth, refraction=refraction), device, [1, 0])
    by_id = arrays.materials["sunny"]
    material_of = dict(zip(arrays.surface.tolist(), arrays.material.tolist(), strict=True))
    for model in arrays.models:
        offset = arrays.town_surface_count
        material_of |= dict(zip((offset + model.surface).tolist(), model.material.tolist(), strict=True))
    slabs = frozenset(s for s, m in material_of.items() if by_id[m].radio.thickness > 0 and refraction)
    compared, doubts = 0, 0
    for link in range(len(links)):
        tx, rx = links.tx.position[link], links.rx.position[link]
        wanted = oracle.brute_force(arrays, int(links.frame[link]), tx, rx, depth, slabs)
        both, doubtful = oracle.matched(oracle.paths_by_interactions(paths, link), wanted)
        for steps, p, path in both:
            order = len(steps)
            np.testing.assert_allclose(paths.tau[p], path.length / SPEED_OF_LIGHT, rtol=1e-12)
            np.testing.assert_allclose(paths.vertex[p, :order], path.point[1:-1], atol=1e-9)
            radio = [by_id[material_of[surface]].radio for _, surface in steps]
            for column, carrier in enumerate(paths.carriers_hz):
                expected = oracle.dyadic_transfer(path, [kind for kind, _ in steps], radio, carrier)
                scale = SPEED_OF_LIGHT / carrier / (4 * np.pi * path.length)
                np.testing.assert_allclose(paths.transfer["sunny"][p, column], expected, atol=1e-9 * scale)
        compared, doubts = compared + len(both), doubts + doubtful
    return compared, doubts


@HYPOTHESIS
@given(seed=st.integers(0, 10_000), is_open=st.booleans())
def test_reflections_against_brute_force(seed: int, is_open: bool, device: str) -> None:
    """Sets of paths, delays, points and transfers to order 3, with a body in any pose."""
    compared, doubts = check_against_brute_force(room(seed, MATERIALS, is_open=is_open), 3, device)
    assert compared > 30 and doubts < 0.3 * compared


@HYPOTHESIS
@given(seed=st.integers(0, 10_000), is_open=st.booleans())
def test_reflections_through_slabs_against_brute_force(seed: int, is_open: bool, device: str) -> None:
    """The same with panes and boards that let the wave through on any segment."""
    slabs = {name: MATERIALS[name] for name in ("pane", "stone", "board")}
    compared, doubts = check_against_brute_force(room(seed, slabs, is_open=is_open), 3, device, refraction=True)
    assert compared > 30 and doubts < 0.3 * compared


def test_launched_candidates_are_a_subset(device: str, record_property) -> None:
    """Rays find no path that is none; the share that 10^5 rays miss is reported, and small."""
    counts = [
        oracle.launched_share(
            room(k, MATERIALS, is_open=k == 2), device, max_depth=3, refraction=on, samples_per_tx=100_000
        )
        for k in range(3)
        for on in (False, True)
    ]
    found, missed = np.sum(counts, axis=0)
    record_property("share_missed", float(missed / found))
    assert found > 500 and missed <= 0.01 * found


COLUMNS = (
    "path_id", "kind", "order", "interaction", "surface", "object_id", "material_id", "vertex", "normal", "tau",
    "theta_t", "phi_t", "theta_r", "phi_r", "range_rate",
)  # fmt: skip


def assert_same_bits(one: PathSet, rows: np.ndarray, other: PathSet, other_rows: np.ndarray) -> None:
    assert rows.sum() == other_rows.sum() > 0
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(one, name)[rows], getattr(other, name)[other_rows], err_msg=name)
    for name in ("a", "transfer"):
        np.testing.assert_array_equal(getattr(one, name)["sunny"][rows], getattr(other, name)["sunny"][other_rows])


def street(frame_count: int = 4) -> SceneData:
    """Two CAVs, a roadside unit, and a turning truck of panes that is not there in frame 2, on ground that scatters."""
    described = {
        "asphalt": RadioMaterial("constant", relative_permittivity=4.0, conductivity=0.1, scattering=0.4),
        "facade": RadioMaterial("constant", relative_permittivity=5.0, conductivity=0.1),
        "pane": RADIO["pane"],
        "paint": RadioMaterial("itu", itu="itu_pec"),
    }
    parts = [
        ground_part(60.0),
        wall_part("north", (-40.0, 10.0), (40.0, 10.0), 15.0, "facade"),
        wall_part("south", (40.0, -10.0), (-40.0, -10.0), 15.0, "pane"),
        box_part("Buildings/kiosk", (4.0, 3.0, 3.0), (8.0, 8.0, 1.5), "facade", "building"),
    ]
    models = (box_model("sedan", material=3), box_model("truck", (8.0, 2.5, 3.5), (0.5, 0.0, 1.75), material=2))
    rows = oracle.driving(0.1 * np.arange(frame_count), truck_y=5.5)
    rows[2:3, 2] = ABSENT
    return arrays_from_parts(parts, models, DRIVING, rows, materials=oracle.radio_materials(described))


EVERYTHING = oracle.channel(
    candidates="launch", samples_per_tx=20_000, links=("v2i", "v2v"), max_depth=3, refraction=True, diffraction=True,
    diffuse_reflection=True, diffuse_samples=300, antennas=antenna_at({"cav": (0.3, 0.2, 1.9), "rsu": (0.0, 0.0, 1.0)}),
)  # fmt: skip


BY_ERROR = EVERYTHING.model_copy(
    update={"diffuse_samples": 1000, "diffuse_error_db": 1.5, "diffuse_order": 2, "diffraction": False}
)
FINITE = EVERYTHING.model_copy(update={"finite_surfaces": True, "diffuse_reflection": False})
BOTH = pytest.mark.parametrize("config", [EVERYTHING, BY_ERROR], ids=["counted", "by error"])


@BOTH
def test_batch_and_order_do_not_change_a_bit(config: ChannelConfig, device: str) -> None:
    arrays = street()
    batches = [
        oracle.solve(arrays, config, device, frames) for frames in ([0, 1, 2, 3], [3, 1, 0, 2], [0], [1], [2], [3])
    ]
    links, paths = batches[0]
    kinds = {PATH_LOS, PATH_SPECULAR, PATH_TRANSMISSION, PATH_DIFFUSE}
    assert kinds | ({PATH_DIFFRACTION} if config.diffraction else set()) <= set(paths.kind.tolist())
    assert set(paths.order.tolist()) == {0, 1, 2, 3}
    assert all(len(set(paths.path_id[paths.link == k].tolist())) == paths.count[k] for k in range(len(links)))
    for other_links, other in batches[1:]:
        for frame in np.unique(other_links.frame):
            assert_same_bits(paths, links.frame[paths.link] == frame, other, other_links.frame[other.link] == frame)


@BOTH
def test_order_of_links_does_not_change_a_bit(config: ChannelConfig, device: str) -> None:
    arrays = street(2)
    scene = loaded(arrays, device, [0, 1])
    links = make_links(arrays, [0, 1], config)
    paths = solve_paths(scene, links, config, arrays.materials)
    mixed = np.random.default_rng(1).permutation(len(links))
    turned = solve_paths(scene, links.take(mixed), config, arrays.materials)
    for k, link in enumerate(mixed):
        assert_same_bits(paths, paths.link == link, turned, turned.link == k)


def test_geometry_of_some_paths_is_that_of_all(device: str) -> None:
    """Every third path, taken from all, has to the bit what its interactions alone give."""
    arrays, config = street(2), EVERYTHING.model_copy(update={"finite_surfaces": True})
    scene = loaded(arrays, device, [0, 1])
    table = make_surface_table(scene, **config.surface_options)
    trace = trace_links(scene, make_links(arrays, [0, 1], config), config, table)
    taken = trace.take(np.arange(1, len(trace.found), 3))
    geometry, own, names = found_geometry(trace.search, taken.found)
    assert len(own.wedges.path) and len(own.rough.path)
    same = taken.interactions
    pairs = (taken.geometry, geometry), (same.wedges, own.wedges), (same.rough, own.rough), (taken.names, names)
    for one, other in pairs:
        for name in one.__dataclass_fields__:
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    for name in ("material_id", "wedge_material", "wedge_width"):
        np.testing.assert_array_equal(getattr(same, name), getattr(own, name), err_msg=name)


@pytest.mark.parametrize("config", [EVERYTHING, BY_ERROR, FINITE], ids=["counted", "by error", "finite"])
@pytest.mark.parametrize("mode", ["launch", "exhaustive"])
def test_sizes_of_the_work_do_not_change_a_bit(
    mode: str, config: ChannelConfig, device: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Tables that must grow, launches that must be split, few candidates at once: nothing shows."""
    arrays, config = street(2), config.model_copy(update={"candidates": mode, "max_depth": 2})
    scene = loaded(arrays, device, [0, 1])
    links, table = make_links(arrays, [0, 1], config), make_surface_table(scene, **config.surface_options)
    paths = solve_paths(scene, links, config, arrays.materials, table)
    again = solve_paths(scene, links, config, arrays.materials, table)
    table.sizes.clear()
    monkeypatch.setattr(candidate_output, "FIRST_PAIRS", 1)
    monkeypatch.setattr(candidates, "FIRST_CELLS", 1)
    monkeypatch.setattr(candidates, "CELLS_AT_ONCE", {"cpu": 512, "cuda": 512})
    monkeypatch.setattr(candidate_list, "CANDIDATES_AT_ONCE", 7)
    monkeypatch.setattr(candidate_list, "FIRST_ROOM", {"candidates": (1, 3), "paths": (1, 3)})
    monkeypatch.setattr(patch_rays, "HITS_AT_ONCE", 1)
    monkeypatch.setattr(scatter_paths, "ROWS_AT_ONCE", 97)
    monkeypatch.setattr(mirrored_patches, "PAIRS_AT_ONCE", 997)
    small = solve_paths(scene, links, config, arrays.materials, table)
    if mode == "launch":
        grown = [name for name in table.sizes if name.startswith(("cells", "candidates", "paths"))]
        assert len(grown) >= 2, table.sizes
        monkeypatch.setattr(candidates, "PAIRS_AT_ONCE", 1)
        monkeypatch.setattr(candidates, "RAYS_AT_ONCE", 1)
        table.workspaces.clear()  # records of a GPU hold for these constants
    one_by_one = solve_paths(scene, links, config, arrays.materials, table)
    every = np.ones(len(paths), dtype=bool)
    for other in (again, small, one_by_one):
        np.testing.assert_array_equal(other.link, paths.link)
        assert_same_bits(paths, every, other, every)


def test_many_links_of_one_transmitter(device: str) -> None:
    """Seventy receivers, more than one pass over the candidates takes, see what each of them sees alone."""
    arrays, config = room(5, MATERIALS, receivers=70), oracle.channel(max_depth=2)
    scene = loaded(arrays, device, [0])
    links = make_links(arrays, [0], config)
    paths = solve_paths(scene, links, config, arrays.materials)
    for link in (0, 30, 31, 32, 61, 62, 69):
        alone = solve_paths(scene, links.take(np.array([link])), config, arrays.materials)
        assert_same_bits(paths, paths.link == link, alone, np.ones(len(alone), dtype=bool))


def test_too_many_candidates(device: str) -> None:
    with pytest.raises(ValueError, match=r"'exhaustive' with max_depth = 8: 13 planes make \d+ candidates"):
        oracle.solve(room(0, MATERIALS), oracle.channel(max_depth=8), device, [0])


@pytest.mark.parametrize("depth", [2, 3])
def test_deeper_searches_keep_the_paths(depth: int, device: str) -> None:
    """A larger depth adds paths of that order and changes none of the others, to the bit, nor their identity."""
    arrays = room(3, MATERIALS)
    (_, less), (_, more) = (oracle.solve(arrays, oracle.channel(max_depth=d), device, [0]) for d in (depth - 1, depth))
    old = more.order < depth
    assert old.sum() == len(less) < len(more)
    for name in ("link", "path_id", "tau", "theta_t", "phi_r", "range_rate"):
        np.testing.assert_array_equal(getattr(more, name)[old], getattr(less, name))
    np.testing.assert_array_equal(more.a["sunny"][old], less.a["sunny"])
    np.testing.assert_array_equal(more.vertex[old][:, : depth - 1], less.vertex)


@pytest.mark.parametrize("mode", ["launch", "exhaustive"])
def test_one_plane_at_depth_two(mode: str, device: str) -> None:
    """A scene of a single plane has no candidate of two, and one of none has only the line of sight."""
    for parts, count in (([], 1), ([ground_part()], 2)):
        arrays = oracle.link_scene(parts, (-9, 0, 2), (9, 0, 3))
        _, paths = oracle.solve(arrays, oracle.channel(max_depth=2, candidates=mode, samples_per_tx=1000), device)
        assert paths.count.tolist() == [count]


@pytest.mark.parametrize("depth", [5, 8])
def test_deepest_search(depth: int, device: str) -> None:
    """The deepest search that a configuration allows, with few rays: two parallel walls mirror to any order."""
    walls = [wall_part("north", (-50.0, 5.0), (50.0, 5.0), 9.0), wall_part("south", (50.0, -5.0), (-50.0, -5.0), 9.0)]
    arrays = oracle.link_scene(walls, (0, 1, 4), (9, 2, 5))
    _, paths = oracle.solve(arrays, oracle.channel(max_depth=depth, candidates="launch", samples_per_tx=1000), device)
    assert paths.order.tolist() == [0, *(k for k in range(1, depth + 1) for _ in range(2))]
