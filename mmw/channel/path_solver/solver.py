"""Solve the paths of every link of a batch, with gains for all weathers and carriers of one trace."""

from collections.abc import Mapping

import numpy as np

from mmw.channel.antennas.link_elements import LinkElements, configured_elements
from mmw.channel.links import Links
from mmw.channel.path_solver.finite_shares import finite_shares, weakest_shares
from mmw.channel.path_solver.found_geometry import found_geometry
from mmw.channel.path_solver.image_method import trace_paths
from mmw.channel.path_solver.path_names import tell_apart
from mmw.channel.path_solver.reciprocity import add_reversed_links, all_links, unique_links
from mmw.channel.path_solver.search import Search
from mmw.channel.path_solver.surface_table import SurfaceTable, make_surface_table
from mmw.channel.path_solver.trace import Trace, losses_db, traced_transfer
from mmw.channel.path_solver.weak_paths import diffracted_bounds, without_weak_wedges
from mmw.channel.paths import PathSet
from mmw.config import ChannelConfig
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.errors import InputError
from mmw.core.kinematics import Motion
from mmw.core.remember import remembered
from mmw.physics.em.diffraction import DiffractionModel, WedgeHits, WedgeTerms, is_lit
from mmw.physics.em.path_gain import wedge_terms_of
from mmw.physics.materials.material import Material
from mmw.physics.materials.permittivity import permittivity_table
from mmw.physics.weather.weather import Weather
from mmw.scene.device_scene import DeviceScene


def check_channel_materials(
    scene_materials: dict[str, tuple[Material, ...]], used: np.ndarray, config: ChannelConfig
) -> None:
    """Raise if a used material of any weather has no data at a configured carrier.

    Args:
        scene_materials: Weather -> materials by id.
        used: Material ids that some face has.
        config: The carriers.

    Raises:
        InputError: Naming material, weather, frequency and the ranges that exist.
    """
    for weather, materials in scene_materials.items():
        try:
            _check_permittivity(materials, used, config.carriers_hz)
        except InputError as error:
            raise InputError(f"channel.carriers_hz, weather {weather}: {error}") from None


@remembered(owners=2, size=64)
def _check_permittivity(materials: tuple[Material, ...], used: np.ndarray, carriers_hz: tuple[float, ...]) -> None:
    """Raise if a material has no data; what has passed once is not looked at again."""
    permittivity_table(materials, carriers_hz, used)


def trace_links(
    scene: DeviceScene,
    links: Links,
    config: ChannelConfig,
    table: SurfaceTable,
    *,
    is_reciprocal: bool = True,
    motion: Motion | None = None,
) -> Trace:
    """Return the geometry of the paths of links. Neither the batch nor the device changes the set of paths.

    Args:
        scene: The scene with the batch of the links loaded.
        links: Links whose frames are loaded.
        config: Rays, candidate mode, depth and interactions.
        table: Surfaces of the scene.
        is_reciprocal: Whether a link and its reverse may share one trace; not with different antennas at both ends.
        motion: Derivatives of all poses of the scene, if they are known.

    Raises:
        InputError: If there are too many candidates.
        ValueError: If a link's frame is not at its batch index, the table lacks wedges that diffraction needs, or it is
            of the other choice of foliage.
    """
    scene.check_loaded("link", links.batch_index, links.frame)
    if config.diffraction and not table.has_wedges:
        raise ValueError("channel.diffraction: the surface table has no wedges; make it with wedges=True")
    if config.foliage != (table.foliage is not None):
        raise ValueError(f"channel.foliage: the surface table is another one; make it with foliage={config.foliage}")
    is_shared = is_reciprocal and config.is_reciprocal
    traced, reverse_of = unique_links(links, config) if is_shared else all_links(len(links))
    is_whole, is_pair = len(traced) == len(links), None
    if not is_whole:
        is_pair = np.zeros(len(traced), dtype=bool)
        is_pair[reverse_of[reverse_of >= 0]] = True
    if config.finite_surfaces and table.outlines is None:
        raise ValueError("channel.finite_surfaces: the surface table has no outlines; make it with finite=True")
    search = Search(scene, links if is_whole else links.take(traced), config, table)
    try:
        found = trace_paths(search, is_pair)
    finally:
        search.release()
    geometry, interactions, names = found_geometry(search, found, motion)
    if config.diffraction and not config.diffraction_lit_region:
        lit = interactions.wedges.path[is_lit(geometry, interactions.wedges)]
        keep = np.setdiff1d(np.arange(len(found)), lit)
        found, geometry, interactions, names = (part.take(keep) for part in (found, geometry, interactions, names))
    share = mixed = curvature = None
    if table.outlines is not None:
        share, mixed, curvature = finite_shares(
            search, found, geometry, interactions.wedges, table.outlines, config.carriers_hz
        )
        keep = np.flatnonzero(np.abs(share).max(axis=1, initial=0.0) >= weakest_shares(found, table))
        found, geometry, interactions, names = (part.take(keep) for part in (found, geometry, interactions, names))
        share, mixed, curvature = share[keep], mixed.take(keep), curvature[keep]
    inside = np.zeros(len(found))
    if table.foliage is not None:
        ends = (end.position[found.link] for end in (search.links.tx, search.links.rx))
        inside = table.foliage.lengths_inside(scene, *ends, found)
    shape = share, mixed, curvature
    return Trace(search, found, geometry, interactions, names, inside, links, traced, reverse_of, *shape)


def path_gains(
    trace: Trace,
    config: ChannelConfig,
    materials: dict[str, tuple[Material, ...]],
    air: Mapping[str, Weather] | None,
    elements: LinkElements,
    *,
    diffraction_model: DiffractionModel = "utd",
) -> PathSet:
    """Return traced paths with their gains for every weather and carrier.

    Args:
        trace: The traced links.
        config: Carriers.
        materials: Weather -> materials by id, for the weathers that are wanted.
        air: Weather -> state of the air; a weather that is not there has air without losses.
        elements: Antenna elements at both ends of each of `trace.links`.
        diffraction_model: Field of a wedge; `sionna` is for comparisons with Sionna RT.

    Raises:
        InputError: If a material on a path has no permittivity at a carrier; see `check_channel_materials` for all.
    """
    is_whole = len(trace.traced) == len(trace.links)
    own = elements if is_whole else elements.take(trace.traced)
    if config.dynamic_range_db is not None:
        trace = without_weak_wedges(trace, config, materials, air, own, diffraction_model)
    search, found, geometry, names = trace.search, trace.found, trace.geometry, trace.names
    links, table = search.links, search.table
    terms = wedge_terms_of(geometry, trace.interactions, config.carriers_hz, diffraction_model)
    transfer, a, loss_db = _gains(trace, config, materials, air, own, diffraction_model, terms)
    rank_by = _ranked_by(trace, config, diffraction_model, terms)
    paths = PathSet(
        carriers_hz=np.array(config.carriers_hz),
        link=found.link,
        path_id=tell_apart(names.path_id, found.link, rank_by),
        kind=names.kind,
        order=found.order.astype(np.int8),
        interaction=found.kind.astype(np.int8),
        surface=found.surface,
        object_id=names.object_id,
        material_id=names.material_id,
        vertex=found.vertex,
        normal=found.normal,
        edge=_edges(len(found), trace.interactions.wedges),
        curvature=np.full((len(found), 6), np.nan) if trace.curvature is None else trace.curvature,
        tau=geometry.length / SPEED_OF_LIGHT,
        theta_t=geometry.theta_t,
        phi_t=geometry.phi_t,
        theta_r=geometry.theta_r,
        phi_r=geometry.phi_r,
        range_rate=geometry.range_rate,
        count=np.bincount(found.link, minlength=len(links)).astype(np.int32),
        transfer=transfer,
        a=a,
        loss_db=loss_db,
    )
    if config.dynamic_range_db is not None:
        rows = paths.rows_within(config.dynamic_range_db)
        paths, rank_by = paths.take(rows), rank_by[rows]
    if is_whole:
        return paths
    return add_reversed_links(paths, trace.links, trace.traced, trace.reverse_of, table, rank_by, search.scene)


def _ranked_by(
    trace: Trace, config: ChannelConfig, model: DiffractionModel, terms: tuple[WedgeTerms, ...]
) -> np.ndarray:
    """Return by what paths of one name are numbered, lowest first, shape [P]: minus their strength in any weather.

    Diffracted ones are numbered by their bounds at the lowest carrier, where levels change the least from frame to
    frame, others by their share of the wall's reflection; without `finite_surfaces` by their length.
    """
    length = trace.geometry.length
    rank_by = length if trace.share is None else -np.linalg.norm(trace.share, axis=1) / length
    wedges = trace.interactions.wedges
    if len(wedges.path):
        lowest = int(np.argmin(config.carriers_hz))
        bounds = diffracted_bounds(trace, terms, config.carriers_hz, model)[:, lowest]
        rank_by = np.where(np.bincount(wedges.path, minlength=len(length)) > 0, -bounds, rank_by)
    return rank_by


def _edges(count: int, wedges: WedgeHits) -> np.ndarray:
    """Return the unit vector along the edge of each path, NaN without one, shape [P, 3]."""
    edge = np.full((count, 3), np.nan)
    edge[wedges.path] = wedges.edge
    return edge


def solve_paths(
    scene: DeviceScene,
    links: Links,
    config: ChannelConfig,
    materials: dict[str, tuple[Material, ...]],
    table: SurfaceTable | None = None,
    air: Mapping[str, Weather] | None = None,
    *,
    diffraction_model: DiffractionModel = "utd",
    motion: Motion | None = None,
) -> PathSet:
    """Return the paths of the links, for every weather and carrier: `trace_links`, then `path_gains`.

    Geometry is found once: weather only changes materials and air, and a link and its reverse share it.

    Args:
        scene: The scene with the batch of the links loaded.
        links: Links whose frames are loaded.
        config: Carriers, rays, candidate mode, depth, interactions and antennas.
        materials: Weather -> materials by id, for the weathers that are wanted.
        table: Surfaces of the scene, from `make_surface_table`; made here when not given.
        air: Weather -> state of the air; a weather that is not there has air without losses.
        diffraction_model: Field of a wedge; `sionna` is for comparisons with Sionna RT.
        motion: Derivatives of all poses of the scene, if they are known.

    Returns:
        The paths, sorted by (link, order, kinds, surfaces).

    Raises:
        InputError: If a material has no permittivity at a carrier, or there are too many candidates.
        ValueError: If a link's frame is not at its batch index, or the table lacks wedges that diffraction needs.

    Source: image method with ray-launched candidates; frequencies and angles as in `docs/concepts/channel.md`.
    """
    if table is None:
        table = make_surface_table(scene, **config.surface_options)
    check_channel_materials(materials, table.used_materials, config)
    trace = trace_links(scene, links, config, table, motion=motion)
    elements = configured_elements(config, links)
    return path_gains(trace, config, materials, air, elements, diffraction_model=diffraction_model)


def launched_rays(links: Links, config: ChannelConfig) -> int:
    """Return how many rays search for reflections: `samples_per_tx` a transmitter, half for each of a pair.

    Args:
        links: The links.
        config: Candidate mode, rays, interactions.
    """
    if config.candidates != "launch" or not config.specular_reflection or config.max_depth == 0 or len(links) == 0:
        return 0
    is_pair = np.zeros(len(links), dtype=bool)
    if config.is_reciprocal:
        traced, reverse_of = unique_links(links, config)
        is_pair[reverse_of >= 0] = True
        is_pair[traced[reverse_of[reverse_of >= 0]]] = True
    places = zip(links.batch_index.tolist(), map(tuple, links.tx.position.tolist()), strict=True)
    ends = set(zip(is_pair.tolist(), places, strict=True))  # antennas at one place share rays
    pairs = sum(is_both for is_both, _ in ends)
    return (len(ends) - pairs) * config.samples_per_tx + pairs * (config.samples_per_tx // 2)


def _gains(
    trace: Trace,
    config: ChannelConfig,
    materials: dict[str, tuple[Material, ...]],
    air: Mapping[str, Weather] | None,
    elements: LinkElements,
    diffraction_model: DiffractionModel,
    terms: tuple[WedgeTerms, ...],
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], dict[str, dict[str, np.ndarray]]]:
    """Return transfer [P, C, 2, 2], coefficient [P, C] and losses [P, C] of every weather."""
    links, found, geometry, carriers = trace.search.links, trace.found, trace.geometry, config.carriers_hz
    rotations = links.tx.rotation, links.rx.rotation
    fields = elements.fields(geometry, *rotations, found.link)
    transfer, a, loss_db = {}, {}, {}
    for weather, by_id in materials.items():
        loss_db[weather] = losses_db(trace, carriers, None if air is None else air.get(weather), elements)
        transfer[weather], a[weather] = traced_transfer(
            trace, carriers, by_id, loss_db[weather], diffraction_model, terms, fields
        )
    return transfer, a, loss_db
