"""glTF, OBJ, PLY, STL and OFF files become worlds: axes, units, hierarchy, materials, broken meshes."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from mmw.core.planar_surfaces import find_surfaces
from mmw.worlds.importers.mesh_cleanup import MeshCollector, PrimNames, bounds, check_scene, clean, identifier, linear
from mmw.worlds.importers.mesh_files import read_meshes
from tests.fixtures.import_files import (
    HIGH,
    HOUSE,
    HOUSE_HIGH,
    HOUSE_LOW,
    LOW,
    write_glb,
    write_obj,
    write_ply,
)
from tests.fixtures.meshes import part_at, volume
from tests.fixtures.scenes import box_mesh


def test_glb_is_turned_up_and_keeps_names_and_materials(tmp_path: Path) -> None:
    world = read_meshes(write_glb(tmp_path / "world.glb"))
    assert [part.path for part in world.parts] == ["Model/ground", "Model/block/house"]
    assert np.allclose(bounds(world), (LOW, HIGH), atol=1e-5)
    house = part_at(world.parts, "Model/block/house")
    assert np.allclose((house.points.min(axis=0), house.points.max(axis=0)), (HOUSE_LOW, HOUSE_HIGH), atol=1e-5)
    assert volume(house) == pytest.approx(480)
    brick = world.materials[house.material]
    assert (brick.name, brick.source, brick.radio) == ("red_brick", "red brick", None)
    assert brick.color == pytest.approx((102 / 255, 26 / 255, 13 / 255), abs=1e-6)  # glTF factors are linear
    assert (brick.roughness, brick.metallic, brick.opacity) == (0.9, 0.0, 1.0)
    assert world.notes == ()


def test_mirrored_instances_and_meshes_above_others(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    glass = PBRMaterial(name="pane", baseColorFactor=[255, 255, 255, 51], alphaMode="BLEND", metallicFactor=0.25)
    box = trimesh.Trimesh(*box_mesh((4, 2, 6)), process=False, visual=TextureVisuals(material=glass))
    scene.add_geometry(box, node_name="one", geom_name="box")
    scene.graph.update("two", "one", matrix=trimesh.transformations.translation_matrix((0, 0, 20)), geometry="box")
    mirror = np.diag([-1.0, 1, 1, 1])
    mirror[0, 3] = 30
    scene.graph.update("three", "world", matrix=mirror, geometry="box")
    (tmp_path / "a.glb").write_bytes(scene.export(file_type="glb"))
    world = read_meshes(tmp_path / "a.glb")
    # trimesh cannot mirror an instance of a mesh, so its GLB holds that mesh twice
    assert [part.path.rpartition("/")[0] for part in world.parts] == ["Model/one", "Model", "Model/one"]
    assert sorted(part.path.rpartition("/")[2] for part in world.parts)[1:] == ["three", "two"]
    for part in world.parts:
        assert volume(part) == pytest.approx(48)
    middles = sorted(tuple(part.points.mean(axis=0).round(3)) for part in world.parts)
    assert middles == [(0, -20, 0), (0, 0, 0), (30, 0, 0)]
    pane = world.materials["pane"]
    assert (pane.opacity, pane.metallic, pane.roughness) == (0.2, 0.25, 1.0)


def test_a_texture_leaves_its_mean_colour(tmp_path: Path) -> None:
    image = Image.fromarray(np.array([[[255, 0, 0], [0, 0, 0]], [[255, 0, 0], [0, 0, 0]]], np.uint8))
    material = PBRMaterial(name="tiles", baseColorTexture=image, metallicFactor=0.0, roughnessFactor=0.5)
    points, faces = box_mesh((4, 4, 4))
    visual = TextureVisuals(uv=np.zeros((8, 2)), material=material)
    mesh = trimesh.Trimesh(points, faces, process=False, visual=visual)
    (tmp_path / "a.glb").write_bytes(trimesh.Scene(mesh).export(file_type="glb"))
    world = read_meshes(tmp_path / "a.glb")
    assert world.materials["tiles"].color == pytest.approx(linear((0.5, 0, 0)), abs=0.002)
    assert "its texture the mean color" in world.notes[0]


def test_obj_objects_and_materials(tmp_path: Path) -> None:
    world = read_meshes(write_obj(tmp_path / "world.obj"))
    assert np.allclose(bounds(world), (LOW, HIGH), atol=1e-5)
    sources = {part.path: world.materials[part.material].source for part in world.parts}
    assert sources == {"Model/ground_stone": "stone", "Model/house_brick": "brick"}
    assert world.materials["brick"].color == pytest.approx((0.4, 0.1, 0.05), abs=0.004)
    assert volume(part_at(world.parts, "Model/house_brick")) == pytest.approx(480, rel=1e-5)
    assert "neither unit nor up axis" in world.notes[0]


@pytest.mark.parametrize("suffix", ["ply", "stl", "off"])
def test_single_meshes_are_called_after_their_file(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"my house.{suffix}"
    data = trimesh.Trimesh(*HOUSE, process=False).export(file_type=suffix)
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    world = read_meshes(path)
    assert [part.path for part in world.parts] == ["Model/my_house"]
    assert len(world.parts[0].points) == 8  # also of STL, which stores every corner three times
    assert np.allclose(bounds(world), (HOUSE_LOW, HOUSE_HIGH), atol=1e-5)
    part = world.parts[0]
    zeros = np.zeros(12, dtype=np.int32)
    assert len(np.unique(find_surfaces(part.points, part.faces, zeros, zeros))) == 6


@pytest.mark.parametrize("suffix", ["ply", "obj", "glb"])
def test_closed_meshes_that_are_inside_out_are_turned_and_counted(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"house.{suffix}"
    data = trimesh.Scene(trimesh.Trimesh(HOUSE[0], HOUSE[1][:, ::-1], process=False)).export(file_type=suffix)
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    world = read_meshes(path)
    assert volume(world.parts[0]) == pytest.approx(480, rel=1e-5)
    assert world.notes[-1] == "1 closed bodies were inside out; their faces were turned outward"


def test_up_unit_and_origin(tmp_path: Path) -> None:
    path = write_ply(tmp_path / "a.ply", *box_mesh((1000, 400, 600), (0, 200, 0)))
    world = read_meshes(path, up="y", unit_m=0.01, origin=(100, 0, 0))
    assert np.allclose(bounds(world), ((-105, -3, 0), (-95, 3, 4)), atol=1e-5)
    assert world.notes == ()


def test_an_origin_keeps_millimetres_of_map_coordinates() -> None:
    """Half a meter of float32 at 5,000 km would bend every plane."""
    parts = MeshCollector(np.array([691_000.0, 5_335_000.0, 500.0]))
    parts.add("file", "Model/a", HOUSE[0] + (691_000.123, 5_335_000.456, 500), HOUSE[1], "m")
    assert np.allclose(parts.parts[0].points.min(axis=0), np.add(HOUSE_LOW, (0.123, 0.456, 0)), atol=1e-5)


@pytest.mark.parametrize(("scale", "part"), [(1000.0, "larger than 20 km"), (0.001, "smaller than 1 m")])
def test_a_wrong_unit_is_an_error_that_names_the_size(tmp_path: Path, scale: float, part: str) -> None:
    world = read_meshes(write_obj(tmp_path / "w.obj", scale))
    with pytest.raises(ValueError, match=part) as caught:
        check_scene("w.obj", world)
    assert f"{40 * scale:.4g} x {30 * scale:.4g}" in str(caught.value)
    assert "--unit" in str(caught.value)


def test_a_world_far_from_its_origin_is_an_error(tmp_path: Path) -> None:
    path = write_ply(tmp_path / "a.ply", HOUSE[0] + (691_000, 5_335_000, 500), HOUSE[1])
    with pytest.raises(ValueError, match="--origin 691012 5335009 500"):
        check_scene("a.ply", read_meshes(path))


@pytest.mark.parametrize(
    ("name", "content", "part"),
    [
        ("a.ply", b"", "cannot be read as ply"),
        ("a.glb", b"", "cannot be read as glb"),
        ("a.glb", b"glTF\x02\x00\x00\x00garbage", "cannot be read as glb"),
        ("a.gltf", b"{broken", "cannot be read as gltf"),
        ("a.obj", b"", ""),
        ("a.obj", b"this is no mesh", ""),
        ("a.stl", b"", ""),
        ("a.off", b"OFF", ""),
    ],
)
def test_files_without_a_mesh(tmp_path: Path, name: str, content: bytes, part: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=part or "cannot be read|holds no triangle"):
        check_scene(name, read_meshes(tmp_path / name))


def test_clean_merges_and_drops() -> None:
    """Two triangles of a square that store their shared edge twice, a sliver, a repeated corner, and the
    first triangle again, seen from behind."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0.0, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [-0.0, 0, 0]])
    faces = np.array([[0, 1, 2], [3, 4, 5], [0, 1, 6], [0, 7, 2], [4, 1, 7]])
    mesh, degenerate, repeated = clean(points, faces)
    assert (degenerate, repeated) == (2, 1)
    assert len(mesh.points) == 4
    assert set(map(tuple, mesh.points.tolist())) == {(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)}
    assert np.allclose(mesh.corners.mean(axis=1), points[faces[:2]].mean(axis=1))
    assert len(set(mesh.faces[0]) & set(mesh.faces[1])) == 2


def test_prim_names_are_identifiers_of_their_own() -> None:
    assert [identifier(name) for name in ("a b", "1st", "Größe", "", "a/b.c")] == ["a_b", "_1st", "Gr__e", "_", "a_b_c"]
    names = PrimNames()
    assert names.child("", "Materials") == "Materials_2"
    found = [names.child("G", "x y"), names.child("G", "x.y"), names.folder("G", "x_y")]
    assert found == ["G/x_y", "G/x_y_2", "G/x_y_3"]
    assert names.folder("G", "x_y") == "G/x_y_3"


def test_a_name_that_is_no_text_is_no_name(tmp_path: Path) -> None:
    path = write_glb(tmp_path / "w.glb")
    data = path.read_bytes()
    size = struct.unpack_from("<I", data, 12)[0]
    tree = json.loads(data[20 : 20 + size])
    tree["materials"][0]["name"] = [1.0, 2.0]
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + size :]
    total = 20 + len(text) + len(rest)
    path.write_bytes(data[:8] + struct.pack("<II", total, len(text)) + b"JSON" + text + rest)
    assert {material.source for material in read_meshes(path).materials.values()} == {"", "tarmac"}
