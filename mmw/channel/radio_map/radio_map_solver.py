"""Solve radio maps of a scene: the public class over `mmw.channel.radio_map.solver`."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mmw.channel.path_solver.place_checks import PlaceCheck
from mmw.channel.path_solver.surface_table import SurfaceTable, make_surface_table
from mmw.channel.radio_ends import RadioEnds
from mmw.channel.radio_map.measurement_surface import MeasurementSurface
from mmw.channel.radio_map.radio_map import RadioMap, RadioMapConfig, at_carrier, check_points
from mmw.channel.radio_map.scene_surface import PLANE, scene_surface
from mmw.channel.radio_map.solver import solve_radio_map
from mmw.channel.radio_map.transmitters import Transmitters, named_precoding
from mmw.config import ChannelConfig
from mmw.config.sampling import Sampling
from mmw.core.errors import InputError
from mmw.scene.scene import Scene

PATH_DEPTH = 3
"""Most interactions on a path without a `channel`, that of `PathSolver`."""

NOT_OF_A_MAP = ("enabled", "physics", "carriers_hz", "links", "antennas")
"""Keys of `ChannelConfig` that are no options of paths from a place to a place; a preset is given in `channel`."""


class RadioMapSolver:
    """Compute radio maps of scenes from the paths that `PathSolver` finds.

    Every point is a receiver of its own: a map and the paths to the middle of a cell are of one solver.

    Examples:
        >>> import mmw
        >>> scene = mmw.load_scene("town03")
        >>> transmitter = scene.add(mmw.Transmitter("bs", position=(13.5, -29.5, 10.0)))
        >>> solver = mmw.RadioMapSolver(max_depth=1, samples_per_tx=100_000)
        >>> radio_map = solver(scene, center_m=(0.0, 0.0), size_m=(80.0, 80.0), cell_size_m=4.0)
        >>> radio_map.path_gain.shape, bool((radio_map.rss_dbm < 0.0).all())
        ((1, 400), True)
    """

    def __init__(
        self,
        channel: ChannelConfig | None = None,
        *,
        points_per_cell: int = 1,
        air_losses: bool = True,
        check_places: bool = True,
        **options: Any,
    ):
        """Choose which paths are searched for, and how.

        Args:
            channel: Settings of the paths, such as those of a dataset; those of `PathSolver` by default. Its antennas
                and links are not used.
            points_per_cell: Points of each cell that the mean is taken over, the square of a whole number; 1 is the
                middle of the cell.
            air_losses: Weaken paths by rain, fog and the gases of the air, as the weather says.
            check_places: Refuse a transmitter inside an object.
            options: Values of `channel` by name, which replace its own: `max_depth`, `refraction`, `diffraction`,
                `diffuse_reflection`, `candidates`, `samples_per_tx` and the others of `PathSolver`.

        Raises:
            InputError: If there is no such option, or a value is out of range.
        """
        known = sorted(set(ChannelConfig.model_fields) - set(Sampling.model_fields) - set(NOT_OF_A_MAP))
        unknown = [name for name in options if name not in known]
        if unknown:
            raise InputError(f"RadioMapSolver: {unknown[0]}; there is no such option; use {', '.join(known)}")
        base = {"max_depth": PATH_DEPTH} if channel is None else channel.model_dump()
        try:
            self._channel = ChannelConfig(**{**base, **options})
        except InputError as error:
            raise InputError(str(error).replace("ChannelConfig", "RadioMapSolver", 1)) from None
        check_points(points_per_cell)
        self._points_per_cell, self._air_losses, self._check_places = points_per_cell, air_losses, check_places

    def __repr__(self) -> str:
        values = self._channel.model_dump(exclude_defaults=True)
        return f"RadioMapSolver({', '.join(f'{name}={value!r}' for name, value in values.items())})"

    def __call__(
        self,
        scene: Scene,
        *,
        carrier_hz: float | None = None,
        surface: str | MeasurementSurface = PLANE,
        cell_size_m: float = 2.0,
        height_m: float | None = None,
        center_m: ArrayLike | None = None,
        size_m: ArrayLike | None = None,
        orientation: ArrayLike | None = None,
        weather: str | None = None,
        precoding: Mapping[str, ArrayLike] | ArrayLike | None = None,
        bandwidth_hz: float = 1e6,
        temperature_k: float = 293.0,
    ) -> RadioMap:
        """Return the map of all transmitters of a scene in its current frame.

        Args:
            scene: The scene, with at least one transmitter.
            carrier_hz: Carrier frequency [Hz]; by default the first one of `channel`, 28 GHz without.
            surface: `plane`; `roads`, cells above the roads with their slope; the name or prim path of an object, whose
                triangles are the cells; or a `MeasurementSurface`, as of `plane_grid`, `road_grid` and `mesh_surface`.
            cell_size_m: Side of a cell of a plane or of roads [m].
            height_m: z of a plane, or height of cells above their road [m], 1.5 by default; distance of cells from an
                object along its outward normals [m], 0.01 by default.
            center_m: Middle (x, y) of a plane or of roads [m], or (x, y, z) of a plane; the middle of the transmitters
                by default.
            size_m: Extent of a plane or of roads [m], shape [2]; the box of the scene by default.
            orientation: Plane to world, quaternion (x, y, z, w); level by default. It needs `center_m` and `size_m`.
            weather: Weather of the materials and of the air; the first of the scene by default.
            precoding: Weights of the antennas of each transmitter: a dict of name -> weights [K], equal ones of unit
                norm where a name is missing; or weights of all transmitters [K], or of each [T, K]. The field is
                h^T p, p not conjugated, and the norm of p counts as gain.
            bandwidth_hz: Bandwidth of the noise [Hz].
            temperature_k: Temperature of the noise [K].

        Raises:
            InputError: If the scene has no transmitter, weather or object of that name, a transmitter is inside an
                object, a value cannot be used, a material has no data at the carrier, or there are too many candidates.
        """
        materials, weather = scene.materials_by_id(weather), scene.check_weather(weather)
        transmitters = scene_transmitters(scene, precoding)
        if isinstance(surface, str):
            surface = scene_surface(
                scene.arrays,
                scene.frame,
                surface,
                transmitters.position,
                cell_size_m=cell_size_m,
                height_m=height_m,
                center_m=center_m,
                size_m=size_m,
                orientation=orientation,
                objects=scene.objects,
            )
        elif not isinstance(surface, MeasurementSurface):
            raise InputError(
                f"radio map: surface is a {type(surface).__name__}; a name or a MeasurementSurface is needed; make one "
                "with plane_grid, road_grid or mesh_surface"
            )
        elif not all(value is None for value in (height_m, center_m, size_m, orientation)):
            raise InputError(
                "radio map: height_m, center_m, size_m or orientation with a MeasurementSurface, which has its place "
                "already; leave them out"
            )
        channel = self._channel
        if carrier_hz is not None:
            channel = at_carrier(channel, carrier_hz)
        config = RadioMapConfig(channel, self._points_per_cell, bandwidth_hz, temperature_k)
        on_device = scene.device_scene
        table = scene.cached(
            ("surfaces", *channel.surface_options.values()),
            lambda: make_surface_table(on_device, **channel.surface_options),
        )
        if self._check_places:
            _check_places(scene, transmitters, table)
        air = scene.weathers[weather] if self._air_losses else None
        return solve_radio_map(on_device, 0, transmitters, surface, config, materials, air, table)


def _check_places(scene: Scene, transmitters: Transmitters, table: SurfaceTable) -> None:
    """Raise InputError if a transmitter of a scene is inside an object."""
    state = scene.antenna_states(list(scene.transmitters.values()))
    ends = RadioEnds(names=transmitters.names, state=state, arrays=transmitters.arrays)
    try:
        PlaceCheck(scene, [("transmitter", ends)], table).finish()
    except InputError as error:
        raise InputError(str(error).replace("PathSolver(", "RadioMapSolver(")) from None


def scene_transmitters(scene: Scene, precoding: Mapping[str, ArrayLike] | ArrayLike | None = None) -> Transmitters:
    """Return the transmitters of a scene in its current frame.

    Args:
        scene: The scene.
        precoding: Weights of the antennas of each, as of `RadioMapSolver`.

    Raises:
        InputError: If there is none, the actor of one is absent, or the weights do not fit.
    """
    devices = list(scene.transmitters.values())
    if not devices:
        raise InputError(
            f"scene {scene.name!r}: has no transmitter; a radio map needs one; give it one by "
            "scene.add(mmw.Transmitter(name, position))"
        )
    names = tuple(scene.transmitters)
    state = scene.antenna_states(devices)
    return Transmitters(
        names,
        position=state.position,
        rotation=state.rotation,
        power_dbm=np.array([device.power_dbm for device in devices], dtype=np.float64),
        array=tuple(scene.array_of(device) for device in devices),
        precoding=named_precoding(names, precoding),
    )
