"""Texture tiles, how materials use them, and the coordinates of town meshes."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pxr import Usd, UsdShade

from mmw.paths import assets_dir
from mmw.town.texture_coordinates import GRID_M, texture_coordinates
from mmw.usd.library import LIBRARY, TEXTURES
from mmw.usd.materials import MaterialUse, read_material
from mmw.usd.textures import SIZE, TILES, tile_pixels, write_tile

FOLDER = assets_dir() / "materials" / TEXTURES


def linear(srgb: np.ndarray) -> np.ndarray:
    value = srgb / 255.0
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def pixels(path: str | Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


@pytest.mark.parametrize("name", TILES)
def test_tile_is_what_the_builder_makes_and_its_mean_is_the_color(name: str, tmp_path) -> None:
    write_tile(tmp_path / "tile.png", TILES[name], LIBRARY[name].color)
    made, shipped = pixels(tmp_path / "tile.png"), pixels(FOLDER / f"{name}.png")
    assert np.abs(made.astype(int) - shipped.astype(int)).max() <= 1
    assert linear(shipped.astype(float)).mean(axis=(0, 1)) == pytest.approx(LIBRARY[name].color, rel=0.03)
    assert (FOLDER / f"{name}.png").stat().st_size < 60_000
    assert shipped.std() > 1.0


@pytest.mark.parametrize("name", TILES)
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
        assert color.HasConnectedSource() == (name in TILES)
        if name in TILES:
            source = color.GetConnectedSources()[0][0].source.GetPrim()
            file = source.GetAttribute("inputs:file").Get()
            assert file.resolvedPath and pixels(file.resolvedPath).shape == (SIZE, SIZE, 3)
            scale = stage.GetPrimAtPath(f"/Materials/{name}/Repeat").GetAttribute("inputs:scale").Get()
            assert scale[0] == pytest.approx(1.0 / TILES[name].size_m)
        assert read_material(stage, MaterialUse(name, str(prim.GetPath()), None)).color == pytest.approx(spec.color)


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    q, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    return q * np.sign(np.linalg.det(q))


def corner_coordinates(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    st, index = texture_coordinates(points, faces)
    return st[faces.reshape(-1) if index is None else index].reshape(-1, 3, 2).astype(float)


def test_coordinates_keep_lengths_on_any_plane() -> None:
    rng = np.random.default_rng(4)
    for _ in range(50):
        points = rng.uniform(-5, 5, (3, 2)) @ random_rotation(rng)[:2] + rng.uniform(-300, 300, 3)
        faces = np.array([[0, 1, 2]])
        normal = np.cross(points[1] - points[0], points[2] - points[0])
        normal /= np.linalg.norm(normal)
        st = corner_coordinates(points, faces)[0]
        for a, b in ((0, 1), (1, 2), (2, 0)):
            length = np.linalg.norm(points[a] - points[b])
            if abs(normal[2]) > 0.9:  # seen on the map
                length = np.linalg.norm((points[a] - points[b])[:2])
            assert np.linalg.norm(st[a] - st[b]) == pytest.approx(length, abs=0.02)


def test_walls_are_upright_and_read_from_left_to_right() -> None:
    """A wall that looks south, seen from the south: s grows to the east, t upward."""
    points = np.array([[0, 0, 0], [4, 0, 0], [4, 0, 3], [0, 0, 3.0]])
    st, index = texture_coordinates(points, np.array([[0, 1, 2], [0, 2, 3]]))
    assert index is None
    assert st - st[0] == pytest.approx(points[:, [0, 2]], abs=GRID_M)


def test_a_vertex_of_two_walls_has_two_coordinates_and_level_ground_is_the_map() -> None:
    corner = np.array([[0, 0, 0], [4, 0, 0], [4, 0, 3], [4, 5, 0.0]])
    st, index = texture_coordinates(corner, np.array([[0, 1, 2], [1, 3, 2]]))
    assert index is not None and len(index) == 6 and len(st) > 4
    ground = np.array([[0, 0, 1], [4, 0, 1], [4, 3, 1.0]])
    st, index = texture_coordinates(ground, np.array([[0, 1, 2]]))
    assert index is None and st == pytest.approx(ground[:, :2])
