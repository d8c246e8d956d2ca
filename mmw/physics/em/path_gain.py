"""Compute the transfer of every path for one weather and all carriers, from its geometry and the materials on it."""

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from mmw.core.remember import remembered
from mmw.physics.em.diffraction import (
    DiffractionModel,
    WedgeHits,
    WedgeTerms,
    wedge_matrices,
    wedge_spreading,
    wedge_terms,
)
from mmw.physics.em.field import PathGeometry, plane_matrices, polarimetric_transfer
from mmw.physics.em.scattering import (
    ScatteringPoints,
    rough_amplitude,
    rough_columns,
    rough_matrices,
    rough_spreading,
)
from mmw.physics.em.surface_response import SurfaceResponse
from mmw.physics.materials.material import Material, RadioMaterial
from mmw.physics.materials.permittivity import permittivity_table

Hits = TypeVar("Hits", WedgeHits, ScatteringPoints)


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

    def take(self, rows: np.ndarray) -> "Interactions":
        """Return the interactions of some of the paths, in their order."""
        own, wedges = _of_paths(self.wedges, rows)
        return Interactions(
            material_id=self.material_id[rows],
            wedges=wedges,
            wedge_material=self.wedge_material[own],
            wedge_width=None if self.wedge_width is None else self.wedge_width[own],
            rough=_of_paths(self.rough, rows)[1],
        )


def _of_paths(hits: Hits, rows: np.ndarray) -> tuple[np.ndarray, Hits]:
    """Return the rows of hits of some paths, which grow, and these hits; `path` of them counts these paths."""
    own = np.flatnonzero(np.isin(hits.path, rows))
    taken = {name: getattr(hits, name)[own] for name in hits.__dataclass_fields__}
    return own, replace(hits, **taken | {"path": np.searchsorted(rows, hits.path[own])})


def wedge_terms_of(
    geometry: PathGeometry, interactions: Interactions, carriers_hz: tuple[float, ...], model: DiffractionModel = "utd"
) -> tuple[WedgeTerms, ...]:
    """Return the terms of all diffractions at every carrier, the same in all weathers; nothing without diffractions.

    Args:
        geometry: The paths.
        interactions: Their interactions.
        carriers_hz: Carrier frequencies [Hz].
        model: How wedges diffract.
    """
    if not len(interactions.wedges.path):
        return ()
    return wedge_terms(geometry, interactions.wedges, carriers_hz, model, interactions.wedge_width)


def path_transfer(
    geometry: PathGeometry,
    interactions: Interactions,
    materials: tuple[Material, ...],
    carriers_hz: tuple[float, ...],
    model: DiffractionModel = "utd",
    terms: tuple[WedgeTerms, ...] | None = None,
) -> np.ndarray:
    """Return the 2x2 polarimetric transfer of every path at every carrier, without carrier phase.

    Args:
        geometry: The paths.
        interactions: Their interactions.
        materials: Materials of the weather by id.
        carriers_hz: Carrier frequencies [Hz].
        model: How wedges diffract.
        terms: `wedge_terms_of` the paths, for several weathers; computed here when not given.

    Returns:
        Shape [P, C, 2, 2], complex128.

    Raises:
        InputError: If a material on a path has no permittivity at a carrier.
    """
    used = np.unique(
        np.concatenate([interactions.material_id[interactions.material_id >= 0], interactions.wedge_material.ravel()])
    )
    permittivity = permittivity_table(materials, carriers_hz, used)
    radios = _radios(materials)
    row = np.where(interactions.material_id >= 0, interactions.material_id, 0)
    spreading = 1.0 / geometry.length
    has_wedges, has_rough = len(interactions.wedges.path) > 0, len(interactions.rough.path) > 0
    if terms is None:
        terms = wedge_terms_of(geometry, interactions, carriers_hz, model)
    amplitude = own = cosine = np.zeros(0)
    if has_wedges:
        spreading[interactions.wedges.path] = wedge_spreading(geometry, interactions.wedges)
    if has_rough:
        path, factor = rough_spreading(geometry, interactions.rough)
        spreading[path] = factor
        at = interactions.rough.path, interactions.rough.step
        own, cosine = interactions.material_id[at], geometry.cosine[at]
        amplitude = rough_amplitude(geometry, interactions.rough, materials, own)
    out = np.zeros((len(spreading), len(carriers_hz), 2, 2), dtype=np.complex128)
    for column, carrier in enumerate(carriers_hz):
        response = SurfaceResponse(radios, permittivity[:, column], carrier)
        matrices = plane_matrices(geometry, row, response)
        if has_wedges:
            matrices[interactions.wedges.path, interactions.wedges.step] = wedge_matrices(
                geometry,
                interactions.wedges,
                terms[column],
                interactions.wedge_material,
                response,
                model,
            )
        scale = None
        if has_rough:
            share = response.diffuse_share(own, cosine)
            matrices[interactions.rough.path, interactions.rough.step] = rough_matrices(
                amplitude, share, materials, own
            )
            scale = rough_columns(geometry, interactions.rough, own, response)
        out[:, column] = polarimetric_transfer(geometry, matrices, spreading, carrier, scale)
    return out


@remembered(size=64)
def _radios(materials: tuple[Material, ...]) -> tuple[RadioMaterial, ...]:
    """Return the radio descriptions of materials, the same object for the same materials."""
    return tuple(material.radio for material in materials)
