"""Small worlds in foreign formats, written by tests: a ground of 40 m x 30 m and a box house 10 x 8 x 6 m on it."""

from pathlib import Path

import numpy as np
import trimesh
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from tests.scenes import box_mesh

LOW, HIGH = (-20.0, -15.0, 0.0), (20.0, 15.0, 6.0)
"""Bounds of the world [m], z up."""

GROUND = (np.array([[-20.0, -15, 0], [20, -15, 0], [20, 15, 0], [-20, 15, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))
HOUSE = box_mesh((10, 8, 6), (12, 9, 3))
HOUSE_LOW, HOUSE_HIGH = (7.0, 5.0, 0.0), (17.0, 13.0, 6.0)


def write_ply(path: Path, points: np.ndarray, faces: np.ndarray) -> Path:
    """Write a binary PLY file, as Sionna's scenes have them."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(trimesh.Trimesh(points, faces, process=False).export(file_type="ply"))
    return path


NEW_DIALECT = """
  <bsdf type="itu-radio-material" id="walls">
    <string name="type" value="brick"/><float name="thickness" value="0.3"/>
  </bsdf>
  <bsdf type="itu-radio-material" id="floor"><string name="type" value="concrete"/></bsdf>"""

OLD_DIALECT = """
  <bsdf type="twosided" id="mat-itu_brick">
    <bsdf type="diffuse"><rgb value="0.4 0.1 0.05" name="reflectance"/></bsdf>
    <float name="thickness" value="0.3"/>
  </bsdf>
  <bsdf type="diffuse" id="itu_concrete"/>"""


def write_mitsuba(folder: Path, dialect: str = "new", extra: str = "") -> Path:
    """Write the world as a Sionna scene in one of its two dialects."""
    write_ply(folder / "meshes" / "ground.ply", *GROUND)
    write_ply(folder / "meshes" / "house.ply", *HOUSE)
    walls, floor = ("walls", "floor") if dialect == "new" else ("mat-itu_brick", "itu_concrete")
    path = folder / "scene.xml"
    path.write_text(
        f"""<scene version="2.1.0">{NEW_DIALECT if dialect == "new" else OLD_DIALECT}
  <shape type="ply" id="mesh-ground">
    <string name="filename" value="meshes/ground.ply"/><ref id="{floor}" name="bsdf"/>
  </shape>
  <shape type="ply" id="mesh-house-walls">
    <string name="filename" value="meshes/house.ply"/><ref id="{walls}" name="bsdf"/>
  </shape>{extra}
</scene>
"""
    )
    return path


def write_glb(path: Path) -> Path:
    """Write the world as binary glTF, y up: a node `block` holds `house`, `ground` stands by itself."""
    scene = trimesh.Scene()
    to_y_up = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    scene.graph.update("block", "world", matrix=to_y_up @ trimesh.transformations.translation_matrix((12, 9, 3)))
    for name, (points, faces), parent, material in (
        ("house", box_mesh((10, 8, 6)), "block", PBRMaterial(
            name="red brick", baseColorFactor=[102, 26, 13, 255], metallicFactor=0.0, roughnessFactor=0.9)),
        ("ground", GROUND, "world", PBRMaterial(
            name="tarmac", baseColorFactor=[26, 26, 26, 255], metallicFactor=0.0, roughnessFactor=0.8)),
    ):  # fmt: skip
        mesh = trimesh.Trimesh(points, faces, process=False, visual=TextureVisuals(material=material))
        place = np.eye(4) if parent == "block" else to_y_up
        scene.add_geometry(mesh, node_name=name, geom_name=f"{name}_mesh", parent_node_name=parent, transform=place)
    path.write_bytes(scene.export(file_type="glb"))
    return path


OBJ_MATERIALS = "newmtl brick\nKd 0.4 0.1 0.05\nnewmtl stone\nKd 0.5 0.5 0.5\nd 1.0\n"


def obj_text(scale: float = 1.0) -> str:
    """Return the world as OBJ text, z up, with two objects."""
    lines, count = ["mtllib world.mtl"], 0
    for name, material, (points, faces) in (("ground", "stone", GROUND), ("house", "brick", HOUSE)):
        lines += [f"o {name}", *(f"v {x * scale:g} {y * scale:g} {z * scale:g}" for x, y, z in points.tolist())]
        lines += [f"usemtl {material}", *("f " + " ".join(str(k + 1 + count) for k in face) for face in faces.tolist())]
        count += len(points)
    return "\n".join(lines) + "\n"


def write_obj(path: Path, scale: float = 1.0) -> Path:
    """Write the world as OBJ with its material file."""
    (path.parent / "world.mtl").write_text(OBJ_MATERIALS)
    path.write_text(obj_text(scale))
    return path
