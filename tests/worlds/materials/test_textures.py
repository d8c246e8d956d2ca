"""Texture tiles, how materials use them, and the coordinates of town meshes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pxr import Usd, UsdShade
from scipy.spatial.transform import Rotation

from mmw.core.mesh import TriangleMesh
from mmw.core.resources import assets_dir
from mmw.usd.material_library import LIBRARY
from mmw.usd.materials import MaterialUse, read_material
from mmw.worlds.materials.shading_networks import TEXTURES
from mmw.worlds.materials.textures import TILES, normal_pixels, roughness_scale, tile_pixels, write_tile
from mmw.worlds.materials.town_decals import TOWN_PICTURES
from mmw.worlds.materials.vehicle_decals import PICTURES
from mmw.worlds.towns.texture_uv import GRID_M, texture_coordinates

FOLDER = assets_dir() / "materials" / TEXTURES
OWN = [name for name, tile in TILES.items() if not tile.file]
ALL_PICTURES = {**PICTURES, **TOWN_PICTURES}


def linear(srgb: np.ndarray) -> np.ndarray:
    value = srgb / 255.0
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def pixels(path: str | Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


@pytest.mark.parametrize("name", OWN)
def test_tile_is_what_the_builder_makes_and_its_mean_is_the_color(name: str, tmp_path) -> None:
    write_tile(tmp_path / "tile.png", TILES[name], LIBRARY[name].color)
    made, shipped = pixels(tmp_path / "tile.png"), pixels(FOLDER / f"{name}.png")
    assert np.abs(made.astype(int) - shipped.astype(int)).max() <= 1
    assert linear(shipped.astype(float)).mean(axis=(0, 1)) == pytest.approx(LIBRARY[name].color, rel=0.03)
    assert shipped.std() > 1.0
    if TILES[name].relief:
        normals = pixels(FOLDER / f"{name}_normal.png")
        assert np.abs(pixels(tmp_path / "tile_normal.png").astype(int) - normals.astype(int)).max() <= 4
        vector = 2.0 * normals / 255.0 - 1.0
        assert np.linalg.norm(vector, axis=2) == pytest.approx(1.0, abs=0.03) and vector[..., 2].min() > 0.0
        assert np.abs(vector[..., :2].mean(axis=(0, 1))).max() < 0.1  # nearly level; roof tiles lean on the next row
        assert vector[..., :2].std() > 0.01


def test_all_files_together_are_small_and_used() -> None:
    files = {path.name for path in FOLDER.iterdir()}
    expected = {f"{name}.png" for name in (*OWN, *ALL_PICTURES)}
    expected |= {f"{name}_normal.png" for name in OWN if TILES[name].relief}
    expected |= {f"{name}_light.png" for name, picture in ALL_PICTURES.items() if picture.light}
    assert files == expected
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < 6_700_000


@pytest.mark.parametrize("name", [name for name, tile in TILES.items() if tile.file])
def test_a_tinted_tile_has_the_color_of_its_material(name: str) -> None:
    tile = TILES[name]
    tinted = np.array(tile.tint) * LIBRARY[tile.file].color
    assert tinted == pytest.approx(LIBRARY[name].color, rel=1e-6)


@pytest.mark.parametrize("name", ALL_PICTURES)
def test_color_of_a_picture_is_its_mean_and_the_file_is_what_is_drawn(name: str) -> None:
    drawn, is_text = ALL_PICTURES[name].draw(), name in PICTURES  # text has the same pixels on every platform
    assert LIBRARY[name].color == pytest.approx(linear(drawn).mean(axis=(0, 1)), abs=1e-3 if is_text else 2e-3)
    assert np.abs(pixels(FOLDER / f"{name}.png").astype(int) - drawn.astype(int)).max() <= (0 if is_text else 1)


def test_normals_lean_away_from_a_slope() -> None:
    """A tile whose surface rises to the right has normals that point left; one that rises upward, down."""
    for axis in (0, 1):
        slope = np.zeros((2, 8, 8))
        slope[axis] = 0.5
        vector = 2.0 * normal_pixels(replace(TILES["bark"], relief=lambda s=slope: s)) / 255.0 - 1.0
        assert vector[..., axis] == pytest.approx(-0.5 / np.sqrt(1.25), abs=0.02)
        assert vector[..., 1 - axis] == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize("name", [name for name, tile in TILES.items() if tile.roughness])
def test_mean_roughness_is_that_of_the_material(name: str) -> None:
    scale, bias = roughness_scale(TILES[name], LIBRARY[name].color, LIBRARY[name].roughness)
    found = scale * pixels(FOLDER / f"{name}.png")[..., 0] / 255.0 + bias
    assert found.mean() == pytest.approx(LIBRARY[name].roughness, abs=0.01)
    assert 0.2 < found.min() < found.max() <= 1.3 and found.std() > 0.004


@pytest.mark.parametrize("name", OWN)
def test_tile_has_no_seam(name: str) -> None:
    """Steps across the border are not larger than the largest steps inside, up to a joint's."""
    index, palette = tile_pixels(TILES[name], LIBRARY[name].color)
    value = palette[index].astype(float).mean(axis=2)
    for axis in (0, 1):
        inside = np.abs(np.diff(value, axis=axis)).mean(axis=1 - axis)
        border = np.abs(np.take(value, 0, axis) - np.take(value, -1, axis)).mean()
        assert border <= inside.max() * 1.2 + 1.0


def test_materials_use_their_tiles_and_readers_see_the_mean() -> None:
    stage = Usd.Stage.Open(str(assets_dir() / "materials" / "materials.usda"))
    for name, spec in LIBRARY.items():
        prim = stage.GetPrimAtPath(f"/Materials/{name}")
        color = UsdShade.Material(prim).ComputeSurfaceSource()[0].GetInput("diffuseColor")
        assert color.HasConnectedSource() == (name in TILES or name in ALL_PICTURES)
        if name in TILES:
            source = color.GetConnectedSources()[0][0].source.GetPrim()
            file = source.GetAttribute("inputs:file").Get()
            assert file.resolvedPath and pixels(file.resolvedPath).shape[2] == 3
            scale = stage.GetPrimAtPath(f"/Materials/{name}/Repeat").GetAttribute("inputs:scale").Get()
            assert scale[0] == pytest.approx(1.0 / TILES[name].size_m)
        assert read_material(stage, MaterialUse(name, str(prim.GetPath()), None)).color == pytest.approx(spec.color)


def corner_coordinates(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    st, index = texture_coordinates(TriangleMesh(points, faces))
    return st[faces.reshape(-1) if index is None else index].reshape(-1, 3, 2).astype(float)


def test_coordinates_keep_lengths_on_any_plane() -> None:
    rng = np.random.default_rng(4)
    for _ in range(50):
        turn = Rotation.random(random_state=rng).as_matrix()
        points = rng.uniform(-5, 5, (3, 2)) @ turn[:2] + rng.uniform(-300, 300, 3)
        faces = np.array([[0, 1, 2]])
        (normal,) = TriangleMesh(points, faces).normals
        st = corner_coordinates(points, faces)[0]
        for a, b in ((0, 1), (1, 2), (2, 0)):
            length = np.linalg.norm(points[a] - points[b])
            if abs(normal[2]) > 0.9:  # seen on the map
                length = np.linalg.norm((points[a] - points[b])[:2])
            assert np.linalg.norm(st[a] - st[b]) == pytest.approx(length, abs=0.02)


def test_walls_are_upright_and_read_from_left_to_right() -> None:
    """A wall that looks south, seen from the south: s grows to the east, t upward."""
    points = np.array([[0, 0, 0], [4, 0, 0], [4, 0, 3], [0, 0, 3.0]])
    st, index = texture_coordinates(TriangleMesh(points, np.array([[0, 1, 2], [0, 2, 3]])))
    assert index is None
    assert st - st[0] == pytest.approx(points[:, [0, 2]], abs=GRID_M)


def test_a_vertex_of_two_walls_has_two_coordinates_and_level_ground_is_the_map() -> None:
    corner = np.array([[0, 0, 0], [4, 0, 0], [4, 0, 3], [4, 5, 0.0]])
    st, index = texture_coordinates(TriangleMesh(corner, np.array([[0, 1, 2], [1, 3, 2]])))
    assert index is not None and len(index) == 6 and len(st) > 4
    ground = np.array([[0, 0, 1], [4, 0, 1], [4, 3, 1.0]])
    st, index = texture_coordinates(TriangleMesh(ground, np.array([[0, 1, 2]])))
    assert index is None and st == pytest.approx(ground[:, :2])
