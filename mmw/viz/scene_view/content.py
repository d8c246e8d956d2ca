"""Gather what a picture of a scene shows, whatever draws it: surfaces, actors, antennas, paths and coverage."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mmw.channel.radio_map.radio_map import RadioMap
from mmw.channel.scene_paths import Paths
from mmw.core.transforms import normalize, rotate
from mmw.scene.radio_devices import RadioDevice
from mmw.scene.scene import Scene
from mmw.viz.scene_view.coverage import Coverage, choose_coverage
from mmw.viz.scene_view.path_lines import PathLines, choose_paths
from mmw.viz.scene_view.surfaces import EVERYTHING, ClipBox, ColorBy, SurfaceMesh, scene_surfaces

FOCUS_DB = 30.0
"""Gain below that of the strongest path to which paths decide what is in view [dB]. Design value."""


@dataclass(frozen=True)
class Antenna:
    """Place of the antenna of a transmitter or receiver."""

    position: np.ndarray
    """World frame [m], shape [3]."""
    rotation: np.ndarray
    """Antenna-to-world rotation, shape [3, 3]; column 0 is the direction it looks in."""


@dataclass(frozen=True)
class SceneContent:
    """A scene at one frame as shapes with colors. World frame, meters."""

    name: str
    town: Sequence[SurfaceMesh]
    """Static surfaces."""
    actors: Mapping[str, Sequence[SurfaceMesh]]
    """Actor -> its surfaces."""
    places: Mapping[str, np.ndarray]
    """Actor that is present -> point above it where its name stands [m], shape [3]."""
    transmitters: Mapping[str, Antenna]
    receivers: Mapping[str, Antenna]
    paths: PathLines | None
    coverage: Coverage | None
    coverage_triangles: np.ndarray
    """Corners of the coverage inside the clip box [m], shape [N, 3, 3], float64."""
    coverage_colors: np.ndarray
    """Color of each of these triangles, shape [N, 3], uint8."""
    notes: tuple[str, ...]
    """Notes on parts that are left out, one line each."""

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Least and greatest coordinates of everything [m], shape [3] each; a cube of 2 m where there is nothing."""
        meshes = [*self.town, *(mesh for own in self.actors.values() for mesh in own)]
        points = [mesh.points for mesh in meshes] + [self.focus, self.coverage_triangles.reshape(-1, 3)]
        every = np.concatenate([np.zeros((0, 3)), *points])
        return (every.min(axis=0), every.max(axis=0)) if len(every) else (-np.ones(3), np.ones(3))

    @property
    def focus(self) -> np.ndarray:
        """Antennas and strong paths (`FOCUS_DB`), which a picture should show [m], shape [N, 3]."""
        ends = [antenna.position for antenna in (*self.transmitters.values(), *self.receivers.values())]
        lines = []
        if self.paths is not None and len(self.paths):
            is_strong = self.paths.gain_db >= self.paths.gain_db.max() - FOCUS_DB
            lines = [self.paths.lines[path] for path in np.flatnonzero(is_strong)]
        return np.concatenate([np.zeros((0, 3)), np.array(ends).reshape(-1, 3), *lines])


def antennas(scene: Scene, devices: Mapping[str, RadioDevice]) -> dict[str, Antenna]:
    """Return where the antennas of transmitters or receivers are."""
    return {name: Antenna(*scene.antenna_state(device)[:2]) for name, device in devices.items()}


def gather(
    scene: Scene,
    *,
    paths: Paths | None = None,
    radio_map: RadioMap | None = None,
    metric: str = "path_gain",
    box: ClipBox = EVERYTHING,
    max_paths: int = 2000,
    carrier_hz: float | None = None,
    weather: str | None = None,
    color_by: ColorBy = "material",
) -> SceneContent:
    """Return what a view of a scene shows; the arguments are those of `show`.

    Raises:
        InputError: If an argument cannot be used, or the paths are of another scene.
    """
    arrays, frame = scene.arrays, scene.frame
    materials = scene.materials_by_id(weather)
    chosen = None
    if paths is not None:
        chosen = choose_paths(paths, carrier_hz=carrier_hz, max_paths=max_paths, scene=scene)
    coverage = None if radio_map is None else choose_coverage(radio_map, metric)
    triangles, colors = np.zeros((0, 3, 3)), np.zeros((0, 3), dtype=np.uint8)
    if coverage is not None:
        triangles, face = box.cut(coverage.triangles)
        colors = coverage.colors[coverage.cell[face]]
    town, actors = scene_surfaces(arrays, frame, materials, box, color_by)
    places = {}
    for actor, pose in zip(arrays.actors, arrays.poses[arrays.frame_row(frame)], strict=True):
        if np.isfinite(pose).all():
            x, y, z = actor.center
            top = (x, y, z + 0.5 * actor.size[2])
            places[actor.name] = rotate(normalize(pose[3:]), top) + pose[:3]
    notes = []
    if chosen is not None and len(chosen) < chosen.total:
        notes.append(f"the strongest {len(chosen):,} of {chosen.total:,} paths; max_paths shows more")
    return SceneContent(
        name=scene.name,
        town=town,
        actors=actors,
        places=places,
        transmitters=antennas(scene, scene.transmitters),
        receivers=antennas(scene, scene.receivers),
        paths=chosen,
        coverage=coverage,
        coverage_triangles=triangles,
        coverage_colors=colors,
        notes=tuple(notes),
    )
