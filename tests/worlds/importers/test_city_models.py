"""CityJSON and CityGML: areas and volumes of a house and a box beside their closed forms, places, faults."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mmw.__main__ import main
from mmw.core.mesh import TriangleMesh, merge
from mmw.worlds.importers.city.polygons import normal_of, triangulate
from mmw.worlds.importers.city.reference_system import ReferenceSystem, place, reference_system
from mmw.worlds.importers.formats import find_importer, read_scene
from mmw.worlds.importers.imported_scene import ImportedScene
from tests.fixtures import city_files
from tests.fixtures.city_files import citygml, cityjson, write_cityjson


def area(scene: ImportedScene, path: str) -> float:
    return sum(float(part.mesh.areas.sum()) for part in scene.parts if part.path.endswith(path))


def volume(scene: ImportedScene, prefix: str) -> float:
    """Return the volume that the parts of a building enclose, by the divergence theorem [m^3]."""
    mesh = merge(part.mesh for part in scene.parts if part.path.startswith(prefix))
    a, b, c = np.moveaxis(mesh.corners, 1, 0)
    return float(np.einsum("fk,fk->f", a, np.cross(b, c)).sum()) / 6.0


def is_closed(scene: ImportedScene, prefix: str) -> bool:
    """Return whether each edge of the parts of a building is met once in each direction."""
    mesh: TriangleMesh = merge(part.mesh for part in scene.parts if part.path.startswith(prefix))
    ends = [tuple(map(tuple, np.round(mesh.corners[:, k], 6).tolist())) for k in range(3)]
    edges = [edge for k in range(3) for edge in zip(ends[k], ends[(k + 1) % 3], strict=True)]
    return len(set(edges)) == len(edges) and set(edges) == {(b, a) for a, b in edges}


def check_house(scene: ImportedScene) -> None:
    """Compare house and box with their closed forms; 1e-3 is the grid of the files times their sizes."""
    assert area(scene, "b_house/roof") == pytest.approx(city_files.ROOF_AREA, abs=1e-2)
    wall_and_ground = city_files.WALL_AREA + city_files.GROUND_AREA
    assert area(scene, "b_house/facade") == pytest.approx(wall_and_ground, abs=1e-2)
    assert volume(scene, "Buildings/b_house/") == pytest.approx(city_files.HOUSE_VOLUME, abs=0.05)
    assert volume(scene, "Buildings/b_box/") == pytest.approx(city_files.BOX_VOLUME, abs=0.05)
    assert is_closed(scene, "Buildings/b_house/")
    assert is_closed(scene, "Buildings/b_box/")
    materials = {part.path: part.material for part in scene.parts}
    assert materials["Buildings/b_house/roof"] == "tile_roof"
    assert materials["Buildings/b_house/facade"] == "concrete_facade"
    assert materials["Buildings/b_box/roof"] == "concrete_roof"
    assert {part.label for part in scene.parts if "Buildings" in part.path} == {"building"}


@pytest.mark.parametrize("version", ["1.0", "1.1", "2.0"])
def test_cityjson(version: str, tmp_path: Path):
    model = cityjson(version)
    if version == "1.0":
        model["CityObjects"]["house"]["geometry"][-1]["lod"] = 2
    (tmp_path / "c.city.json").write_text(json.dumps(model))
    scene = read_scene(tmp_path / "c.city.json")
    check_house(scene)
    assert area(scene, "b_lawn/surface") == pytest.approx(50.0 * 50.0, abs=0.1)
    assert "objects of other types left out: 1 CityObjectGroup" in scene.notes


def test_a_sequence_is_the_same_as_one_object(tmp_path: Path):
    one = read_scene(write_cityjson(tmp_path / "a.json"))
    sequence = read_scene(write_cityjson(tmp_path / "a.city.jsonl"))
    check_house(sequence)
    for first, second in zip(one.parts, sequence.parts, strict=True):
        assert first.path == second.path
        assert np.array_equal(first.points, second.points)


def test_a_lower_level_of_detail(tmp_path: Path):
    path = write_cityjson(tmp_path / "a.json")
    scene = read_scene(path, lod="1.3")
    assert volume(scene, "Buildings/b_house/") == pytest.approx(10 * 8 * 6, abs=0.05)
    with pytest.raises(ValueError, match=r"lod = 'high'; a level of detail such as 2.2 is needed"):
        read_scene(path, lod="high")


def test_inside_out_holes_windows_and_closures(tmp_path: Path):
    """A wall with a window in its hole, a roof that is not there, and all faces the other way round."""
    model = cityjson()
    house = model["CityObjects"]["house"]["geometry"][2]
    start = len(model["vertices"])
    model["vertices"] += [[4000, 0, 2000], [6000, 0, 2000], [6000, 0, 4000], [4000, 0, 4000]]
    hole, pane = [start + 3, start + 2, start + 1, start], [start, start + 1, start + 2, start + 3]
    shell = house["boundaries"][0]
    shell[1].append(hole)
    shell.append([pane])
    house["semantics"]["surfaces"].append({"type": "Window"})
    house["semantics"]["values"][0].append(3)
    house["boundaries"][0] = [[ring[::-1] for ring in surface] for surface in shell]
    (tmp_path / "c.json").write_text(json.dumps(model))
    scene = read_scene(tmp_path / "c.json")
    assert area(scene, "b_house/window") == pytest.approx(4.0, abs=1e-2)
    assert area(scene, "b_house/facade") == pytest.approx(316.0, abs=1e-2)
    assert volume(scene, "Buildings/b_house/") == pytest.approx(city_files.HOUSE_VOLUME, abs=0.05)
    assert is_closed(scene, "Buildings/b_house/")
    assert "1 closed bodies were inside out; their faces were turned outward" in scene.notes
    house["semantics"]["surfaces"][1] = {"type": "ClosureSurface"}
    (tmp_path / "c.json").write_text(json.dumps(model))
    assert area(read_scene(tmp_path / "c.json"), "b_house/roof") == 0.0


def test_instances_of_templates(tmp_path: Path):
    """Two boxes from one template: the second twice as large, at its reference point."""
    model = cityjson(shift=(0.0, 0.0, 0.0))
    template = {"type": "MultiSurface", "lod": "2", "boundaries": [[face] for face in city_files.BOX_FACES]}
    corners = (city_files.BOX_POINTS - [12, 0, 0]).tolist()
    model["geometry-templates"] = {"templates": [template], "vertices-templates": corners}
    for number, (scale, vertex) in enumerate(((1.0, 0), (2.0, 2))):
        matrix = np.diag([scale, scale, scale, 1.0]).ravel().tolist()
        instance = {"type": "GeometryInstance", "template": 0, "boundaries": [vertex], "transformationMatrix": matrix}
        model["CityObjects"][f"kiosk_{number}"] = {"type": "OtherConstruction", "geometry": [instance]}
    (tmp_path / "c.json").write_text(json.dumps(model))
    scene = read_scene(tmp_path / "c.json")
    for number, (factor, corner) in enumerate(((1.0, (0, 0, 0)), (8.0, (10, 8, 0)))):
        path = f"Buildings/b_kiosk_{number}/"
        assert volume(scene, path) == pytest.approx(factor * city_files.BOX_VOLUME, abs=1e-3)
        low = np.min([part.points.min(axis=0) for part in scene.parts if part.path.startswith(path)], axis=0)
        assert low == pytest.approx(corner, abs=1e-6)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_citygml(version: str, tmp_path: Path):
    (tmp_path / "c.gml").write_text(citygml(version))
    scene = read_scene(tmp_path / "c.gml")
    check_house(scene)
    assert "no ground: the file has none; vehicles need roads of another file" in scene.notes
    lower = read_scene(tmp_path / "c.gml", lod="1")
    assert {part.path.split("/")[1] for part in lower.parts} == {"b_box"}
    assert "1 objects without surfaces of this level of detail were left out" in lower.notes


def test_reference_systems_have_names_in_several_styles():
    names = ("urn:ogc:def:crs,crs:EPSG::25832,crs:EPSG::5783", "https://www.opengis.net/def/crs/EPSG/0/7415",
             "EPSG:4979", "urn:ogc:def:crs:EPSG:6.12:31467", "http://www.opengis.net/gml/srs/epsg.xml#25833",
             "urn:adv:crs:ETRS89_UTM33*DE_DHHN2016_NH", "local")  # fmt: skip
    assert [reference_system(name).code for name in names] == [25832, 7415, 4979, 31467, 25833, 25833, 0]


def test_degrees_become_meters_east_and_north():
    """Closed form: radii of curvature of WGS-84 at 48 deg, 6,384,000 m east-west and 6,370,900 m north-south."""
    step = 1e-3
    degrees = np.array([[48.0, 11.0, 500.0], [48.0 + step, 11.0, 510.0], [48.0, 11.0 + step, 500.0]])
    world, georeference, notes = place("f", degrees, ReferenceSystem(4979))
    e2, s = 6.69437999014e-3, np.sin(np.radians(48.0 + 0.5 * step))
    north = 6378137.0 * (1 - e2) / (1 - e2 * s**2) ** 1.5 * np.radians(step)
    east = 6378137.0 / np.sqrt(1 - e2 * np.sin(np.radians(48.0)) ** 2) * np.cos(np.radians(48.0)) * np.radians(step)
    assert (world[1] - world[0])[:2] == pytest.approx([0.0, north], abs=2e-3)
    assert (world[2] - world[0])[:2] == pytest.approx([east, 0.0], abs=2e-3)
    assert world[:, 2] == pytest.approx([0.0, 10.0, 0.0])
    swapped, _, same = place("f", degrees[:, [1, 0, 2]], reference_system("EPSG:4979"))
    assert np.array_equal(swapped, world)
    assert notes == same == ["origin: latitude 48.000500, longitude 11.000500 deg, height 500.00 m"]
    assert georeference is not None
    assert georeference.degrees(world[:, :2]) == pytest.approx(degrees[:, :2], abs=1e-9)


def test_a_projected_system_has_its_origin_on_the_earth():
    """On the central meridian of a UTM zone north is up and the scale is 0.9996."""
    pytest.importorskip("rasterio")
    points = np.array([[499_990.0, 5_300_000.0, 0.0], [500_010.0, 5_300_000.0, 0.0], [500_000.0, 5_300_030.0, 5.0]])
    world, georeference, notes = place("f", points, reference_system("urn:ogc:def:crs:EPSG::32632"))
    assert (world[1] - world[0])[:2] == pytest.approx([20.0 / 0.9996, 0.0], abs=1e-4)
    middle = 0.5 * (world[0] + world[1])
    assert (world[2] - middle) == pytest.approx([0.0, 30.0 / 0.9996, 5.0], abs=1e-4)
    assert notes[0].startswith("origin: latitude 47.8")
    assert "longitude 9.000000" in notes[0]
    assert georeference is not None and georeference.longitude == pytest.approx(9.0, abs=1e-6)


def test_triangles_fill_polygons_with_holes_in_any_plane():
    generator = np.random.Generator(np.random.PCG64(3))
    outer = np.array([[0, 0, 0], [6, 0, 0], [6, 4, 0], [3, 4, 0], [3, 2, 0], [0, 2, 0]], float)
    hole = np.array([[4, 1, 0], [4, 3, 0], [5, 3, 0], [5, 1, 0]], float)
    bow = np.array([[0, 0, 0], [2, 2, 0], [2, 0, 0], [0, 2.5, 0]], float)
    for _ in range(5):
        turn, _ = np.linalg.qr(generator.normal(size=(3, 3)))
        turn *= np.sign(np.linalg.det(turn))
        shift = generator.normal(size=3) * 100
        placed = [ring @ turn.T + shift for ring in (outer, hole, bow)]
        found = triangulate([[placed[0], placed[1]], [placed[0][:2]], [placed[2]]])
        assert (found.degenerate, found.repaired) == (1, 1)
        first = found.corners[found.owner == 0]
        crosses = np.cross(first[:, 1] - first[:, 0], first[:, 2] - first[:, 0])
        assert 0.5 * np.linalg.norm(crosses, axis=1).sum() == pytest.approx(6 * 4 - 3 * 2 - 2)
        assert (crosses @ normal_of(placed[0]) > 0).all()
        used = {tuple(corner) for corner in first.reshape(-1, 3).tolist()}
        assert used == {tuple(corner) for ring in placed[:2] for corner in ring.tolist()}


FAULTS: dict[str, tuple[Callable[[dict], object], str]] = {
    "type": (lambda m: m.update(type="FeatureCollection"), r'holds no object with "type": "CityJSON"'),
    "objects": (lambda m: m.update(CityObjects=[]), r"CityObjects is no map of objects by id"),
    "vertex": (lambda m: m["CityObjects"]["box"]["geometry"][0]["boundaries"][0][0][0].append(999),
               r"CityObjects\['box'\].geometry\[0\]: surface 0: vertex 999 of 22 .* does not exist"),
    "transform": (lambda m: m.update(transform={"scale": [1, 1]}),
                  r"transform.scale: rows of three numbers are needed"),
    "nothing": (lambda m: m.update(CityObjects={}), r"holds no city object with surfaces; give a file with buildings"),
    "lod": (lambda m: m["CityObjects"]["box"]["geometry"][0].update(lod="fine"),
            r"\['box'\].geometry\[0\].lod = 'fine'"),
    "number": (lambda m: m["vertices"][0].__setitem__(0, float("nan")),
               r"c.json: house: a coordinate is nan; a number below 1e\+12 is needed; correct it"),
    "far": (lambda m: m["vertices"][20].__setitem__(0, 10**11), r"c.json: lawn: reaches .* km from the middle"),
    "place": (lambda m: m.update(metadata={"referenceSystem": "EPSG:4979"}),
              r"a place of EPSG:4979 is not on the earth"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_faults_name_element_and_cure(name: str, tmp_path: Path):
    change, match = FAULTS[name]
    model = cityjson()
    change(model)
    (tmp_path / "c.json").write_text(json.dumps(model))
    with pytest.raises(ValueError, match=match) as caught:
        read_scene(tmp_path / "c.json")
    assert str(caught.value).startswith(str(tmp_path / "c.json"))


def test_importers_by_suffix(tmp_path: Path):
    names = {"a.city.json": "cityjson", "a.json": "cityjson", "a.city.jsonl": "cityjson", "tileset.json": "tiles",
             "a.b3dm": "tiles", "a.gml": "citygml", "b.parquet": "overture"}  # fmt: skip
    assert {name: find_importer(tmp_path / name) for name in names} == names


def test_the_town_is_sound(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    for path in (write_cityjson(tmp_path / "a.city.json"), tmp_path / "b.gml"):
        if path.suffix == ".gml":
            path.write_text(citygml())
        out = tmp_path / path.stem
        assert main(["import", str(path), "--out", str(out)]) == 0
        (layer,) = out.glob("*.usda")
        assert main(["town", "check", str(layer)]) == 0, capsys.readouterr().out
