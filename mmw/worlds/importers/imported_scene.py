"""Hold an imported scene: meshes with materials in the world frame, and lanes if the source has any."""

from dataclasses import dataclass, field

from mmw.core.georeference import Georeference
from mmw.physics.materials.material import RadioMaterial
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.usd.material_library import LIBRARY
from mmw.worlds.importers.geo.projection import Projection
from mmw.worlds.towns.mesh_part import MeshPart


@dataclass(frozen=True)
class ImportedMaterial:
    """A material of the source file that is not one of our library."""

    name: str
    """Name of the Material prim, an identifier."""
    source: str
    """Name in the source file, which the patterns of a material map are matched against too; empty for a mesh that has
    no material."""
    color: tuple[float, float, float] | None = None
    """Diffuse color, linear sRGB, 0 to 1; None where the source gives none."""
    opacity: float = 1.0
    """1 for opaque [-]."""
    metallic: float = 0.0
    """0 for a dielectric, 1 for a bare metal [-]."""
    roughness: float = 0.8
    """GGX roughness of the picture, 0 to 1 [-]."""
    radio: RadioMaterial | None = None
    """Radio material of the source; None if it has none."""
    unknown_row: str = ""
    """Radio row that the source names and that does not exist: an error, unless a material map gives another one."""
    base: str = ""
    """SimReady base token, a key of `mmw.physics.materials.material.LIDAR_REFLECTANCE_905NM`; empty for that of
    the radio row."""
    coating: str = "none"
    """SimReady coating token."""
    attributes: tuple[str, ...] = ("none",)
    """SimReady attribute tokens."""


def library_material(name: str) -> ImportedMaterial:
    """Return a material of the library as an imported one, to be changed."""
    spec = LIBRARY[name]
    fields = ("color", "opacity", "metallic", "roughness", "radio", "base", "coating", "attributes")
    return ImportedMaterial(name, name, **{field: getattr(spec, field) for field in fields})


@dataclass(frozen=True)
class ImportedScene:
    """An imported world: z up, meters, x east, y north."""

    parts: list[MeshPart]
    """Meshes; `path` is below the town's root, `material` names a library material or one of `materials`, `label` a
    semantic class (`unlabeled` where the source has none)."""
    materials: dict[str, ImportedMaterial] = field(default_factory=dict)
    """Name -> material, for parts whose material is not in the library."""
    lanes: LaneGraph | None = None
    """Lanes that vehicles can drive on; None if the source has none."""
    notes: tuple[str, ...] = ()
    """Omissions and assumptions, one line each."""
    components: frozenset[str] = frozenset()
    """Paths that the source itself declares as components; others follow from the hierarchy."""
    notice: str = ""
    """Text that has to be named with data of this source, such as its license; empty if that is not known."""
    projection: Projection | None = None
    """Map projection of the source, if it has one."""
    georeference: Georeference | None = None
    """Place on the earth; `mmw.worlds.importers.geo.placing` finds it by the projection."""
