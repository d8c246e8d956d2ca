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
from mmw.physics.materials.material import Material
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
    ids = interactions.material_id
    is_used = np.bincount(ids.ravel() + 1, minlength=len(materials) + 1)[1:]
    if len(interactions.wedge_material):
        is_used += np.bincount(interactions.wedge_material.ravel(), minlength=len(materials))
    together, by_carrier = _responses(materials, carriers_hz, tuple(np.flatnonzero(is_used).tolist()))
    row = np.maximum(ids, 0) + len(materials) * np.arange(len(carriers_hz))[:, None, None]
    spreading = 1.0 / geometry.length
    has_wedges, has_rough = len(interactions.wedges.path) > 0, len(interactions.rough.path) > 0
    matrices = plane_matrices(geometry, row, together)
    if has_wedges:
        hits = interactions.wedges
        if terms is None:
            terms = wedge_terms_of(geometry, interactions, carriers_hz, model)
        spreading[hits.path] = wedge_spreading(geometry, hits)
        for own, term, response in zip(matrices, terms, by_carrier, strict=True):
            own[hits.path, hits.step] = wedge_matrices(
                geometry, hits, term, interactions.wedge_material, response, model
            )
    columns = []
    if has_rough:
        hits = interactions.rough
        path, factor = rough_spreading(geometry, hits)
        spreading[path] = factor
        material, cosine = ids[hits.path, hits.step], geometry.cosine[hits.path, hits.step]
        amplitude = rough_amplitude(geometry, hits, materials, material)
        for own, response in zip(matrices, by_carrier, strict=True):
            share = response.diffuse_share(material, cosine)
            own[hits.path, hits.step] = rough_matrices(amplitude, share, materials, material)
            columns.append(rough_columns(geometry, hits, material, response))

    def attenuate(step: int, field: np.ndarray) -> np.ndarray:
        return np.stack([column(step, own) for column, own in zip(columns, field, strict=True)])

    more = (attenuate,) if has_rough else ()
    transfer = polarimetric_transfer(geometry, matrices, spreading, np.array(carriers_hz), *more)
    return np.ascontiguousarray(transfer.swapaxes(0, 1))


@remembered(size=256)
def _responses(
    materials: tuple[Material, ...], carriers_hz: tuple[float, ...], used: tuple[int, ...]
) -> tuple[SurfaceResponse, tuple[SurfaceResponse, ...]]:
    """Return the response of all materials at all carriers, material m at carrier c as m + c M, and those at each.

    Raises:
        InputError: If a used material has no permittivity at a carrier.
    """
    permittivity = permittivity_table(materials, carriers_hz, used)
    radios = tuple(material.radio for material in materials)
    by_carrier = tuple(SurfaceResponse(radios, permittivity[:, c], f) for c, f in enumerate(carriers_hz))
    carriers = np.repeat(np.array(carriers_hz), len(radios))
    return SurfaceResponse(radios * len(carriers_hz), permittivity.T.ravel(), carriers), by_carrier
