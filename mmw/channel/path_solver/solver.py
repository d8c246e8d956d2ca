"""Solve the paths of every link of a batch, with gains for all weathers and carriers of one trace."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mmw.channel.antennas.link_elements import LinkElements, configured_elements
from mmw.channel.links import Links
from mmw.channel.path_solver.image_method import trace_paths
from mmw.channel.path_solver.reciprocity import add_reversed_links, unique_links
from mmw.channel.path_solver.reflected_shares import reflected_shares
from mmw.channel.path_solver.search import Search
from mmw.channel.path_solver.surface_table import SurfaceTable, make_surface_table
from mmw.channel.path_solver.traced_paths import TracedPaths
from mmw.channel.paths import AIR_LOSSES, PathSet, path_ids, path_kinds
from mmw.config import ChannelConfig
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.errors import InputError
from mmw.core.kinematics import differentiate_rows
from mmw.core.transforms import rotate
from mmw.physics.em.attenuation import path_loss_db
from mmw.physics.em.diffraction import DiffractionModel, WedgeHits, is_lit
from mmw.physics.em.field import PathGeometry, combine, path_geometry
from mmw.physics.em.finite_surfaces import WEAKEST_SHARE
from mmw.physics.em.foliage import foliage_loss_db, with_scattering_foliage
from mmw.physics.em.interaction import DIFFRACTION, DIFFUSE, SPECULAR, TRANSMISSION
from mmw.physics.em.path_gain import Interactions, path_transfer
from mmw.physics.em.scattering import ScatteringPoints
from mmw.physics.em.vectors import dot, norm
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
            permittivity_table(materials, config.carriers_hz, used)
        except InputError as error:
            raise InputError(f"channel.carriers_hz, weather {weather}: {error}") from None


@dataclass(frozen=True)
class Trace:
    """Geometry of the paths of links, from which gains follow for any materials, carriers, antennas and air."""

    search: Search
    """Search for the links that were traced; its `links` are those."""
    found: TracedPaths
    geometry: PathGeometry
    interactions: Interactions
    range_rate: np.ndarray
    """Rate of change of each path's length [m/s], shape [P]."""
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


def trace_links(
    scene: DeviceScene, links: Links, config: ChannelConfig, table: SurfaceTable, *, is_reciprocal: bool = True
) -> Trace:
    """Return the geometry of the paths of links. Neither the batch nor the device changes the set of paths.

    Args:
        scene: The scene with the batch of the links loaded.
        links: Links whose frames are loaded.
        config: Rays, candidate mode, depth and interactions.
        table: Surfaces of the scene.
        is_reciprocal: Whether a link and its reverse may share one trace; not with different antennas at both ends.

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
    traced, reverse_of = np.arange(len(links)), np.full(len(links), -1)
    if is_reciprocal and config.is_reciprocal:
        traced, reverse_of = unique_links(links, config)
    is_whole = len(traced) == len(links)
    is_pair = np.zeros(len(traced), dtype=bool)
    is_pair[reverse_of[reverse_of >= 0]] = True
    if config.finite_surfaces and table.outlines is None:
        raise ValueError("channel.finite_surfaces: the surface table has no outlines; make it with finite=True")
    search = Search(scene, links if is_whole else links.take(traced), config, table)
    try:
        found = trace_paths(search, None if is_whole else is_pair)
    finally:
        search.release()
    geometry, interactions = _geometry(search, found)
    if config.diffraction and not config.diffraction_lit_region:
        keep = np.ones(len(found), dtype=bool)
        keep[interactions.wedges.path[is_lit(geometry, interactions.wedges)]] = False
        found = found.take(np.nonzero(keep)[0])
        geometry, interactions = _geometry(search, found)
    share = None
    if table.outlines is not None:
        share = reflected_shares(search, found, geometry, table.outlines, config.carriers_hz)
        keep = np.flatnonzero(np.abs(share).max(axis=1, initial=0.0) >= WEAKEST_SHARE)
        found, share = found.take(keep), share[keep]
        geometry, interactions = _geometry(search, found)
    range_rate = _range_rate(search, found, geometry)
    inside = np.zeros(len(found))
    if table.foliage is not None:
        ends = (end.position[found.link] for end in (search.links.tx, search.links.rx))
        inside = table.foliage.lengths_inside(scene, *ends, found)
    return Trace(search, found, geometry, interactions, range_rate, inside, links, traced, reverse_of, share)


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
    search, found, geometry = trace.search, trace.found, trace.geometry
    links, table = search.links, search.table
    is_whole = len(trace.traced) == len(trace.links)
    own = elements if is_whole else elements.take(trace.traced)
    transfer, a, loss_db = _gains(trace, config, materials, air, own, diffraction_model)
    is_there = found.kind != 0
    paths = PathSet(
        carriers_hz=np.array(config.carriers_hz),
        link=found.link,
        path_id=_path_ids(links, found, table),
        kind=path_kinds(found.kind),
        order=found.order.astype(np.int8),
        interaction=found.kind.astype(np.int8),
        surface=found.surface,
        object_id=_gather(table.object_id, _faces(found, table), is_there),
        material_id=trace.interactions.material_id,
        vertex=found.vertex,
        normal=found.normal,
        tau=geometry.length / SPEED_OF_LIGHT,
        **{name: getattr(geometry, name) for name in ("theta_t", "phi_t", "theta_r", "phi_r")},
        range_rate=trace.range_rate,
        count=np.bincount(found.link, minlength=len(links)).astype(np.int32),
        transfer=transfer,
        a=a,
        loss_db=loss_db,
    )
    if config.dynamic_range_db is not None:
        paths = paths.within(config.dynamic_range_db)
    return paths if is_whole else add_reversed_links(paths, trace.links, trace.traced, trace.reverse_of, table.wall)


def solve_paths(
    scene: DeviceScene,
    links: Links,
    config: ChannelConfig,
    materials: dict[str, tuple[Material, ...]],
    table: SurfaceTable | None = None,
    air: Mapping[str, Weather] | None = None,
    *,
    diffraction_model: DiffractionModel = "utd",
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
    trace = trace_links(scene, links, config, table)
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
    ends = np.concatenate([links.batch_index[:, None], links.tx.position], axis=1)  # antennas at one place share rays
    return sum(
        len(np.unique(ends[rows], axis=0)) * rays
        for rows, rays in ((~is_pair, config.samples_per_tx), (is_pair, config.samples_per_tx // 2))
    )


def _path_ids(links: Links, found: TracedPaths, table: SurfaceTable) -> np.ndarray:
    """Return identifiers that stay as a point of reflection moves on over coplanar surfaces, shape [P]."""
    is_flat = (found.kind == SPECULAR) | (found.kind == TRANSMISSION)
    surface = found.surface
    if is_flat.any():
        surface = np.where(is_flat, table.wall[np.where(is_flat, surface, 0)], surface)
    rough, step = np.nonzero(found.kind == DIFFUSE)
    if len(rough):  # a patch is known by its ray
        surface = surface.copy()
        surface[rough, step] = found.ray[rough]
    return path_ids(links.tx_number[found.link], links.rx_number[found.link], found.kind, surface)


def _faces(found: TracedPaths, table: SurfaceTable) -> np.ndarray:
    """Return the surface of each interaction, for a diffraction the first face of its wedge, shape [P, D]."""
    if not len(table.wedges):
        return found.surface
    is_diffracted = found.kind == DIFFRACTION
    return np.where(is_diffracted, table.wedges.surface_0[np.where(is_diffracted, found.surface, 0)], found.surface)


def _gather(values: np.ndarray, row: np.ndarray, is_there: np.ndarray) -> np.ndarray:
    """Return values[row] where there is something, -1 elsewhere, int32."""
    if not len(values):
        return np.full(row.shape, -1, dtype=np.int32)
    return np.where(is_there, values[np.where(is_there, row, 0)], -1).astype(np.int32)


def _geometry(search: Search, found: TracedPaths) -> tuple[PathGeometry, Interactions]:
    """Return the geometry of found paths, and their interactions."""
    links, table = search.links, search.table
    wedges = _wedge_hits(search, found)
    edge = np.zeros_like(found.vertex)
    edge[wedges.path, wedges.step] = wedges.edge
    tx, rx = links.tx.position[found.link], links.rx.position[found.link]
    geometry = path_geometry(tx, rx, found.kind, found.vertex, found.normal, edge)
    path, step = np.nonzero(found.kind == DIFFUSE)
    solid_angle = np.full(len(path), 4.0 * np.pi / search.config.diffuse_samples)
    rough = ScatteringPoints(path, step, found.normal[path, step], solid_angle, found.ray[path] < -1)
    wedge = found.surface[wedges.path, wedges.step]
    sides = np.stack([table.wedges.surface_0[wedge], table.wedges.surface_n[wedge]], axis=1).reshape(-1, 2)
    outlines = table.outlines
    return geometry, Interactions(
        material_id=_gather(table.material_id, _faces(found, table), found.kind != 0),
        wedges=wedges,
        wedge_material=table.material_id[sides],
        wedge_width=None if outlines is None else outlines.width[outlines.of_plane[table.plane[sides]]],
        rough=rough,
    )


def _wedge_hits(search: Search, found: TracedPaths) -> WedgeHits:
    path, step = np.nonzero(found.kind == DIFFRACTION)
    wedge, wedges = found.surface[path, step], search.table.wedges
    vectors = [(wedges.end - wedges.begin)[wedge], *(v[wedge] for v in (wedges.normal_0, wedges.normal_n, wedges.away))]
    moved = np.nonzero(wedges.carrier[wedge] < len(search.scene.instance_actor))[0]
    if len(moved):
        batch_index = search.links.batch_index[found.link[path[moved]]]
        turn = search.host_pose[batch_index, wedges.carrier[wedge[moved]], 3:]
        for vector in vectors:
            vector[moved] = rotate(turn, vector[moved])
    vectors[0] = vectors[0] / norm(vectors[0])[:, None]
    return WedgeHits(path, step, *vectors)


def _gains(
    trace: Trace,
    config: ChannelConfig,
    materials: dict[str, tuple[Material, ...]],
    air: Mapping[str, Weather] | None,
    elements: LinkElements,
    diffraction_model: DiffractionModel,
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], dict[str, dict[str, np.ndarray]]]:
    """Return transfer [P, C, 2, 2], coefficient [P, C] and losses [P, C] of every weather."""
    links, found, geometry, interactions = trace.search.links, trace.found, trace.geometry, trace.interactions
    rotations = links.tx.rotation, links.rx.rotation
    tx_field, rx_field = elements.fields(geometry.departure, geometry.arrival, *rotations, found.link)
    tilt = elements.tx.tilt[found.link]
    elevation = np.pi / 2 - geometry.theta_t
    transfer, a, loss_db = {}, {}, {}
    in_foliage = foliage_loss_db(config.carriers_hz, trace.foliage_m)
    for weather, by_id in materials.items():
        if trace.search.table.foliage is not None:
            by_id = with_scattering_foliage(by_id)
        if air is None or weather not in air:
            loss_db[weather] = {name: np.zeros((len(found), len(config.carriers_hz))) for name in AIR_LOSSES}
        else:
            loss_db[weather] = path_loss_db(air[weather], config.carriers_hz, geometry.length, elevation, tilt)
        loss_db[weather] = {**loss_db[weather], "foliage_db": in_foliage}
        remaining = 10.0 ** (-sum(loss_db[weather].values()) / 20.0)
        transfer[weather] = (
            path_transfer(geometry, interactions, by_id, config.carriers_hz, diffraction_model)
            * remaining[:, :, None, None]
        )
        if trace.share is not None:
            transfer[weather] *= trace.share[:, :, None, None]
        columns = [
            combine(rx_field, transfer[weather][:, c], tx_field)[:, 0, 0] for c in range(len(config.carriers_hz))
        ]
        a[weather] = np.stack(columns, axis=1)
    return transfer, a, loss_db


def _range_rate(search: Search, found: TracedPaths, geometry: PathGeometry) -> np.ndarray:
    """Return d(length)/dt of each path [m/s] from the velocities of both ends and of every vertex, shape [P].

    Source: first-order Doppler, Sionna RT 2.2 technical report; the bodies are rigid, so the velocity of a point is
    v + w x r.
    """
    scene, links, table = search.scene, search.links, search.table
    rate = -dot(links.tx.velocity[found.link], geometry.departure)
    rate -= dot(links.rx.velocity[found.link], geometry.arrival)
    if not len(table) or not len(scene.instance_actor):
        return rate
    is_there = found.kind != 0
    owner = _gather(table.owner, _faces(found, table), is_there)
    path, step = np.nonzero(owner >= 0)
    if len(path):
        rows = np.array([scene.arrays.frame_row(frame) for frame in scene.batch_frames], dtype=np.int64)
        motion = differentiate_rows(scene.arrays.poses, rows, scene.arrays.pose_dt)
        batch_index = links.batch_index[found.link[path]]
        actor = scene.instance_actor[owner[path, step]]
        arm = found.vertex[path, step] - scene.arrays.poses[rows[batch_index], actor, :3]
        moving = motion.velocity[batch_index, actor] + np.cross(motion.world_rate[batch_index, actor], arm)
        turned = geometry.direction[path, step] - geometry.direction[path, step + 1]
        np.add.at(rate, path, dot(moving, turned))
    return rate
