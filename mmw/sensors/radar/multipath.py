"""Trace multipath of a radar once a batch, and evaluate its echoes in every weather."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.core.transfer import to_host
from mmw.kernels.radar import bounce_paths, echo_paths
from mmw.kernels.radar import trace as radar
from mmw.physics.materials.material import Material
from mmw.physics.weather.weather import Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.views import Views
from mmw.sensors.radar.config import Radar
from mmw.sensors.radar.mirrors import mirror_table
from mmw.sensors.radar.resolution_cells import cell_grid
from mmw.sensors.radar.trace import radar_grid, radar_link, shade_radar, surfaces_on_device
from mmw.sensors.ray_batch import BLOCK_DIM, check_count, empty_struct

ECHOES = {"none": 1, "ground": 4, "full": 7}
"""Echoes of a ray by `Radar.multipath`: the direct one, and three for each mirror."""


@dataclass(frozen=True)
class TracedPaths:
    """Phases of the direct echoes, and paths over mirrors, of a batch: geometry only, so it serves every weather."""

    turns: wp.array
    """Phase of each ray's direct echo in turns, shape [A, R]."""
    bounces: tuple[bounce_paths.BouncePaths, ...]
    """Legs over the ground to the target of each ray, and, for `full`, to what a ray meets after a reflection where it
    hits; empty without multipath."""
    mirror_ids: tuple[int, ...]
    """Materials of all mirrors."""


@dataclass(frozen=True)
class PlacedPaths:
    """Positions of the echoes of all paths, and which paths interfere: the same in every weather."""

    rays: radar.RadarRays
    """Positions, objects and path types, shape [A, N], with N = `ECHOES` x R; the rest has no arrays yet."""
    mirrors: tuple[tuple[bounce_paths.BouncePaths, echo_paths.PathColumns, wp.array], ...]
    """Paths, columns and leads of each kind of mirror: the ground first."""


def trace_paths(scene: DeviceScene, views: Views, velocity: np.ndarray, config: Radar, keys: np.ndarray) -> TracedPaths:
    """Trace the rays of `mmw.sensors.radar.trace.trace_radar` on: over the ground, and after a mirror reflection.

    The ground is what the town has of nearly level surfaces; it mirrors what a ray hits, if the reflection point and
    both parts of the way are free. Anything else that a ray hits is a mirror for the ray to go on by once. Ground is no
    target of either, and a vehicle or a person is none of its own mirrors, whose roughness represents that already.

    Args:
        scene: Town and vehicles, with the views' frames loaded.
        views: Sensor poses, A rows.
        velocity: Velocity of each view's sensor, world frame [m/s], shape [A, 3].
        config: Field of view, range, rays, carrier and multipath.
        keys: Those of `trace_radar`, shape [A, 2], uint32.
    """
    device, shape = scene.device, (len(views), config.ray_count)
    check_count("radar", *shape, ECHOES[config.multipath])
    turns = wp.zeros(shape, dtype=float, device=device)
    ground, ghosts = bounce_paths.BouncePaths(), bounce_paths.BouncePaths()
    if config.multipath != "none":
        ground = empty_struct(bounce_paths.BouncePaths, shape, device)
    if config.multipath == "full":
        ghosts = empty_struct(bounce_paths.BouncePaths, shape, device)
    if len(views) > 0:
        inputs = [
            scene.struct,
            views.for_scene(scene),
            wp.array(velocity.astype(np.float32), dtype=wp.vec3, device=device),
            wp.array(keys, dtype=wp.vec2ui, device=device),
            radar_grid(config),
            config.range_m,
            1.0 / config.wavelength,
        ]
        outputs = [turns, ground, ghosts]
        wp.launch(bounce_paths.bounce_kernel, shape, inputs, outputs, device=device, block_dim=BLOCK_DIM)
    bounces = (ground, ghosts)[: ECHOES[config.multipath] // 3]
    mirrors = to_host([found.mirror_id for found in bounces])
    used = np.unique(np.concatenate([np.empty(0, np.int32), *(found.ravel() for found in mirrors)]))
    return TracedPaths(turns, bounces, tuple(int(index) for index in used if index >= 0))


def place_paths(hits: radar.RadarHits, paths: TracedPaths, config: Radar, *, merges: bool) -> PlacedPaths | None:
    """Return where the echoes of traced paths are, None without multipath.

    Args:
        hits: First hits of the rays.
        paths: Their paths.
        config: Resolution and multipath.
        merges: True lets paths of a ray and a mirror that are less than a resolution cell apart interfere in one echo,
            as cells and dense points need; False leaves each an echo of its own, as IQ samples need.
    """
    if config.multipath == "none":
        return None
    views, count = hits.range.shape
    shape, device = (views, ECHOES[config.multipath] * count), hits.range.device
    rays = radar.RadarRays()
    for name in ("range", "azimuth", "elevation", "velocity"):
        setattr(rays, name, wp.empty(shape, dtype=float, device=device))
    rays.object_id = wp.empty(shape, dtype=int, device=device)
    rays.path_type = wp.empty(shape, dtype=wp.uint8, device=device)
    over_ground = echo_paths.PATH_GROUND
    types = (
        (over_ground, over_ground, over_ground),
        (echo_paths.PATH_TYPE_1, echo_paths.PATH_TYPE_2, echo_paths.PATH_TYPE_2_THIRD),
    )
    mirrors = []
    for kind, found in enumerate(paths.bounces):
        columns = echo_paths.PathColumns()
        columns.has_direct, columns.first = int(kind == 0), (1 + 3 * kind) * count
        columns.md, columns.dm, columns.mm = types[kind]
        lead = wp.empty((views, count), dtype=wp.vec4i, device=device)
        inputs = [hits, found, columns, cell_grid(config), int(merges)]
        wp.launch(echo_paths.place_kernel, (views, count), inputs, [rays, lead], device=device)
        mirrors.append((found, columns, lead))
    return PlacedPaths(rays, tuple(mirrors))


def shade_paths(
    hits: radar.RadarHits,
    paths: TracedPaths,
    placed: PlacedPaths | None,
    materials: Sequence[Material],
    weather: Weather,
    config: Radar,
) -> radar.RadarRays:
    """Return the echoes of traced rays and of their paths in one weather, with phases.

    Args:
        hits: First hits of the rays.
        paths: Their paths.
        placed: From `place_paths`.
        materials: Materials by id, as they are in the weather (`SceneData.materials[weather]`).
        weather: Rain, fog and air on the path, and how wet surfaces are.
        config: Power, antennas and carrier.

    Returns:
        Arrays of shape [A, N] on the device, with N = R without multipath.

    Raises:
        ValueError: If there are no materials, one has an unknown base, or the carrier is outside a loss model.
        InputError: If a mirror has no permittivity at the carrier.
    """
    rays = shade_radar(hits, materials, weather, config)
    if placed is None:
        rays.turns = paths.turns
        return rays
    device, (views, count) = hits.range.device, hits.range.shape
    echoes = radar.RadarRays()
    for name in ("range", "azimuth", "elevation", "velocity", "object_id", "path_type"):
        setattr(echoes, name, getattr(placed.rays, name))
    for name, direct in (("rcs", rays.rcs), ("power", rays.power), ("turns", paths.turns)):
        values = wp.zeros(echoes.range.shape, dtype=float, device=device)
        wp.launch(echo_paths.direct_kernel, (views, count), [direct], [values], device=device)
        setattr(echoes, name, values)
    surface = surfaces_on_device(materials, weather, config.carrier_hz, str(device))
    table = mirror_table(materials, paths.mirror_ids, config.carrier_hz)
    mirrors = wp.array(table, dtype=wp.vec4, device=device)
    outputs = [echoes.rcs, echoes.power, echoes.turns]
    for found, columns, lead in placed.mirrors:
        inputs = [found, surface, mirrors, radar_link(weather, config), columns, lead]
        wp.launch(echo_paths.path_echo_kernel, (views, count), inputs, outputs, device=device)
    return echoes
