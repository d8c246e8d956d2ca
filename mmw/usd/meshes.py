"""Read triangle meshes of any USD stage: n-gons, shapes, instances, point instancers, subsets, units, handedness."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from types import EllipsisType

import numpy as np
from pxr import Kind, Sdf, Usd, UsdGeom, UsdShade

from mmw.core.errors import InputError
from mmw.usd.builtin_shapes import SHAPES
from mmw.usd.prim_values import attribute_value
from mmw.usd.primvars import NO_CORNERS, Corners, is_mirror, read_corners
from mmw.usd.semantics import CARLA_TAG, TAXONOMY
from mmw.usd.triangulate import Polygons, Triangles, cut_meshes

SKIPPED_PURPOSES = (UsdGeom.Tokens.proxy, UsdGeom.Tokens.guide)
"""Purposes that are no geometry of the world: stand-ins and construction aids."""

MAX_USES = 200_000
"""Meshes that the point instancers of a stage may place; design value, a town has thousands."""

MAX_NUMBER_M = 1e12
"""Largest coordinate [m]: float32 overflows in products beyond it."""

_RADIO = "radio"
"""Purpose of a material binding that counts before the one for all purposes."""


@dataclass(frozen=True)
class FoundMesh:
    """One use of a mesh prim. A point instancer uses its prototypes' meshes many times."""

    prim: Usd.Prim
    """The Mesh prim, or a Cube, Sphere, ...; an instance proxy where it is inside an instance."""
    anchor: Usd.Prim
    """The prim itself, or the point instancer that places it."""
    to_anchor: np.ndarray | None
    """Mesh space to the anchor's space, row vectors, shape [4, 4]; None for the identity."""


@dataclass
class MeshReader:
    """Reads mesh prims; a prototype is cut into triangles once, however often it is used."""

    stage: Usd.Stage
    time: Usd.TimeCode
    """Time at which static parts are read."""
    uses: int = 0
    """Meshes that point instancers place, as far as they were yielded."""
    keeps_flat: bool = False
    """Keep triangles without area, for checks that count them."""
    _triangles: dict[str, Triangles] = field(default_factory=dict)
    _corners: dict[tuple[int, str], Corners] = field(default_factory=dict)
    _labels: dict[Sdf.Path, str] = field(default_factory=dict)
    _visible: dict[Sdf.Path, bool] = field(default_factory=dict)
    _components: dict[Sdf.Path, Usd.Prim | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.xforms = UsdGeom.XformCache(self.time)

    def meshes(self) -> Iterator[FoundMesh]:
        """Yield every mesh and shape that is visible and no proxy or guide, in the stage's order."""
        prims = iter(Usd.PrimRange(self.stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()))
        for prim in prims:
            if not self.is_visible(prim) and is_hidden(prim):
                prims.PruneChildren()
            elif prim.IsA(UsdGeom.PointInstancer):
                prims.PruneChildren()
                yield from self._instanced(UsdGeom.PointInstancer(prim))
            elif _is_geometry(prim):
                yield FoundMesh(prim, prim, None)

    def _instanced(self, instancer: UsdGeom.PointInstancer) -> Iterator[FoundMesh]:
        """Yield the meshes that a point instancer places."""
        prim = instancer.GetPrim()
        roots = [self.stage.GetPrimAtPath(path) for path in instancer.GetPrototypesRel().GetForwardedTargets()]
        index = _integers(instancer.GetProtoIndicesAttr(), self.time).tolist()
        if not index or not all(roots):
            return
        if not 0 <= min(index) <= max(index) < len(roots):
            raise InputError(
                f"{prim.GetPath()}: protoIndices from {min(index)} to {max(index)}, of {len(roots)} prototypes; "
                "repair the instancer"
            )
        places = instancer.ComputeInstanceTransformsAtTime(
            self.time, self.time, UsdGeom.PointInstancer.IncludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
        )
        mask = instancer.ComputeMaskAtTime(self.time) or [True] * len(index)
        if not len(index) == len(places) == len(mask):
            raise InputError(
                f"{prim.GetPath()}: {len(index)} protoIndices, but not as many positions, orientations and scales; "
                "repair the instancer"
            )
        meshes = [self._prototype_meshes(root) for root in roots]
        self.uses += len(index) * max(map(len, meshes))
        if self.uses > MAX_USES:
            raise InputError(
                f"{prim.GetPath()}: places over {MAX_USES:,} meshes; each is traced; place fewer, or merge them"
            )
        for k, place, is_shown in zip(index, places, mask, strict=True):
            if is_shown:
                for mesh, to_root in meshes[k]:
                    yield FoundMesh(mesh, prim, to_root @ np.array(place))

    def _prototype_meshes(self, root: Usd.Prim) -> list[tuple[Usd.Prim, np.ndarray]]:
        found = []
        prims = iter(Usd.PrimRange(root, Usd.TraverseInstanceProxies()))
        for prim in prims:
            if is_hidden(prim):
                prims.PruneChildren()
            elif prim.IsA(UsdGeom.PointInstancer):
                raise InputError(
                    f"{prim.GetPath()}: a point instancer inside a prototype of another one; one level of point "
                    "instancing is read; turn the inner one into references"
                )
            elif _is_geometry(prim):
                found.append((prim, self.relative(prim, root)))
        return found

    def relative(self, prim: Usd.Prim, ancestor: Usd.Prim) -> np.ndarray:
        """Return prim space to ancestor space, row vectors, [4, 4]: the same bits for equal parts of equal objects."""
        if prim == ancestor:
            return np.eye(4)
        matrix, is_reset = self.xforms.ComputeRelativeTransform(prim, ancestor)
        if is_reset:
            matrix = matrix * self.xforms.GetLocalToWorldTransform(ancestor).GetInverse()
        return np.array(matrix)

    def to_world(self, mesh: FoundMesh) -> np.ndarray:
        """Return mesh space to the stage's world, row vectors, stage units, shape [4, 4]."""
        world = np.array(self.xforms.GetLocalToWorldTransform(mesh.anchor))
        return world if mesh.to_anchor is None else mesh.to_anchor @ world

    def label(self, prim: Usd.Prim) -> str:
        """Return what `semantic_label` does; ancestors are read once for all below them."""
        return semantic_label(prim, self._labels)

    def is_visible(self, prim: Usd.Prim) -> bool:
        """Return whether neither a prim nor an ancestor is invisible at the reader's time; ancestors are read once."""
        path = prim.GetPath()
        if path not in self._visible:
            attribute = prim.GetAttribute(UsdGeom.Tokens.visibility) if prim.IsA(UsdGeom.Imageable) else None
            is_shown = not attribute or attribute.Get(self.time) != UsdGeom.Tokens.invisible
            parent = prim.GetParent()
            self._visible[path] = is_shown and (not parent or self.is_visible(parent))
        return self._visible[path]

    def component(self, prim: Usd.Prim) -> Usd.Prim:
        """Return the nearest component that holds a prim, or the prim itself; ancestors are read once."""
        return self._component(prim) or prim

    def _component(self, prim: Usd.Prim) -> Usd.Prim | None:
        if not prim or prim.IsPseudoRoot():
            return None
        path = prim.GetPath()
        if path not in self._components:
            is_component = Kind.Registry.IsA(Usd.ModelAPI(prim).GetKind(), Kind.Tokens.component)
            self._components[path] = prim if is_component else self._component(prim.GetParent())
        return self._components[path]

    def triangles(self, prim: Usd.Prim) -> Triangles:
        """Return a mesh prim as triangles.

        Raises:
            InputError: As `read`.
        """
        self.read([prim])
        return self._triangles[_source(prim)]

    def read(self, prims: Iterable[Usd.Prim]) -> None:
        """Cut many mesh prims into triangles at once, so that `triangles` has them at hand.

        Raises:
            InputError: If the points of one move against each other, or its topology is broken.
        """
        sources = {_source(prim): prim for prim in prims}
        new = {key: prim for key, prim in sources.items() if key not in self._triangles}
        meshes = {key: self._polygons(prim) for key, prim in new.items() if prim.IsA(UsdGeom.Mesh)}
        self._triangles.update((key, _read_shape(prim)) for key, prim in new.items() if key not in meshes)
        self._triangles.update(zip(meshes, cut_meshes([*meshes.values()], keeps_flat=self.keeps_flat), strict=True))

    def corners(self, prim: Usd.Prim, cut: Triangles, name: str) -> Corners:
        """Return what lies at the corners of a mesh prim cut into triangles, with the texture coordinates `name`."""
        key = id(cut), name  # `_triangles` holds it, so its id stays unique
        if key not in self._corners:
            is_mesh = prim.IsA(UsdGeom.Mesh)
            read = read_corners(prim, name, cut.faces, cut.polygon, cut.corners, self.time) if is_mesh else NO_CORNERS
            self._corners[key] = read
        return self._corners[key]

    def _polygons(self, prim: Usd.Prim) -> Polygons:
        names = UsdGeom.Tokens
        at, corner = prim.GetAttribute(names.points), prim.GetAttribute(names.faceVertexIndices)
        if at.ValueMightBeTimeVarying() or corner.ValueMightBeTimeVarying():
            raise InputError(
                f"{prim.GetPath()}: its points change over time; meshes are traced as rigid bodies; "
                "remove the point animation or bake the mesh at one time"
            )
        return Polygons(
            str(prim.GetPath()),
            _numbers(at, self.time, 3).reshape(-1, 3),
            _integers(prim.GetAttribute(names.faceVertexCounts), self.time),
            _integers(corner, self.time),
            _integers(prim.GetAttribute(names.holeIndices)),
            prim.GetAttribute(names.orientation).Get() == names.leftHanded,
        )


def _source(prim: Usd.Prim) -> str:
    """Return the path of the prim that a mesh prim is, or is an instance of."""
    return str((prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim).GetPath())


def _integers(attribute: Usd.Attribute, time: Usd.TimeCode | None = None) -> np.ndarray:
    return _numbers(attribute, Usd.TimeCode.Default() if time is None else time).astype(np.int64)


def _numbers(attribute: Usd.Attribute, time: Usd.TimeCode, width: int = 1) -> np.ndarray:
    """Return the numbers of an attribute, none where it has no value; a file may declare it of another type."""
    value = attribute.Get(time)
    if value is None:
        return np.zeros(0)
    try:
        found = np.asarray(value)
    except (TypeError, ValueError):
        found = np.asarray("")
    if found.dtype.kind not in "iuf" or found.shape[1:] != (width,) * (width > 1) or found.ndim == 0:
        raise InputError(
            f"{attribute.GetPath()}: is of type {attribute.GetTypeName()}; numbers are needed; repair the mesh"
        )
    return found


def _is_geometry(prim: Usd.Prim) -> bool:
    if not (prim.IsA(UsdGeom.Mesh) or prim.GetTypeName() in SHAPES):
        return False
    return UsdGeom.Imageable(prim).ComputePurpose() not in SKIPPED_PURPOSES


def _read_shape(prim: Usd.Prim) -> Triangles:
    points, faces = SHAPES[prim.GetTypeName()](prim)
    corners = np.arange(faces.size, dtype=np.int32).reshape(-1, 3)
    return Triangles(points, faces, np.arange(len(faces), dtype=np.int32), corners)


def is_hidden(prim: Usd.Prim) -> bool:
    """Return whether a prim and all below it are invisible at all times."""
    if not prim.IsA(UsdGeom.Imageable):
        return False
    visibility = prim.GetAttribute(UsdGeom.Tokens.visibility)
    return visibility.Get() == UsdGeom.Tokens.invisible and not visibility.ValueMightBeTimeVarying()


def to_metres(stage: Usd.Stage) -> np.ndarray:
    """Return the stage's world to ours (z up, meters), row vectors, shape [4, 4].

    Raises:
        InputError: If the stage's up axis is neither Y nor Z, or its unit is no length.
    """
    up = UsdGeom.GetStageUpAxis(stage)
    if up == UsdGeom.Tokens.z:
        turn = np.eye(3)
    elif up == UsdGeom.Tokens.y:
        turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # (x, y, z) -> (x, -z, y)
    else:
        raise InputError(f"{stage.GetRootLayer().identifier}: upAxis = {up}; Y and Z are read; turn the stage")
    unit = UsdGeom.GetStageMetersPerUnit(stage)
    if not 1e-9 <= unit <= 1e9:
        raise InputError(
            f"{stage.GetRootLayer().identifier}: metersPerUnit = {unit:g}; 1e-9 to 1e9 is needed; set it, 1 for meters"
        )
    matrix = np.eye(4)
    matrix[:3, :3] = turn * unit
    return matrix


def check_placed(where: object, points: np.ndarray) -> None:
    """Raise InputError for a mesh with a point [N, 3] that is not finite or beyond `MAX_NUMBER_M` once it is placed."""
    if len(points) and not np.abs(points).max() <= MAX_NUMBER_M:  # NaN too
        raise InputError(
            f"{where}: its transforms place a point at no number, or beyond {MAX_NUMBER_M:g} m; correct them, or the "
            "unit of the stage"
        )


def place(triangles: Triangles, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points and faces of a mesh in another space; a mirrored transform turns the faces over, as it must."""
    points = triangles.points @ matrix[:3, :3] + matrix[3, :3]
    return points, triangles.faces[:, ::-1] if is_mirror(matrix) else triangles.faces


def bound_materials(
    prim: Usd.Prim, polygon: np.ndarray, bound: Usd.Prim | EllipsisType | None = ...
) -> tuple[list[Usd.Prim | None], np.ndarray]:
    """Return the material prims of a mesh (None for no material) and the index of that of each triangle, shape [M].

    The binding of purpose `radio` counts where there is one, else the one for all purposes.

    Args:
        prim: The Mesh prim.
        polygon: Polygon of each triangle, shape [M].
        bound: Result of `materials_of` for the prim, if it is known.
    """
    materials: list[Usd.Prim | None] = materials_of([prim]) if bound is ... else [bound]
    index = np.zeros(len(polygon), dtype=np.int32)
    subsets = UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets()
    if not subsets:
        return materials, index
    for subset in subsets:
        if subset.GetElementTypeAttr().Get() == UsdGeom.Tokens.face:
            inside = np.isin(polygon, _integers(subset.GetIndicesAttr()))
            index[inside] = len(materials)
            materials += materials_of([subset.GetPrim()])
    used, index = np.unique(index, return_inverse=True)
    return [materials[k] for k in used], index.astype(np.int32)


def materials_of(prims: Sequence[Usd.Prim]) -> list[Usd.Prim | None]:
    """Return the material that is bound to each prim as a whole, None for none; faster than one after the other."""
    found = UsdShade.MaterialBindingAPI.ComputeBoundMaterials(list(prims), _RADIO)[0]
    return [material.GetPrim() if material else None for material in found]


def semantic_label(prim: Usd.Prim, known: dict[Sdf.Path, str] | None = None) -> str:
    """Return the nearest known semantic class of a prim and its ancestors, `unlabeled` where there is none.

    Args:
        prim: The prim.
        known: Remembers the answers, for many prims with the same ancestors.
    """
    known = {} if known is None else known
    path = prim.GetPath()
    if path not in known:
        parent = prim.GetParent()
        known[path] = _own_label(prim) or (semantic_label(parent, known) if parent else "unlabeled")
    return known[path]


def _own_label(prim: Usd.Prim) -> str:
    """Return the first known semantic class that a prim itself has, empty for none."""
    labels = attribute_value(prim, _LABELS) or ()
    return next((str(label) for label in labels if label in CARLA_TAG), "")


_LABELS = f"semantics:labels:{TAXONOMY}"
