"""Leave out diffracted paths that are surely too weak, most of those that are found, before gains are computed."""

from collections.abc import Mapping

import numpy as np

from mmw.channel.antennas.link_elements import LinkElements
from mmw.channel.path_solver.trace import Trace, losses_db, traced_transfer
from mmw.config import ChannelConfig
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.physics.em.diffraction import DiffractionModel, WedgeTerms, wedge_spreading
from mmw.physics.em.foliage import foliage_loss_db
from mmw.physics.em.interaction import DIFFRACTION, DIFFUSE
from mmw.physics.em.path_gain import wedge_terms_of
from mmw.physics.materials.material import Material
from mmw.physics.weather.weather import Weather

SLACK = 1.01
"""Factor on bounds, far above their rounding."""


def without_weak_wedges(
    trace: Trace,
    config: ChannelConfig,
    materials: dict[str, tuple[Material, ...]],
    air: Mapping[str, Weather] | None,
    elements: LinkElements,
    model: DiffractionModel,
) -> Trace:
    """Return a trace without diffracted paths that `PathSet.within` would leave out whatever they meet.

    The strongest path of a link is at least the strongest that is not diffracted. A diffracted path is at most that of
    mirrors and faces that reflect all, in air without losses.

    Args:
        trace: Traced links.
        config: Carriers and dynamic range.
        materials: Weather -> materials by id.
        air: Weather -> state of the air.
        elements: Antenna elements at both ends of each traced link.
        model: How wedges diffract.
    """
    is_diffracted = (trace.found.kind == DIFFRACTION).any(axis=1)
    if config.dynamic_range_db is None or not is_diffracted.any():
        return trace
    plain = trace.take(np.flatnonzero(~is_diffracted & ~(trace.found.kind == DIFFUSE).any(axis=1)))
    carriers = config.carriers_hz
    most = diffracted_bounds(
        trace, wedge_terms_of(trace.geometry, trace.interactions, carriers, model), carriers, model
    )
    keep = ~is_diffracted
    none = wedge_terms_of(plain.geometry, plain.interactions, carriers, model)
    for weather, by_id in materials.items():
        losses = losses_db(plain, carriers, None if air is None else air.get(weather), elements)
        transfer, _ = traced_transfer(plain, carriers, by_id, losses, model, none)
        strength = np.linalg.norm(transfer, axis=(2, 3))
        strongest = np.zeros((len(trace.search.links), len(carriers)))
        np.maximum.at(strongest, plain.found.link, strength)
        needed = strongest[trace.found.link] * 10.0 ** (-config.dynamic_range_db / 20.0)
        keep |= (most * SLACK >= needed).any(axis=1)
    return trace.take(np.flatnonzero(keep))


def diffracted_bounds(
    trace: Trace, terms: tuple[WedgeTerms, ...], carriers_hz: tuple[float, ...], model: DiffractionModel
) -> np.ndarray:
    """Return more than the Frobenius norm of the transfer of each diffracted path, 0 for the others, shape [P, C]."""
    wedges = trace.interactions.wedges
    out = np.zeros((len(trace.found), len(carriers_hz)))
    spreading = wedge_spreading(trace.geometry, wedges)
    for column, (own, carrier) in enumerate(zip(terms, carriers_hz, strict=True)):
        d1, d2, d3, d4 = own.d
        if model == "utd":
            size = np.abs(d1 + d2) + np.where(wedges.is_curved, 0.0, np.abs(d3) + np.abs(d4))
        else:
            size = np.abs(d1) + np.abs(d2) + np.abs(d3) + np.abs(d4)
        wave = SPEED_OF_LIGHT / carrier / (4.0 * np.pi)
        out[wedges.path, column] = np.sqrt(2.0) * wave * spreading * size
    if trace.share is not None:
        out *= np.abs(trace.share)
    return out * 10.0 ** (-foliage_loss_db(carriers_hz, trace.foliage_m) / 20.0)
