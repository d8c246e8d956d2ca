"""Solve radio maps: mean path gain of every transmitter over every cell of a surface, RSS, SINR and association.

The gain of a cell is the mean over its area of the power that an ideal isotropic receiver gets from all paths,
summed without regard to their phases:

    g = (lambda / 4 pi)^2 / A  sum over crossings of  |E|^2 dOmega / cos(theta),   dOmega = 4 pi / N

with E the field of a ray without spreading (`kernels/channel/radio_map.py`), theta the angle between ray and cell
normal, and A the area of the cell. For the line of sight that is (lambda / 4 pi r)^2 |F_t|^2, since a cell covers A
cos(theta) / r^2 of solid angle. N rays leave each transmitter on a Fibonacci lattice, so no random number is drawn.

Source: radio maps by shooting and bouncing rays, as in Sionna RT 2.2 (technical report, "radio map solver").
"""

from collections.abc import Sequence

import numpy as np
import warp as wp

from mmw.channel.antennas.arrays import PlanarArray
from mmw.channel.antennas.patterns import PatternName, slant_angles
from mmw.channel.path_solver.candidates import neighbor_stride
from mmw.channel.radio_map.measurement_surface import MeasurementSurface
from mmw.channel.radio_map.radio_map import RadioMap, RadioMapConfig
from mmw.channel.radio_map.sampled_patterns import pattern_table
from mmw.channel.radio_map.transmitters import Transmitters
from mmw.core.bvh import build_bvhs
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.errors import InputError
from mmw.kernels.channel import radio_map as kernels
from mmw.kernels.channel import transmitted_field as fields
from mmw.physics.materials.material import Material
from mmw.physics.materials.permittivity import log_extrapolations, permittivity_table
from mmw.scene.device_scene import DeviceScene

RAYS_AT_ONCE = 2**22
"""Maximum number of rays of one kernel launch; it changes no byte of a map."""

MAX_RAYS = 2**26
"""Maximum number of rays of a transmitter."""

MAX_DEPTH = 30
"""Maximum number of interactions of a ray."""

MAX_BRANCHING_DEPTH = 8
"""Maximum number of interactions of a ray with transmission, where every one doubles the branches."""

MAX_ELEMENT_GAIN = 8.0
"""No element of `mmw.channel.antennas.patterns` has more gain than this (tr38901: 8 dBi = 6.3)."""

PATTERN_CODES: dict[PatternName, int] = {
    "iso": 0,
    "dipole": fields.PATTERN_DIPOLE,
    "hw_dipole": fields.PATTERN_HW_DIPOLE,
    "tr38901": fields.PATTERN_TR38901,
}


def solve_radio_map(
    scene: DeviceScene,
    batch_index: int,
    transmitters: Transmitters,
    surface: MeasurementSurface,
    config: RadioMapConfig,
    materials: tuple[Material, ...],
) -> RadioMap:
    """Return the path gain of every transmitter in every cell.

    Power is summed in whole steps of 2^-43 (one element; 2^-(43 - log2 K) with K antennas) of the power that one
    isotropic ray without losses leaves at right angles, so the same bytes come out for every launch shape and every
    run on one device. Of a pattern table, the step is relative to its peak. A crossing flatter than
    cos(theta) = 2^-16 counts as if it were that steep.

    Args:
        scene: Town and vehicles, with a batch loaded.
        batch_index: Position of the frame in that batch.
        transmitters: T transmitters.
        surface: C cells.
        config: Carrier, rays and depth.
        materials: Materials by id, of the weather that is wanted.

    Raises:
        InputError: If index, transmitters or configuration cannot be used, or a material has no data at the carrier.
    """
    if not 0 <= batch_index < scene.batch_size:
        raise InputError(
            f"batch_index {batch_index}: the scene holds {scene.batch_size} frames; load the frame, then give its index"
        )
    check_samples(config.samples_per_tx, config.max_depth, config.refraction)
    for name in ("carrier_hz", "bandwidth_hz", "temperature_k"):
        if not 0.0 < getattr(config, name) < np.inf:
            raise InputError(
                f"radio map: {name} = {getattr(config, name):g}; it must be above 0; give a positive number"
            )
    inputs = [scene.struct, _materials(scene, materials, config.carrier_hz), _grid(scene, surface)]
    path_gain = np.zeros((len(transmitters), len(surface)))
    wavelength = SPEED_OF_LIGHT / config.carrier_hz
    unit = (wavelength / (4.0 * np.pi)) ** 2 * 4.0 * np.pi / config.samples_per_tx
    for rows in transmitters.rows_by_array():
        weight = np.stack([transmitters.weights[row] for row in rows])
        norm = np.linalg.norm(weight, axis=1)
        array = transmitters.arrays[rows[0]]
        sources, peak = map_sources(scene, transmitters, rows, array, weight / norm[:, None], config.carrier_hz)
        bits = 62 - 16 - int(np.ceil(np.log2(MAX_ELEMENT_GAIN * array.antenna_count)))
        total = _trace(inputs, sources, (len(rows), len(surface)), batch_index, config, bits)
        path_gain[rows] = unit * (peak * norm[:, None]) ** 2 * total / surface.area
    return RadioMap(transmitters, surface, config, path_gain)


def check_samples(samples_per_tx: int, max_depth: int, refraction: bool) -> None:
    """Check how many rays of which depth are followed.

    Raises:
        InputError: If a number is out of range or not whole, or a cell's sum could overflow.
    """
    for name, value in (("samples_per_tx", samples_per_tx), ("max_depth", max_depth)):
        if not isinstance(value, int | np.integer):
            raise InputError(f"radio map: {name} = {value!r}; a whole number is needed, such as int(1e7); correct it")
    if not 1000 <= samples_per_tx <= MAX_RAYS:
        raise InputError(f"radio map: samples_per_tx = {samples_per_tx}; choose 1000 to {MAX_RAYS:,}")
    limit = MAX_BRANCHING_DEPTH if refraction else MAX_DEPTH
    if not 0 <= max_depth <= limit:
        raise InputError(
            f"radio map: max_depth = {max_depth}; 0 to {limit} is possible {'with' if refraction else 'without'} "
            "transmission; choose a number within"
        )
    segments = 2 ** (max_depth + 1) - 1 if refraction else max_depth + 1
    # A segment crosses each of a cell's two triangles once; the low halves of 2^31 crossings fit into 63 bits.
    if samples_per_tx * segments * 2 > 2**31:
        raise InputError(
            f"radio map: {samples_per_tx:,} rays of {segments} segments could overflow a cell's sum; "
            f"rays times segments must stay within {2**30:,}; use fewer rays or a smaller depth"
        )


def _trace(
    inputs: Sequence[object],
    sources: fields.MapSources,
    shape: tuple[int, int],
    batch_index: int,
    config: RadioMapConfig,
    bits: int,
) -> np.ndarray:
    """Return the sum of |E|^2 / cos(theta) in every cell, shape [T, C], of transmitters with one kind of array."""
    scene, materials, grid = inputs
    branches, device = 2**config.max_depth if config.refraction else 1, sources.position.device
    high, low = (wp.zeros(shape, dtype=wp.int64, device=device) for _ in range(2))
    launch = kernels.MapLaunch()
    launch.batch_index = batch_index
    launch.ray_count, launch.stride = config.samples_per_tx, neighbor_stride(config.samples_per_tx)
    launch.row_count = -(-config.samples_per_tx // launch.stride)
    launch.max_depth = config.max_depth
    launch.wavenumber = 2.0 * np.pi * config.carrier_hz / SPEED_OF_LIGHT
    launch.scale = 2.0**bits
    threads = launch.row_count * launch.stride
    step = max(1, RAYS_AT_ONCE // (shape[0] * branches))
    for first in range(0, threads, step):
        launch.first = first
        wp.launch(
            kernels.map_kernel,
            dim=(shape[0], min(step, threads - first), branches),
            inputs=[scene, sources, materials, grid, launch],
            outputs=[high, low],
            device=device,
            block_dim=64,
        )
    return np.ldexp(high.numpy().astype(np.float64), 32 - bits) + np.ldexp(low.numpy().astype(np.float64), -bits)


def _pairs(values: np.ndarray) -> np.ndarray:
    return np.stack([values.real, values.imag], axis=-1)


def map_sources(
    scene: DeviceScene,
    transmitters: Transmitters,
    rows: np.ndarray,
    array: PlanarArray,
    weight: np.ndarray,
    carrier_hz: float,
) -> tuple[fields.MapSources, float]:
    """Return transmitters with one kind of array on the device, and the amplitude that was taken out of its pattern."""
    device, peak = scene.device, 1.0
    offset = array.element_positions(carrier_hz) @ array.rotation * (carrier_hz / SPEED_OF_LIGHT)
    sources = fields.MapSources()
    sources.position = wp.array(transmitters.position[rows] - scene.origin, dtype=wp.vec3d, device=device)
    sources.rotation = wp.array(transmitters.rotation[rows] @ array.rotation, dtype=wp.mat33d, device=device)
    sources.weight = wp.array(_pairs(weight), dtype=wp.vec2d, device=device)
    sources.offset = wp.array(offset, dtype=wp.vec3d, device=device)
    slant = np.repeat(slant_angles(array.polarization), array.element_count)
    sources.slant = wp.array(slant, dtype=wp.float64, device=device)
    sources.turns_slant = array.polarization_model == "tr38901_1"
    if isinstance(array.pattern, str):
        sources.pattern = int(PATTERN_CODES[array.pattern])
        return sources, peak
    table = pattern_table(array.pattern)
    values = np.concatenate([_pairs(table.c_theta), _pairs(np.asarray(table.c_phi))], axis=-1)
    peak = float(np.linalg.norm(values, axis=-1).max()) or 1.0
    sources.pattern = int(fields.PATTERN_TABLE)
    sources.table = wp.array(values / peak, dtype=wp.vec4d, device=device)
    sources.table_theta = wp.array(table.theta, dtype=wp.float64, device=device)
    around = np.append(table.phi - table.phi[0], 2.0 * np.pi)
    sources.table_phi = wp.array(around, dtype=wp.float64, device=device)
    sources.table_start = float(table.phi[0])
    return sources, peak


def _materials(scene: DeviceScene, materials: tuple[Material, ...], carrier_hz: float) -> kernels.MapMaterials:
    """Return the materials that some face has; the others are NaN."""
    arrays = scene.arrays
    used = np.unique(np.concatenate([arrays.material, *(model.material for model in arrays.models)]))
    permittivity = permittivity_table(materials, [carrier_hz], used)[:, 0]
    log_extrapolations(materials, [carrier_hz], used)
    thickness = np.array([material.radio.thickness for material in materials], dtype=np.float64)
    scattering = np.array([material.radio.scattering for material in materials], dtype=np.float64)
    result = kernels.MapMaterials()
    result.permittivity = wp.array(_pairs(permittivity), dtype=wp.vec2d, device=scene.device)
    result.thickness = wp.array(thickness, dtype=wp.float64, device=scene.device)
    result.specular = wp.array(np.sqrt(1.0 - scattering**2), dtype=wp.float64, device=scene.device)
    return result


def _grid(scene: DeviceScene, surface: MeasurementSurface) -> kernels.MapGrid:
    corners = (surface.corners.reshape(-1, 3) - scene.origin).astype(np.float32)[surface.faces]
    across = np.cross(*np.moveaxis(corners[:, 1:].astype(np.float64) - corners[:, :1], 1, 0))
    size = np.linalg.norm(
        across, axis=1, keepdims=True
    )  # 0 for a sliver that float32 does not resolve: no ray meets it
    grid = kernels.MapGrid()
    grid.tree, _ = build_bvhs([corners], scene.device)
    grid.normal = wp.array(across / np.where(size > 0.0, size, 1.0), dtype=wp.vec3d, device=scene.device)
    grid.cell = wp.array(surface.cell_of_face, dtype=wp.int32, device=scene.device)
    return grid
