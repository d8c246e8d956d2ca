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
from dataclasses import dataclass, field

import numpy as np
import warp as wp

from mmw.channel.antennas.arrays import PlanarArray
from mmw.channel.antennas.patterns import PatternName, slant_angles
from mmw.channel.path_solver.candidates import neighbor_stride
from mmw.channel.radio_map.measurement_surface import MeasurementSurface
from mmw.core.bvh import build_bvhs
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.errors import InputError
from mmw.core.transforms import normalize, quaternion_to_matrix, transform_points
from mmw.kernels.channel import radio_map as kernels
from mmw.physics.materials.material import Material
from mmw.physics.materials.permittivity import permittivity_table
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData

BOLTZMANN = 1.380_649e-23
"""Boltzmann constant [J/K], exact (SI of 2019)."""

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
    "dipole": kernels.PATTERN_DIPOLE,
    "hw_dipole": kernels.PATTERN_HW_DIPOLE,
    "tr38901": kernels.PATTERN_TR38901,
}


@dataclass(frozen=True)
class Transmitters:
    """The transmitters of a map."""

    names: tuple[str, ...]
    position: np.ndarray
    """Phase center of the array, world frame [m], shape [T, 3], float64."""
    rotation: np.ndarray
    """Agent-to-world rotation, shape [T, 3, 3], float64; the array may be turned against its agent."""
    power_dbm: np.ndarray
    """Transmit power of each [dBm], shape [T]."""
    array: PlanarArray = field(default_factory=PlanarArray)
    """The array that every transmitter has; its pattern is one of the named ones."""
    precoding: np.ndarray | None = None
    """Weights p of each transmitter's antennas, shape [T, K], complex: the field is h^T p, p not conjugated. Equal
    weights of unit norm if None. The norm of p counts as gain."""

    def __len__(self) -> int:
        return len(self.names)


@dataclass(frozen=True)
class RadioMapConfig:
    """Settings of the computation of a map."""

    carrier_hz: float
    """Carrier frequency [Hz]."""
    samples_per_tx: int = 10_000_000
    """N: rays of each transmitter."""
    max_depth: int = 3
    """Maximum number of reflections (and transmissions) of a ray; 0 is the line of sight."""
    refraction: bool = False
    """Follow transmissions through slabs, too."""
    bandwidth_hz: float = 1e6
    """Bandwidth of the noise [Hz]. Source of this default and the next: Sionna RT 2.2."""
    temperature_k: float = 293.0
    """Temperature of the noise [K]."""


@dataclass(frozen=True)
class RadioMap:
    """A finished map: T transmitters, C cells."""

    transmitters: Transmitters
    surface: MeasurementSurface
    config: RadioMapConfig
    path_gain: np.ndarray
    """Mean power gain to an ideal isotropic receiver, transmit pattern and precoding included, shape [T, C], float64;
    exactly 0 where no ray of the transmitter arrives."""

    @property
    def path_gain_db(self) -> np.ndarray:
        """Path gain [dB], shape [T, C]; -inf where nothing arrives."""
        return _db(self.path_gain)

    @property
    def received_w(self) -> np.ndarray:
        """Received power [W], shape [T, C]; 0 where nothing arrives."""
        return self.path_gain * 10.0 ** ((np.asarray(self.transmitters.power_dbm) - 30.0) / 10.0)[:, None]

    @property
    def rss_dbm(self) -> np.ndarray:
        """Received signal strength [dBm], shape [T, C]; -inf where nothing arrives."""
        return _db(self.received_w) + 30.0

    @property
    def noise_w(self) -> float:
        """Thermal noise k_B T B [W]."""
        return BOLTZMANN * self.config.temperature_k * self.config.bandwidth_hz

    @property
    def sinr_db(self) -> np.ndarray:
        """Signal of each transmitter over noise and all others [dB], shape [T, C]; -inf where nothing of it arrives."""
        power = self.received_w
        others = np.stack([np.delete(power, row, axis=0).sum(axis=0) for row in range(len(power))])
        return _db(power / (others + self.noise_w))

    @property
    def tx_association(self) -> np.ndarray:
        """Transmitter with the most received power, shape [C], int32; -1 where nothing arrives."""
        power = self.received_w
        return np.where(power.max(axis=0) > 0.0, power.argmax(axis=0), -1).astype(np.int32)


def _db(power: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore"):
        return 10.0 * np.log10(power)


def actor_transmitters(
    arrays: SceneData,
    frame: int,
    *,
    role: str = "rsu",
    mount_m: Sequence[float] = (0.0, 0.0, 4.0),
    array: PlanarArray | None = None,
    power_dbm: float = 44.0,
) -> Transmitters:
    """Return the actors of a role that are present in a frame, as transmitters.

    Args:
        arrays: The scene.
        frame: Frame number.
        role: `rsu` or `cav`.
        mount_m: Antenna in the actor's frame [m].
        array: Antennas; one vertical short dipole by default.
        power_dbm: Transmit power of each [dBm]; the default is Sionna RT's.

    Raises:
        InputError: If the scene does not cover the frame, or has no such actor in it.
    """
    pose = arrays.poses[arrays.frame_row(frame)]
    rows = [i for i, actor in enumerate(arrays.actors) if actor.role == role and np.isfinite(pose[i]).all()]
    if not rows:
        raise InputError(
            f"frame {frame}: no actor of role {role!r}; a map needs a transmitter; add one to the scenario"
        )
    return Transmitters(
        names=tuple(arrays.actors[i].name for i in rows),
        position=transform_points(pose[rows], np.asarray(mount_m, dtype=np.float64)),
        rotation=quaternion_to_matrix(normalize(pose[rows, 3:])),
        power_dbm=np.full(len(rows), float(power_dbm)),
        array=array or PlanarArray(),
    )


def radio_map(
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
    run on one device. A crossing flatter than cos(theta) = 2^-16 counts as if it were that steep.

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
    _check(transmitters, config)
    branches = 2**config.max_depth if config.refraction else 1
    weight, norm = _weights(transmitters)
    bits = 62 - 16 - int(np.ceil(np.log2(MAX_ELEMENT_GAIN * transmitters.array.antenna_count)))
    grid = _grid(scene, surface)
    shape = (len(transmitters), len(surface))
    high, low = (wp.zeros(shape, dtype=wp.int64, device=scene.device) for _ in range(2))
    inputs = [
        scene.struct,
        _sources(scene, transmitters, weight, config.carrier_hz),
        _materials(scene, materials, config.carrier_hz),
        grid,
    ]
    launch = kernels.MapLaunch()
    launch.batch_index = batch_index
    launch.ray_count, launch.stride = config.samples_per_tx, neighbor_stride(config.samples_per_tx)
    launch.row_count = -(-config.samples_per_tx // launch.stride)
    launch.max_depth = config.max_depth
    launch.wavenumber = 2.0 * np.pi * config.carrier_hz / SPEED_OF_LIGHT
    launch.scale = 2.0**bits
    threads = launch.row_count * launch.stride
    step = max(1, RAYS_AT_ONCE // (len(transmitters) * branches))
    for first in range(0, threads, step):
        launch.first = first
        wp.launch(
            kernels.map_kernel,
            dim=(len(transmitters), min(step, threads - first), branches),
            inputs=[*inputs, launch],
            outputs=[high, low],
            device=scene.device,
            block_dim=64,
        )
    total = np.ldexp(high.numpy().astype(np.float64), 32 - bits) + np.ldexp(low.numpy().astype(np.float64), -bits)
    wavelength = SPEED_OF_LIGHT / config.carrier_hz
    unit = (wavelength / (4.0 * np.pi)) ** 2 * 4.0 * np.pi / config.samples_per_tx
    return RadioMap(transmitters, surface, config, unit * norm[:, None] ** 2 * total / surface.area)


def _check(transmitters: Transmitters, config: RadioMapConfig) -> None:
    """Raise InputError for what cannot be traced."""
    if not len(transmitters):
        raise InputError("radio map: no transmitter; a map needs at least one; add one")
    if not 1000 <= config.samples_per_tx <= MAX_RAYS:
        raise InputError(f"radio map: samples_per_tx = {config.samples_per_tx}; choose 1000 to {MAX_RAYS:,}")
    limit = MAX_BRANCHING_DEPTH if config.refraction else MAX_DEPTH
    if not 0 <= config.max_depth <= limit:
        raise InputError(
            f"radio map: max_depth = {config.max_depth}; 0 to {limit} is possible "
            f"{'with' if config.refraction else 'without'} transmission; choose a number within"
        )
    if transmitters.array.pattern not in PATTERN_CODES:
        raise InputError(
            f"radio map: its kernel has no pattern table or function; use one of {', '.join(PATTERN_CODES)}"
        )
    segments = 2 ** (config.max_depth + 1) - 1 if config.refraction else config.max_depth + 1
    # A segment crosses each of a cell's two triangles once; the low halves of 2^31 crossings fit into 63 bits.
    if config.samples_per_tx * segments * 2 > 2**31:
        raise InputError(
            f"radio map: {config.samples_per_tx:,} rays of {segments} segments could overflow a cell's sum; "
            f"rays times segments must stay within {2**30:,}; use fewer rays or a smaller depth"
        )
    for name in ("carrier_hz", "bandwidth_hz", "temperature_k"):
        if not 0.0 < getattr(config, name) < np.inf:
            raise InputError(
                f"radio map: {name} = {getattr(config, name):g}; it must be above 0; give a positive number"
            )


def _weights(transmitters: Transmitters) -> tuple[np.ndarray, np.ndarray]:
    """Return precoding weights of unit norm, shape [T, K], and the norms that were taken out, shape [T]."""
    shape = (len(transmitters), transmitters.array.antenna_count)
    given = transmitters.precoding
    weight = (
        np.full(shape, shape[1] ** -0.5, dtype=np.complex128) if given is None else np.asarray(given, np.complex128)
    )
    norm = np.linalg.norm(weight, axis=1) if weight.shape == shape else np.zeros(1)
    if weight.shape != shape or not (np.isfinite(norm) & (norm > 0.0)).all():
        raise InputError(
            f"radio map: precoding of shape {weight.shape}; finite numbers of shape {shape} (transmitters, antennas) "
            "are needed, not all 0 in a row; give one row a transmitter"
        )
    return weight / norm[:, None], norm


def _pairs(values: np.ndarray) -> np.ndarray:
    return np.stack([values.real, values.imag], axis=-1)


def _sources(
    scene: DeviceScene, transmitters: Transmitters, weight: np.ndarray, carrier_hz: float
) -> kernels.MapSources:
    array, device = transmitters.array, scene.device
    offset = array.element_positions(carrier_hz) @ array.rotation * (carrier_hz / SPEED_OF_LIGHT)
    sources = kernels.MapSources()
    sources.position = wp.array(transmitters.position - scene.origin, dtype=wp.vec3d, device=device)
    sources.rotation = wp.array(transmitters.rotation @ array.rotation, dtype=wp.mat33d, device=device)
    sources.weight = wp.array(_pairs(weight), dtype=wp.vec2d, device=device)
    sources.offset = wp.array(offset, dtype=wp.vec3d, device=device)
    slant = np.repeat(slant_angles(array.polarization), array.element_count)
    sources.slant = wp.array(slant, dtype=wp.float64, device=device)
    sources.pattern = int(PATTERN_CODES[array.pattern])
    sources.turns_slant = array.polarization_model == "tr38901_1"
    return sources


def _materials(scene: DeviceScene, materials: tuple[Material, ...], carrier_hz: float) -> kernels.MapMaterials:
    """Return the materials that some face has; the others are NaN."""
    arrays = scene.arrays
    used = np.unique(np.concatenate([arrays.material, *(model.material for model in arrays.models)]))
    permittivity = permittivity_table(materials, [carrier_hz], used)[:, 0]
    thickness = np.array([material.radio.thickness for material in materials], dtype=np.float64)
    scattering = np.array([material.radio.scattering for material in materials], dtype=np.float64)
    result = kernels.MapMaterials()
    result.permittivity = wp.array(_pairs(permittivity), dtype=wp.vec2d, device=scene.device)
    result.thickness = wp.array(thickness, dtype=wp.float64, device=scene.device)
    result.specular = wp.array(np.sqrt(1.0 - scattering**2), dtype=wp.float64, device=scene.device)
    return result


def _grid(scene: DeviceScene, surface: MeasurementSurface) -> kernels.MapGrid:
    faces = surface.faces
    corners = (surface.corners.reshape(-1, 3) - scene.origin).astype(np.float32)[faces]
    across = np.cross(*np.moveaxis(corners[:, 1:].astype(np.float64) - corners[:, :1], 1, 0))
    grid = kernels.MapGrid()
    grid.tree, _ = build_bvhs([corners], scene.device)
    grid.normal = wp.array(across / np.linalg.norm(across, axis=1, keepdims=True), dtype=wp.vec3d, device=scene.device)
    grid.cell = wp.array(np.arange(len(faces), dtype=np.int32) // 2, dtype=wp.int32, device=scene.device)
    return grid
