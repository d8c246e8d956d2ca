"""Solve radio maps of a scene: the public class over `mmw.channel.radio_map.solver`."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from mmw.channel.radio_map.measurement_surface import MeasurementSurface
from mmw.channel.radio_map.radio_map import RadioMap, RadioMapConfig
from mmw.channel.radio_map.scene_surface import PLANE, scene_surface
from mmw.channel.radio_map.solver import check_samples, solve_radio_map
from mmw.channel.radio_map.transmitters import Transmitters, named_precoding
from mmw.core.errors import InputError
from mmw.scene.scene import Scene


class RadioMapSolver:
    """Compute radio maps of scenes by rays that are launched from every transmitter.

    Examples:
        >>> import mmw
        >>> scene = mmw.load_scene("town03")
        >>> transmitter = scene.add(mmw.Transmitter("bs", position=(13.5, -29.5, 10.0)))
        >>> solver = mmw.RadioMapSolver(max_depth=1, samples_per_tx=100_000)
        >>> radio_map = solver(scene, center_m=(0.0, 0.0), size_m=(80.0, 80.0), cell_size_m=4.0)
        >>> radio_map.path_gain.shape, bool((radio_map.rss_dbm < 0.0).all())
        ((1, 400), True)
    """

    def __init__(self, *, max_depth: int = 3, samples_per_tx: int = 10_000_000, refraction: bool = False):
        """Set how rays are followed.

        Args:
            max_depth: Maximum number of reflections (and transmissions) of a ray, 0 to 30, with refraction to 8; 0 is
                the line of sight.
            samples_per_tx: Rays of each transmitter, 1000 to 2^26.
            refraction: Follow transmissions through slabs, too; the cost doubles with every interaction.

        Raises:
            InputError: If a number is out of range.
        """
        check_samples(samples_per_tx, max_depth, refraction)
        self.max_depth, self.samples_per_tx, self.refraction = max_depth, samples_per_tx, refraction

    def __call__(
        self,
        scene: Scene,
        *,
        carrier_hz: float = 28e9,
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
            carrier_hz: Carrier frequency [Hz].
            surface: `plane`; `roads`, cells above the roads with their slope; the name or prim path of an object, whose
                triangles are the cells; or a `MeasurementSurface`, as of `plane_grid`, `road_grid` and `mesh_surface`.
            cell_size_m: Side of a cell of a plane or of roads [m].
            height_m: z of a plane, or height of cells above their road [m], 1.5 by default; distance of cells from an
                object along its outward normals [m], 0.01 by default.
            center_m: Middle (x, y) of a plane or of roads [m], or (x, y, z) of a plane; the middle of the transmitters
                by default.
            size_m: Extent of a plane or of roads [m], shape [2]; the box of the scene by default.
            orientation: Plane to world, quaternion (x, y, z, w); level by default. It needs `center_m` and `size_m`.
            weather: Weather of the materials; the first of the scene by default. Air and rain take no power.
            precoding: Weights of the antennas of each transmitter: a dict of name -> weights [K], equal ones of unit
                norm where a name is missing; or weights of all transmitters [K], or of each [T, K]. The field is
                h^T p, p not conjugated, and the norm of p counts as gain.
            bandwidth_hz: Bandwidth of the noise [Hz].
            temperature_k: Temperature of the noise [K].

        Raises:
            InputError: If the scene has no transmitter, weather or object of that name, a value cannot be used, or a
                material has no data at the carrier.
        """
        materials = scene.materials_by_id(weather)
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
        config = RadioMapConfig(
            carrier_hz, self.samples_per_tx, self.max_depth, self.refraction, bandwidth_hz, temperature_k
        )
        return solve_radio_map(scene.device_scene, 0, transmitters, surface, config, materials)


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
