"""Simulate a receiver whose satellites are traced through the scene: pseudo-ranges, carrier to noise, outages, a fix.

Each satellite above the mask is a far transmitter of the path solver. What arrives over reflections and edges shifts
the code that the receiver tracks (`code_tracking`), and pulls the position (`position_fix`). A blocked satellite may be
tracked by a reflection alone, with the whole detour as its error. Errors are functions of (seed, scenario, time) and of
what stands around the antenna, so that neighbors in space and time have like errors: paths come and go with places.
Noise of a loop is correlated over 1 / (4 B), that of a first-order loop; the residual drift of a satellite is one for
all receivers. There is no fix, NaN, with fewer than four satellites or where they stand badly.
"""

from dataclasses import dataclass

import numpy as np

from mmw.channel.path_solver.surface_table import SurfaceTable, make_surface_table
from mmw.core.constants import FRAME_DT
from mmw.core.errors import InputError
from mmw.core.frame_rate import instants, seconds
from mmw.core.geodesy import wgs84_from_world, world_from_ecef
from mmw.core.random_keys import random_keys
from mmw.core.random_series import gauss_markov
from mmw.scene.enclosing_objects import enclosing_objects
from mmw.scene.scene_data import SceneData
from mmw.scene.views import Views, view_twists
from mmw.sensors.gnss.code_tracking import thermal_noise_m, track_code
from mmw.sensors.gnss.config import Gnss
from mmw.sensors.gnss.constellation import SLOT_NAMES, satellite_positions, seconds_since_slots
from mmw.sensors.gnss.error_models import GnssSample, make_gnss
from mmw.sensors.gnss.position_fix import PositionFix, range_variance, solve_position
from mmw.sensors.gnss.satellite_paths import Sightings, channel_config, satellite_paths, signal_paths
from mmw.sensors.mount_checks import inside_words
from mmw.sensors.samples import PointSamples
from mmw.sensors.sensor_input import SensorInput


@dataclass(frozen=True)
class GnssSatellites(PointSamples):
    """Satellites above the mask of A views, one after the other: N rows, sorted by view and satellite."""

    satellite: np.ndarray
    """Slot of the constellation, such as `A1`, shape [N]."""
    azimuth: np.ndarray
    """Clockwise from north, 0 to 2 pi [rad], shape [N], float64."""
    elevation: np.ndarray
    """Above the world's horizontal plane [rad], shape [N], float64."""
    cn0_db_hz: np.ndarray
    """Carrier to noise density [dB Hz], shape [N], float64; NaN if nothing arrives."""
    pseudorange: np.ndarray
    """Measured distance, without an offset of the receiver's clock [m], shape [N], float64; NaN if not tracked."""
    pseudorange_error: np.ndarray
    """Length that it is too long by [m], shape [N], float64; NaN if not tracked."""
    multipath_error: np.ndarray
    """Part of the error by reflections and edges [m], shape [N], float64; NaN if not tracked."""
    is_los: np.ndarray
    """True if the satellite is in sight, through foliage too, shape [N], bool."""
    is_tracked: np.ndarray
    """True if the receiver tracks it, shape [N], bool."""


@dataclass(frozen=True)
class RayTracedGnssSample(GnssSample):
    """GNSS samples of mode `ray_traced`; position, velocity and speed are NaN without a fix."""

    satellites: GnssSatellites
    """The satellites of each view."""
    hdop: np.ndarray
    """Horizontal dilution of precision of the fix [-], shape [A]."""
    vdop: np.ndarray
    """Vertical dilution of precision of the fix [-], shape [A]."""

    @property
    def has_fix(self) -> np.ndarray:
        """True where there is a position, shape [A], bool."""
        return np.isfinite(self.hdop)


def make_ray_traced(data: SensorInput, config: Gnss) -> dict[str, RayTracedGnssSample]:
    """Return the samples of all views by weather: wet surfaces reflect otherwise.

    Raises:
        InputError: If an antenna is inside an object, or a material has no permittivity at L1.
    """
    scene = data.scene if data.radio_scene is None else data.radio_scene
    arrays, views = scene.arrays, data.views
    base = make_gnss(arrays, views, config, data.seed, data.scenario)
    place = views.pose[:, :3]
    times = seconds_since_slots(config.epoch) + seconds(views.frame, arrays.rate_hz)
    satellites = world_from_ecef(satellite_positions(times), config.reference)
    sightings, distance = _sightings(satellites, place, config)
    drift, noise = _range_noise(arrays, views, config, (data.seed, data.scenario))
    row, number = sightings.view, sightings.satellite
    offsets = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=len(views)))]).astype(np.int32)
    paths = None
    if len(sightings):
        _check_places(data, place, config)
        velocity = view_twists(arrays, data.motion, views)[0]
        materials = {name: arrays.materials[name] for name in data.weathers}
        table = _surfaces(data, config)
        paths = satellite_paths(scene, views, velocity, sightings, config, materials, table)
    samples = {}
    for weather in data.weathers:
        cn0, multipath, is_los = np.full(len(sightings), np.nan), np.full(len(sightings), np.nan), np.zeros(0, bool)
        if paths is not None:
            signals, is_los = signal_paths(paths, weather, views, sightings, config)
            tracked = track_code(signals, config)
            multipath, has_power = tracked.error, tracked.power > 0.0
            cn0[has_power] = config.cn0_zenith_db + 10.0 * np.log10(tracked.power[has_power])
        is_tracked = np.nan_to_num(cn0, nan=-np.inf) >= config.tracking_threshold_db
        error = multipath + drift[row, number] + thermal_noise_m(cn0, config) * noise[row, number]
        error, multipath = (np.where(is_tracked, values, np.nan) for values in (error, multipath))
        found = GnssSatellites(
            offsets=offsets,
            satellite=np.array(SLOT_NAMES)[number],
            azimuth=np.mod(np.arctan2(sightings.direction[:, 0], sightings.direction[:, 1]), 2.0 * np.pi),
            elevation=np.arcsin(np.clip(sightings.direction[:, 2], -1.0, 1.0)),
            cn0_db_hz=cn0,
            pseudorange=distance + error,
            pseudorange_error=error,
            multipath_error=multipath,
            is_los=is_los,
            is_tracked=is_tracked,
        )
        samples[weather] = _with_fixes(base, found, satellites[row, number], config)
    return samples


def _sightings(satellites: np.ndarray, place: np.ndarray, config: Gnss) -> tuple[Sightings, np.ndarray]:
    """Return the satellites above the mask, and their distances [m], shape [N].

    Args:
        satellites: Places in each view's frame [m], shape [A, S, 3].
        place: Receivers [m], shape [A, 3].
        config: The mask.
    """
    span = satellites - place[:, None]
    distance = np.linalg.norm(span, axis=2)
    view, number = np.nonzero(span[..., 2] >= distance * np.sin(np.radians(config.elevation_mask_deg)))
    far = distance[view, number]
    return Sightings(view, number, span[view, number] / far[:, None]), far


def _range_noise(
    arrays: SceneData, views: Views, config: Gnss, stream: tuple[str | int, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Return residual drift [m] and unit noise of the loops of each view's satellites, shape [A, S] each."""
    frames, at_frame = np.unique(views.frame, return_inverse=True)
    actors, of_actor = np.unique(views.actor, return_inverse=True)
    base, parts = instants(frames, arrays.rate_hz)
    count = len(SLOT_NAMES)
    sky = random_keys([(*stream, "gnss", "satellites")])
    drift = gauss_markov(sky, base, count, config.drift_correlation_s / FRAME_DT, parts)[0]
    own = random_keys((*stream, arrays.actors[actor].name, config.name, "code") for actor in actors)
    loop = gauss_markov(own, base, count, 0.25 / config.loop_bandwidth_hz / FRAME_DT, parts)
    return config.residual_range_std_m * drift[at_frame], loop[of_actor, at_frame]


def _surfaces(data: SensorInput, config: Gnss) -> SurfaceTable:
    """Return the surfaces of the scene; those of the channel where it has the same choices."""
    scene = data.scene if data.radio_scene is None else data.radio_scene
    options = channel_config(config).surface_options
    return data.cached(("surfaces", *options.values()), lambda: make_surface_table(scene, **options))


def _check_places(data: SensorInput, place: np.ndarray, config: Gnss) -> None:
    """Raise if an antenna is inside something, or on the ground below its body, in the first frame of the batch."""
    arrays, views = data.scene.arrays, data.views
    rows = np.flatnonzero(views.batch_index == 0)
    for row, object_id in zip(rows, enclosing_objects(data.scene, place[rows]), strict=True):
        actor = arrays.actors[views.actor[row]]
        where = ""
        if object_id >= 0:
            where = inside_words(arrays, int(object_id), actor.object_id, int(views.frame[row]))
        elif actor.model >= 0 and not any(config.mount_on(*actor.identity).position_m):
            where = "is on the ground below its own body, which blocks all satellites"
        if where:
            x, y, z = place[row]
            raise InputError(
                f"{actor.name}: {config.name} at ({x:g}, {y:g}, {z:g}) m in the world {where}; mount it above the "
                f"body, as in mount: {{{actor.role}: {{position_m: [0, 0, 1], relative_to: roof}}}}"
            )


def _with_fixes(base: GnssSample, found: GnssSatellites, satellites: np.ndarray, config: Gnss) -> RayTracedGnssSample:
    """Return samples with the position that the satellites of each view give.

    Args:
        base: Samples with velocity, speed and heading.
        found: The satellites.
        satellites: Place of each [m], shape [N, 3].
        config: Reference point and weights.
    """
    variance = range_variance(found.cn0_db_hz, config.residual_range_std_m)
    fixes: list[PositionFix] = []
    for begin, end in zip(found.offsets[:-1], found.offsets[1:], strict=True):
        rows = begin + np.flatnonzero(found.is_tracked[begin:end])
        fixes.append(solve_position(satellites[rows], found.pseudorange[rows], variance[rows], np.zeros(3)))
    place = np.array([fix.position for fix in fixes]).reshape(-1, 3)
    is_lost = np.array([not fix.is_fix for fix in fixes], dtype=bool)
    geodetic = np.full(place.shape, np.nan)
    geodetic[~is_lost] = wgs84_from_world(place[~is_lost], config.reference)
    shared = {name: getattr(base, name) for name in ("geodetic_true", "heading")}
    return RayTracedGnssSample(
        geodetic=geodetic,
        velocity=np.where(is_lost[:, None], np.nan, base.velocity),
        speed=np.where(is_lost, np.nan, base.speed),
        satellites=found,
        hdop=np.array([fix.hdop for fix in fixes]),
        vdop=np.array([fix.vdop for fix in fixes]),
        **shared,
    )
