"""Paths of every link of a batch, with gains for all weathers and carriers of one trace."""

from collections.abc import Mapping

import numpy as np

from mmw.channel.antennas.patterns import antenna_field
from mmw.channel.links import Links
from mmw.channel.path_solver.image_method import TracedPaths, instance_poses, trace_paths
from mmw.channel.path_solver.reciprocity import one_way, read_both_ways
from mmw.channel.path_solver.surface_table import SurfaceTable, make_surface_table
from mmw.channel.paths import LOSSES, PathSet, path_ids, path_kinds
from mmw.config import ChannelConfig
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.errors import InputError
from mmw.core.kinematics import differentiate_rows
from mmw.core.transforms import rotate
from mmw.physics.em.attenuation import path_loss_db
from mmw.physics.em.diffraction import WedgeHits, is_lit
from mmw.physics.em.field import PathGeometry, combine, path_geometry
from mmw.physics.em.interaction import DIFFRACTION, DIFFUSE
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


def solve_paths(
    scene: DeviceScene,
    links: Links,
    config: ChannelConfig,
    materials: dict[str, tuple[Material, ...]],
    table: SurfaceTable | None = None,
    air: Mapping[str, Weather] | None = None,
) -> PathSet:
    """Return the paths of the links, for every weather and carrier.

    Geometry is found once: weather only changes materials and air, and a link and its reverse share it. Neither the
    batch nor the device changes the set of paths.

    Args:
        scene: The scene with the batch of the links loaded.
        links: Links whose `slot` is a slot of the scene's batch.
        config: Carriers, rays, candidate mode, depth, interactions, pattern and polarisation.
        materials: Weather -> materials by id, for the weathers that are wanted.
        table: Surfaces of the scene, from `make_surface_table`; made here when not given.
        air: Weather -> state of the air; a weather that is not there has air that weakens nothing.

    Returns:
        The paths, sorted by (link, order, kinds, surfaces).

    Raises:
        InputError: If a material has no permittivity at a carrier, a link's frame is not in its slot of the scene, or
            the table lacks wedges that diffraction needs.

    Source: image method with ray-launched candidates; frequencies and angles as in `docs/concepts/channel.md`.
    """
    _check_links(scene, links)
    if table is None:
        table = make_surface_table(scene, wedges=config.diffraction, sheets=config.diffraction_sheets)
    if config.diffraction and not table.has_wedges:
        raise ValueError("channel.diffraction: the surface table has no wedges; make it with wedges=True")
    check_channel_materials(materials, np.unique(table.material_id), config)
    if not config.is_reciprocal:
        return _solve(scene, links, config, materials, table, air)
    traced, reverse_of = one_way(links)
    if len(traced) == len(links):
        return _solve(scene, links, config, materials, table, air)
    is_pair = np.zeros(len(traced), dtype=bool)
    is_pair[reverse_of[reverse_of >= 0]] = True
    paths = _solve(scene, links.take(traced), config, materials, table, air, is_pair)
    return read_both_ways(paths, links, traced, reverse_of)


def launched_rays(links: Links, config: ChannelConfig) -> int:
    """Return how many rays look for the reflections of links: `channel.rays` a transmitter, half for each of a pair.

    Args:
        links: The links.
        config: Candidate mode, rays, interactions.
    """
    if config.candidates != "launch" or not config.specular or config.max_depth == 0 or len(links) == 0:
        return 0
    is_pair = np.zeros(len(links), dtype=bool)
    if config.is_reciprocal:
        traced, reverse_of = one_way(links)
        is_pair[reverse_of >= 0] = True
        is_pair[traced[reverse_of[reverse_of >= 0]]] = True
    ends = np.stack([links.slot, links.tx_actor], axis=1)
    return sum(
        len(np.unique(ends[rows], axis=0)) * rays
        for rows, rays in ((~is_pair, config.rays), (is_pair, config.rays // 2))
    )


def _solve(
    scene: DeviceScene,
    links: Links,
    config: ChannelConfig,
    materials: dict[str, tuple[Material, ...]],
    table: SurfaceTable,
    air: Mapping[str, Weather] | None,
    is_pair: np.ndarray | None = None,
) -> PathSet:
    """Return the paths of links of which none is the reverse of another; those of `is_pair` stand for both."""
    found = trace_paths(scene, links, config, table, is_pair)
    geometry, met = _geometry(scene, links, table, found, config)
    if config.diffraction and not config.diffraction_lit_region:
        keep = np.ones(len(found), dtype=bool)
        keep[met.wedges.path[is_lit(geometry, met.wedges)]] = False
        found = found.take(np.nonzero(keep)[0])
        geometry, met = _geometry(scene, links, table, found, config)
    transfer, a, loss_db = _gains(links, config, materials, air, found, geometry, met)
    is_there = found.kind != 0
    return PathSet(
        carriers_hz=np.array(config.carriers_hz),
        link=found.link,
        path_id=_path_ids(links, found),
        kind=path_kinds(found.kind),
        order=found.order.astype(np.int8),
        interaction=found.kind.astype(np.int8),
        surface=found.surface,
        object_id=_looked_up(table.object_id, _faces(found, table), is_there),
        material_id=met.material_id,
        vertex=found.vertex,
        normal=found.normal,
        tau=geometry.length / SPEED_OF_LIGHT,
        theta_t=geometry.theta_t,
        phi_t=geometry.phi_t,
        theta_r=geometry.theta_r,
        phi_r=geometry.phi_r,
        range_rate=_range_rate(scene, links, table, found, geometry),
        count=np.bincount(found.link, minlength=len(links)).astype(np.int32),
        transfer=transfer,
        a=a,
        loss_db=loss_db,
    )


def _check_links(scene: DeviceScene, links: Links) -> None:
    loaded = np.array(scene.batch_frames, dtype=np.int64)
    is_loaded = links.slot < len(loaded)
    is_loaded[is_loaded] = loaded[links.slot[is_loaded]] == links.frame[is_loaded]
    if not is_loaded.all():
        row = int(np.argmin(is_loaded))
        raise ValueError(
            f"link {row}: frame {links.frame[row]} in slot {links.slot[row]}; the scene holds frames "
            f"{list(scene.batch_frames[:8])}; call load_batch with the frames that the links were made for"
        )


def _path_ids(links: Links, found: TracedPaths) -> np.ndarray:
    surface = found.surface
    rough, step = np.nonzero(found.kind == DIFFUSE)
    if len(rough):  # a patch is known by its ray
        surface = surface.copy()
        surface[rough, step] = found.ray[rough]
    return path_ids(links.tx_actor[found.link], links.rx_actor[found.link], found.kind, surface)


def _faces(found: TracedPaths, table: SurfaceTable) -> np.ndarray:
    """Return the surface of each interaction, for a diffraction the first face of its wedge, shape [P, D]."""
    if not len(table.wedges):
        return found.surface
    is_bent = found.kind == DIFFRACTION
    return np.where(is_bent, table.wedges.surface_0[np.where(is_bent, found.surface, 0)], found.surface)


def _looked_up(values: np.ndarray, row: np.ndarray, is_there: np.ndarray) -> np.ndarray:
    """Return values[row] where there is something, -1 elsewhere, int32."""
    if not len(values):
        return np.full(row.shape, -1, dtype=np.int32)
    return np.where(is_there, values[np.where(is_there, row, 0)], -1).astype(np.int32)


def _geometry(
    scene: DeviceScene, links: Links, table: SurfaceTable, found: TracedPaths, config: ChannelConfig
) -> tuple[PathGeometry, Interactions]:
    """Return the geometry of found paths, and their interactions."""
    wedges = _wedge_hits(scene, links, table, found)
    edge = np.zeros_like(found.vertex)
    edge[wedges.path, wedges.step] = wedges.edge
    tx, rx = links.tx.position[found.link], links.rx.position[found.link]
    geometry = path_geometry(tx, rx, found.kind, found.vertex, found.normal, edge)
    path, step = np.nonzero(found.kind == DIFFUSE)
    solid_angle = np.full(len(path), 4.0 * np.pi / config.diffuse_rays)
    rough = ScatteringPoints(path, step, found.normal[path, step], solid_angle, found.ray[path] < -1)
    sides = (wedges.surface_0, wedges.surface_n)
    return geometry, Interactions(
        material_id=_looked_up(table.material_id, _faces(found, table), found.kind != 0),
        wedges=wedges,
        wedge_material=np.stack([table.material_id[side] for side in sides], axis=1).reshape(-1, 2),
        rough=rough,
    )


def _wedge_hits(scene: DeviceScene, links: Links, table: SurfaceTable, found: TracedPaths) -> WedgeHits:
    path, step = np.nonzero(found.kind == DIFFRACTION)
    wedge, wedges = found.surface[path, step], table.wedges
    vectors = [
        wedges.end[wedge] - wedges.begin[wedge],
        wedges.normal_0[wedge],
        wedges.normal_n[wedge],
        wedges.away[wedge],
    ]
    moved = np.nonzero(wedges.carrier[wedge] < len(scene.instance_actor))[0]
    if len(moved):
        turn = instance_poses(scene)[links.slot[found.link[path[moved]]], wedges.carrier[wedge[moved]], 3:]
        for vector in vectors:
            vector[moved] = rotate(turn, vector[moved])
    vectors[0] = vectors[0] / norm(vectors[0])[:, None]
    return WedgeHits(path, step, *vectors, wedges.surface_0[wedge], wedges.surface_n[wedge])


def _gains(
    links: Links,
    config: ChannelConfig,
    materials: dict[str, tuple[Material, ...]],
    air: Mapping[str, Weather] | None,
    found: TracedPaths,
    geometry: PathGeometry,
    met: Interactions,
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], dict[str, dict[str, np.ndarray]]]:
    """Return transfer [P, C, 2, 2], coefficient [P, C] and losses of the air [P, C] of every weather."""
    sent = antenna_field(geometry.departure, links.tx.rotation[found.link], config.pattern, config.polarization)
    received = antenna_field(geometry.arrival, links.rx.rotation[found.link], config.pattern, config.polarization)
    elevation = np.pi / 2 - geometry.theta_t
    tilt = 0.0 if config.polarization == "H" else np.pi / 2
    transfer, a, loss_db = {}, {}, {}
    for weather, by_id in materials.items():
        if air is None or weather not in air:
            loss_db[weather] = {name: np.zeros((len(found), len(config.carriers_hz))) for name in LOSSES}
        else:
            loss_db[weather] = path_loss_db(air[weather], config.carriers_hz, geometry.length, elevation, tilt)
        left = 10.0 ** (-sum(loss_db[weather].values()) / 20.0)
        transfer[weather] = (
            path_transfer(geometry, met, by_id, config.carriers_hz, config.diffraction_model) * left[:, :, None, None]
        )
        columns = [combine(received, transfer[weather][:, c], sent)[:, 0, 0] for c in range(len(config.carriers_hz))]
        a[weather] = np.stack(columns, axis=1)
    return transfer, a, loss_db


def _range_rate(
    scene: DeviceScene, links: Links, table: SurfaceTable, found: TracedPaths, geometry: PathGeometry
) -> np.ndarray:
    """Return d(length)/dt of each path [m/s] from the velocities of both ends and of every point on the way, shape [P].

    Source: first-order Doppler, Sionna RT 2.2 technical report; the bodies are rigid, so the velocity of a point is
    v + w x r.
    """
    rate = -dot(links.tx.velocity[found.link], geometry.departure)
    rate -= dot(links.rx.velocity[found.link], geometry.arrival)
    if not len(table) or not len(scene.instance_actor):
        return rate
    is_there = found.kind != 0
    owner = _looked_up(table.owner, _faces(found, table), is_there)
    path, step = np.nonzero(owner >= 0)
    if len(path):
        rows = np.array([scene.arrays.frame_row(frame) for frame in scene.batch_frames], dtype=np.int64)
        motion = differentiate_rows(scene.arrays.poses, rows)
        slot = links.slot[found.link[path]]
        actor = scene.instance_actor[owner[path, step]]
        arm = found.vertex[path, step] - scene.arrays.poses[rows[slot], actor, :3]
        moving = motion.velocity[slot, actor] + np.cross(motion.world_rate[slot, actor], arm)
        turned = geometry.direction[path, step] - geometry.direction[path, step + 1]
        np.add.at(rate, path, dot(moving, turned))
    return rate
