"""Solve the paths between the transmitters and receivers of a scene."""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, overload

import numpy as np

from mmw.channel.antennas.link_elements import EndElements, LinkElements
from mmw.channel.links import Links
from mmw.channel.path_solver.place_checks import PlaceCheck
from mmw.channel.path_solver.solver import Trace, check_channel_materials, path_gains, trace_links
from mmw.channel.path_solver.surface_table import SurfaceTable, make_surface_table
from mmw.channel.paths import PathSet
from mmw.channel.radio_ends import RadioEnds
from mmw.channel.scene_paths import Paths
from mmw.config import ChannelConfig
from mmw.config.physics_presets import PHYSICS_PRESETS, Physics
from mmw.core.choices import check_choice
from mmw.core.errors import InputError
from mmw.physics.em.vectors import rotate
from mmw.physics.materials.material import Material
from mmw.physics.materials.permittivity import log_extrapolations
from mmw.scene.mounted_antennas import RadioDevices
from mmw.scene.radio_devices import RadioDevice
from mmw.scene.scene import Scene

FREE_DEVICE = 1 << 30
"""Bit of the number of a device that rides on no actor, so that it is not that of an actor."""


@dataclass(frozen=True)
class _Ends:
    """One side of the links of a scene: devices, or the elements of their arrays."""

    devices: RadioEnds
    state: RadioDevices
    """Place, rotation and velocity of each end, shape [N, ...]."""
    device: np.ndarray
    """Device of each, shape [N], int32."""
    element: np.ndarray
    """Element of its array, 0 for a phase center, shape [N], int32."""
    number: np.ndarray
    """Number of the device in the identifiers of paths, shape [N], int32."""

    def __len__(self) -> int:
        return len(self.device)


class PathSolver:
    """Finds the paths between all transmitters and receivers of a scene, by the code that generates datasets.

    What a scene's meshes give is made at the first call and kept with the scene, so that further calls only search for
    paths; where no pose has changed, as after a change of a permittivity, they only compute gains.

    Source: image method with ray-launched or exhaustive candidates, see `docs/concepts/channel.md`.

    Examples:
        >>> import mmw
        >>> scene = mmw.load_scene("town03")
        >>> transmitter = scene.add(mmw.Transmitter("bs", position=(13.5, -29.5, 10.0)))
        >>> receiver = scene.add(mmw.Receiver("ue", position=(-2.0, 45.0, 1.5)))
        >>> solver = mmw.PathSolver(max_depth=2, diffraction=False)
        >>> paths = solver(scene, carriers_hz=[4.9e9, 28e9])  # both from one trace
        >>> paths.a.shape == (len(paths), 2), paths.is_los.sum().item()
        (True, 1)
    """

    def __init__(
        self,
        *,
        max_depth: int = 3,
        los: bool = True,
        specular_reflection: bool = True,
        refraction: bool = False,
        finite_surfaces: bool = False,
        diffraction: bool = False,
        edge_diffraction: bool = False,
        diffraction_min_bend_rad: float = 0.05,
        diffraction_lit_region: bool = True,
        diffuse_reflection: bool = False,
        foliage: bool = False,
        candidates: Literal["launch", "exhaustive"] = "launch",
        samples_per_tx: int = 1_000_000,
        diffuse_samples: int = 1000,
        diffuse_error_db: float | None = None,
        diffuse_order: int = 1,
        dynamic_range_db: float | None = None,
        synthetic_array: bool = True,
        air_losses: bool = True,
        check_places: bool = True,
    ):
        """Choose which paths are searched for, and how.

        Args:
            max_depth: Most interactions on a path, 0 to 8.
            los: Find the line of sight.
            specular_reflection: Find mirror reflections.
            refraction: Go straight through slabs, materials with a thickness.
            finite_surfaces: Weigh reflections by the size of the surface against the Fresnel zone.
            diffraction: Go around one convex edge, by the uniform theory of diffraction.
            edge_diffraction: With `diffraction`, go around free edges of open sheets too, whose faces then have both
                sides.
            diffraction_min_bend_rad: Edges with a smaller angle between the normals of their faces do not diffract
                [rad].
            diffraction_lit_region: Find diffracted paths also where the source or its reflection is seen.
            diffuse_reflection: Scatter at one rough surface, materials with a scattering coefficient.
            foliage: Weaken waves in crowns of trees, instead of blocking and mirroring them.
            candidates: `launch` finds reflecting surfaces by rays, `exhaustive` tries every surface for every link.
            samples_per_tx: Rays of each transmitter, for `launch`.
            diffuse_samples: Rays that look for rough surfaces; each gives at most one path a link.
            diffuse_error_db: Standard error of the summed power of the diffuse paths of a link [dB], from which the
                number of rays follows in place of `diffuse_samples`.
            diffuse_order: Most rough surfaces on a path, 1 or 2.
            dynamic_range_db: Leave out paths that are weaker than the strongest of their link by more than this, at
                every carrier and in every weather that is asked for [dB]; None keeps all.
            synthetic_array: Trace between phase centers and apply arrays as to plane waves; False traces between all
                elements, which is exact near an array, at the cost of a link for each pair of them.
            air_losses: Weaken paths by rain, fog and the gases of the air, as the weather says.
            check_places: Refuse a device inside an object.

        Raises:
            InputError: If a value is out of range.
        """
        self._config = _channel_config(
            max_depth=max_depth, los=los, specular_reflection=specular_reflection, refraction=refraction,
            finite_surfaces=finite_surfaces, diffraction=diffraction, edge_diffraction=edge_diffraction,
            diffraction_min_bend_rad=diffraction_min_bend_rad, diffraction_lit_region=diffraction_lit_region,
            diffuse_reflection=diffuse_reflection, foliage=foliage, candidates=candidates,
            samples_per_tx=samples_per_tx, diffuse_samples=diffuse_samples, diffuse_error_db=diffuse_error_db,
            diffuse_order=diffuse_order, dynamic_range_db=dynamic_range_db,
        )  # fmt: skip
        self._synthetic_array, self._air_losses, self._check_places = synthetic_array, air_losses, check_places
        self._geometry = repr(self._config.model_dump(exclude={"carriers_hz", "pattern", "polarization"}))
        self._last: tuple[str, ChannelConfig] | None = None

    @classmethod
    def preset(cls, physics: Physics, **changed: Any) -> "PathSolver":
        """Return a solver with the settings of a preset of `channel.physics`.

        Its materials are those of `mmw.load_scene(..., physics=...)`.

        Args:
            physics: `paper`, `standard` or `full`.
            changed: Further arguments, which win.

        Raises:
            InputError: If the preset is unknown, or a value is out of range.

        Examples:
            >>> import mmw
            >>> mmw.PathSolver.preset("standard", max_depth=1)
            PathSolver(refraction=True, finite_surfaces=True, diffraction=True, dynamic_range_db=40.0, foliage=True)
        """
        settings = PHYSICS_PRESETS[check_choice("PathSolver.preset", physics, Physics)]
        return cls(**{"max_depth": ChannelConfig.model_fields["max_depth"].default, **settings, **changed})

    def __repr__(self) -> str:
        values = self._config.model_dump(exclude_defaults=True)
        return f"PathSolver({', '.join(f'{name}={value!r}' for name, value in values.items())})"

    @overload
    def __call__(self, scene: Scene, *, carriers_hz: float | Sequence[float] = ..., weathers: None = None) -> Paths: ...

    @overload
    def __call__(
        self, scene: Scene, *, carriers_hz: float | Sequence[float] = ..., weathers: Sequence[str]
    ) -> dict[str, Paths]: ...

    def __call__(
        self,
        scene: Scene,
        *,
        carriers_hz: float | Sequence[float] = (28e9,),
        weathers: Sequence[str] | None = None,
    ) -> Paths | dict[str, Paths]:
        """Return the paths from every transmitter to every receiver of a scene, in its current frame.

        Args:
            scene: The scene.
            carriers_hz: Carrier frequencies, all from one trace [Hz], shape [C], or one.
            weathers: Weathers of the scene, all from one trace; None for its first one.

        Returns:
            The paths; a mapping by weather if weathers are named.

        Raises:
            InputError: If there is no transmitter or no receiver, one is inside an object, a weather or an actor is not
                there, a carrier is out of the range of a material, or there are too many candidates.
        """
        config = self._config_at([carriers_hz] if np.isscalar(carriers_hz) else list(carriers_hz))
        names = [scene.check_weather(name) for name in ([None] if weathers is None else weathers)]
        on_device = scene.device_scene
        table: SurfaceTable = scene.cached(
            ("surfaces", *config.surface_options.values()),
            lambda: make_surface_table(on_device, **config.surface_options),
        )
        materials = {name: scene.materials_by_id(name) for name in names}
        _check_materials_once(scene, materials, table, config)
        tx, rx = (self._ends(scene, kind, config) for kind in ("transmitter", "receiver"))
        ends = [("transmitter", tx.devices), ("receiver", rx.devices)] if self._check_places else []
        check = PlaceCheck(scene, ends, table)
        elements = LinkElements(*(_end_elements(own, index) for own, index in _pairs(tx, rx)))
        is_two_way = elements.is_uniform and not set(tx.number.tolist()).isdisjoint(rx.number.tolist())
        trace = self._trace(scene, tx, rx, table, config, is_reciprocal=is_two_way)
        check.finish()
        air = {name: scene.weathers[name] for name in names} if self._air_losses else None
        found = path_gains(trace, config, materials, air, elements)
        result = {name: self._paths(scene, found, name, tx, rx) for name in names}
        return result if weathers is not None else result[names[0]]

    def _config_at(self, carriers: list[Any]) -> ChannelConfig:
        """Return the settings at some carriers; those of the last call are kept."""
        key = repr(carriers)
        if self._last is None or self._last[0] != key:
            self._last = key, _channel_config(**{**self._config.model_dump(), "carriers_hz": carriers})
        return self._last[1]

    def _ends(self, scene: Scene, kind: str, config: ChannelConfig) -> _Ends:
        """Return the devices of one kind, or their elements, where they are now."""
        known = scene.transmitters if kind == "transmitter" else scene.receivers
        devices: list[RadioDevice] = list(known.values())
        if not devices:
            raise InputError(
                f"scene {scene.name!r}: has no {kind}; paths need one; give it one by "
                f"scene.add(mmw.{kind.capitalize()}(name, position))"
            )
        arrays = tuple(scene.array_of(device) for device in devices)
        state = scene.antenna_states(devices)
        own = RadioEnds(names=tuple(device.name for device in devices), state=state, arrays=arrays)
        number = np.array([_number(scene, device) for device in devices], dtype=np.int32)
        index = np.arange(len(devices), dtype=np.int32)
        if self._synthetic_array:
            return _Ends(own, state, index, np.zeros_like(index), number)
        if len(config.carriers_hz) > 1:
            raise InputError(
                f"PathSolver: synthetic_array = False with {len(config.carriers_hz)} carriers; the places of elements "
                "depend on the carrier; give one carrier at a time"
            )
        offsets = [array.element_positions(config.carriers_hz[0])[: array.element_count] for array in arrays]
        index = np.repeat(index, [len(offset) for offset in offsets])
        element = np.concatenate([np.arange(len(offset), dtype=np.int32) for offset in offsets])
        moved = rotate(state.rotation[index], np.concatenate(offsets))
        apart = RadioDevices(state.position[index] + moved, state.rotation[index], state.velocity[index])
        return _Ends(own, apart, index, element, number[index])

    def _trace(
        self, scene: Scene, tx: _Ends, rx: _Ends, table: SurfaceTable, config: ChannelConfig, *, is_reciprocal: bool
    ) -> Trace:
        """Return the traced links: those of the last call if nothing that they depend on has changed."""
        (_, t), (_, r) = _pairs(tx, rx)
        links = Links(
            frame=np.full(len(t), scene.frame, dtype=np.int32),
            batch_index=np.zeros(len(t), dtype=np.int32),
            kind=np.zeros(len(t), dtype=np.int8),
            tx_actor=tx.number[t],
            rx_actor=rx.number[r],
            tx_antenna=np.zeros(len(t), dtype=np.int32),
            rx_antenna=np.zeros(len(t), dtype=np.int32),
            tx=tx.state.take(t),
            rx=rx.state.take(r),
        )
        places = tuple(
            values.tobytes()
            for end in (tx, rx)
            for values in (end.state.position, end.state.rotation, end.state.velocity, end.number)
        )
        carriers = config.carriers_hz if config.finite_surfaces else ()
        key = (scene.version, scene.frame, is_reciprocal, places, carriers)
        last: dict[Any, Trace] = scene.cached(("trace", self._geometry), dict)
        if key not in last:
            trace = trace_links(scene.device_scene, links, config, table, is_reciprocal=is_reciprocal)
            last.clear()
            last[key] = trace
        return last[key]

    def _paths(self, scene: Scene, found: PathSet, weather: str, tx: _Ends, rx: _Ends) -> Paths:
        r, t = np.divmod(found.link, max(len(tx), 1))
        return Paths(
            scenario=scene.name, weather=weather, frame=scene.frame, carriers_hz=found.carriers_hz,
            transmitters=tx.devices, receivers=rx.devices, is_synthetic=self._synthetic_array,
            tx=tx.device[t], rx=rx.device[r], tx_element=tx.element[t], rx_element=rx.element[r],
            tau=found.tau, a=found.a[weather], transfer=found.transfer[weather], theta_t=found.theta_t,
            phi_t=found.phi_t, theta_r=found.theta_r, phi_r=found.phi_r, range_rate=found.range_rate,
            kind_id=found.kind, depth=found.order, interaction_types=found.interaction, vertices=found.vertex,
            normals=found.normal, edges=found.edge, curvatures=found.curvature, object_ids=found.object_id,
            material_ids=found.material_id,
            surface_ids=found.surface, path_ids=found.path_id, **found.loss_db[weather],
        )  # fmt: skip


def _channel_config(**values: Any) -> ChannelConfig:
    """Return validated settings.

    Raises:
        InputError: If a value is out of range.
    """
    try:
        return ChannelConfig(**values)
    except InputError as error:
        raise InputError(str(error).replace("ChannelConfig", "PathSolver", 1)) from None


def _check_materials_once(
    scene: Scene, materials: dict[str, tuple[Material, ...]], table: SurfaceTable, config: ChannelConfig
) -> None:
    """Raise InputError if a material has no data at a carrier; what passed is not looked at again."""
    passed: dict[str, list[Any]] = scene.cached(("materials with data", config.carriers_hz), dict)
    new = {name: own for name, own in materials.items() if not any(own is one for one in passed.get(name, ()))}
    if new:
        check_channel_materials(new, table.used_materials, config)
        for by_id in new.values():
            log_extrapolations(by_id, config.carriers_hz, table.used_materials)
        passed |= {name: [own] for name, own in new.items()}


def _pairs(tx: _Ends, rx: _Ends) -> tuple[tuple[_Ends, np.ndarray], tuple[_Ends, np.ndarray]]:
    """Return both sides with the end of each link, receiver by receiver, shape [L]."""
    link = np.arange(len(tx) * len(rx), dtype=np.int32)
    return (tx, link % len(tx)), (rx, link // len(tx))


def _end_elements(ends: _Ends, index: np.ndarray) -> EndElements:
    """Return the elements of one side of the links; devices that share an array have one entry."""
    arrays = list({id(array): array for array in ends.devices.arrays}.values())
    row_of = {id(array): row for row, array in enumerate(arrays)}
    of_device = np.array([row_of[id(array)] for array in ends.devices.arrays], dtype=np.int32)
    return EndElements(tuple(arrays), of_device[ends.device[index]])


def _number(scene: Scene, device: RadioDevice) -> int:
    """Return the number of a device in path identifiers: its actor, or a hash of its name."""
    actor = scene.device_actor(device)
    if actor >= 0:
        return actor
    return FREE_DEVICE | (zlib.crc32(f"{device.kind} {device.name}".encode()) & (FREE_DEVICE - 1))
