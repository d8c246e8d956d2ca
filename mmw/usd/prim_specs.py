"""Write prims spec by spec: much faster than through a stage, and relative asset paths stay as they are."""

from typing import Any

import numpy as np
from pxr import Gf, Sdf, Vt

from mmw.core.errors import InputError
from mmw.usd.semantics import CARLA_TAG, TAXONOMY


def new_prim(layer: Sdf.Layer, path: Sdf.Path, type_name: str, kind: str = "") -> Sdf.PrimSpec:
    """Return a defined prim; prims above it that do not exist yet are made without a type."""
    spec = Sdf.CreatePrimInLayer(layer, path)
    spec.specifier, spec.typeName = Sdf.SpecifierDef, type_name
    if kind:
        spec.kind = kind
    return spec


def set_value(spec: Sdf.PrimSpec, name: str, type_name: Sdf.ValueTypeName, value: Any, uniform: bool = False) -> None:
    """Give a prim an attribute with a value; all but `mmw:*` belong to a USD schema."""
    variability = Sdf.VariabilityUniform if uniform else Sdf.VariabilityVarying
    Sdf.AttributeSpec(spec, name, type_name, variability, name.startswith("mmw:")).default = value


def set_pose(spec: Sdf.PrimSpec, pose: np.ndarray) -> None:
    """Put a prim at a pose (x, y, z, qx, qy, qz, qw) relative to its parent, shape [7], of a unit quaternion.

    Both are float64: USD takes the arc cosine of w, which in float32 is off by up to 3e-4 rad for small turns.
    """
    x, y, z, qx, qy, qz, qw = pose.tolist()
    set_value(spec, "xformOp:translate", Sdf.ValueTypeNames.Double3, Gf.Vec3d(x, y, z))
    set_value(spec, "xformOp:orient", Sdf.ValueTypeNames.Quatd, Gf.Quatd(qw, qx, qy, qz))
    set_op_order(spec, "xformOp:translate", "xformOp:orient")


def set_op_order(spec: Sdf.PrimSpec, *names: str) -> None:
    """Write which transforms a prim has, the outermost first."""
    set_value(spec, "xformOpOrder", Sdf.ValueTypeNames.TokenArray, names, uniform=True)


def apply_api(spec: Sdf.PrimSpec, schema_name: str) -> None:
    """Apply an API schema to a prim."""
    applied = spec.GetInfo("apiSchemas").prependedItems if spec.HasInfo("apiSchemas") else []
    spec.SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=[*applied, schema_name]))


def set_label(spec: Sdf.PrimSpec, label: str) -> None:
    """Write the semantic class of a prim and what is below it.

    Raises:
        InputError: If the class is unknown.
    """
    if label not in CARLA_TAG:
        raise InputError(f"{spec.path}: label {label!r}; labels are: {', '.join(CARLA_TAG)}; use one of them")
    apply_api(spec, f"SemanticsLabelsAPI:{TAXONOMY}")
    set_value(spec, f"semantics:labels:{TAXONOMY}", Sdf.ValueTypeNames.TokenArray, Vt.TokenArray([label]))


def new_mesh(
    layer: Sdf.Layer, path: Sdf.Path, points: np.ndarray, faces: np.ndarray, material: Sdf.Path
) -> Sdf.PrimSpec:
    """Return a Mesh prim of triangles that is bound to a material.

    Args:
        layer: Layer to write to.
        path: Path of the prim.
        points: Vertices, shape [N, 3].
        faces: Triangles, counter-clockwise seen from the front, shape [M, 3].
        material: Path of the Material prim.
    """
    points = np.ascontiguousarray(points, np.float32)
    faces = np.ascontiguousarray(faces, np.int32)
    spec, types = new_prim(layer, path, "Mesh"), Sdf.ValueTypeNames
    extent = np.stack([points.min(axis=0), points.max(axis=0)])
    apply_api(spec, "MaterialBindingAPI")
    set_value(spec, "extent", types.Float3Array, Vt.Vec3fArray.FromNumpy(extent))
    set_value(spec, "faceVertexCounts", types.IntArray, Vt.IntArray.FromNumpy(np.full(len(faces), 3, np.int32)))
    set_value(spec, "faceVertexIndices", types.IntArray, Vt.IntArray.FromNumpy(faces.ravel()))
    set_value(spec, "points", types.Point3fArray, Vt.Vec3fArray.FromNumpy(points))
    set_value(spec, "subdivisionScheme", types.Token, "none", uniform=True)
    Sdf.RelationshipSpec(spec, "material:binding", custom=False).targetPathList.explicitItems = [material]
    return spec


def set_texture_coordinates(mesh: Sdf.PrimSpec, st: np.ndarray, index: np.ndarray | None) -> None:
    """Write the primvar `st` of a mesh, shape [K, 2], with an index for each corner of each face or one a vertex."""
    array = Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(st, np.float32))
    set_value(mesh, "primvars:st", Sdf.ValueTypeNames.TexCoord2fArray, array)
    attribute = mesh.attributes["primvars:st"]
    attribute.SetInfo("interpolation", "vertex" if index is None else "faceVarying")
    if index is not None:
        indices = Vt.IntArray.FromNumpy(np.ascontiguousarray(index, np.int32))
        set_value(mesh, "primvars:st:indices", Sdf.ValueTypeNames.IntArray, indices)


def set_normals(mesh: Sdf.PrimSpec, normals: np.ndarray) -> None:
    """Write the normals of a mesh: one a vertex, shape [N, 3], or one a corner of its triangles, shape [M, 3, 3]."""
    array = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(normals.reshape(-1, 3), np.float32))
    set_value(mesh, "normals", Sdf.ValueTypeNames.Normal3fArray, array)
    mesh.attributes["normals"].SetInfo("interpolation", "vertex" if normals.ndim == 2 else "faceVarying")
