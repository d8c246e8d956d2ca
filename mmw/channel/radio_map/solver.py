"""Solve radio maps: the paths from every transmitter to points of every cell, by the code of links.

The gain of a point is the power that an ideal isotropic receiver, which takes both polarizations, gets from all paths,
summed without regard to their phases:

    g = sum over paths of  |T h^T p|^2

with T the 2x2 transfer of a path, losses of the air included, and h^T p the field of the transmitter's array. The gain
of a cell is the mean over its points.
"""

from collections.abc import Iterator

import numpy as np

from mmw.channel.antennas.arrays import ElementArray
from mmw.channel.antennas.link_elements import EndElements, LinkElements
from mmw.channel.antennas.patterns import antenna_field
from mmw.channel.antennas.spherical_response import ArrayEnd, transmit_phasors
from mmw.channel.antennas.wavefronts import MAX_PLANE_WAVE_ERROR_RAD, Wavefronts, find_wavefronts
from mmw.channel.links import Links
from mmw.channel.path_solver.solver import check_channel_materials, path_gains, trace_links
from mmw.channel.path_solver.surface_table import SurfaceTable, make_surface_table
from mmw.channel.path_table import samples_from_paths
from mmw.channel.radio_map.cell_points import grid_in_cells
from mmw.channel.radio_map.measurement_surface import MeasurementSurface
from mmw.channel.radio_map.radio_map import RadioMap, RadioMapConfig
from mmw.channel.radio_map.transmitters import Transmitters
from mmw.config import ChannelConfig
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.errors import InputError
from mmw.core.spatial_order import spatial_order
from mmw.physics.em.vectors import unit_vector
from mmw.physics.materials.material import Material
from mmw.physics.materials.permittivity import log_extrapolations
from mmw.physics.weather.weather import Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.mounted_antennas import RadioDevices

LINKS_AT_ONCE = 2**16
"""Maximum number of links that are traced together; about 10 kB each at depth 3."""

DIFFRACTED_LINKS_AT_ONCE = 2**11
"""The same with diffraction, which finds some hundred paths a link in a town."""

SCATTERED_ROWS_AT_ONCE = 2**22
"""Maximum number of (link, ray, interaction) rows of diffuse reflection that are traced together."""

PHASES_AT_ONCE = 2**23
"""Maximum number of (path, element) pairs whose phases are held together, 16 bytes each."""

MIN_LINKS_AT_ONCE = 64
"""Links that are traced together whatever they cost."""


def solve_radio_map(
    scene: DeviceScene,
    batch_index: int,
    transmitters: Transmitters,
    surface: MeasurementSurface,
    config: RadioMapConfig,
    materials: tuple[Material, ...],
    air: Weather | None = None,
    table: SurfaceTable | None = None,
) -> RadioMap:
    """Return the path gain of every transmitter in every cell.

    Args:
        scene: Town and vehicles, with a batch loaded.
        batch_index: Position of the frame in that batch.
        transmitters: T transmitters.
        surface: C cells.
        config: Paths, carrier, and points of a cell.
        materials: Materials by id, of the weather that is wanted.
        air: State of the air in that weather; None for air without losses.
        table: Surfaces of the scene, from `make_surface_table`; made here when not given.

    Raises:
        InputError: If index, transmitters or configuration cannot be used, a material has no data at the carrier, or
            there are too many candidates.
    """
    if not 0 <= batch_index < scene.batch_size:
        raise InputError(
            f"batch_index {batch_index}: the scene holds {scene.batch_size} frames; load the frame, then give its index"
        )
    config.check()
    channel = config.channel
    if table is None:
        table = make_surface_table(scene, **channel.surface_options)
    check_channel_materials({"": materials}, table.used_materials, channel)
    log_extrapolations(materials, channel.carriers_hz, table.used_materials)
    points = grid_in_cells(surface, config.points_per_cell)
    order = spatial_order(points)  # the path solver tests blocks of links that are near each other
    frame = int(scene.batch_frames[batch_index])
    path_gain = np.empty((len(transmitters), len(surface)))
    for row in range(len(transmitters)):
        gain, array = np.empty(len(points)), transmitters.arrays[row]
        for part in _portions(len(points), channel):
            links = _links(transmitters, row, points[order[part]], frame, batch_index)
            trace = trace_links(scene, links, channel, table, is_reciprocal=False)
            end = EndElements((array,), np.zeros(len(links), dtype=np.int32))  # that of the receiver is not used
            paths = path_gains(
                trace, channel, {"": materials}, None if air is None else {"": air}, LinkElements(end, end)
            )
            departure = unit_vector(paths.theta_t, paths.phi_t)
            waves = None
            if array.element_count > 1:
                waves = find_wavefronts(samples_from_paths(links, paths, "", 0))
            turn, weights = transmitters.rotation[row], transmitters.weights[row]
            field = precoded_field(array, turn, weights, departure, config.carrier_hz, waves)
            arriving = np.einsum("pij,pj->pi", paths.transfer[""][:, 0], field)
            power = (np.abs(arriving) ** 2).sum(axis=1)
            gain[order[part]] = np.bincount(paths.link, power, minlength=len(links))
        path_gain[row] = gain.reshape(len(surface), -1).mean(axis=1)
    return RadioMap(transmitters, surface, config, path_gain)


def _portions(count: int, channel: ChannelConfig) -> Iterator[slice]:
    """Yield ranges of the links of a transmitter that keep memory bounded."""
    step = DIFFRACTED_LINKS_AT_ONCE if channel.diffraction else LINKS_AT_ONCE
    if channel.diffuse_reflection:
        step = min(step, SCATTERED_ROWS_AT_ONCE // (channel.expected_diffuse_rays * max(channel.max_depth, 1)))
    step = max(step, MIN_LINKS_AT_ONCE)
    for begin in range(0, count, step):
        yield slice(begin, min(begin + step, count))


def _links(transmitters: Transmitters, row: int, points: np.ndarray, frame: int, batch_index: int) -> Links:
    """Return the links from a transmitter to points [m], shape [L, 3]."""
    count = len(points)
    zeros = np.zeros(count, dtype=np.int32)

    def end(position: np.ndarray, rotation: np.ndarray) -> RadioDevices:
        shape = (count, 3)
        return RadioDevices(
            np.broadcast_to(position, shape), np.broadcast_to(rotation, (*shape, 3)), np.broadcast_to(0.0, shape)
        )

    return Links(
        frame=np.full(count, frame, dtype=np.int32),
        batch_index=np.full(count, batch_index, dtype=np.int32),
        kind=np.zeros(count, dtype=np.int8),
        tx_actor=zeros,
        rx_actor=np.arange(1, count + 1, dtype=np.int32),
        tx_antenna=zeros,
        rx_antenna=zeros,
        tx=end(transmitters.position[row], transmitters.rotation[row]),
        rx=end(points, np.eye(3)),
    )


def precoded_field(
    array: ElementArray,
    rotation: np.ndarray,
    weights: np.ndarray,
    direction: np.ndarray,
    carrier_hz: float,
    waves: Wavefronts | None = None,
) -> np.ndarray:
    """Return the field h^T p of an array in directions, in the world's basis, as at its phase center.

    Args:
        array: The array.
        rotation: Agent-to-world rotation, shape [3, 3].
        weights: Weight p of each antenna, not conjugated, shape [K].
        direction: Unit directions, world frame, shape [P, 3].
        carrier_hz: Carrier frequency [Hz].
        waves: Waves of the paths in these directions: in the near field of the array they are spherical, see
            `mmw.channel.apply_arrays`. None for the far field.

    Returns:
        Components (theta, phi), shape [P, 2], complex128.

    Source: 3GPP TR 38.901 section 7.3 for the elements; phases exp(+j 2 pi k . d / lambda) as in Sionna RT 2.2.
    """
    rows = max(1, PHASES_AT_ONCE // array.element_count)
    if len(direction) > rows:
        parts = [slice(begin, begin + rows) for begin in range(0, len(direction), rows)]
        return np.concatenate([
            precoded_field(array, rotation, weights, direction[part], carrier_hz, waves and waves.take(part))
            for part in parts
        ])  # fmt: skip
    turn = np.broadcast_to(rotation @ array.rotation, (len(direction), 3, 3))
    field = antenna_field(direction, turn, array.pattern, array.polarization, array.polarization_model)
    offset = array.element_positions(carrier_hz)[: array.element_count] @ rotation.T
    phase = np.exp(2j * np.pi * carrier_hz / SPEED_OF_LIGHT * np.einsum("px,ex->pe", direction, offset))
    if waves is not None:
        offset = array.element_positions(carrier_hz)[: array.element_count]
        end = ArrayEnd(offset, np.broadcast_to(rotation, (len(direction), 3, 3)))
        near = np.flatnonzero(waves.plane_wave_error(end.radius, 0.0, carrier_hz) > MAX_PLANE_WAVE_ERROR_RAD)
        phase[near] = transmit_phasors(waves.take(near), end.take(near), carrier_hz)
    by_polarization = weights.reshape(-1, array.element_count)  # antenna n = p E + e
    return np.einsum("psx,ps->px", field, np.einsum("pe,se->ps", phase, by_polarization))
