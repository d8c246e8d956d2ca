"""Find the paths of satellites to receivers, by the path solver that finds the paths of radio links.

A satellite is a point far along its direction. The receiver takes the role of the transmitter, since the rays that look
for reflections start there: one launch serves all satellites, and gains are the same in both directions. Lengths are
those of a plane wave: the parts between receiver and last interaction, less what that interaction is nearer to the
satellite. A path of the solver is stationary, so its points at a finite distance change this by a second-order term
only, 2 mm for a reflection that is 100 m away at an image 200 m beside the direction.
"""

from dataclasses import dataclass

import numpy as np

from mmw.channel.antennas.link_elements import configured_elements
from mmw.channel.links import Links
from mmw.channel.path_solver.solver import path_gains, trace_links
from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.channel.paths import PATH_LOS, PathSet
from mmw.config import ChannelConfig
from mmw.core.transforms import quaternion_to_matrix
from mmw.physics.em.vectors import dot, norm
from mmw.physics.materials.material import Material
from mmw.scene.device_scene import DeviceScene
from mmw.scene.mounted_antennas import RadioDevices
from mmw.scene.views import Views
from mmw.sensors.gnss.code_tracking import CARRIER_HZ, SignalPaths
from mmw.sensors.gnss.config import Gnss

DISTANCE_M = 50e3
"""Distance at which the solver has a satellite [m]: far against a town, and near enough that the ends of a path which
are not searched for obstacles, 6e-6 of a segment, stay at 0.3 m."""

RIGHT, LEFT = np.array([1.0, -1.0j]) / np.sqrt(2.0), np.array([1.0, 1.0j]) / np.sqrt(2.0)
"""Circular polarizations of transmitted waves in the basis (theta, phi), e^{+jwt}."""


@dataclass(frozen=True)
class Sightings:
    """Satellites above the mask, one row a view and satellite; N rows."""

    view: np.ndarray
    """Row of the view, shape [N]."""
    satellite: np.ndarray
    """Number of the satellite, a row of `SLOT_NAMES`, shape [N]."""
    direction: np.ndarray
    """Unit vector from the receiver to the satellite, world frame, shape [N, 3]."""

    def __len__(self) -> int:
        return len(self.view)


def channel_config(config: Gnss) -> ChannelConfig:
    """Return the settings of the path solver."""
    return ChannelConfig(
        carriers_hz=(CARRIER_HZ,),
        physics=config.physics,
        max_depth=config.max_depth,
        samples_per_tx=config.samples_per_tx,
    )


def satellite_paths(
    scene: DeviceScene,
    views: Views,
    velocity: np.ndarray,
    sightings: Sightings,
    config: Gnss,
    materials: dict[str, tuple[Material, ...]],
    table: SurfaceTable,
) -> PathSet:
    """Return the paths from receivers to satellites, one link a sighting, in every weather.

    Args:
        scene: The scene as the radio channel meets it, with the views' frames loaded.
        views: Poses of the receivers.
        velocity: Velocity of each receiver [m/s], shape [A, 3].
        sightings: The satellites.
        config: Depth, rays and physics.
        materials: Weather -> materials by id.
        table: Surfaces of the scene.

    Raises:
        InputError: If a material on a path has no permittivity at L1.
    """
    channel = channel_config(config)
    row, count = sightings.view, len(sightings)
    place = views.pose[row, :3]
    none = np.zeros(count, dtype=np.int32)
    still = np.zeros((count, 3))
    links = Links(
        frame=views.frame[row].astype(np.int32),
        batch_index=views.batch_index[row].astype(np.int32),
        kind=none.astype(np.int8),
        tx_actor=views.actor[row].astype(np.int32),
        rx_actor=(len(scene.arrays.actors) + sightings.satellite).astype(np.int32),
        tx_antenna=none,
        rx_antenna=none,
        tx=RadioDevices(place, quaternion_to_matrix(views.pose[row, 3:]), velocity[row]),
        rx=RadioDevices(place + DISTANCE_M * sightings.direction, np.tile(np.eye(3), (count, 1, 1)), still),
    )
    trace = trace_links(scene, links, channel, table, is_reciprocal=False)
    return path_gains(trace, channel, materials, None, configured_elements(channel, links))


def excess_lengths(paths: PathSet, place: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Return the length of each path of a plane wave beyond that of the straight line [m], shape [P].

    Args:
        paths: The paths, receivers as transmitters.
        place: Receiver of each link [m], shape [N, 3].
        direction: Unit vector to the satellite of each link, shape [N, 3].
    """
    start = place[paths.link]
    length, before = np.zeros(len(paths)), start
    for k in range(paths.vertex.shape[1]):
        at = np.where((k < paths.order)[:, None], paths.vertex[:, k], before)
        length += norm(at - before)
        before = at
    return length - dot(before - start, direction[paths.link])


def antenna_fields(paths: PathSet, axis: np.ndarray, config: Gnss) -> np.ndarray:
    """Return the field of the receiving antenna toward each path, in the world's (theta, phi), shape [P, 2].

    A cardioid about the antenna's axis, (1 + cos) / 2, right-handed and with a left-handed part by the axial ratio.

    Args:
        paths: The paths, receivers as transmitters.
        axis: Axis of the antenna of each link, world frame, shape [N, 3].
        config: The axial ratio.
    """
    sine = np.sin(paths.theta_t)
    away = np.stack([sine * np.cos(paths.phi_t), sine * np.sin(paths.phi_t), np.cos(paths.theta_t)], axis=1)
    gain = 0.5 * (1.0 + dot(away, axis[paths.link]))
    ratio = 10.0 ** (config.axial_ratio_db / 20.0)
    return gain[:, None] * (RIGHT + (ratio - 1.0) / (ratio + 1.0) * LEFT)


def signal_paths(
    paths: PathSet, weather: str, views: Views, sightings: Sightings, config: Gnss
) -> tuple[SignalPaths, np.ndarray]:
    """Return what arrives behind the antenna in a weather, and whether each satellite is in sight, shape [N], bool.

    Args:
        paths: From `satellite_paths`.
        weather: The weather.
        views: Poses of the receivers.
        sightings: The satellites.
        config: The antenna.
    """
    row = sightings.view
    axis = quaternion_to_matrix(views.pose[row, 3:])[..., 2]
    excess = excess_lengths(paths, views.pose[row, :3], sightings.direction)
    # Without the spreading of the whole path, which is that of the straight line.
    scale = 4.0 * np.pi * paths.tau * CARRIER_HZ
    field = antenna_fields(paths, axis, config)
    amplitude = scale * np.sum(paths.transfer[weather][:, 0] * RIGHT[:, None] * field[:, None, :], axis=(1, 2))
    found = SignalPaths(paths.count, amplitude, excess, paths.range_rate)
    is_los = np.zeros(len(sightings), dtype=bool)
    is_los[paths.link[paths.kind == PATH_LOS]] = True
    return found, is_los
