"""Read texture coordinates and normals at the corners of triangles, of every interpolation, indexed or not."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from mmw.usd.prim_values import decimals

COMMON_NAMES = ("st", "st0", "UVMap")
"""Names of texture coordinates by custom, after the one that a material names; then any texCoord2f[]."""

_TEXTURE_TYPES = (Sdf.ValueTypeNames.TexCoord2fArray, Sdf.ValueTypeNames.TexCoord2hArray,
                  Sdf.ValueTypeNames.TexCoord2dArray)  # fmt: skip


@dataclass(frozen=True)
class Corners:
    """Primvars at the corners of a mesh's triangles, in the mesh's own space."""

    uv: np.ndarray | None
    """Texture coordinates, shape [M, 3, 2], float32; None where the mesh has none."""
    normals: np.ndarray | None
    """Normals, any length, shape [M, 3, 3], float32; None where the mesh is flat."""
    notes: tuple[str, ...] = ()
    """Values that could not be used, one line each."""


NO_CORNERS = Corners(None, None)
"""Of a built-in shape: flat, without texture coordinates."""


def read_corners(
    prim: Usd.Prim, name: str, faces: np.ndarray, polygon: np.ndarray, corners: np.ndarray, time: Usd.TimeCode
) -> Corners:
    """Return texture coordinates and normals of a mesh's triangles; what does not fit the mesh is noted and left out.

    Args:
        prim: The Mesh prim.
        name: Primvar of the texture coordinates that its material reads.
        faces: Points of each triangle, shape [M, 3].
        polygon: Polygon of each triangle, shape [M].
        corners: Row of `faceVertexIndices` of each corner, shape [M, 3].
        time: Time code of the values.
    """
    rows = {"uniform": polygon, "vertex": faces, "varying": faces, "faceVarying": corners}
    authored = prim.GetAuthoredPropertyNames()  # read once: a town has thousands of meshes
    notes: list[str] = []
    st = _texture_coordinates(prim, name, authored)
    uv = _at_corners(prim, st, 2, rows, authored, time, notes) if st else None
    normal = next((known for known in ("primvars:normals", "normals") if known in authored), "")
    normals = _at_corners(prim, normal, 3, rows, authored, time, notes) if normal else None
    return Corners(uv, normals, tuple(notes))


def _texture_coordinates(prim: Usd.Prim, name: str, authored: Sequence[str]) -> str:
    """Return the attribute that holds a mesh's texture coordinates, empty for none."""
    named = (f"primvars:{known}" for known in (name, *COMMON_NAMES))
    found = next((known for known in named if known in authored), "")
    primvars = (known for known in authored if known.startswith("primvars:"))
    return found or next((p for p in primvars if prim.GetAttribute(p).GetTypeName() in _TEXTURE_TYPES), "")


def _at_corners(
    prim: Usd.Prim,
    name: str,
    width: int,
    rows_of: Mapping[str, np.ndarray],
    authored: Sequence[str],
    time: Usd.TimeCode,
    notes: list[str],
) -> np.ndarray | None:
    """Return an attribute at the corners, shape [M, 3, width], float32; None where it has no value or does not fit."""
    attribute = prim.GetAttribute(name)
    values = attribute.Get(time)
    if values is None:
        return None
    values = np.asarray(values, dtype=np.float32)
    # A primvar is constant, `normals` are of the vertices, where nothing else is said.
    kind = attribute.GetMetadata("interpolation") or ("vertex" if name == "normals" else "constant")
    rows = rows_of.get(kind, _CONSTANT)
    try:
        if f"{name}:indices" in authored:
            rows = np.asarray(prim.GetAttribute(f"{name}:indices").Get(time), dtype=np.uint32).take(rows)
        found = values.take(rows, axis=0)[..., :width]
    except IndexError:
        where = f"{prim.GetPath()}: {name}"
        notes.append(f"{where} has {len(values)} values, too few for its interpolation {kind}; it is left out")
        return None
    if not math.isfinite(found.sum()):
        notes.append(f"{prim.GetPath()}: {name} has values that are not finite; they count as 0")
        found = np.nan_to_num(found, posinf=0.0, neginf=0.0)
    if rows.ndim == 1:
        found = np.broadcast_to(found[:, None], (len(rows_of["vertex"]), 3, width))
    return found


_CONSTANT = np.zeros(1, dtype=np.int32)


def place_corners(corners: Corners, matrix: np.ndarray) -> Corners:
    """Return texture coordinates and unit normals of a mesh in another space.

    Normals go by the inverse transpose, so they stay upright on their surface under any scale; the corners are turned
    over with the faces where the transform mirrors.

    Args:
        corners: Of the mesh in its own space.
        matrix: Its space to the other one, row vectors, shape [4, 4].
    """
    is_turned = is_mirror(matrix)
    uv, normals = corners.uv, corners.normals
    if uv is not None and is_turned:
        uv = uv[:, ::-1]
    if normals is not None:
        (a, b, c), (d, e, f), (g, h, i) = matrix[:3, :3].tolist()
        rows = (e * i - f * h, f * g - d * i, d * h - e * g), (h * c - i * b, i * a - g * c, g * b - h * a)
        cofactor = np.array([*rows, (b * f - c * e, c * d - a * f, a * e - b * d)])  # inverse transpose x determinant
        normals = (normals[:, ::-1] if is_turned else normals) @ (-cofactor if is_turned else cofactor)
        length = np.linalg.norm(normals, axis=2, keepdims=True)
        normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0.0).astype(np.float32)
    return Corners(uv, normals, corners.notes)


def is_mirror(matrix: np.ndarray) -> bool:
    """Return whether a transform [4, 4] turns left into right."""
    (a, b, c), (d, e, f), (g, h, i) = matrix[:3, :3].tolist()
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) < 0.0


def display_color(prim: Usd.Prim) -> tuple[float, float, float] | None:
    """Return the one color that `primvars:displayColor` gives a mesh, its own or an ancestor's; None for several."""
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("displayColor")
    if not primvar or not primvar.HasAuthoredValue():
        return None
    values = primvar.Get()
    if values is None or len(values) == 0 or (len(values) > 1 and primvar.GetInterpolation() != "constant"):
        return None
    return decimals(values[0])
