"""Mitsuba and Sionna RT scenes become worlds: shapes, transforms, materials, errors with file and line."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mmw.physics.materials.material import RadioMaterial
from mmw.worlds.importers.formats import read_scene
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.importers.mesh_cleanup import bounds
from mmw.worlds.importers.mitsuba.read_mitsuba import read_mitsuba
from tests.fixtures.import_files import GROUND, HIGH, HOUSE, LOW, write_mitsuba, write_ply
from tests.fixtures.meshes import volume


def scene(folder: Path, body: str) -> ImportedScene:
    (folder / "scene.xml").write_text(f'<scene version="3.0.0">\n<bsdf type="diffuse" id="m"/>\n{body}\n</scene>')
    return read_mitsuba(folder / "scene.xml")


def radio_with(name: str, value: float) -> str:
    """Return a radio material with one number of a scene."""
    return f'<bsdf type="radio-material" id="x"><float name="{name}" value="{value}"/></bsdf>'


@pytest.mark.parametrize("dialect", ["new", "old"])
def test_both_dialects_name_the_same_materials(tmp_path: Path, dialect: str) -> None:
    world = read_mitsuba(write_mitsuba(tmp_path, dialect))
    assert [part.path for part in world.parts] == ["Shapes/ground", "Shapes/house/walls"]
    radio = [world.materials[part.material].radio for part in world.parts]
    assert radio == [
        RadioMaterial("itu", itu="itu_concrete", thickness=0.1), RadioMaterial("itu", itu="itu_brick", thickness=0.3)
    ]  # fmt: skip
    assert np.allclose(bounds(world), (LOW, HIGH))
    assert volume(world.parts[1]) == pytest.approx(10 * 8 * 6)
    assert world.notes == ()
    brick = world.materials[world.parts[1].material]
    assert brick.color == ((0.4, 0.1, 0.05) if dialect == "old" else None)


def test_a_radio_material_with_numbers(tmp_path: Path) -> None:
    body = """<bsdf type="radio-material" id="foam">
      <float name="relative_permittivity" value="1.5"/><float name="conductivity" value="0.02"/>
      <float name="thickness" value="0.05"/><float name="scattering_coefficient" value="0.3"/>
      <float name="xpd_coefficient" value="0.1"/><string name="scattering_pattern" value="directive"/>
      <integer name="alpha_r" value="7"/></bsdf>
      <shape type="cube"><ref id="foam"/></shape>"""
    world = scene(tmp_path, body)
    assert world.materials[world.parts[0].material].radio == RadioMaterial(
        "constant", relative_permittivity=1.5, conductivity=0.02, thickness=0.05, scattering=0.3, xpd=0.1,
        scattering_pattern="directive", alpha_r=7,
    )  # fmt: skip


@pytest.mark.parametrize(
    "text",
    [
        '<bsdf type="itu-radio-material" id="x"><string name="type" value="cheese"/></bsdf>',
        '<bsdf type="diffuse" id="mat-itu_cheese"/>',
    ],
)
def test_a_row_that_does_not_exist_is_left_to_the_map(tmp_path: Path, text: str) -> None:
    name = "x" if 'id="x"' in text else "mat-itu_cheese"
    world = scene(tmp_path, f'{text}<shape type="cube"><ref id="{name}"/></shape>')
    material = world.materials[world.parts[0].material]
    assert (material.radio, material.unknown_row) == (None, "itu_cheese")


def test_looks_of_plain_materials(tmp_path: Path) -> None:
    body = """<bsdf type="principled" id="p"><rgb name="base_color" value="#ff8000"/>
      <float name="roughness" value="0.2"/></bsdf>
      <bsdf type="roughconductor" id="c"><float name="alpha" value="0.25"/></bsdf>
      <shape type="cube"><ref id="p"/></shape><shape type="cube"><ref id="c"/></shape>
      <shape type="cube" id="own"><bsdf type="diffuse"><rgb name="reflectance" value="0.25"/></bsdf></shape>
      <shape type="cube" id="bare"/>"""
    world = scene(tmp_path, body)
    plain, metal, own, bare = (world.materials[part.material] for part in world.parts)
    assert plain.color == pytest.approx((1.0, 128 / 255, 0.0))
    assert (plain.roughness, plain.metallic, plain.radio) == (0.2, 0.0, None)
    assert (metal.roughness, metal.metallic) == (0.5, 1.0)
    assert (own.source, own.color) == ("own", (0.25, 0.25, 0.25))
    assert (bare.source, bare.radio) == ("", None)


@pytest.mark.parametrize(
    ("steps", "image"),
    [
        ('<translate x="1" z="2"/>', lambda p: np.add(p, (1, 0, 2))),
        ('<scale value="2"/><translate value="1 2 3"/>', lambda p: 2 * p + (1, 2, 3)),
        ('<translate value="1 2 3"/><scale value="2"/>', lambda p: 2 * np.add(p, (1, 2, 3))),
        ('<scale x="3"/>', lambda p: p * (3, 1, 1)),
        ('<rotate z="1" angle="90"/>', lambda p: np.stack([-p[:, 1], p[:, 0], p[:, 2]], axis=1)),
        ('<rotate value="2,0,0" angle="-90"/>', lambda p: np.stack([p[:, 0], p[:, 2], -p[:, 1]], axis=1)),
        ('<matrix value="0 -1 0 5  1 0 0 6  0 0 1 7  0 0 0 1"/>', lambda p: np.stack(
            [5 - p[:, 1], 6 + p[:, 0], 7 + p[:, 2]], axis=1)),
        # from (1, 2, 3) along +x with z up: the shape's z looks along x, its y up, its x to y
        ('<lookat origin="1,2,3" target="9,2,3" up="0,0,1"/>', lambda p: np.stack(
            [1 + p[:, 2], 2 + p[:, 0], 3 + p[:, 1]], axis=1)),
    ],
)  # fmt: skip
def test_transforms_apply_in_the_order_of_the_file(tmp_path: Path, steps: str, image) -> None:
    points = np.array([[0.0, 0, 0], [4, 0, 0], [0, 5, 0], [0, 0, 6]])
    write_ply(tmp_path / "t.ply", points, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))
    shape = '<shape type="ply"><string name="filename" value="t.ply"/><transform name="to_world">'
    world = scene(tmp_path, f'{shape}{steps}</transform><ref id="m"/></shape>')
    got, wanted = world.parts[0].points, image(points)
    order = [np.lexsort(a.round(4).T) for a in (got, wanted)]
    assert np.allclose(got[order[0]], wanted[order[1]], atol=1e-5)
    assert volume(world.parts[0]) > 0


def test_a_mirrored_shape_still_looks_outward(tmp_path: Path) -> None:
    step = '<transform name="to_world"><scale x="-1" y="2"/></transform>'
    assert volume(scene(tmp_path, f'<shape type="cube">{step}<ref id="m"/></shape>').parts[0]) == pytest.approx(16)


def test_the_inside_out_buildings_of_sionna_s_street_canyon_are_turned(tmp_path: Path) -> None:
    """They are boxes that stand nearly along the axes: 90 to 100 % of the volume of their bounds."""
    folder = Path(__file__).parents[2] / "reference" / "sionna" / "geometry"
    names = [f"simple_street_canyon_building_{k}" for k in range(1, 7)]
    string = '<shape type="ply"><string name="filename" value="{}"/><ref id="m"/></shape>'
    world = scene(tmp_path, "".join(string.format(folder / f"{name}.ply") for name in names))
    assert len(world.parts) == 6
    for part in world.parts:
        box = float(np.prod(np.ptp(part.points, axis=0)))
        assert 0.9 * box < volume(part) < 1.0001 * box, part.path
    assert world.notes == ("6 closed bodies were inside out; their faces were turned outward",)


def test_shapes_without_a_file(tmp_path: Path) -> None:
    ref = '<ref id="m"/></shape>'
    body = f"""<shape type="rectangle">{ref}
      <shape type="rectangle"><boolean name="flip_normals" value="true"/>{ref}<shape type="cube">{ref}
      <shape type="sphere"><float name="radius" value="3"/><point name="center" x="1" y="2" z="3"/>{ref}
      <shape type="disk">{ref}
      <shape type="cylinder"><point name="p1" x="0" y="0" z="4"/><float name="radius" value="2"/>{ref}"""
    world = scene(tmp_path, body)
    assert [part.path.split("/")[1] for part in world.parts] == [
        "rectangle", "rectangle_2", "cube", "sphere", "disk", "cylinder"
    ]  # fmt: skip
    shapes = [trimesh.Trimesh(part.points, part.faces, process=False) for part in world.parts]
    assert np.allclose(shapes[0].face_normals, (0, 0, 1))
    assert np.allclose(shapes[1].face_normals, (0, 0, -1))
    assert shapes[0].area == pytest.approx(4)
    assert shapes[2].volume == pytest.approx(8)
    assert shapes[3].volume == pytest.approx(4 / 3 * np.pi * 27, rel=0.02)
    assert np.allclose(shapes[3].bounds, [[-2, -1, 0], [4, 5, 6]], atol=1e-4)
    assert shapes[4].area == pytest.approx(np.pi, rel=0.01)
    assert shapes[5].area == pytest.approx(2 * np.pi * 2 * 4, rel=0.01)
    outward = shapes[5].triangles_center * (1, 1, 0)
    assert (np.einsum("ij,ij->i", outward, shapes[5].face_normals) > 0).all()


def test_variables_includes_merges_and_instances(tmp_path: Path) -> None:
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "part.xml").write_text(
        '<scene version="3.0.0"><default name="size" value="9"/><shape type="cube" id="inner">'
        '<transform name="to_world"><scale value="$size"/></transform><ref id="m"/></shape></scene>'
    )
    body = """<default name="size" value="2"/><include filename="more/part.xml"/>
      <shape type="merge"><shape type="cube" id="a"><ref id="m"/></shape></shape>
      <shape type="shapegroup" id="g"><shape type="cube" id="b"><ref id="m"/></shape></shape>
      <shape type="instance"><ref id="g"/><transform name="to_world"><translate x="10"/></transform></shape>
      <shape type="instance"><ref id="g"/><transform name="to_world"><translate x="20"/></transform></shape>"""
    world = scene(tmp_path, body)
    assert [part.path for part in world.parts] == ["Shapes/inner", "Shapes/a", "Shapes/b", "Shapes/b_2"]
    assert volume(world.parts[0]) == pytest.approx(4**3)
    assert [part.points[:, 0].min() for part in world.parts] == [-2, -1, 9, 19]


def test_y_up_units_and_origin(tmp_path: Path) -> None:
    path = write_mitsuba(tmp_path)
    turned = read_mitsuba(path, up="y", unit_m=0.01, origin=(0, 0, -0.15))
    assert np.allclose(bounds(turned), ((-0.2, -0.06, 0), (0.2, 0, 0.3)), atol=1e-6)


@pytest.mark.parametrize(
    ("body", "part"),
    [
        ('<shape type="ply"><string name="filename" value="no.ply"/><ref id="m"/></shape>', "no.ply: no such file"),
        ('<shape type="ply"><ref id="m"/></shape>', "has no filename"),
        ('<shape type="cube"><ref id="nobody"/></shape>', "no <bsdf> has the id 'nobody'"),
        ('<shape type="hair"><ref id="m"/></shape>', "shape 'hair' is not read"),
        ('<shape type="cube"><transform name="to_world"><scale value="x"/></transform></shape>', "finite number"),
        ('<shape type="cube"><transform name="to_world"><shear/></transform></shape>', "<shear> is no transform"),
        ('<shape type="cube"><transform name="to_world"><scale value="$k"/></transform></shape>', "'$k'"),
        ('<include filename="no.xml"/>', "no.xml: no such file"),
        ('<include filename="scene.xml"/>', "include itself"),
        ('<bsdf type="diffuse"/>', "has no id"),
        ('<bsdf type="diffuse" id="m"/>', "given twice"),
        ('<bsdf type="itu-radio-material" id="x"/>', "no <string name='type'>"),
        (radio_with("scattering_coefficient", 1.5), "scattering_coefficient = 1.5; 0 to 1 is needed"),
        (radio_with("relative_permittivity", -2.0), "relative_permittivity = -2.0; at least 1 is needed"),
        (radio_with("thickness", -1.0), "thickness = -1.0; at least 0 m is needed"),
        (radio_with("alpha_r", 2.5), "alpha_r = 2.5; a whole number from 1 to"),
        (radio_with("lambda_", -0.5), "lambda_ = -0.5; 0 to 1 is needed"),
        ('<shape type="instance"/>', "no shapegroup"),
        ('<shape type="cube">', "not well-formed XML"),
        ("<shape type='merge'>" * 60_000 + "</shape>" * 60_000, "nested more than 100 deep"),
        ('<bsdf id="b" type="diffuse"><rgb name="reflectance" value="#zzzzzz"/></bsdf>', "finite number(s) are needed"),
        (
            "".join(
                f'<default name="v{k}" value="{"$v" + str(k - 1) if k else "x"}{"$v" + str(k - 1) if k else "x"}"/>'
                for k in range(60)
            ),
            "over 100,000 characters",
        ),
        (
            '<shape type="shapegroup" id="g"><shape type="instance"><ref id="g"/></shape></shape>'
            '<shape type="instance"><ref id="g"/></shape>',
            "an instance inside a shapegroup",
        ),
        ('<include filename="leaf.xml"/>' * 1_001, "more than 1000 files are included"),
    ],
)
def test_what_cannot_be_read_is_named_with_its_line(tmp_path: Path, body: str, part: str) -> None:
    (tmp_path / "leaf.xml").write_text("<scene/>")
    with pytest.raises(ValueError, match=r"scene\.xml:\d+: ") as caught:
        scene(tmp_path, body)
    assert part in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["a.xml", "a.xodr", "a.osm"])
def test_entities_do_not_multiply(tmp_path: Path, name: str) -> None:
    lines = "".join(f'<!ENTITY e{k} "{f"&e{k - 1};" * 10 if k else "x" * 100}">' for k in range(12))
    (tmp_path / name).write_text(f'<?xml version="1.0"?><!DOCTYPE scene [{lines}]><scene>&e11;</scene>')
    with pytest.raises(ValueError, match="amplification"):
        read_scene(tmp_path / name)


@pytest.mark.parametrize(("text", "part"), [("", "no element found"), ("<osm/>", "<scene>")])
def test_what_is_no_scene(tmp_path: Path, text: str, part: str) -> None:
    (tmp_path / "a.xml").write_text(text)
    with pytest.raises(ValueError, match=part):
        read_mitsuba(tmp_path / "a.xml")
    with pytest.raises(ValueError, match="cannot be read"):
        read_mitsuba(tmp_path / "b.xml")


@pytest.mark.parametrize("content", [b"", b"ply\nformat binary_little_endian 1.0\nelement vertex 9\n"])
def test_a_torn_mesh_file(tmp_path: Path, content: bytes) -> None:
    path = write_mitsuba(tmp_path)
    (tmp_path / "meshes" / "house.ply").write_bytes(content)
    with pytest.raises(ValueError, match=r"scene\.xml:\d+: .*house\.ply"):
        read_mitsuba(path)


def test_a_vertex_that_is_no_number(tmp_path: Path) -> None:
    path = write_mitsuba(tmp_path)
    points = HOUSE[0].copy()
    points[3, 1] = np.nan
    write_ply(tmp_path / "meshes" / "house.ply", points, HOUSE[1])
    with pytest.raises(ValueError, match="1 of 8 vertices are not finite"):
        read_mitsuba(path)
    write_ply(tmp_path / "meshes" / "house.ply", GROUND[0][:, [0, 0, 0]], GROUND[1])
    assert read_mitsuba(path).notes[0] == "2 triangles without area were left out"


@pytest.mark.skipif(importlib.util.find_spec("sionna") is None, reason="Sionna is not installed")
def test_munich_of_an_installed_sionna() -> None:
    """Triangles and bounds as Mitsuba 3.9 loads the scene."""
    spec = importlib.util.find_spec("sionna")
    assert spec is not None
    assert spec.submodule_search_locations is not None
    world = read_mitsuba(Path(spec.submodule_search_locations[0]) / "rt" / "scenes" / "munich" / "munich.xml")
    assert len(world.parts) == 2367
    assert sum(len(part.faces) for part in world.parts) == 38936
    assert np.allclose(bounds(world), ((-805.584, -688.601, 0), (669.883, 517.035, 98.57)), atol=1e-3)
    assert {material.radio.itu for material in world.materials.values() if material.radio} == {
        "itu_marble", "itu_metal", "itu_brick", "itu_wood", "itu_concrete"
    }  # fmt: skip
