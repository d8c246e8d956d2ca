"""Transfer and coefficient of every path, for one weather and all carriers: what materials make of the geometry."""

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
    rough: ScatteringPoints
    """The diffuse reflections among them."""


def spreading_factor(geometry: PathGeometry, met: Interactions) -> np.ndarray:
    """Return what the spreading of the wave leaves of each path [1/m], shape [P].

    1 / length by image theory; behind a wedge and behind a rough patch, what those say.
    """
    factor = 1.0 / geometry.length
    factor[met.wedges.path] = wedge_spreading(geometry, met.wedges)
    factor[met.rough.path] = rough_spreading(geometry, met.rough)
    return factor


def path_transfer(
    geometry: PathGeometry,
    met: Interactions,
    materials: tuple[Material, ...],
    carriers_hz: tuple[float, ...],
    model: DiffractionModel = "utd",
) -> np.ndarray:
    """Return the 2x2 polarimetric transfer of every path at every carrier, without carrier phase.

    Args:
        geometry: The paths.
        met: Their interactions.
        materials: Materials of the weather by id.
        carriers_hz: Carrier frequencies [Hz].
        model: How wedges diffract.

    Returns:
        Shape [P, C, 2, 2], complex128.

    Raises:
        InputError: If a material on a path has no permittivity at a carrier.
    """
    used = np.unique(np.concatenate([met.material_id[met.material_id >= 0], met.wedge_material.ravel()]))
    permittivity = permittivity_table(materials, carriers_hz, used)
    thickness, scattering = (
        np.array([getattr(material.radio, name) for material in materials] or [0.0])
        for name in ("thickness", "scattering")
    )
    row = np.where(met.material_id >= 0, met.material_id, 0)
    spreading = spreading_factor(geometry, met)
    out = np.zeros((len(spreading), len(carriers_hz), 2, 2), dtype=np.complex128)
    pattern = rough_matrices(geometry, met.rough, materials, met.material_id)
    for column, carrier in enumerate(carriers_hz):
        eta = permittivity[:, column] if len(materials) else np.ones(1, dtype=np.complex128)
        matrices = plane_matrices(geometry, eta[row], thickness[row], scattering[row], carrier)
        if len(met.wedges.path):
            faces = met.wedge_material
            matrices[met.wedges.path, met.wedges.step] = wedge_matrices(
                geometry, met.wedges, eta[faces], thickness[faces], scattering[faces], carrier, model
            )
        scale = None
        if len(met.rough.path):
            matrices[met.rough.path, met.rough.step] = pattern
            own = met.material_id[met.rough.path, met.rough.step]
            scale = rough_columns(geometry, met.rough, eta[own], thickness[own], carrier)
        out[:, column] = polarimetric_transfer(geometry, matrices, spreading, carrier, scale)
    return out
