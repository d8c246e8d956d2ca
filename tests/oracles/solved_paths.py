"""Solve paths by the public API for the oracles of the radio channel, in the tables that runs have."""

import numpy as np

import mmw
from mmw.channel.antennas.link_elements import configured_array
from mmw.channel.links import Links, make_links
from mmw.channel.paths import LOSSES, PathSet
from mmw.config import ChannelConfig
from mmw.physics.weather.weather import PRESETS, Weather
from mmw.scene.scene_data import SceneData

SOLVER_OPTIONS = (
    "max_depth", "los", "specular_reflection", "refraction", "diffraction", "diffraction_lit_region",
    "edge_diffraction", "diffraction_min_bend_rad", "finite_surfaces", "dynamic_range_db",
    "diffuse_reflection", "foliage", "candidates", "samples_per_tx", "diffuse_samples",
    "diffuse_error_db", "diffuse_order",
)  # fmt: skip
"""Settings of a run's channel that `mmw.PathSolver` has too."""


def solve(
    arrays: SceneData, config: ChannelConfig, device: str, frames: list[int] | None = None
) -> tuple[Links, PathSet]:
    """Return the links of some frames, all by default, and their paths, by the public API: frame after frame."""
    scene = mmw.Scene(arrays, {name: PRESETS.get(name, Weather()) for name in arrays.materials}, device=device)
    scene.tx_array = scene.rx_array = configured_array(config.antennas[0])
    options = {name: getattr(config, name) for name in SOLVER_OPTIONS}
    solver = mmw.PathSolver(**options, air_losses=False, check_places=False)
    numbers = list(arrays.frames) if frames is None else frames
    links, parts = make_links(arrays, numbers, config), []
    for batch_index, frame in enumerate(numbers):
        own = np.flatnonzero(links.batch_index == batch_index)
        if not len(own):
            continue
        scene.frame = frame
        ends = [
            [(kind, int(index)) for index in np.unique(column[own])]
            for kind, column in ((mmw.Transmitter, links.tx_actor), (mmw.Receiver, links.rx_actor))
        ]
        for kind, index in (*ends[0], *ends[1]):
            actor = arrays.actors[index]
            place = config.antennas[0].mount_on(actor.role, actor.name).position_m
            scene.add(kind(actor.name, place, actor=actor.name))
        found = solver(scene, carriers_hz=config.carriers_hz, weathers=list(arrays.materials))
        of_pair = np.full((len(ends[1]), len(ends[0])), -1)
        tx_row, rx_row = ({index: row for row, (_, index) in enumerate(side)} for side in ends)
        for row in own:
            of_pair[rx_row[int(links.rx_actor[row])], tx_row[int(links.tx_actor[row])]] = row
        parts.append((of_pair, found))
        for name in {*scene.transmitters, *scene.receivers}:
            scene.remove(name)
    return links, _as_path_set(parts, len(links), config, arrays)


def _as_path_set(
    parts: list[tuple[np.ndarray, dict[str, mmw.Paths]]], count: int, config: ChannelConfig, arrays: SceneData
) -> PathSet:
    """Return the paths of several frames as one table; pairs without a link in `of_pair` are left out."""
    rows = [of_pair[first.rx, first.tx] for of_pair, found in parts for first in (next(iter(found.values())),)]
    link = np.concatenate([np.zeros(0, dtype=np.int64), *rows])
    order = np.argsort(link, kind="stable")[np.sum(link < 0) :]

    def joined(name: str, weather: str | None = None) -> np.ndarray:
        chosen = [found[weather or next(iter(found))] for _, found in parts]
        return np.concatenate([getattr(paths, name) for paths in chosen])[order] if chosen else _nothing(name, config)

    weathers = list(arrays.materials)
    return PathSet(
        carriers_hz=np.array(config.carriers_hz), link=link[order].astype(np.int32),
        count=np.bincount(link[order], minlength=count).astype(np.int32),
        **{own: joined(name) for own, name in PATH_SET_FIELDS.items()},
        transfer={name: joined("transfer", name) for name in weathers},
        a={name: joined("a", name) for name in weathers},
        loss_db={name: {loss: joined(loss, name) for loss in LOSSES} for name in weathers},
    )  # fmt: skip


PATH_SET_FIELDS = {
    "path_id": "path_ids", "kind": "kind_id", "order": "depth", "interaction": "interaction_types",
    "surface": "surface_ids", "object_id": "object_ids", "material_id": "material_ids", "vertex": "vertices",
    "normal": "normals", "edge": "edges", "curvature": "curvatures", "tau": "tau",
    "theta_t": "theta_t", "phi_t": "phi_t", "theta_r": "theta_r",
    "phi_r": "phi_r", "range_rate": "range_rate",
}  # fmt: skip
"""Field of `PathSet` -> field of `mmw.Paths`."""


def _nothing(name: str, config: ChannelConfig) -> np.ndarray:
    """Return an array of no paths."""
    depth, carriers = max(1, config.max_depth), len(config.carriers_hz)
    shapes = {"vertices": (depth, 3), "normals": (depth, 3), "edges": (3,), "curvatures": (6,)}
    shapes |= {"transfer": (carriers, 2, 2), "a": (carriers,)}
    shapes |= dict.fromkeys(("interaction_types", "surface_ids", "object_ids", "material_ids"), (depth,))
    return np.zeros((0, *shapes.get(name, (carriers,) if name in LOSSES else ())))
