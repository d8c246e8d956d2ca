"""Waves through crowns of trees: lengths against clipped lines, losses against Weissberger."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import mmw
from mmw.channel.links import make_links
from mmw.channel.path_solver.solver import trace_links
from mmw.channel.path_solver.surface_table import make_surface_table
from mmw.channel.paths import PATH_KINDS, PATH_LOS, PATH_SPECULAR, PATH_TRANSMISSION, PathSet
from mmw.channel.rows import link_rows
from mmw.config import ChannelConfig
from mmw.core.errors import InputError
from mmw.generation.configuration_warnings import surface_warnings
from mmw.physics.em.interaction import DIFFRACTION, DIFFUSE, SPECULAR
from mmw.physics.materials.material import RadioMaterial
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.trees import sphere
from tests.fixtures.scenes import box_model, box_part, pose, quad_part
from tests.oracles import channel as oracle

RADIO = {
    "leaf": RadioMaterial("itu", itu="itu_wood", medium="foliage"),
    "brick": RadioMaterial("constant", relative_permittivity=3.9, conductivity=0.04),
    "glass": RadioMaterial("constant", relative_permittivity=6.3, conductivity=0.03, thickness=0.006),
    "rough": RadioMaterial("constant", relative_permittivity=3.9, scattering=0.5),
}
MATERIALS = oracle.radio_materials(RADIO)
CLEAR = oracle.channel(max_depth=1, foliage=True)


def ball(name: str, center: Sequence[float], radius: float, frequency: int = 8) -> MeshPart:
    mesh = sphere(frequency)
    return MeshPart(f"Props/{name}/crown", mesh.points * radius + np.array(center), mesh.faces, "leaf", "vegetation")


def wall(x: float, material: str, half: float = 60.0) -> MeshPart:
    """Return an upright wall across the x axis."""
    corners = [(x, -half, -half), (x, half, -half), (x, half, half), (x, -half, half)]
    return quad_part(f"Buildings/wall_{x:g}", corners, material, "building")


POST = quad_part("Props/post", [(77, 900, 0), (77, 901, 0), (77, 901, 1), (77, 900, 1)], "brick", "static")


def scene(parts: Sequence[MeshPart], tx: Sequence[float], *rx: Sequence[float], **options) -> SceneData:
    return oracle.link_scene([*parts, POST], tx, *rx, materials=MATERIALS, **options)


def loss_db(paths: PathSet, carrier: int = 0) -> np.ndarray:
    return next(iter(paths.loss_db.values()))["foliage_db"][:, carrier]


def weissberger(length: float, ghz: float = 28.0) -> float:
    return 0.45 * ghz**0.284 * length if length < 14.0 else 1.33 * ghz**0.284 * length**0.588


def stretches(part: MeshPart, begin: np.ndarray, end: np.ndarray) -> tuple[float, float]:
    """Return the shares of a segment at which it enters and leaves a convex part, by the planes of all faces."""
    low, high = 0.0, 1.0
    for corner in part.points[part.faces]:
        normal = np.cross(corner[1] - corner[0], corner[2] - corner[0])
        ahead, height = normal @ (end - begin), normal @ (corner[0] - begin)
        if ahead == 0.0:
            if height < 0.0:
                return 0.0, 0.0
        elif ahead < 0.0:
            low = max(low, height / ahead)
        else:
            high = min(high, height / ahead)
    return (low, high) if low < high else (0.0, 0.0)


def length_inside(parts: Sequence[MeshPart], *points: Sequence[float]) -> float:
    """Return the length of a polyline inside the union of convex parts [m]."""
    total = 0.0
    for begin, end in pairwise(np.array(points, dtype=np.float64)):
        reached = 0.0
        for low, high in sorted(stretches(part, begin, end) for part in parts):
            total += max(0.0, high - max(low, reached)) * float(np.linalg.norm(end - begin))
            reached = max(reached, high)
    return total


def only_path(arrays: SceneData, device: str, config: ChannelConfig = CLEAR) -> tuple[PathSet, int]:
    """Return the paths of a scene with one link, and the row of its line of sight."""
    _, paths = oracle.solve(arrays, config, device)
    (row,) = np.flatnonzero(paths.kind == PATH_LOS)
    return paths, int(row)


@pytest.mark.parametrize("height", [0.0, 0.7, 1.5, 2.3, 2.49])
def test_chords_of_a_crown(height: float, device: str) -> None:
    """The line of sight of a crown of 2.5 m: close to a sphere's chord, and exactly that of its facets."""
    crown, tx, rx = ball("a", (1.0, 2.0, 3.0), 2.5, 16), (-9.0, 2.1, 3.0 + height), (14.0, 2.1, 3.0 + height)
    paths, row = only_path(scene([crown], tx, rx), device)
    length = length_inside([crown], tx, rx)
    assert length == pytest.approx(2.0 * np.sqrt(2.5**2 - height**2 - 0.01), abs=0.15)
    assert paths.order[row] == 0
    for carrier, ghz in enumerate((28.0, 4.9)):
        assert loss_db(paths, carrier)[row] == pytest.approx(weissberger(length, ghz), rel=1e-9)


def test_a_crown_of_5_m_at_28_ghz(device: str) -> None:
    """The value that measured single trees scatter around by about 4 dB."""
    paths, row = only_path(scene([ball("a", (0, 0, 0), 2.5, 24)], (-20, 0, 0.05), (20, 0, 0.05)), device)
    assert loss_db(paths)[row] == pytest.approx(5.8, abs=0.1)
    weather = next(iter(paths.a))
    free, _ = only_path(scene([], (-20, 0, 0.05), (20, 0, 0.05)), device)
    lost = 20 * np.log10(np.abs(free.a[weather][0, 0] / paths.a[weather][row, 0]))
    assert lost == pytest.approx(loss_db(paths)[row], abs=1e-9)


@pytest.mark.parametrize(
    ("tx", "rx"),
    [
        ((-12, 0.1, 0.2), (12, 0.3, 0.1)),  # through all
        ((-12, 0.1, 0.2), (0.4, 0.3, 0.1)),  # the receiver is inside of the first
        ((1.9, 0.1, 0.2), (2.4, 0.3, 0.1)),  # both are inside, where two overlap
        ((3.9, 0.1, 0.2), (8.0, 0.3, 1.1)),  # from one to the other, which lies apart
        ((-12, 9, 0), (12, 9, 0)),  # beside
    ],
)
@pytest.mark.parametrize("offset", [(0, 0, 0), (30e3, -7e3, 100.0)])
def test_crowns_that_overlap_count_once(tx: tuple, rx: tuple, offset: tuple, device: str) -> None:
    moved = np.array(offset, dtype=np.float64)
    crowns = [ball(name, np.array(at) + moved, r) for name, at, r in (
        ("a", (0.0, 0.0, 0.0), 2.5), ("b", (3.0, 0.0, 0.0), 2.0), ("c", (8.0, 0.0, 1.0), 1.5))]  # fmt: skip
    ends = moved + tx, moved + rx
    paths, row = only_path(scene(crowns, *ends), device)
    assert loss_db(paths)[row] == pytest.approx(weissberger(length_inside(crowns, *ends)), rel=1e-9, abs=1e-9)


def test_through_edges_and_corners_of_hulls(device: str) -> None:
    """A line along the diagonals of sides and through corners, and one that touches an edge from outside."""
    box = box_part("Props/hedge", (2, 2, 2), (0, 0, 0), "leaf", "vegetation")
    ends = [((-9, 0, 0), (9, 0, 0)), ((-5, -5, -5), (5, 5, 5)), ((-5, 5, 0), (5, -5, 0)), ((-5, 3, 0), (3, -5, 0)),
            ((0, 0, -9), (0, 0, 9)), ((-9, -1.5, 0.5), (9, 1.5, 0.5)), ((-5, 5, 5), (5, -5, -5))]  # fmt: skip
    for tx, rx in ends:
        paths, row = only_path(scene([box], tx, rx), device)
        assert loss_db(paths)[row] == pytest.approx(weissberger(length_inside([box], tx, rx)), abs=1e-9), (tx, rx)


def test_hulls_that_look_inward_and_open_ones(device: str) -> None:
    """Turned faces are turned back; what closes no volume is passed without loss, and told."""
    crown, tx, rx = ball("a", (0, 0, 0), 2.5), (-9, 0.1, 0.2), (9, 0.1, 0.2)
    turned, cut = replace(crown, faces=crown.faces[:, ::-1]), replace(crown, faces=crown.faces[1:])
    expected = weissberger(length_inside([crown], tx, rx))
    for part, value in ((turned, expected), (cut, 0.0)):
        arrays = scene([part], tx, rx)
        paths, row = only_path(arrays, device)
        assert loss_db(paths)[row] == pytest.approx(value, rel=1e-9)
        table = make_surface_table(DeviceScene(arrays, device, 1), foliage=True)
        assert table.foliage is not None and table.foliage.open_faces == (len(cut.faces) if part is cut else 0)
        assert len(list(surface_warnings(table))) == (part is cut)


def test_reflections_before_and_behind_crowns(device: str) -> None:
    """The crowns on both legs count, on no path as an interaction; the wall reflects at depth 1."""
    crowns = [ball("a", (-4, 4, 0.3), 2.0), ball("b", (4, 4, 0), 1.5)]
    tx, rx = (-8.0, 0.0, 0.0), (8.0, 0.5, 0.0)
    mirror = quad_part("Buildings/w", [(-60, 8, -60), (-60, 8, 60), (60, 8, 60), (60, 8, -60)], "brick", "building")
    for mode in ("exhaustive", "launch"):
        arrays = scene([*crowns, mirror], tx, rx)
        _, paths = oracle.solve(arrays, replace_config(CLEAR, candidates=mode, samples_per_tx=2000), device)
        (row,) = np.flatnonzero(paths.kind == PATH_SPECULAR)
        length = length_inside(crowns, tx, paths.vertex[row, 0], rx)
        assert paths.order[row] == 1 and length > 4.0
        assert loss_db(paths)[row] == pytest.approx(weissberger(length), rel=1e-9)


def replace_config(config: ChannelConfig, **changes) -> ChannelConfig:
    return ChannelConfig(**{**config.model_dump(), **changes})


@pytest.mark.parametrize("mode", ["exhaustive", "launch"])
def test_a_crown_is_no_mirror_no_wedge_and_no_obstacle(mode: str, device: str) -> None:
    """It is all three without the switch, as a solid."""
    arrays = scene([ball("a", (0, 0, 0), 2.5, 4)], (-9, 0, 0.1), (9, 0, 0.1), (-9, 3, 0.1), (7, 4, 0.1))
    config = replace_config(CLEAR, max_depth=2, diffraction=True, candidates=mode, samples_per_tx=4000)
    _, solid = oracle.solve(arrays, replace_config(config, foliage=False), device)
    assert {SPECULAR, DIFFRACTION} <= set(solid.interaction.ravel().tolist())
    assert set(solid.link[solid.kind == PATH_LOS].tolist()) == {1}
    assert (loss_db(solid) == 0.0).all()
    _, paths = oracle.solve(arrays, config, device)
    assert paths.kind.tolist() == [PATH_LOS] * 3 and paths.link.tolist() == [0, 1, 2]
    assert loss_db(paths)[0] > 0.0 and loss_db(paths)[1] == 0.0


def test_crowns_use_up_no_depth(device: str) -> None:
    crowns = [ball(f"c{k}", (3.0 * k, 0, 0), 1.0) for k in range(8)]
    tx, rx = (-4.0, 0.1, 0.0), (25.0, 0.1, 0.0)
    paths, row = only_path(scene(crowns, tx, rx), device, replace_config(CLEAR, max_depth=0))
    assert loss_db(paths)[row] == pytest.approx(weissberger(length_inside(crowns, tx, rx)), rel=1e-9)
    arrays = scene([*crowns, wall(4.5, "glass")], tx, rx)
    _, paths = oracle.solve(arrays, replace_config(CLEAR, refraction=True), device)
    (row,) = np.flatnonzero(paths.kind == PATH_TRANSMISSION)
    assert paths.order[row] == 1
    assert loss_db(paths)[row] == pytest.approx(weissberger(length_inside(crowns, tx, rx)), rel=1e-9)


def test_the_rim_of_a_crown_is_no_step(device: str) -> None:
    """As the receiver moves behind the crown the loss grows from 0 in small steps, and there is always a path."""
    crown, tx = ball("a", (0, 0, 0), 2.0, 6), (-10.0, 0.05, 0.0)
    rx = [(10.0, 0.05, z) for z in np.linspace(3.0, 5.0, 401)]
    links, paths = oracle.solve(scene([crown], tx, *rx), CLEAR, device)
    assert paths.kind.tolist() == [PATH_LOS] * len(links)
    loss = loss_db(paths)
    assert loss[0] > 1.0 and loss[-1] == 0.0 and (np.diff(loss) <= 1e-9).all() and np.diff(loss).min() > -0.25
    rows = link_rows(
        ["rsu_1", *(f"cav_{k + 1}" for k in range(len(rx)))], ("antenna",), ("v2i",), links, paths, "sunny"
    )
    states = np.array(rows["los_state"].to_list()).reshape(len(rx), -1)
    assert (states == np.where(loss > 0.0, "foliage", "clear")[:, None]).all() and rows["is_los"].all()


def test_states_of_lines_of_sight(device: str) -> None:
    """Clear, through a crown, behind a wall, behind a wall and a crown; without the switch crowns block."""
    arrays = scene([ball("a", (0, 0, 0), 2.0), wall(20.0, "brick", 5.0)], (-10, 0, 0), (10, 30, 0), (10, 0, 0),
                   (30, 0, 0), (30, -40, 0))  # fmt: skip
    names = ["rsu_1", *(f"cav_{k + 1}" for k in range(4))]
    for switch, expected in ((True, "clear foliage blocked clear"), (False, "clear blocked blocked clear")):
        links, paths = oracle.solve(arrays, replace_config(CLEAR, foliage=switch, carriers_hz=(28e9,)), device)
        rows = link_rows(names, ("antenna",), ("v2i",), links, paths, "sunny")
        assert rows["los_state"].to_list() == expected.split()
        assert rows["is_los"].tolist() == [state != "blocked" for state in expected.split()]


def test_crowns_scatter_from_their_outside(device: str) -> None:
    """Patches look to both ends; a rough wall behind the crown scatters too, weakened on the way."""
    crown, tx, rx = ball("a", (0, 0, 0), 2.0), (-8.0, 0.0, 0.0), (-6.0, 5.0, 1.0)
    config = replace_config(CLEAR, diffuse_reflection=True, diffuse_samples=20000)
    arrays = scene([crown, wall(9.0, "rough")], tx, rx)
    _, paths = oracle.solve(arrays, config, device)
    rough = np.flatnonzero(paths.interaction[:, 0] == DIFFUSE)
    on_crown = rough[paths.vertex[rough, 0, 0] < 8.9]
    behind = np.setdiff1d(rough, on_crown)
    assert len(on_crown) > 100 and len(behind) > 1000
    place, normal = paths.vertex[on_crown, 0], paths.normal[on_crown, 0]
    np.testing.assert_allclose(np.linalg.norm(place, axis=1), 2.0, atol=0.06)
    for end in (tx, rx):
        assert (np.einsum("pk,pk->p", normal, np.array(end) - place) > 0.0).all()
    assert (np.einsum("pk,pk->p", normal, place) > 0.0).all() and (loss_db(paths)[on_crown] < 1e-6).all()
    for row in behind[:: len(behind) // 50]:
        length = length_inside([crown], tx, paths.vertex[row, 0], rx)
        assert loss_db(paths)[row] == pytest.approx(weissberger(length), abs=1e-6)
    assert (loss_db(paths)[behind] > 1.0).any()
    _, inner = oracle.solve(scene([crown], (0.1, 0.0, 0.0), rx), config, device)
    assert inner.kind.tolist() == [PATH_LOS], "an antenna inside sees no outer face"
    _, solid = oracle.solve(arrays, replace_config(config, foliage=False), device)
    assert (solid.vertex[solid.interaction[:, 0] == DIFFUSE, 0, 0] > 8.9).all(), (
        "leaves have no coefficient of their own"
    )


def test_power_of_a_scattering_crown_is_lambertian(device: str) -> None:
    """Against the integral over a sphere of |Gamma|^2 cos cos / (pi d^4), mean of both polarizations, with S = 1."""
    crown = ball("a", (0, 0, 0), 1.0, 24)
    config = oracle.channel(
        "iso", max_depth=1, foliage=True, diffuse_reflection=True, diffuse_samples=400_000, los=False
    )
    _, paths = oracle.solve(scene([crown], (-30, 0, 0), (-30, 0.1, 0)), config, device)
    matrix = next(iter(paths.transfer.values()))[:, 0]
    power = (np.abs(matrix) ** 2).sum(axis=(1, 2)).sum() / 2.0
    angle = (np.arange(2000) + 0.5) * np.pi / 4000
    cosine, eta = np.cos(angle), 1.99 - 17.98j * 0.0047 * 28.0**1.0718 / 28.0  # wood, ITU-R P.2040-4
    inner = np.sqrt(eta - np.sin(angle) ** 2)
    te, tm = (cosine - inner) / (cosine + inner), (eta * cosine - inner) / (eta * cosine + inner)
    share = 0.5 * (np.abs(te) ** 2 + np.abs(tm) ** 2)
    ring = 2.0 * np.pi * np.sin(angle) * np.pi / 4000
    distance = np.sqrt(30.0**2 + 1.0 - 60.0 * cosine)
    wave = 299792458.0 / 28e9
    expected = (wave / (4 * np.pi)) ** 2 * (ring * cosine * share * cosine / np.pi / distance**4).sum()
    assert 10 * np.log10(power / expected) == pytest.approx(0.0, abs=0.3)
    assert set(paths.kind.tolist()) == {PATH_KINDS.index("diffuse")}


def test_foliage_that_moves_stays_a_solid(device: str) -> None:
    """A float of leaves on a truck blocks, and has surfaces that reflect."""
    model = box_model("float", (4, 4, 4), (0, 0, 0), material=0)
    arrays = oracle.arrays_from_parts(
        [POST], (model,), [("rsu_1", "rsu", -1), ("cav_1", "cav", -1), ("cav_2", "cav", -1), ("truck", "vehicle", 0)],
        [[pose(-9, 0), pose(9, 0), pose(-9, 4), pose(0, 0)]], materials=MATERIALS,
    )  # fmt: skip
    _, paths = oracle.solve(arrays, CLEAR, device)
    assert set(paths.link[paths.kind == PATH_LOS].tolist()) == {1} and (paths.kind == PATH_SPECULAR).any()
    assert (loss_db(paths) == 0.0).all()


def test_a_device_inside_a_crown_is_in_the_open_with_the_switch(device: str) -> None:
    arrays = scene([ball("a", (0, 0, 5), 2.0)], (-9, 0, 5), (9, 0, 5))
    town = mmw.Scene(arrays, {"sunny": mmw.Weather()}, device=device)
    town.add(mmw.Transmitter("tx", (-9.0, 0.0, 5.0)))
    town.add(mmw.Receiver("rx", (0.0, 0.0, 5.0)))
    with pytest.raises(InputError, match=r"receiver 'rx'.*is inside .*vegetation"):
        mmw.PathSolver(max_depth=0)(town)
    paths = mmw.PathSolver(max_depth=0, foliage=True)(town)
    assert paths.is_los.all() and paths.foliage_db[0, 0] == pytest.approx(weissberger(2.0), rel=0.02)


def test_a_medium_that_changes_is_traced_anew(device: str) -> None:
    arrays = scene([ball("a", (0, 0, 5), 2.0)], (-9, 0, 5), (9, 0, 5))
    town = mmw.Scene(arrays, {"sunny": mmw.Weather()}, device=device)
    town.add(mmw.Transmitter("tx", (-9.0, 0.0, 5.0)))
    town.add(mmw.Receiver("rx", (9.0, 0.0, 5.0)))
    solver = mmw.PathSolver(max_depth=0, foliage=True)
    assert len(solver(town)) == 1
    town.materials["leaf"].set(medium="solid")
    assert len(solver(town)) == 0


def test_both_directions_are_equal(device: str) -> None:
    arrays = oracle.arrays_from_parts(
        [ball("a", (0, 0, 0), 2.0), POST], actors=[("cav_1", "cav", -1), ("cav_2", "cav", -1)],
        poses=[[pose(-9, 0), pose(9, 0.3)]], materials=MATERIALS,
    )  # fmt: skip
    _, paths = oracle.solve(arrays, replace_config(CLEAR, links=("v2v",)), device)
    assert len(paths) == 2 and loss_db(paths)[0] == loss_db(paths)[1] > 1.0


def test_a_table_of_the_other_choice_is_refused(device: str) -> None:
    arrays = scene([ball("a", (0, 0, 0), 2.0)], (-9, 0, 0), (9, 0, 0))
    on_device = DeviceScene(arrays, device, 1)
    on_device.load_batch([0])
    with pytest.raises(ValueError, match=r"channel\.foliage.*foliage=True"):
        trace_links(on_device, make_links(arrays, [0], CLEAR), CLEAR, make_surface_table(on_device))
