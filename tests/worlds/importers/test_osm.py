"""OpenStreetMap extract -> World: map projection, solids in closed form, ground, messages."""

import bz2
import gzip
import math
import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely

from mmw.core.errors import InputError, MissingPackageError
from mmw.core.geodesy import world_from_wgs84
from mmw.core.mesh import merge
from mmw.usd.material_library import LIBRARY
from mmw.worlds.importers.formats import find_importer
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.importers.osm.read_osm import read_osm
from mmw.worlds.importers.osm.xml import length_m
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.meshes import area, corners_of, is_closed, volume
from tests.fixtures.osm_files import ORIGIN, Map, quarter, to_degrees
from tests.oracles.tracing import trapezoid

FOOT = 0.5
"""How far solids reach into the ground [m]."""


def read(tmp_path: Path, text: str, origin: tuple[float, float] | None = ORIGIN) -> ImportedScene:
    path = tmp_path / "extract.osm"
    path.write_text(text)
    return read_osm(path, origin)


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> ImportedScene:
    return read(tmp_path_factory.mktemp("osm"), quarter().text())


def to_plane(lat: float, lon: float) -> np.ndarray:
    return world_from_wgs84((lat, lon, 0.0), (*ORIGIN, 0.0))[:2]


def parts_of(world: ImportedScene, prefix: str) -> list[MeshPart]:
    found = [part for part in world.parts if part.path.startswith(prefix)]
    assert found, prefix
    return found


@pytest.mark.parametrize("bearing_deg", [0, 90, 37, 211])
def test_distances_within_5_km_to_a_centimetre(bearing_deg: float) -> None:
    """Against arcs integrated on the ellipsoid: the meridian for north, the normal section by Euler's radius else."""
    a, e2 = 6378137.0, 0.00669437999014
    lat0 = math.radians(ORIGIN[0])
    w = math.sqrt(1 - e2 * math.sin(lat0) ** 2)
    meridian, normal = a * (1 - e2) / w**3, a / w
    azimuth, distance = math.radians(bearing_deg), 5000.0
    radius = 1 / (math.cos(azimuth) ** 2 / meridian + math.sin(azimuth) ** 2 / normal)
    # A plane point at R sin(d / R) lies d away along the ellipsoid; the next term of the series is below a millimeter.
    flat = radius * math.sin(distance / radius)
    assert abs(flat - distance) < 0.001
    lat, lon = to_degrees(flat * math.sin(azimuth), flat * math.cos(azimuth))
    if bearing_deg == 0:
        phi = np.linspace(lat0, math.radians(lat), 20001)
        arc = trapezoid(a * (1 - e2) / (1 - e2 * np.sin(phi) ** 2) ** 1.5, phi)
        assert arc == pytest.approx(distance, abs=0.01)
    xy = to_plane(lat, lon)
    assert float(np.hypot(*xy)) == pytest.approx(distance, abs=0.01)


def test_solids_have_the_volumes_of_their_tags(town: ImportedScene) -> None:
    expected = {
        "b_w1": 16 * 12 * (6 + FOOT) + 0.5 * 12 * 4 * 16,  # two storeys, then a gable of 4 m along the longer side
        "b_w2": 20 * 15 * (18.5 + FOOT),
        "b_r1": (40 * 30 - 20 * 10) * (15 + FOOT),  # a courtyard
        "b_w5": 10 * 20 * (7 + FOOT) + 0.5 * 10 * 3 * 10 + 10 * 10 * 3 / 3,  # hips: a prism and two half pyramids
        "b_w8": 8 * 8 * (4 + FOOT) + 8 * 8 * 8 / 3,
    }
    for name, cubic in expected.items():
        parts = parts_of(town, f"Buildings/{name}/")
        assert volume(merge(parts)) == pytest.approx(cubic, rel=1e-5), name
        assert is_closed(corners_of(parts)), name
        assert all(part.label == "building" for part in parts)
        low = min(part.points[:, 2].min() for part in parts)
        assert low == -FOOT
    assert max(part.points[:, 2].max() for part in parts_of(town, "Buildings/b_w1/")) == pytest.approx(10.0)
    glass = parts_of(town, "Buildings/b_w2/facade")
    assert area(merge(glass)) == pytest.approx(70 * (18.5 + FOOT) + 20 * 15, rel=1e-5)
    assert area(merge(parts_of(town, "Buildings/b_r1/roof"))) == pytest.approx(1000.0, rel=1e-5)


def test_abutting_buildings_share_no_wall(town: ImportedScene) -> None:
    both = parts_of(town, "Buildings/b_w6/") + parts_of(town, "Buildings/b_w7/")
    # The left-out faces cancel, so the two enclose the sum of their volumes, with only the visible walls.
    assert volume(merge(both)) == pytest.approx(12 * 12 * (9 + FOOT) + 8 * 12 * (6 + FOOT), rel=1e-5)
    outside = (3 * 12) * (9 + FOOT) + 12 * 3 + (2 * 8 + 12) * (6 + FOOT)
    walls = [
        part
        for name in ("w6", "w7")
        for use in ("facade", "windows")
        for part in parts_of(town, f"Buildings/b_{name}/{use}")
    ]
    assert area(merge(walls)) == pytest.approx(outside + 144 + 96, rel=1e-5)
    assert any("1 walls between buildings left out" in note for note in town.notes)


def test_materials(town: ImportedScene) -> None:
    def material(path: str) -> str:
        return parts_of(town, path)[0].material

    assert material("Buildings/b_w1/facade") == "brick_facade" and material("Buildings/b_w1/roof") == "tile_roof"
    assert material("Buildings/b_w2/facade") == "glass_facade" and material("Buildings/b_w2/roof") == "concrete_roof"
    assert material("Buildings/b_w6/facade") == "marble_facade"
    tinted = town.materials[material("Buildings/b_w5/facade")]
    assert tinted.radio == LIBRARY["concrete_facade"].radio
    assert tinted.color == pytest.approx((0.60383, 0.24620, 0.05781), abs=2e-5)  # cc8844 as linear light
    assert town.materials[material("Buildings/b_w5/roof")].color == (1.0, 0.0, 0.0)
    for part in town.parts:
        assert part.material in LIBRARY or part.material in town.materials
    assert {part.label for part in town.parts} == {"road", "sidewalk", "terrain", "water", "building", "vegetation"}


def test_ground_is_one_plane_without_gaps_or_overlaps(town: ImportedScene) -> None:
    ground = [part for part in town.parts if part.label in ("road", "sidewalk", "terrain", "water")]
    assert all(np.all(part.points[:, 2] == 0) for part in ground)
    low = np.min([part.points[:, :2].min(axis=0) for part in ground], axis=0)
    high = np.max([part.points[:, :2].max(axis=0) for part in ground], axis=0)
    assert area(merge(ground)) == pytest.approx(float(np.prod(high - low)), rel=1e-6)
    np.testing.assert_allclose(low, [-100 - 30 - 3.5, -80 - 30 - 3.25], atol=3.0)
    assert area(merge(parts_of(town, "Terrain/water"))) == pytest.approx(400.0, rel=1e-4)
    # Two strips of 7 and 6.5 m with round ends; the cross counts once. A quarter circle has four chords.
    fan = 8 * math.sin(math.pi / 16) * math.cos(math.pi / 16) * 2
    caps = fan * (3.5**2 + 3.25**2)
    assert area(merge(parts_of(town, "Roads/"))) == pytest.approx(200 * 7 + 160 * 6.5 - 7 * 6.5 + caps, rel=2e-3)


def test_trees_stand_outside_buildings(town: ImportedScene) -> None:
    trunks = [part for part in town.parts if part.path.startswith("Props/tree_") and part.path.endswith("trunk")]
    middles = sorted(tuple(np.round(part.points[:, :2].mean(axis=0), 1).tolist()) for part in trunks)
    np.testing.assert_allclose(middles, [(10.0, 10.0), (15.0, 10.0)], atol=0.15)


def test_default_origin_heights_and_parts(tmp_path: Path) -> None:
    town = Map()
    town.box(0, 0, 30, 20, building="yes", height="99")
    town.box(0, 0, 10, 20, building__part="yes", height="30")
    town.box(10, 0, 20, 20, building__part="yes", height="12", min_height="6")
    world = read(tmp_path, town.text(), None)
    points = np.concatenate([part.points for part in parts_of(world, "Buildings/")])
    np.testing.assert_allclose(points[:, :2].min(axis=0), [-15, -10], atol=0.06)
    assert points[:, 2].max() == 30.0
    lifted = parts_of(world, "Buildings/b_w3/")
    assert min(part.points[:, 2].min() for part in lifted) == 6.0
    assert any("1 outlines left out" in note for note in world.notes)
    assert [length_m(text) for text in ("12", "12,5 m", "40 ft", "7'4\"", "high", None)] == [
        12.0, 12.5, pytest.approx(12.192), pytest.approx(2.2352), None, None]  # fmt: skip


def test_the_box_that_was_asked_for_gives_the_origin(tmp_path: Path) -> None:
    """An export holds its ways as a whole: here a power line that goes on for 8 km."""
    town = quarter()
    town.way([(100, 0), (8000, 100)], {"power": "line"})
    low, high = to_degrees(-50.0, -40.0), to_degrees(150.0, 40.0)
    box = '<bounds minlat="{}" minlon="{}" maxlat="{}" maxlon="{}"/>'.format(*low, *high)
    world = read(tmp_path, town.text().replace('<osm version="0.6">', f'<osm version="0.6">{box}'), None)
    points = np.concatenate([part.points for part in parts_of(world, "Buildings/")])
    np.testing.assert_allclose((points[:, 0].min(), points[:, 0].max()), (-60 - 50, 70 - 50), atol=0.06)
    with pytest.raises(ValueError, match="<bounds> are 48, , , ; degrees are needed"):
        read(tmp_path, town.text().replace('<osm version="0.6">', '<osm version="0.6"><bounds minlat="48"/>'), None)


def with_bounds(text: str, west: float, south: float, east: float, north: float) -> str:
    """Return an extract with bounds in meters."""
    low, high = to_degrees(west, south), to_degrees(east, north)
    box = '<bounds minlat="{}" minlon="{}" maxlat="{}" maxlon="{}"/>'.format(*low, *high)
    return text.replace('<osm version="0.6">', f'<osm version="0.6">{box}')


def test_everything_but_buildings_is_cut_at_the_bounds(tmp_path: Path) -> None:
    """A road of 60 km and a lake of 40 km reach far beyond; a house stands across the border, one outside."""
    town = Map()
    town.way([(-30000, 0), (0, 0), (30000, 0)], {"highway": "primary"})
    town.box(-20000, 50, 40000, 20, natural="water")
    town.box(95, 20, 10, 10, building="yes", height="6")
    town.box(200, 20, 10, 10, building="yes", height="6")
    world = read(tmp_path, with_bounds(town.text(), -100, -100, 100, 100))
    road = np.concatenate([part.points for part in parts_of(world, "Roads/")])
    np.testing.assert_allclose((road[:, 0].min(), road[:, 0].max()), (-104.5, 104.5), atol=0.1)  # half of 9 m beyond
    water = parts_of(world, "Terrain/water")
    assert area(merge(water)) == pytest.approx(200 * 20, rel=0.01)
    houses = parts_of(world, "Buildings/")
    assert volume(merge(houses)) == pytest.approx(10 * 10 * (6 + FOOT), rel=1e-4)
    text = "cut at the bounds of the file: 2 ways and areas, and 1 outside left out; buildings across stay whole"
    assert text in world.notes


def test_a_way_that_leaves_the_bounds_and_comes_back_keeps_its_direction(tmp_path: Path) -> None:
    """Its sidewalk stays on the left in both pieces, and nothing joins them."""
    town = Map()
    way = [(-50, 0), (50, 0), (50, 300), (90, 300), (90, -80)]
    town.way(way, {"highway": "residential", "sidewalk": "left"})
    world = read(tmp_path, with_bounds(town.text(), -100, -100, 100, 100))
    walk = shapely.union_all([shapely.Polygon(c[:, :2]) for c in corners_of(parts_of(world, "Sidewalks/"))])
    assert walk.contains(shapely.Point(0, 4)) and walk.contains(shapely.Point(94, 0))
    assert not walk.contains(shapely.Point(0, -4)) and not walk.contains(shapely.Point(86, 0))
    assert walk.bounds[3] < 110


def test_without_bounds_areas_are_cut_around_roads_and_buildings(tmp_path: Path) -> None:
    town = Map()
    town.way([(-100, 0), (100, 0)], {"highway": "primary"})
    town.box(-20000, 10, 40000, 10, natural="water")
    world = read(tmp_path, town.text())
    assert area(merge(parts_of(world, "Terrain/water"))) == pytest.approx(260 * 10, rel=0.01)


def test_a_way_with_a_gap_is_not_closed_by_a_straight_line(tmp_path: Path) -> None:
    town = Map()
    town.way([(-50, 0), (0, 0), (30, 40), (60, 0), (90, 0)], {"highway": "residential"})
    text = re.sub(r'<node id="3" [^\n]*', "", town.text())
    road = merge(parts_of(read(tmp_path, text), "Roads/"))
    round_ends = 2 * 8 * math.sin(math.pi / 16) * math.cos(math.pi / 16) * 2 * 3.0**2
    assert area(road) == pytest.approx((50 + 30) * 6 + round_ends, rel=1e-3)


def test_surfaces_that_touch_in_a_line_and_elsewhere_overlap(tmp_path: Path) -> None:
    """The parking lot leaves a line and an area of the squares, which overlays do not take together."""
    town = Map()
    town.box(0, 0, 40, 40, amenity="parking")
    town.box(20, 10, 20, 20, highway="pedestrian", area="yes")
    town.box(60, 0, 10, 10, highway="pedestrian", area="yes")
    town.way([(0, -20), (80, -20)], {"highway": "service"})
    world = read(tmp_path, town.text())
    assert area(merge(parts_of(world, "Sidewalks/"))) == pytest.approx(100, rel=1e-3)


def test_negative_ids_of_josm(tmp_path: Path) -> None:
    """Its new features count down from -1, and what it deleted is still in the file."""
    text = re.sub(r'(id|ref)="(\d)', r'\1="-\2', quarter().text())
    text = text.replace('<way id="-2">', '<way id="-2" action="delete">')
    world = read(tmp_path, text)
    assert {part.path for part in world.parts} >= {"Buildings/b_w_1/facade", "Buildings/b_r_1/roof"}
    assert not any(part.path.startswith("Buildings/b_w_2/") for part in world.parts)


def test_ids_that_repeat_give_buildings_of_their_own(tmp_path: Path) -> None:
    town = Map()
    town.box(0, 0, 10, 10, building="yes")
    town.box(20, 0, 10, 10, building="yes")
    world = read(tmp_path, town.text().replace('way id="1"', 'way id="a-b"').replace('way id="2"', 'way id="a.b"'))
    assert len({part.path for part in world.parts}) == len(world.parts)
    assert {part.path for part in parts_of(world, "Buildings/")} >= {"Buildings/b_wa_b/roof", "Buildings/b_wa_b_2/roof"}


def test_a_multipolygon_alone_can_be_the_road(tmp_path: Path) -> None:
    town = Map()
    outer, inner = town.box(0, 0, 40, 40), town.box(10, 10, 10, 10)
    town.multipolygon([(outer, "outer"), (inner, "inner")], {"highway": "service", "area": "yes"})
    assert area(merge(parts_of(read(tmp_path, town.text()), "Roads/"))) == pytest.approx(1500, rel=1e-4)


@pytest.mark.parametrize("suffix", [".osm", ".osm.gz", ".osm.bz2"])
def test_a_file_that_the_system_refuses_is_not_called_broken(tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"folder{suffix}").mkdir()
    for name, reason in (("folder", "directory"), ("missing", "No such file")):
        with pytest.raises(InputError, match=rf"{name}{suffix}: cannot be read \(.*{reason}.*\); give the path"):
            read_osm(tmp_path / f"{name}{suffix}")


@pytest.mark.parametrize(("suffix", "pack"), [(".osm.gz", gzip.compress), (".osm.bz2", bz2.compress)])
def test_packed_extracts(tmp_path: Path, town: ImportedScene, suffix: str, pack: Callable[[bytes], bytes]) -> None:
    path = tmp_path / f"extract{suffix}"
    data = pack(quarter().text().encode())
    path.write_bytes(data)
    assert find_importer(path) == "openstreetmap"
    assert [part.path for part in read_osm(path, ORIGIN).parts] == [part.path for part in town.parts]
    for torn in (data[:-20], b"<osm/>", b""):
        path.write_bytes(torn)
        with pytest.raises(InputError, match="download the extract again"):
            read_osm(path)


def test_rings_that_cross_are_repaired(tmp_path: Path) -> None:
    """Two outer rings that overlap, with no node where their lines cross, and one that crosses itself."""
    town = Map()
    one, two = town.box(0, 0, 20, 20), town.box(10, 10, 20, 20)
    bow = town.way([(40, 0), (60, 20), (60, 0), (40, 20)], {}, closed=True)
    town.multipolygon([(one, "outer"), (two, "outer"), (bow, "outer")], {"building": "yes", "height": "6"})
    world = read(tmp_path, town.text())
    roofs = [part for part in parts_of(world, "Buildings/") if part.path.endswith("roof")]
    assert area(merge(roofs)) == pytest.approx(700 + 200, rel=1e-4)


def test_pbf_holds_the_same_world(tmp_path: Path, town: ImportedScene) -> None:
    osmium = pytest.importorskip("osmium")
    source, path = tmp_path / "extract.osm", tmp_path / "extract.osm.pbf"
    source.write_text(quarter().text())
    with osmium.SimpleWriter(str(path)) as writer:
        for entity in osmium.FileProcessor(str(source)):
            writer.add(entity)
    assert find_importer(path) == "openstreetmap"
    world = read_osm(path, ORIGIN)  # its places are rounded to 1e-7 deg, 11 mm
    for group in ("Buildings/", "Props/"):  # rounded ground may reach into the next tile
        assert [p.path for p in parts_of(world, group)] == [p.path for p in parts_of(town, group)]
    for name in ("b_w1", "b_w2", "b_r1", "b_w5", "b_w8"):
        one, other = (merge(parts_of(w, f"Buildings/{name}/")) for w in (world, town))
        assert volume(one) == pytest.approx(volume(other), rel=5e-3), name
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(InputError, match=r"cannot be read as PBF .*download the extract again"):
        read_osm(path)


def test_pbf_without_osmium_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "osmium", None)
    (tmp_path / "extract.osm.pbf").write_bytes(b"")
    with pytest.raises(MissingPackageError, match=r"osmium, which is not installed; pip install '.*\[osm\]'"):
        read_osm(tmp_path / "extract.osm.pbf")


def test_clipped_ways_and_multipolygons_are_told(tmp_path: Path) -> None:
    text = quarter().text()
    cut = text.replace('<nd ref="1"/>', '<nd ref="77777"/>')  # the first house reaches beyond the extract
    cut = cut.replace('<member type="way" ref="3"', '<member type="way" ref="333"')
    world = read(tmp_path, cut)
    assert not any(part.path.startswith(("Buildings/b_w1/", "Buildings/b_r1/")) for part in world.parts)
    assert any("1 ways reach beyond the extract" in note for note in world.notes)
    assert any("1 multipolygons reach beyond the extract" in note for note in world.notes)


def test_same_file_same_world(town: ImportedScene, tmp_path: Path) -> None:
    again = read(tmp_path, quarter().text())
    assert again.notes == town.notes
    for one, other in zip(again.parts, town.parts, strict=True):
        assert one.path == other.path and np.array_equal(one.points, other.points)
        assert np.array_equal(one.faces, other.faces)


def far_apart() -> str:
    town = Map()
    town.way([(-11000, 0), (11000, 0)], {"highway": "primary"})
    return town.text()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<osm><node", "broken XML .*download the extract again"),
        ('<osm><node id="5" lat="4"/><way id="8"><nd/></wa', "broken XML .* in or after <nd>; download"),
        ('<osm><node id="5" lat="4" lon="1"></osm>', "mismatched tag.* in or after <node id='5'>; download"),
        ('<?xml version="1.0" encoding="utf-99"?><osm/>', "broken XML .*; download"),
        ("<OpenDRIVE/>", "root element <OpenDRIVE>; <osm> is needed"),
        ("<osm/>", "has no nodes"),
        ('<osm><node id="5" lat="148" lon="11"/></osm>', "node 5: lat '148', lon '11'; -90 to 90"),
        ('<osm><node id="5" lat="48" lon="11"/></osm>', "holds neither buildings nor roads"),
        (
            quarter().text().replace('v="7"', 'v="7e9 km"').replace('v="2"', f'v="{"9" * 400}"'),
            "w1: building:levels = '9{40}'",
        ),
        (quarter().text().replace('v="18.5 m"', 'v="18500 m"'), "w2: height = '18500 m'; -100 to 2000 is needed"),
        (far_apart(), "22.0 km wide .* 20 km or less are needed; cut out a smaller area"),
    ],
)
def test_messages(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        read(tmp_path, text)
    assert "\n" not in str(caught.value)
