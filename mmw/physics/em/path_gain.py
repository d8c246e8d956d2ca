"""Compute the transfer of every path for one weather and all carriers, from its geometry and the materials on it."""

from dataclasses import dataclass

import numpy as np

from mmw.physics.em.diffraction import DiffractionModel, WedgeHits, wedge_matrices, wedge_spreading
from mmw.physics.em.field import PathGeometry, plane_matrices, polarimetric_transfer
from mmw.physics.em.scattering import ScatteringPoints, rough_columns, rough_matrices, rough_spreading
from mmw.physics.materials.material import Material
from mmw.physics.materials.permittivity import permittivity_table


@dataclass(frozen=True)
class Interactions:
    """Interactions of a set of paths: P paths of at most D interactions."""

    material_id: np.ndarray
    """Material of each interaction, -1 where there is none, shape [P, D]."""
    wedges: WedgeHits
    """The diffractions among them."""
    wedge_material: np.ndarray
    """Material of both faces of each diffraction, shape [Q, 2]."""
    wedge_width: np.ndarray | None
    """Smaller extents of the two faces of each wedge [m], shape [Q, 2]; None if faces reflect as if infinite."""
    rough: ScatteringPoints
    """The diffuse reflections among them."""


def path_transfer(
    geometry: PathGeometry,
    interactions: Interactions,
    materials: tuple[Material, ...],
    carriers_hz: tuple[float, ...],
    model: DiffractionModel = "utd",
) -> np.ndarray:
    """Return the 2x2 polarimetric transfer of every path at every carrier, without carrier phase.

    Args:
        geometry: The paths.
        interactions: Their interactions.
        materials: Materials of the weather by id.
        carriers_hz: Carrier frequencies [Hz].
        model: How wedges diffract.

    Returns:
        Shape [P, C, 2, 2], complex128.

    Raises:
        InputError: If a material on a path has no permittivity at a carrier.
    """
    used = np.unique(
        np.concatenate([interactions.material_id[interactions.material_id >= 0], interactions.wedge_material.ravel()])
    )
    permittivity = permittivity_table(materials, carriers_hz, used)
    thickness, scattering = (
        np.array([getattr(material.radio, name) for material in materials] or [0.0])
        for name in ("thickness", "scattering")
    )
    row = np.where(interactions.material_id >= 0, interactions.material_id, 0)
    spreading = 1.0 / geometry.length
    has_wedges, has_rough = len(interactions.wedges.path) > 0, len(interactions.rough.path) > 0
    pattern = None
    if has_wedges:
        spreading[interactions.wedges.path] = wedge_spreading(geometry, interactions.wedges)
    if has_rough:
        spreading[interactions.rough.path] = rough_spreading(geometry, interactions.rough)
        pattern = rough_matrices(geometry, interactions.rough, materials, interactions.material_id)
    out = np.zeros((len(spreading), len(carriers_hz), 2, 2), dtype=np.complex128)
    for column, carrier in enumerate(carriers_hz):
        eta = permittivity[:, column] if len(materials) else np.ones(1, dtype=np.complex128)
        matrices = plane_matrices(geometry, eta[row], thickness[row], scattering[row], carrier)
        if has_wedges:
            faces = interactions.wedge_material
            matrices[interactions.wedges.path, interactions.wedges.step] = wedge_matrices(
                geometry,
                interactions.wedges,
                eta[faces],
                thickness[faces],
                scattering[faces],
                carrier,
                model,
                interactions.wedge_width,
            )
        scale = None
        if has_rough:
            matrices[interactions.rough.path, interactions.rough.step] = pattern
            own = interactions.material_id[interactions.rough.path, interactions.rough.step]
            scale = rough_columns(geometry, interactions.rough, eta[own], thickness[own], carrier)
        out[:, column] = polarimetric_transfer(geometry, matrices, spreading, carrier, scale)
    return out
