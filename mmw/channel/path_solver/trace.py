"""Hold traced paths with their geometry, from which gains follow for any weather."""

from dataclasses import dataclass, replace

import numpy as np

from mmw.channel.antennas.link_elements import LinkElements
from mmw.channel.links import Links
from mmw.channel.path_solver.mixed_walls import MixedWalls
from mmw.channel.path_solver.path_names import PathNames
from mmw.channel.path_solver.search import Search
from mmw.channel.path_solver.traced_paths import TracedPaths
from mmw.channel.paths import AIR_LOSSES
from mmw.physics.em.attenuation import VERTICAL_TILT, path_loss_db
from mmw.physics.em.diffraction import DiffractionModel, WedgeTerms
from mmw.physics.em.field import PathGeometry, combine
from mmw.physics.em.foliage import foliage_loss_db, with_scattering_foliage
from mmw.physics.em.path_gain import Interactions, path_transfer
from mmw.physics.materials.material import Material
from mmw.physics.weather.weather import Weather


@dataclass(frozen=True)
class Trace:
    """Geometry of the paths of links, from which gains follow for any materials, carriers, antennas and air."""

    search: Search
    """Search for the links that were traced; its `links` are those."""
    found: TracedPaths
    geometry: PathGeometry
    interactions: Interactions
    names: PathNames
    foliage_m: np.ndarray
    """Length of each path inside foliage that waves pass [m], shape [P]."""
    links: Links
    """All links, those that are the reverse of a traced one too."""
    traced: np.ndarray
    """Rows of `links` that were traced, shape [T]."""
    reverse_of: np.ndarray
    """Row of the traced link that each link is the reverse of, -1 for none, shape [L]."""
    share: np.ndarray | None
    """Share of the mirror's field that finite surfaces reflect, at every carrier, shape [P, C]; None if infinite."""
    mixed: MixedWalls | None
    """Reflections of which several materials have a part; None if surfaces are infinite."""
    curvature: np.ndarray | None
    """Curvature of the surface that reflects, see `PathSet`, shape [P, 6]; None if surfaces are infinite planes."""

    def take(self, rows: np.ndarray) -> "Trace":
        """Return some of the paths, in their order."""
        return replace(
            self,
            found=self.found.take(rows),
            geometry=self.geometry.take(rows),
            interactions=self.interactions.take(rows),
            names=self.names.take(rows),
            foliage_m=self.foliage_m[rows],
            share=None if self.share is None else self.share[rows],
            mixed=None if self.mixed is None else self.mixed.take(rows),
            curvature=None if self.curvature is None else self.curvature[rows],
        )


def losses_db(
    trace: Trace, carriers_hz: tuple[float, ...], air: Weather | None, elements: LinkElements
) -> dict[str, np.ndarray]:
    """Return what the air and foliage take from each path [dB], shape [P, C] each.

    Args:
        trace: The paths.
        carriers_hz: Carrier frequencies [Hz].
        air: State of the air; None for air without losses.
        elements: Antenna elements at both ends of each traced link.
    """
    if air is None:
        losses = {name: np.zeros((len(trace.found), len(carriers_hz))) for name in AIR_LOSSES}
    else:
        directions = 0.0, VERTICAL_TILT
        if air.rain_mm_h > 0.0:  # the only loss that depends on them
            directions = np.pi / 2 - trace.geometry.theta_t, elements.tx.tilt[trace.found.link]
        losses = path_loss_db(air, carriers_hz, trace.geometry.length, *directions)
    is_clear = trace.search.table.foliage is None
    foliage = np.zeros(losses["gas_db"].shape) if is_clear else foliage_loss_db(carriers_hz, trace.foliage_m)
    return {**losses, "foliage_db": foliage}


def traced_transfer(
    trace: Trace,
    carriers_hz: tuple[float, ...],
    materials: tuple[Material, ...],
    losses: dict[str, np.ndarray],
    model: DiffractionModel,
    terms: tuple[WedgeTerms, ...],
    fields: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the polarimetric transfer of each path in one weather, with its losses, shape [P, C, 2, 2], and the
    coefficients between the antennas, shape [P, C], or [0, C] without fields.

    Args:
        trace: The paths.
        carriers_hz: Carrier frequencies [Hz].
        materials: Materials of the weather by id.
        losses: `losses_db` of the weather.
        model: How wedges diffract.
        terms: `wedge_terms_of` the paths.
        fields: Far fields (theta, phi) of the antennas of transmitter and receiver, shape [P, 2, 2]; None for none.
    """
    if trace.search.table.foliage is not None:
        materials = with_scattering_foliage(materials)
    remaining = 10.0 ** (-sum(losses.values()) / 20.0)
    weight = remaining if trace.share is None else remaining * trace.share
    paths = trace.geometry, trace.interactions
    transfer, coefficients = path_transfer(*paths, materials, carriers_hz, model, terms, weight, fields)
    if trace.mixed is not None:
        rows, transfers = mixed_transfer(trace, trace.mixed, materials, carriers_hz, model)
        transfer[rows] = transfers * remaining[rows][:, :, None, None]
        if fields is not None:
            own = fields[rows]
            coefficients[rows] = combine(own[:, 1:], transfer[rows], own[:, :1])[:, :, 0, 0]
    return transfer, coefficients


def mixed_transfer(
    trace: Trace,
    mixed: MixedWalls,
    materials: tuple[Material, ...],
    carriers_hz: tuple[float, ...],
    model: DiffractionModel,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the paths that reflect at several materials at once, and the sums of their transfers, [n, C, 2, 2].

    Args:
        trace: The paths.
        mixed: The materials and their shares.
        materials: Materials of the weather by id.
        carriers_hz: Carrier frequencies [Hz].
        model: How wedges diffract.
    """
    paths, first, count = np.unique(mixed.path, return_index=True, return_counts=True)
    total = np.zeros((len(paths), len(carriers_hz), 2, 2), dtype=np.complex128)
    for turn in range(int(count.max(initial=0))):  # the combination of this number of every path that has one
        own = np.flatnonzero(count > turn)
        rows = first[own] + turn
        interactions = trace.interactions.take(paths[own])
        given = np.where(mixed.material_id[rows] < 0, interactions.material_id, mixed.material_id[rows])
        interactions = replace(interactions, material_id=given)
        part, _ = path_transfer(trace.geometry.take(paths[own]), interactions, materials, carriers_hz, model)
        total[own] += mixed.weight[rows][:, :, None, None] * part
    return paths, total
