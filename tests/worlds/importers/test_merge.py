"""OpenStreetMap extracts around the roads of an OpenDRIVE file: places, cuts, one ground, and messages."""

from pathlib import Path

import numpy as np
import pytest
import shapely

from mmw.cli.import_scene import main
from mmw.core.errors import InputError
from mmw.core.georeference import Georeference
from mmw.traffic.roads.town_asset import open_town
from mmw.worlds.importers.geo.merge import AROUND, CLEAR, merge_extract
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.importers.opendrive.read_opendrive import read_opendrive
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.meshes import corners_of, plumb, upward
from tests.fixtures.osm_files import ORIGIN, Map
from tests.fixtures.xodr_files import LANE, WALK, Plan, document, road, street

pytest.importorskip("rasterio")
TMERC = f"+proj=tmerc +lat_0={ORIGIN[0]} +lon_0={ORIGIN[1]} +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs"
HALF = LANE + WALK
SHIFT = (500_000.0, 4_000_000.0)


def roads(reference: str = TMERC, offset: str = "") -> str:
    """Return a straight road of 200 m along x through the origin, with sidewalks."""
    text = document(road("1", Plan(-100.0, 0.0, 0.0).line(200.0), street(0.0, False, False)))
    head = '<header revMajor="1" revMinor="6"'
    inner = f"<geoReference><![CDATA[{reference}]]></geoReference>{offset}" if reference else ""
    return text.replace(f"{head}/>", f"{head}>{inner}</header>")


def quarter() -> str:
    town = Map()
    town.way([(-150.0, 0.5), (-40.0, 0.5), (150.0, 0.5)], {"highway": "residential", "width": "6"})
    town.way([(0.0, 0.0), (0.0, 80.0)], {"highway": "service", "width": "4"})
    town.box(-60.0, 20.0, 20.0, 10.0, building="yes", height="9")  # beside the road
    town.box(20.0, HALF - 2.0, 20.0, 12.0, building="yes", height="12")  # 2 m of it on the sidewalk
    town.box(60.0, -4.0, 10.0, 8.0, building="yes", height="6")  # on the road
    town.box(40.0, -33.0, 30.0, 20.0, natural="water")
    town.point(-80.0, 1.0, natural="tree")
    town.point(-80.0, 30.0, natural="tree")
    town.point(-70.0, -HALF - 1.0, natural="tree")
    return town.text()


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    (tmp_path / "roads.xodr").write_text(roads())
    (tmp_path / "quarter.osm").write_text(quarter())
    return tmp_path / "roads.xodr", tmp_path / "quarter.osm"


def plans(parts: list[MeshPart], suffix: str) -> list[shapely.Geometry]:
    chosen = [part for part in parts if part.path.startswith("Buildings/") and part.path.endswith(suffix)]
    return [shapely.MultiPoint(part.points[:, :2]).convex_hull for part in chosen]


def area(parts: list[MeshPart], *labels: str) -> float:
    return sum(0.5 * np.maximum(part.mesh.crosses[:, 2], 0.0).sum() for part in parts if part.label in labels)


def test_buildings_around_roads_are_where_they_are_and_cut_at_them(files: tuple[Path, Path]) -> None:
    before = read_opendrive(files[0])
    scene = merge_extract(before, files[1])
    first, second = sorted(plans(scene.parts, "/facade"), key=lambda plan: plan.centroid.x)
    np.testing.assert_allclose(first.bounds, (-60.0, 20.0, -40.0, 30.0), atol=2e-3)
    np.testing.assert_allclose(second.bounds, (20.0, HALF + CLEAR, 40.0, HALF + 10.0), atol=5e-3)
    assert "1 buildings reached into roads and were cut, 1 stood on them and were left out" in scene.notes[-2]
    assert scene.lanes is before.lanes
    trees = {part.path.split("/")[1]: part for part in scene.parts if part.label == "vegetation"}
    feet = sorted(tuple(np.round(part.points[:, :2].mean(axis=0))) for part in trees.values())
    assert [foot[1] > 0 for foot in feet] == [True, False]
    over = next(part for part in scene.parts if part.path.endswith("crown") and part.points[:, 1].max() < 0)
    assert over.points[:, 2].min() > 4.4  # its crown reaches over the sidewalk
    assert scene.notice


def test_one_ground_and_no_asphalt_twice(files: tuple[Path, Path]) -> None:
    before = read_opendrive(files[0])
    scene = merge_extract(before, files[1])
    asphalt = [part for part in scene.parts if part.label in ("road", "road_line")]
    whole = shapely.union_all([p for part in asphalt for p in shapely.polygons(upward(part.mesh.corners)[:, :, :2])])
    assert area(scene.parts, "road", "road_line") == pytest.approx(whole.area, rel=1e-4)
    # 50 m of the street go on at either end; half a circle of a cap each; the side street from the verge outward
    more = area(scene.parts, "road", "road_line") - area(before.parts, "road", "road_line")
    assert more == pytest.approx(2 * 50 * 6 + np.pi * 3**2 + (80 - HALF) * 4 + 0.5 * np.pi * 2**2, rel=0.03)
    faces = upward(corners_of([part for part in scene.parts if part.label in ("road", "sidewalk", "terrain", "water")]))
    low, high = np.array([-153.0, -33.0]) - AROUND, np.array([153.0, 82.0]) + AROUND
    points = np.random.default_rng(3).uniform(low + 0.01, high - 0.01, (400, 2))
    assert all(len(heights) for heights in plumb(faces, points, 1e-6))
    assert area(scene.parts, "water") == pytest.approx(600.0, rel=1e-3)


def test_offsets_of_the_header_and_an_origin_given_by_hand(files: tuple[Path, Path]) -> None:
    wanted = sorted(plan.bounds for plan in plans(merge_extract(read_opendrive(files[0]), files[1]).parts, "/facade"))
    x, y = SHIFT
    moved = TMERC.replace("+x_0=0", f"+x_0={x}").replace("+y_0=0", f"+y_0={y}")
    files[0].write_text(roads(moved, f'<offset x="{x}" y="{y}" z="0" hdg="0"/>'))
    found = sorted(plan.bounds for plan in plans(merge_extract(read_opendrive(files[0]), files[1]).parts, "/facade"))
    np.testing.assert_allclose(found, wanted, atol=2e-3)
    files[0].write_text(roads(""))
    out = files[0].parent / "out"
    origin = ["--geo-origin", *map(str, ORIGIN)]
    assert main([str(files[1]), str(files[0]), "--out", str(out), *origin], "mmw import") == 0
    place = open_town(out / "roads.usda").georeference
    assert place == Georeference(*ORIGIN)


def test_the_place_of_the_roads_travels_with_the_town(files: tuple[Path, Path], capsys: pytest.CaptureFixture) -> None:
    out = files[0].parent / "out"
    assert main([str(files[0]), str(files[1]), "--out", str(out)], "mmw import") == 0
    assert "origin: latitude 48.137000, longitude 11.575000 deg" in capsys.readouterr().out
    place = open_town(out / "roads.usda").georeference
    assert place is not None
    assert (place.latitude, place.longitude, place.scale) == pytest.approx((*ORIGIN, 1.0), abs=1e-6)


def test_messages(files: tuple[Path, Path], capsys: pytest.CaptureFixture) -> None:
    files[0].write_text(roads(""))
    with pytest.raises(InputError, match=r"no <geoReference>; write one into their file, or give --geo-origin"):
        merge_extract(read_opendrive(files[0]), files[1])
    files[0].write_text(roads(TMERC.replace("+lat_0=48", "+lat_0=48.05")))
    far = TMERC.replace(f"+lon_0={ORIGIN[1]}", f"+lon_0={ORIGIN[1] + 0.05}")
    files[0].write_text(roads(far))
    with pytest.raises(InputError, match=r"lies 3\.7 km from the roads, beside all of them"):
        merge_extract(read_opendrive(files[0]), files[1])
    files[0].write_text(roads("gibberish"))
    with pytest.raises(InputError, match="<geoReference> 'gibberish' is no projection"):
        merge_extract(read_opendrive(files[0]), files[1])
    with pytest.raises(InputError, match="have no ground around them"):
        merge_extract(ImportedScene([], georeference=Georeference(*ORIGIN)), files[1])
    assert main([str(files[1]), str(files[1]), "--out", "x"], "mmw import") == 2
    assert "of several files one is OpenDRIVE" in capsys.readouterr().err


def test_an_import_of_an_import_keeps_the_place(files: tuple[Path, Path]) -> None:
    folder = files[0].parent
    assert main([str(files[0]), "--out", str(folder / "out")], "mmw import") == 0
    command = [str(folder / "out" / "roads.usda"), "--out", str(folder / "again"), "--origin", "30", "40", "0"]
    assert main(command, "mmw import") == 0
    first, second = (open_town(folder / name / "roads.usda").georeference for name in ("out", "again"))
    assert first is not None and second is not None
    np.testing.assert_allclose(first.world([(second.latitude, second.longitude)])[0], (30.0, 40.0), atol=1e-4)
