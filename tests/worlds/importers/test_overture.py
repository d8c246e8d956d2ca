"""Overture buildings: volumes and areas beside closed forms, materials, parts, places, faults."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from mmw.__main__ import main
from mmw.core.mesh import merge
from mmw.worlds.importers.formats import read_scene
from mmw.worlds.importers.imported_scene import ImportedScene
from tests.fixtures.overture_files import GEO, HOUSES, box, write_overture


def volume(scene: ImportedScene, name: str) -> float:
    mesh = merge(part.mesh for part in scene.parts if part.path.startswith(f"Buildings/b_o{name}/"))
    a, b, c = np.moveaxis(mesh.corners, 1, 0)
    return float(np.einsum("fk,fk->f", a, np.cross(b, c)).sum()) / 6.0


def test_buildings_have_the_volume_of_their_columns(tmp_path: Path):
    """A gabled house 6 m to the eaves and 9 m to the ridge, and four storeys of 3 m; both reach 0.5 m down."""
    scene = read_scene(write_overture(tmp_path / "b.parquet", HOUSES))
    assert volume(scene, "08f1") == pytest.approx(10 * 8 * 6.5 + 0.5 * 8 * 3 * 10, rel=1e-4)
    assert volume(scene, "08f2") == pytest.approx(12 * 10 * 12.5, rel=1e-4)
    assert not any("08f3" in part.path for part in scene.parts)
    roofs = {part.path: float(part.mesh.areas.sum()) for part in scene.parts if part.path.endswith("/roof")}
    assert roofs["Buildings/b_o08f1/roof"] == pytest.approx(2 * 10 * 5, rel=1e-4)
    assert roofs["Buildings/b_o08f2/roof"] == pytest.approx(12 * 10, rel=1e-4)
    materials = {part.path: part.material for part in scene.parts}
    assert materials["Buildings/b_o08f1/facade"] == "brick_facade"
    assert materials["Buildings/b_o08f1/roof"] == "tile_roof"
    assert materials["Buildings/b_o08f2/facade"] == "concrete_facade_336699"
    assert "overturemaps.org" in scene.notice


def test_places_are_meters_from_the_middle(tmp_path: Path):
    scene = read_scene(write_overture(tmp_path / "b.geoparquet", HOUSES))
    bounds = {
        name: merge(part.mesh for part in scene.parts if f"b_o{name}/" in part.path).bounds for name in ("08f1", "08f2")
    }
    # the middle is rounded to 1e-6 deg, 0.11 m
    assert bounds["08f2"][0] - bounds["08f1"][0] == pytest.approx([50.0, 30.0, 0.0], abs=1e-3)
    assert bounds["08f1"][0] == pytest.approx([-31.0, -20.0, -0.5], abs=0.12)
    assert bounds["08f2"][1] == pytest.approx([31.0, 20.0, 12.0], abs=0.12)
    assert scene.notes[0].startswith("origin: latitude 48.000000, longitude 11.0000")


def test_parts_replace_the_outline_that_holds_them(tmp_path: Path):
    parts = [
        {"id": "p1", "geometry": box(20, 10, 6, 10), "height": 20.0},
        {"id": "p2", "geometry": box(26, 10, 6, 10), "height": 9.0, "min_height": 6.0},
    ]
    path = write_overture(tmp_path / "b.parquet", HOUSES)
    scene = read_scene(path, parts=str(write_overture(tmp_path / "p.parquet", parts)))
    assert {part.path.split("/")[1] for part in scene.parts if "Buildings" in part.path} == {
        "b_o08f1",
        "b_op1",
        "b_op2",
    }
    high = merge(part.mesh for part in scene.parts if "b_op2/" in part.path).bounds
    assert high[:, 2] == pytest.approx([6.0, 9.0])


def test_the_town_is_sound(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = write_overture(tmp_path / "b.parquet", HOUSES)
    assert main(["import", str(path), "--out", str(tmp_path / "out")]) == 0
    assert main(["town", "check", str(tmp_path / "out" / "b.usda")]) == 0, capsys.readouterr().out


def test_faults_name_column_and_cure(tmp_path: Path):
    path = tmp_path / "b.parquet"

    def refused(match: str, rows: list[dict[str, Any]], geo: dict[str, Any] | None = GEO) -> None:
        with pytest.raises(ValueError, match=match) as caught:
            read_scene(write_overture(path, rows, geo))
        assert str(caught.value).startswith(str(path))

    refused(r"no column 'geometry'; the file has id, height; download", [{"id": "a", "height": 3.0}])
    refused(r"holds no building; choose another area", [HOUSES[2]])
    refused(r"cannot be read as GeoParquet", [{"id": "a", "geometry": b"no geometry"}])
    mercator = {"id": "a", "geometry": shapely.to_wkb(shapely.box(1e6, 6e6, 1e6 + 10, 6e6 + 10))}
    refused(r"geometry reaches from 1000000.0, 6000000.0 .*degrees are needed", [mercator])
    far = {"id": "b", "geometry": box(40_000, 0, 10, 10)}
    refused(r"40.\d km wide; 20 km or less are needed; cut out an area", [HOUSES[0], far])
    tall = {"id": "c", "geometry": box(0, 0, 10, 10), "height": 1e12}
    refused(r"height = '1000000000000.0'; -100 to 2000 is needed", [HOUSES[0], tall])
    crs = {
        "primary_column": "geometry",
        "columns": {"geometry": {"encoding": "WKB", "crs": {"id": {"authority": "EPSG", "code": 3857}}}},
    }
    refused(r"column geometry: encoding 'WKB' in EPSG:3857; WKB in OGC:CRS84", HOUSES, crs)
    path.write_text("nonsense")
    with pytest.raises(ValueError, match=r"b.parquet: cannot be read as GeoParquet"):
        read_scene(path)
