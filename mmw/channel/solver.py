"""Paths of every link of a batch, with gains for all weathers and carriers of one trace."""

import numpy as np

from mmw.channel.antennas import antenna_field
from mmw.channel.field import PathGeometry, combine, path_geometry, polarimetric_transfer
from mmw.channel.finder import FoundPaths, find_paths
from mmw.channel.links import Links
from mmw.channel.materials import permittivity_table
from mmw.channel.paths import PATH_LOS, PATH_SPECULAR, Paths
from mmw.channel.surface_table import SurfaceTable, make_surface_table
from mmw.channel.vectors import dot
from mmw.config import ChannelConfig
from mmw.constants import SPEED_OF_LIGHT
from mmw.materials import Material
from mmw.scene import Scene
from mmw.sensors.kinematics import differentiate_rows


def check_channel_materials(
    scene_materials: dict[str, tuple[Material, ...]], used: np.ndarray, config: ChannelConfig
) -> None:
    """Raise if a used material of any weather has no data at a configured carrier.

    Args:
        scene_materials: Weather -> materials by id.
        used: Material ids that some face has.
        config: The carriers.

    Raises:
        ValueError: Naming material, weather, frequency and the ranges that exist.
    """
    for weather, materials in scene_materials.items():
        try:
            permittivity_table(materials, config.carriers_hz, used)
        except ValueError as error:
            raise ValueError(f"channel.carriers_hz, weather {weather}: {error}") from None


def solve_paths(
    scene: Scene,
    links: Links,
    config: ChannelConfig,
    materials: dict[str, tuple[Material, ...]],
    table: SurfaceTable | None = None,
) -> Paths:
    """Return the line of sight and all first-order specular paths of the links, for every weather and carrier.

    Geometry is found once: weather only changes materials. Neither the batch nor the device changes the set of paths.

    Args:
        scene: The scene with the batch of the links loaded.
        links: Links whose `slot` is a slot of the scene's batch.
        config: Carriers, rays, candidate mode, depth, pattern and polarisation.
        materials: Weather -> materials by id, for the weathers that are wanted.
        table: Surfaces of the scene, from `make_surface_table`; made here when not given.

    Returns:
        The paths, sorted by (link, kind, surface).

    Raises:
        ValueError: If a material has no permittivity at a carrier, or a link's frame is not in its slot of the scene.

    Source: image method with ray-launched candidates, first order; frequencies and angles as in `docs/channel.md`.
    """
    loaded = np.array(scene.batch_frames, dtype=np.int64)
    is_loaded = links.slot < len(loaded)
    is_loaded[is_loaded] = loaded[links.slot[is_loaded]] == links.frame[is_loaded]
    if not is_loaded.all():
        row = int(np.argmin(is_loaded))
        raise ValueError(
            f"link {row}: frame {links.frame[row]} in slot {links.slot[row]}; the scene holds frames "
            f"{list(scene.batch_frames[:8])}; call load_batch with the frames that the links were made for"
        )
    table = make_surface_table(scene) if table is None else table
    check_channel_materials(materials, np.unique(table.material_id), config)
    found = find_paths(scene, links, config, table)
    tx, rx = links.tx.position[found.link], links.rx.position[found.link]
    geometry = path_geometry(tx, rx, found.vertex, found.normal)
    is_reflected = found.surface >= 0
    surface = np.where(is_reflected, found.surface, 0)
    if len(table):
        material_id = np.where(is_reflected, table.material_id[surface], -1)
        object_id = np.where(is_reflected, table.object_id[surface], -1)
    else:
        material_id = object_id = np.full(len(surface), -1)
    transfer, a = _gains(links, config, materials, found.link, geometry, material_id)
    return Paths(
        carriers_hz=np.array(config.carriers_hz),
        link=found.link,
        kind=np.where(is_reflected, PATH_SPECULAR, PATH_LOS).astype(np.int8),
        surface=found.surface,
        object_id=object_id.astype(np.int32),
        material_id=material_id.astype(np.int32),
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
    )


def _gains(
    links: Links,
    config: ChannelConfig,
    materials: dict[str, tuple[Material, ...]],
    link: np.ndarray,
    geometry: PathGeometry,
    material_id: np.ndarray,
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return transfer [P, C, 2, 2] and coefficient [P, C] of every weather."""
    sent = antenna_field(geometry.departure, links.tx.rotation[link], config.pattern, config.polarization)
    received = antenna_field(geometry.arrival, links.rx.rotation[link], config.pattern, config.polarization)
    transfer, a = {}, {}
    is_reflected, used = material_id >= 0, np.unique(material_id[material_id >= 0])
    row = np.where(is_reflected, material_id, 0)
    for weather, by_id in materials.items():
        permittivity = permittivity_table(by_id, config.carriers_hz, used)
        thickness = np.array([material.radio.thickness for material in by_id] or [0.0])
        scattering = np.array([material.radio.scattering for material in by_id] or [0.0])
        transfer[weather] = np.zeros((len(link), len(config.carriers_hz), 2, 2), dtype=np.complex128)
        a[weather] = np.zeros((len(link), len(config.carriers_hz)), dtype=np.complex128)
        for column, carrier in enumerate(config.carriers_hz):
            eta = permittivity[row, column] if len(by_id) else np.ones(len(link), dtype=np.complex128)
            matrix = polarimetric_transfer(geometry, is_reflected, eta, thickness[row], scattering[row], carrier)
            transfer[weather][:, column] = matrix
            a[weather][:, column] = combine(received, matrix, sent)[:, 0, 0]
    return transfer, a


def _range_rate(
    scene: Scene, links: Links, table: SurfaceTable, found: FoundPaths, geometry: PathGeometry
) -> np.ndarray:
    """Return d(length)/dt of each path [m/s] from the velocities of both ends and of the reflecting point, shape [P].

    Source: first-order Doppler, Sionna RT 2.2 technical report; the reflecting body is rigid, so the velocity of its
    point is v + w x r.
    """
    rate = -dot(links.tx.velocity[found.link], geometry.departure)
    rate -= dot(links.rx.velocity[found.link], geometry.arrival)
    path = np.nonzero(found.surface >= 0)[0]
    path = path[table.owner[found.surface[path]] >= 0] if len(path) else path
    if len(path):
        rows = np.array([scene.arrays.frame_row(frame) for frame in scene.batch_frames], dtype=np.int64)
        motion = differentiate_rows(scene.arrays.poses, rows)
        slot = links.slot[found.link[path]]
        actor = scene.instance_actor[table.owner[found.surface[path]]]
        arm = found.vertex[path] - scene.arrays.poses[rows[slot], actor, :3]
        moving = motion.velocity[slot, actor] + np.cross(motion.world_rate[slot, actor], arm)
        rate[path] += dot(moving, geometry.departure[path] + geometry.arrival[path])
    return rate
