"""Worlds over height rasters, against the functions that the rasters were made of."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mmw.core.errors import InputError
from mmw.core.georeference import Georeference
from mmw.core.mesh import TriangleMesh
from mmw.worlds.importers.geo.drape import split_edges
from mmw.worlds.importers.geo.relief import ROAD_REACH
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.importers.osm.buildings import FOOT
from mmw.worlds.importers.osm.read_osm import read_osm
from tests.fixtures.meshes import corners_of, plumb, upward
from tests.fixtures.osm_files import ORIGIN, Map

rasterio = pytest.importorskip("rasterio")
CRS, TRANSFORM, WARP = (__import__(f"rasterio.{name}", fromlist=["x"]) for name in ("crs", "transform", "warp"))
UTM = "EPSG:32632"
REACH, CELL = 250.0, 2.0
"""Half the side of the rasters, and the side of their cells [m]."""


def quarter() -> str:
    """Return a street along x, one building on either side, a tree."""
    town = Map()
    town.way([(-100.0, 0.0), (100.0, 0.0)], {"highway": "residential", "width": "6"})
    town.box(-40.0, 10.0, 20.0, 12.0, building="yes", height="9")
    town.box(-20.0, 10.0, 20.0, 12.0, building="yes", height="9")
    town.box(30.0, -30.0, 20.0, 12.0, building="yes", height="15", roof__shape="gabled")
    town.point(70.0, 20.0, natural="tree")
    return town.text()


def write_raster(path: Path, height: Callable[[np.ndarray, np.ndarray], np.ndarray], crs: str | None = UTM,
                 cell: float = CELL, reach: float = REACH, **profile: object) -> Path:  # fmt: skip
    """Write a function of the world's x and y as a raster whose cells are parallel to the grid of UTM zone 32."""
    (east,), (north,) = WARP.transform("EPSG:4326", UTM, [ORIGIN[1]], [ORIGIN[0]])
    count = int(2 * reach / cell)
    transform = TRANSFORM.from_origin(east - reach, north + reach, cell, cell)
    column, row = np.meshgrid(np.arange(count) + 0.5, np.arange(count) + 0.5)
    at_east, at_north = transform @ (column, row)
    lon, lat = WARP.transform(UTM, "EPSG:4326", at_east.ravel().tolist(), at_north.ravel().tolist())
    x, y = Georeference(*ORIGIN).world(np.column_stack([lat, lon])).T
    z = height(x, y).reshape(count, count)
    options = {"driver": "GTiff", "width": count, "height": count, "count": 1, "dtype": "float32", **profile}
    if crs is not None:
        options |= {"crs": crs, "transform": transform}
    with rasterio.open(path, "w", **options) as file:
        file.write(z.astype(options["dtype"]), 1)
    return path


def read(folder: Path, raster: Path) -> ImportedScene:
    (folder / "quarter.osm").write_text(quarter())
    return read_osm(folder / "quarter.osm", ORIGIN, terrain=str(raster))


def slope(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 520.0 + 0.05 * x - 0.03 * y


def hill(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 300.0 + 20.0 * np.exp(-(x * x + (y - 40.0) ** 2) / (2 * 60.0**2))


def ground(scene: ImportedScene, *labels: str) -> np.ndarray:
    return np.concatenate([part.points for part in scene.parts if part.label in labels])


def along(height: Callable[[np.ndarray, np.ndarray], np.ndarray], points: np.ndarray) -> np.ndarray:
    """Return the height of the nearest place of the street's center line."""
    return height(np.clip(points[:, 0], -100.0, 100.0), np.zeros(len(points)))


def beside(points: np.ndarray) -> np.ndarray:
    """Return the distance from the street's center line."""
    return np.hypot(points[:, 0] - np.clip(points[:, 0], -100.0, 100.0), points[:, 1])


def zero_of(scene: ImportedScene) -> float:
    return float(scene.notes[-1].split("z = 0 is ")[1].split(" m")[0])


def test_a_slope_is_followed_exactly(tmp_path: Path) -> None:
    scene = read(tmp_path, write_raster(tmp_path / "dem.tif", slope))
    zero = zero_of(scene)
    points, road = ground(scene, "terrain"), ground(scene, "road")
    away = points[beside(points) > ROAD_REACH]
    # heights are float32 in the file, 6e-5 m at 520 m; the raster's plane is exact to that under any interpolation
    np.testing.assert_allclose(away[:, 2] + zero, slope(*away[:, :2].T), atol=1e-3)
    np.testing.assert_allclose(road[:, 2] + zero, along(slope, road), atol=1e-3)  # level across
    assert 0.0 <= points[:, 2].min() < 1.5  # the ground ends 30 m out, heights were read to 45 m
    faces = upward(corners_of([part for part in scene.parts if part.label in ("road", "terrain")]))
    for part in scene.parts:
        if part.path.endswith("/facade"):
            lowest = min(min(heights) for heights in plumb(faces, part.points[:, :2], 1e-5))
            # walls are looked at every 2 m, and the ground bends where it goes over into the road's heights
            assert part.points[:, 2].min() == pytest.approx(lowest - FOOT, abs=0.05)
    tree = np.concatenate([part.points for part in scene.parts if part.label == "vegetation"])
    ((foot,),) = plumb(faces, np.array([[70.0, 20.0]]), 1e-9)
    assert tree[:, 2].min() < foot < tree[:, 2].max()


def test_a_hill_within_the_error_of_interpolation_and_smoothing(tmp_path: Path) -> None:
    scene = read(tmp_path, write_raster(tmp_path / "dem.tif", hill))
    zero = zero_of(scene)
    green, road = ground(scene, "terrain"), ground(scene, "road")
    away = green[beside(green) > ROAD_REACH]
    # Second derivative of the hill: at most 20 / 60^2. Bilinear reading of 2 m cells, at most h^2 / 8 of it in each
    # direction, and the same once more on the grid of the spline.
    curvature = 20.0 / 60.0**2
    np.testing.assert_allclose(away[:, 2] + zero, hill(*away[:, :2].T), atol=4 * curvature * CELL**2 / 8 + 1e-3)
    # A Gaussian of 8 m adds s^2 / 2 times the Laplacian, at most 2 / 60^2 of the height; then 4th order.
    np.testing.assert_allclose(road[:, 2] + zero, along(hill, road), atol=8.0**2 / 2 * 2 * curvature * 1.05 + 0.02)


def test_roads_are_smooth_over_a_noisy_raster(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).normal(0.0, 0.3, (int(2 * REACH / CELL),) * 2)
    scene = read(tmp_path, write_raster(tmp_path / "dem.tif", lambda x, y: slope(x, y) + noise.ravel()))
    residual = ground(scene, "road")
    residual = residual[:, 2] + zero_of(scene) - along(slope, residual)
    # White noise after a Gaussian of s = 8 m on cells of 2 m: sigma x cell / (2 sqrt(pi) s); three sigma
    assert np.std(residual) < 3 * 0.3 * CELL / (2 * np.sqrt(np.pi) * 8.0)


def test_neighbors_share_their_wall_and_faces_stay_edge_to_edge(tmp_path: Path) -> None:
    scene = read(tmp_path, write_raster(tmp_path / "dem.tif", slope))
    # two buildings of one height side by side on a slope of 5 %: of each shared wall shows what the other leaves free
    areas, feet = {}, {}
    for part in scene.parts:
        if part.path.endswith("/facade"):
            corners = part.mesh.corners
            on_wall = (np.abs(corners[:, :, 0] + 20.0) < 1e-2).all(axis=1)
            areas[part.path] = part.mesh.areas[on_wall].sum()
            feet[part.path] = part.points[:, 2].min()
    shown = [path for path, area in areas.items() if area > 0]
    assert len(shown) == 2
    step = abs(feet[shown[0]] - feet[shown[1]])
    assert step == pytest.approx(0.05 * 20.0, rel=0.1)
    np.testing.assert_allclose([areas[path] for path in shown], 12.0 * step, rtol=1e-3)
    square = TriangleMesh(
        np.array([[0, 0, 0], [9, 0, 0], [9, 5, 0], [0, 5, 0]], float), np.array([[0, 1, 2], [0, 2, 3]])
    )
    fine = split_edges(square, 1.0)
    edges = np.sort(fine.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, uses = np.unique(edges, axis=0, return_counts=True)
    outer = unique[uses == 1]
    assert uses.max() == 2
    assert np.linalg.norm(fine.points[outer[:, 0]] - fine.points[outer[:, 1]], axis=1).sum() == pytest.approx(28.0)
    assert (fine.areas.sum(), (fine.crosses[:, 2] > 0).all()) == (pytest.approx(45.0), True)


def test_a_raster_in_degrees_and_one_with_a_scale(tmp_path: Path) -> None:
    plain = read(tmp_path, write_raster(tmp_path / "dem.tif", slope))
    with rasterio.open(tmp_path / "dem.tif") as file:
        lat, lon = 1e-5, 1.5e-5
        transform = TRANSFORM.from_origin(ORIGIN[1] - 0.003, ORIGIN[0] + 0.002, lon, lat)
        shape = (400, 400)
        z = np.full(shape, np.nan, np.float32)
        WARP.reproject(file.read(1), z, src_transform=file.transform, src_crs=file.crs, dst_transform=transform,
                       dst_crs="EPSG:4326", resampling=WARP.Resampling.bilinear)  # fmt: skip
    options = {"driver": "GTiff", "width": 400, "height": 400, "count": 1, "dtype": "float32", "crs": "EPSG:4326"}
    with rasterio.open(tmp_path / "degrees.tif", "w", transform=transform, **options) as file:
        file.write(z / 2, 1)
        file.scales = (2.0,)
    other = read(tmp_path, tmp_path / "degrees.tif")
    for scene in (plain, other):
        points = ground(scene, "road")
        np.testing.assert_allclose(points[:, 2] + zero_of(scene), along(slope, points), atol=5e-3)


def test_rasters_that_cannot_be_used(tmp_path: Path) -> None:
    cases = {
        "no height at .* % of the map.*fill its gaps": write_raster(
            tmp_path / "gap.tif", lambda x, y: np.where(x * x + y * y < 400.0, -9999.0, 300.0), nodata=-9999.0
        ),
        "no height at": write_raster(tmp_path / "nan.tif", lambda x, y: np.where(x > 0.0, np.nan, 300.0)),
        "has no coordinate system; .*assign one": write_raster(tmp_path / "bare.tif", slope, crs=None),
        "covers .* % of the map.*give a larger raster": write_raster(tmp_path / "small.tif", slope, reach=80.0),
        "cannot be read .*give an existing GeoTIFF": tmp_path / "missing.tif",
    }
    for message, path in cases.items():
        with pytest.raises(InputError, match=message):
            read(tmp_path, path)
