"""Sidewalks, buildings and furniture along imported roads: off every lane, on the ground, and the same each time."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from mmw.core.errors import InputError
from mmw.core.mesh import merge
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.worlds.importers.blocks.fill_blocks import fill_blocks
from mmw.worlds.importers.blocks.layout import FAST_CLEAR, OPEN_END, find_layout
from mmw.worlds.importers.blocks.mixes import MIXES, load_mix
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.importers.opendrive.cross_section import KERB_HEIGHT
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.meshes import corners_of, plumb, upward
from tests.fixtures.xodr_files import LANE, WALK, Plan, document, lane, mark, read_xodr, road, section, t_town

LONG = 200.0


def bare_road(speed: str = '<speed max="50" unit="km/h"/>') -> str:
    """Return a straight road of two lanes along x, without sidewalks and with open ends."""
    sides = [[lane(k, "driving", LANE, mark("solid"))] for k in (1, -1)]
    return document(
        road("1", Plan(0.0, 0.0, 0.0).line(LONG), section(0.0, sides[0], mark("none"), sides[1]), speed=speed)
    )


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> ImportedScene:
    return read_xodr(tmp_path_factory.mktemp("xodr"), t_town())


@pytest.fixture(scope="module")
def filled(town: ImportedScene) -> ImportedScene:
    return fill_blocks("town.xodr", town, MIXES["city"])


def made(scene: ImportedScene, group: str) -> dict[str, list[MeshPart]]:
    """Return the objects of a group by name."""
    found: dict[str, list[MeshPart]] = {}
    for part in scene.parts:
        if part.path.startswith(f"{group}/"):
            found.setdefault(part.path.split("/")[1], []).append(part)
    return found


def hull(parts: list[MeshPart]) -> shapely.Geometry:
    return shapely.MultiPoint(np.concatenate([part.points[:, :2] for part in parts])).convex_hull


def test_buildings_stand_off_every_lane_and_off_each_other(filled: ImportedScene) -> None:
    assert filled.lanes is not None
    lanes = shapely.union_all(
        [shapely.LineString(each.points[:, :2]).buffer(0.5 * each.width) for each in filled.lanes.lanes.values()]
    )
    # a facade reaches from the plan by belts and awnings, so its walls alone are compared
    plans = [hull([p for p in parts if p.path.endswith("/facade")]) for parts in made(filled, "Buildings").values()]
    assert len(plans) > 10
    # sidewalk of 2 m, set-back of 3.2 m or more, less the 0.3 m by which fronts cut corners
    assert shapely.distance(np.array(plans), lanes).min() > WALK + 3.2 - 0.6
    first, second = shapely.STRtree(plans).query(plans, predicate="intersects")
    assert (first == second).all()
    low_props = [part for parts in made(filled, "Props").values() for part in parts if part.points[:, 2].max() < 3.0]
    assert all(shapely.distance(hull([part]), lanes) > 0.0 for part in low_props)


def test_buildings_reach_into_the_ground_and_have_the_storeys_of_their_style(filled: ImportedScene) -> None:
    ground = upward(corners_of([part for part in filled.parts if part.label in ("terrain", "sidewalk", "road")]))
    tallest = max(s.storeys[1] * max(s.storey_m, s.ground_storey_m) for s in MIXES["city"].blocks.styles.values())
    for parts in made(filled, "Buildings").values():
        walls = next(part for part in parts if part.path.endswith("/facade"))
        below = np.array([min(h) for h in plumb(ground, walls.points[:, :2], 1e-5)])
        assert walls.points[:, 2].min() < below.min() - 0.3
        assert 6.0 < np.ptp(walls.points[:, 2]) < tallest + 10.0
    used = {part.material for part in filled.parts if part.path.startswith("Buildings/")}
    assert {"window_glass", "glass_facade", "concrete_facade", "brick_facade"} <= used


def test_the_seed_decides(town: ImportedScene, filled: ImportedScene) -> None:
    def text(scene: ImportedScene) -> bytes:
        return b"".join(part.path.encode() + part.points.tobytes() + part.faces.tobytes() for part in scene.parts)

    again = fill_blocks("town.xodr", town, load_mix("city", 1))
    other = fill_blocks("town.xodr", town, load_mix("city", 2))
    assert text(again) == text(filled) != text(other)
    assert "seed 2" in other.notes[-1]


def test_sidewalks_along_a_bare_road(tmp_path: Path) -> None:
    scene = fill_blocks("town.xodr", read_xodr(tmp_path, bare_road()), MIXES["suburb"])
    walks = merge(part.mesh for part in scene.parts if re.match(r"Sidewalks/front_\d+/walk", part.path))
    area = 0.5 * np.maximum(walks.crosses[:, 2], 0.0).sum()
    assert area == pytest.approx(2 * LONG * WALK, rel=0.01)  # no sidewalk across the open ends
    assert np.abs(np.abs(walks.points[:, 1]) - LANE - 1.0).max() == pytest.approx(1.0, abs=4e-3)
    np.testing.assert_allclose(walks.points[:, 2], KERB_HEIGHT, atol=1e-6)
    assert find_layout(scene).carriageway.area == pytest.approx(2 * LANE * LONG, rel=1e-6)  # no second asphalt


def test_nothing_ahead_of_open_ends_and_along_motorways(tmp_path: Path) -> None:
    scene = fill_blocks("town.xodr", read_xodr(tmp_path, bare_road()), MIXES["suburb"])
    ahead = shapely.box(LONG, -LANE, LONG + OPEN_END, LANE)
    objects = [hull(parts) for group in ("Buildings", "Props") for parts in made(scene, group).values()]
    assert objects
    assert not any(shapely.intersects(ahead, plan) for plan in objects)
    fast = read_xodr(tmp_path, bare_road('<speed max="100" unit="km/h"/>'))
    scene = fill_blocks("town.xodr", fast, MIXES["city"])
    assert not made(scene, "Sidewalks")
    zone = shapely.LineString([(0, 0), (LONG, 0)]).buffer(FAST_CLEAR + 0.5 * LANE - 0.1, cap_style="flat")
    walls = [hull([p for p in parts if p.label == "building"]) for parts in made(scene, "Buildings").values()]
    assert not any(shapely.intersects(zone, plan) for plan in walls)


def test_objects_of_the_source_stay_and_keep_their_names(town: ImportedScene, filled: ImportedScene) -> None:
    name, parts = next(iter(made(filled, "Buildings").items()))
    held = replace(town, parts=[*town.parts, *parts])
    scene = fill_blocks("town.xodr", held, MIXES["city"])
    assert made(scene, "Buildings")[name] == parts
    others = [hull(found) for key, found in made(scene, "Buildings").items() if key != name]
    walls = hull([part for part in parts if part.path.endswith("/facade")])
    assert not any(shapely.intersects(walls, plan) for plan in others)


def test_a_mix_of_ones_own_and_its_errors(tmp_path: Path, town: ImportedScene) -> None:
    path = tmp_path / "mix.yaml"
    path.write_text(
        "blocks:\n  styles: {low: {storeys: [1, 1]}}\n"
        "  districts: [{name: all, center: [0, 0], radius_m: 5000, styles: {low: 1}}]\n"
    )
    scene = fill_blocks("town.xodr", town, load_mix(str(path), 5))
    assert made(scene, "Buildings") and not made(scene, "Props")
    for text, message in {
        "lots: [{name: a, at: [0, 0], rows: 1}]": "lots: goes only with roads from a town's YAML",
        "blocks: {seeds: 3}": "seeds",
    }.items():
        path.write_text(text)
        with pytest.raises(InputError, match=message):
            load_mix(str(path), None)
    with pytest.raises(InputError, match="'village': is no mix; give city, suburb or a YAML file"):
        load_mix("village", None)
    bare = ImportedScene([part for part in town.parts if part.label == "terrain"], lanes=LaneGraph())
    with pytest.raises(InputError, match="no mesh has the class road; label roads"):
        fill_blocks("x.glb", bare, MIXES["city"])
