"""Compute the transfer of every path for one weather and all carriers, from its geometry and the materials on it."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import warp as wp

from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.host_kernels import HOST, as_pairs
from mmw.core.remember import remembered
from mmw.kernels.channel.plane_response import PlaneMaterials
from mmw.physics.em.diffraction import (
    DiffractionModel,
    WedgeHits,
    WedgeTerms,
    wedge_matrices,
    wedge_spreading,
    wedge_terms,
)
from mmw.physics.em.field import GivenMatrices, PathGeometry, polarimetric_transfer
from mmw.physics.em.interaction import SPECULAR, TRANSMISSION
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
    weight: np.ndarray | None = None,
    fields: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the 2x2 polarimetric transfer of every path at every carrier, without carrier phase, and coefficients.

    Args:
        geometry: The paths.
        interactions: Their interactions.
        materials: Materials of the weather by id.
        carriers_hz: Carrier frequencies [Hz].
        model: How wedges diffract.
        terms: `wedge_terms_of` the paths, for several weathers; computed here when not given.
        weight: Further factor of each path at each carrier, shape [P, C]; None for 1.
        fields: Far fields (theta, phi) of the antennas of transmitter and receiver, shape [P, 2, 2]; None for none.

    Returns:
        Transfer, shape [P, C, 2, 2], and coefficients between the antennas, shape [P, C], or [0, C] without fields;
        complex128.

    Raises:
        InputError: If a material on a path has no permittivity at a carrier.
    """
    ids = interactions.material_id
    is_used = np.bincount(ids.ravel() + 1, minlength=len(materials) + 1)[1:]
    if len(interactions.wedge_material):
        is_used += np.bincount(interactions.wedge_material.ravel(), minlength=len(materials))
    used = is_used.nonzero()[0].tolist()
    table = material_table(materials, carriers_hz, used)
    spreading = 1.0 / geometry.length
    has_wedges, has_rough = len(interactions.wedges.path) > 0, len(interactions.rough.path) > 0
    given = None
    if has_wedges or has_rough or not table.layered.isdisjoint(used):
        shape = geometry.interaction.shape
        matrix = np.zeros((len(ids), len(carriers_hz), shape[1], 2, 2), dtype=np.complex128)
        given = GivenMatrices(np.zeros(shape, dtype=bool), matrix)
        _add_layered(given, geometry, ids, table.by_carrier)
    if has_wedges:
        assert given is not None
        hits = interactions.wedges
        if terms is None:
            terms = wedge_terms_of(geometry, interactions, carriers_hz, model)
        spreading[hits.path] = wedge_spreading(geometry, hits)
        given.is_given[hits.path, hits.step] = True
        for carrier, (term, response) in enumerate(zip(terms, table.by_carrier, strict=True)):
            given.matrix[hits.path, carrier, hits.step] = wedge_matrices(
                geometry, hits, term, interactions.wedge_material, response, model
            )
    columns = []
    if has_rough:
        assert given is not None
        hits = interactions.rough
        path, factor = rough_spreading(geometry, hits)
        spreading[path] = factor
        material, cosine = ids[hits.path, hits.step], geometry.cosine[hits.path, hits.step]
        amplitude = rough_amplitude(geometry, hits, materials, material)
        given.is_given[hits.path, hits.step] = True
        for carrier, response in enumerate(table.by_carrier):
            share = response.diffuse_share(material, cosine)
            given.matrix[hits.path, carrier, hits.step] = rough_matrices(amplitude, share, materials, material)
        columns = [rough_columns(geometry, hits, material, response) for response in table.by_carrier]

    factor = table.aperture * spreading[:, None]
    if weight is not None:
        factor = factor * weight
    return polarimetric_transfer(geometry, ids, table.planes, factor, given, columns, fields)


def _add_layered(
    given: GivenMatrices, geometry: PathGeometry, material_id: np.ndarray, responses: Sequence[SurfaceResponse]
) -> None:
    """Add the matrices of reflections at, and passages through, materials that have layers."""
    kind = geometry.interaction
    is_own = responses[0].has_layers[material_id] & (material_id >= 0)
    for code in (SPECULAR, TRANSMISSION):
        path, step = np.nonzero(is_own & (kind == code))
        material, cosine = material_id[path, step], geometry.cosine[path, step]
        given.is_given[path, step] = True
        for carrier, response in enumerate(responses):
            if code == SPECULAR:
                share = response.specular_share(material, cosine)
                pair = [share * part for part in response.reflection(material, cosine)]
            else:
                pair = response.transmission(material, cosine)
            for row, values in enumerate(pair):
                given.matrix[path, carrier, step, row, row] = values


@dataclass(frozen=True)
class MaterialTable:
    """Materials of a weather at C carriers."""

    planes: PlaneMaterials
    """All of them as kernels of the host take them; without layers."""
    by_carrier: tuple[SurfaceResponse, ...]
    """Their responses at each carrier."""
    ids: frozenset[int]
    """Those that have data; the others are NaN."""
    layered: frozenset[int]
    """Those of them that have layers."""
    aperture: np.ndarray
    """lambda / (4 pi) at each carrier [m], shape [C]."""


def material_table(
    materials: tuple[Material, ...], carriers_hz: tuple[float, ...], used: Collection[int]
) -> MaterialTable:
    """Return the materials of a weather at all carriers, with data of those that were asked for so far.

    Paths of other frames meet other materials: a table for each combination would be made anew in every other step.

    Args:
        materials: Materials by id.
        carriers_hz: Carrier frequencies [Hz].
        used: Ids that some path has; others need no data.

    Raises:
        InputError: If a used material has no permittivity at a carrier.
    """
    made = _made_table(materials, carriers_hz)
    table = made[0] if made else None
    if table is None or not table.ids.issuperset(used):
        ids = frozenset(used) if table is None else table.ids.union(used)
        made[:] = [table := _material_table(materials, carriers_hz, ids)]
    return table  # not `made[0]`, which another thread may have replaced


@remembered(size=256)
def _made_table(materials: tuple[Material, ...], carriers_hz: tuple[float, ...]) -> list[MaterialTable]:
    """Return the table that `material_table` made last, which it replaces; none at first."""
    return []


def _material_table(
    materials: tuple[Material, ...], carriers_hz: tuple[float, ...], ids: frozenset[int]
) -> MaterialTable:
    """Return the table with data of some materials."""
    permittivity = permittivity_table(materials, carriers_hz, ids)
    radios = tuple(material.radio for material in materials)
    planes, wave_number = PlaneMaterials(), 2.0 * np.pi / SPEED_OF_LIGHT * np.array(carriers_hz)
    planes.permittivity = wp.array(as_pairs(permittivity), dtype=wp.vec2d, device=HOST)
    planes.wave_number = wp.array(wave_number, dtype=wp.float64, device=HOST)
    for name in ("thickness", "scattering", "rms_height"):
        values = [getattr(radio, name) for radio in radios]
        setattr(planes, name, wp.array(values, dtype=wp.float64, device=HOST))
    by_carrier = tuple(SurfaceResponse(radios, permittivity[:, c], f) for c, f in enumerate(carriers_hz))
    layered = frozenset(index for index in ids if radios[index].layers)
    return MaterialTable(planes, by_carrier, ids, layered, SPEED_OF_LIGHT / np.array(carriers_hz) / (4.0 * np.pi))
