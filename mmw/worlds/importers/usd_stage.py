"""Read any USD stage: its meshes, z up and in meters, with its materials, labels and lanes.

The geometry is copied and not referenced, because a reference cannot repair such a stage: it has one
root prim only, so that bindings to materials beside that prim are lost; nothing below an instance can be given a
material or a label; and left-handed meshes and mirrored transforms stay as they are.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from pxr import Kind, Usd, UsdGeom, UsdShade

from mmw.physics.materials.material import RadioMaterial
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.roads.lane_prims import has_lanes, read_lanes
from mmw.usd.georeference import read_georeference
from mmw.usd.materials import NONVISUAL, MaterialUse, read_material, resolve_material, unknown_row
from mmw.usd.meshes import FoundMesh, MeshReader, bound_materials, place, to_metres
from mmw.usd.notices import read_notices
from mmw.usd.open_stage import check_references, open_stage, reads_usd
from mmw.usd.prim_values import attribute_value, decimal
from mmw.worlds.importers.imported_scene import ImportedMaterial, ImportedScene
from mmw.worlds.importers.mesh_cleanup import MeshCollector, PrimNames, free_name, identifier


@reads_usd
def read_usd(path: str | Path, *, unit_m: float = 0.0, origin: Sequence[float] = (0.0, 0.0, 0.0)) -> ImportedScene:
    """Return the meshes, materials, labels, components and lanes of a stage, at its start time.

    Args:
        path: USD file.
        unit_m: One unit of the file [m]; the stage's own if zero.
        origin: Point of the world [m] that becomes (0, 0, 0).

    Raises:
        InputError: If the file cannot be read, a layer is missing, or a mesh is broken.
    """
    path = Path(path)
    stage = open_stage(path)
    check_references(stage, path)
    start = stage.GetStartTimeCode() if stage.HasAuthoredTimeCodeRange() else 0.0
    meshes, meters = MeshReader(stage, Usd.TimeCode(start)), to_metres(stage)
    stretch = unit_m / UsdGeom.GetStageMetersPerUnit(stage) if unit_m else 1.0
    meters[:3, :3] *= stretch
    reader = _Reader(stage, MeshCollector(np.asarray(origin, float)))
    found = [mesh for mesh in meshes.meshes() if meshes.is_visible(mesh.anchor)]
    reader.above = {str(prefix) for mesh in found for prefix in mesh.anchor.GetPath().GetParentPath().GetPrefixes()}
    for mesh in found:
        reader.add(mesh, meshes, meshes.to_world(mesh) @ meters, str(path))
    lanes = _lanes(stage, stretch, np.asarray(origin, float))
    notes = (*_notes(stage), *reader.notes(), *reader.parts.notes())
    notice = "; ".join(read_notices(stage))
    reference = read_georeference(stage)
    if reference is not None:
        latitude, longitude = reference.degrees([origin[:2]])[0].tolist()
        reference = replace(reference, latitude=latitude, longitude=longitude)
    components = frozenset(reader.components)
    return ImportedScene(reader.parts.parts, reader.materials, lanes, notes, components, notice, georeference=reference)


@dataclass
class _Reader:
    stage: Usd.Stage
    parts: MeshCollector
    names: PrimNames = field(default_factory=PrimNames)
    materials: dict[str, ImportedMaterial] = field(default_factory=dict)
    components: set[str] = field(default_factory=set)
    above: set[str] = field(default_factory=set)  # prims that have meshes below them
    textured: set[str] = field(default_factory=set)
    _name_of: dict[tuple[str, RadioMaterial | None], str] = field(default_factory=dict)

    def add(self, mesh: FoundMesh, meshes: MeshReader, matrix: np.ndarray, where: str) -> None:
        """Add one use of a mesh prim, one part for each of its materials."""
        triangles = meshes.triangles(mesh.prim)
        points, faces = place(triangles, matrix)
        materials, index = bound_materials(mesh.prim, triangles.polygon)
        label = meshes.label(mesh.prim)
        component_prim, anchor = meshes.component(mesh.anchor), mesh.anchor
        is_component = Kind.Registry.IsA(Usd.ModelAPI(component_prim).GetKind(), Kind.Tokens.component)
        is_folder = mesh.to_anchor is not None or len(materials) > 1 or str(anchor.GetPath()) in self.above
        parent = self.folder(anchor if is_folder else anchor.GetParent())
        for k, material in enumerate(materials):
            name = self.material_name(str(mesh.prim.GetPath()), label, material)
            own = name if len(materials) > 1 else mesh.prim.GetName()
            path = self.names.child(parent, own)
            if is_component:
                self.components.add(path if component_prim == anchor and not is_folder else self.folder(component_prim))
            self.parts.add(f"{where}: {mesh.prim.GetPath()}", path, points, faces[index == k], name, label)

    def folder(self, prim: Usd.Prim) -> str:
        """Return the path of a prim that holds others."""
        if prim.IsPseudoRoot():
            return ""
        return self.names.folder(self.folder(prim.GetParent()), prim.GetName())

    def material_name(self, mesh_path: str, label: str, prim: Usd.Prim | None) -> str:
        """Return the name of a mesh's material, which is added if it is new."""
        is_known = prim is None or not unknown_row(prim)  # a material map may describe it
        use = resolve_material(label, prim) if is_known else None
        if prim is None:
            self.materials.setdefault("no_material", ImportedMaterial("no_material", ""))
            return "no_material"
        path = str(prim.GetPath())
        known = read_material(self.stage, use or MaterialUse(prim.GetName(), path, RadioMaterial("constant")))
        radio = known.radio if use else None
        if (path, radio) not in self._name_of:
            name = free_name(identifier(prim.GetName()), self.materials)
            self._name_of[path, radio] = name
            self.materials[name] = ImportedMaterial(
                name,
                prim.GetName(),
                radio=radio,
                base="" if known.nonvisual_base == "none" else known.nonvisual_base,
                coating=str(attribute_value(prim, NONVISUAL + "coating", "none")),
                attributes=tuple(map(str, attribute_value(prim, NONVISUAL + "attributes", ("none",)))),
                **self.look(prim, known.color),
            )
        return self._name_of[path, radio]

    def look(self, prim: Usd.Prim, color: tuple[float, float, float]) -> dict:
        """Return the numbers of the surface shader, as fields of `ImportedMaterial`."""
        shader = UsdShade.Material(prim).ComputeSurfaceSource()[0]
        if not shader:
            return {}
        look: dict = {}
        for name in ("diffuseColor", "opacity", "metallic", "roughness"):
            port = shader.GetInput(name)
            value = port.Get() if port else None
            if port and port.HasConnectedSource():
                self.textured.add(prim.GetName())
            elif name == "diffuseColor" and value is not None:
                look["color"] = color
            elif value is not None:
                look[name] = decimal(value)
        return look

    def notes(self) -> list[str]:
        if not self.textured:
            return []
        return [f"textures are not kept, these materials have a plain color: {', '.join(sorted(self.textured))}"]


def _lanes(stage: Usd.Stage, stretch: float, origin: np.ndarray) -> LaneGraph | None:
    """Return the lanes of a stage that has some, z up and in meters; `stretch` corrects the stage's unit."""
    if not has_lanes(stage):
        return None
    lanes = read_lanes(stage, "/").lanes
    return LaneGraph({name: replace(lane, points=stretch * lane.points - origin) for name, lane in lanes.items()})


def _notes(stage: Usd.Stage) -> list[str]:
    """Return notes on the assumptions of an import, and on motion and variants, which are lost."""
    moving, notes = 0, []
    if not UsdGeom.StageHasAuthoredMetersPerUnit(stage):
        notes.append("the stage does not say its unit: USD's fallback, the centimeter, is assumed (--unit)")
    for prim in stage.Traverse():
        moving += prim.IsA(UsdGeom.Xformable) and UsdGeom.Xformable(prim).TransformMightBeTimeVarying()
        sets = prim.GetVariantSets()
        for name in sets.GetNames():
            selected = sets.GetVariantSelection(name)
            if len(sets.GetVariantSet(name).GetVariantNames()) > 1:
                notes.append(f"{prim.GetPath()}: of variant set {name} only {selected or 'none'!r} is kept")
    if moving:
        notes.append(f"{moving} prims move; they stay where they are at the start (to keep motion, use `stage:`)")
    return notes
