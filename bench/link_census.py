"""What stands between roadside units and CAVs, and what reflects: counted by tracing, frame by frame."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.channel.links import LINK_V2I, make_links
from mmw.channel.path_solver.solver import solve_paths
from mmw.channel.path_solver.surface_table import make_surface_table
from mmw.channel.paths import PATH_LOS
from mmw.config import ChannelConfig
from mmw.kernels.core.structs import Hit
from mmw.kernels.core.trace import cast_kernel
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData, SceneObject

GLASS = ("glass_facade", "window_glass")
"""Materials that count as glass."""

BATCH = 25
"""Frames a launch."""


@dataclass(frozen=True)
class LinkCensus:
    """One link from a roadside unit to a CAV over the sampled frames."""

    rsu: str
    cav: str
    frames: int
    """Frames sampled (count)."""
    los_share: float
    """Share of the frames with line of sight."""
    blockers: dict[str, float]
    """What blocks the line first, seen from the unit -> share of the frames."""
    path_count: tuple[int, float, int]
    """Least, mean and greatest number of first-order paths in a frame (count)."""
    reflectors: dict[str, float]
    """What reflects -> share of the frames with at least one first-order path off it."""
    height_m: tuple[float, float]
    """Lowest and highest ground under the CAV [m]."""


def census(arrays: SceneData, weather: str, frames: Sequence[int], device: str = "cpu") -> list[LinkCensus]:
    """Count over some frames of a scenario, every surface tried for every link.

    Args:
        arrays: The scene.
        weather: Weather whose materials are taken.
        frames: Frames to look at.
        device: Warp device.
    """
    config = ChannelConfig(candidates="exhaustive", links=("v2i",), carriers_hz=(28e9,))
    scene = DeviceScene(arrays, device, BATCH)
    table = make_surface_table(scene)
    blocked: dict[tuple[int, int], Counter[str]] = {}
    reflected: dict[tuple[int, int], Counter[str]] = {}
    counts: dict[tuple[int, int], list[int]] = {}
    for begin in range(0, len(frames), BATCH):
        batch = list(frames[begin : begin + BATCH])
        scene.load_batch(batch)
        links = make_links(arrays, batch, config)
        paths = solve_paths(scene, links, config, {weather: arrays.materials[weather]}, table)
        first = _first_objects(scene, arrays, links.slot, links.tx.position, links.rx.position, links.rx_actor)
        los = np.isin(np.arange(len(links)), paths.link[paths.kind == PATH_LOS])
        for row in np.flatnonzero(links.kind == LINK_V2I):
            key = (int(links.tx_actor[row]), int(links.rx_actor[row]))
            mine = np.flatnonzero((paths.link == row) & (paths.order == 1))
            counts.setdefault(key, []).append(len(mine))
            seen = {
                kind
                for path in mine
                for kind in reflector_kinds(
                    arrays.objects[paths.object_id[path, 0]],
                    arrays.materials[weather][paths.material_id[path, 0]].name,
                    paths.vertex[path, 0, 2] > max(links.tx.position[row, 2], links.rx.position[row, 2]),
                )
            }
            reflected.setdefault(key, Counter()).update(seen)
            found = (
                "" if los[row] else blocker_kind(arrays.objects[first[row]]) if first[row] >= 0 else "the CAV itself"
            )
            blocked.setdefault(key, Counter()).update([found])
    result = []
    for (tx, rx), numbers in counts.items():
        total = len(numbers)
        share = {kind: count / total for kind, count in blocked[tx, rx].items()}
        rows = [arrays.frame_row(frame) for frame in frames]
        heights = arrays.poses[rows, rx, 2]
        result.append(
            LinkCensus(
                rsu=arrays.actors[tx].name,
                cav=arrays.actors[rx].name,
                frames=total,
                los_share=share.pop("", 0.0),
                blockers=share,
                path_count=(min(numbers), float(np.mean(numbers)), max(numbers)),
                reflectors={kind: count / total for kind, count in sorted(reflected[tx, rx].items())},
                height_m=(float(heights.min()), float(heights.max())),
            )
        )
    return result


def blocker_kind(thing: SceneObject) -> str:
    """Return what an object is called in the table: the kind in its prim's name, or its semantic class."""
    if thing.actor:
        return "parked car" if is_parked(thing) else thing.label
    name = re.sub(r"(_?\d+)+$", "", thing.prim_path.rsplit("/", 1)[-1])
    group = thing.prim_path.removeprefix("/World/Town/").split("/")[0].lower()
    if group == "props":
        return name.replace("_", " ")
    return {"skybridges": "skybridge", "bridges": "bridge"}.get(group, thing.label)


def reflector_kinds(thing: SceneObject, material: str, is_above: bool) -> list[str]:
    """Return what a reflection counts as: the kind of object, besides glass where the face is a pane, and a soffit
    where it happens above both ends."""
    return [blocker_kind(thing), *(["glass"] if material in GLASS else []), *(["soffit"] if is_above else [])]


def is_parked(thing: SceneObject) -> bool:
    """Return whether an object is a vehicle that belongs to the town."""
    return thing.prim_path.startswith("/World/Town/")


def _first_objects(
    scene: DeviceScene, arrays: SceneData, slot: np.ndarray, start: np.ndarray, end: np.ndarray, owner: np.ndarray
) -> np.ndarray:
    """Return the first object on the way from start to end, other than the receiver's own body; -1 for none, [L]."""
    way = end - start
    length = np.linalg.norm(way, axis=1)
    out = np.full(len(way), -1, dtype=np.int64)
    instance = {int(actor): index for index, actor in enumerate(scene.instance_actor)}
    ignore = np.array([instance.get(int(actor), -1) for actor in owner], dtype=np.int32)
    device = scene.device
    hit = wp.zeros(len(way), dtype=Hit, device=device)
    blocked = wp.zeros(len(way), dtype=wp.bool, device=device)
    wp.launch(
        cast_kernel,
        dim=len(way),
        inputs=[
            scene.struct,
            wp.array(slot.astype(np.int32), dtype=int, device=device),
            wp.array((start - scene.origin).astype(np.float32), dtype=wp.vec3, device=device),
            wp.array((way / length[:, None]).astype(np.float32), dtype=wp.vec3, device=device),
            float(length.max()),
            wp.array(ignore, dtype=int, device=device),
        ],
        outputs=[hit, blocked],
        block_dim=64,
        device=device,
    )
    found = hit.numpy()
    near = found["t"] < length
    out[near] = found["object_id"][near]
    return out
