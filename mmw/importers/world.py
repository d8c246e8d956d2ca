"""What every importer returns: meshes with materials in our world frame, and lanes where the source has them."""

from dataclasses import dataclass, field

from mmw.town.lanes import LaneGraph
from mmw.town.parts import MeshPart


@dataclass(frozen=True)
class ForeignMaterial:
    """A material of the source file that is not one of our library."""

    name: str
    """Name of the Material prim, an identifier."""
    source: str
    """Name in the source file, which the patterns of a material map are matched against too."""
    color: tuple[float, float, float] = (0.5, 0.5, 0.5)
    """Diffuse colour, linear sRGB, 0 to 1."""
    opacity: float = 1.0
    metallic: float = 0.0
    roughness: float = 0.8
    itu: str = ""
    """Radio material that the source itself names, such as `itu_concrete`; empty if it names none."""
    thickness: float = 0.0
    """Thickness as a slab [m]; 0 for a half-space."""
    scattering: float = 0.0
    """Scattering coefficient S, 0 to 1."""
    xpd: float = 0.0
    """Cross-polarised share of the scattered power, 0 to 1."""


@dataclass(frozen=True)
class World:
    """An imported world: z up, metres, x east, y north."""

    parts: list[MeshPart]
    """Meshes; `path` is below the town's root, `material` names a library material or one of `materials`, `label` a
    semantic class (`unlabeled` where the source says nothing)."""
    materials: dict[str, ForeignMaterial] = field(default_factory=dict)
    """Name -> material, for parts whose material is not in the library."""
    lanes: LaneGraph | None = None
    """Lanes that vehicles can drive on; None if the source has none."""
    notes: tuple[str, ...] = ()
    """What was left out or assumed, one line each, for people."""
