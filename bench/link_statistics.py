"""Measure how links live in each preset of the physics: outage, paths, births, jumps, and reflections at poles.

    python -m bench.link_statistics --physics paper standard --frames 40 [--scenarios town03_roundabout ...]

Prints a line of JSON for each scenario and preset, at the first carrier in dry weather. A birth is a path whose
identifier its link did not have in the frame before; it continues an old path if one that ended there had nearly its
length.
"""

import argparse
import json
import time

import numpy as np

from mmw import load_config, load_scene
from mmw.channel.links import Links, make_links
from mmw.channel.path_solver.solver import solve_paths
from mmw.channel.path_solver.surface_table import make_surface_table
from mmw.channel.paths import PathSet
from mmw.config.physics_presets import PHYSICS_PRESETS
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.physics.em.interaction import SPECULAR
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData

SAME_LENGTH_M = 0.1
"""Largest change of length between two frames of what counts as one path [m]: 10 m/s over 0.01 s."""

JUMP_DB = 3.0
"""Change of the level of one path from frame to frame that counts as a jump [dB]."""


def lives(links: Links, paths: PathSet, weather: str) -> dict[str, float]:
    """Return the shares of births and jumps over successive frames of all links."""
    length, level = paths.tau * SPEED_OF_LIGHT, np.abs(paths.a[weather][:, 0])
    order = np.argsort(paths.link, kind="stable")
    first = np.concatenate([[0], np.cumsum(paths.count)])
    births = continued = pairs = jumps = 0
    before: dict[tuple[int, ...], dict[int, int]] = {}
    for link in np.argsort(links.frame, kind="stable"):
        ends = tuple(
            int(column[link]) for column in (links.tx_actor, links.rx_actor, links.tx_antenna, links.rx_antenna)
        )
        now = {int(paths.path_id[row]): int(row) for row in order[first[link] : first[link + 1]]}
        old = before.get(ends)
        if old is not None:
            ended = length[[row for name, row in old.items() if name not in now]]
            for name, row in now.items():
                if name in old:
                    pairs += 1
                    with np.errstate(divide="ignore", invalid="ignore"):
                        jumps += bool(abs(20.0 * np.log10(level[row] / level[old[name]])) > JUMP_DB)
                else:
                    births += 1
                    continued += bool((np.abs(ended - length[row]) < SAME_LENGTH_M).any())
        before[ends] = now
    return {
        "births_per_link_frame": births / len(links),
        "births_that_continue": continued / max(births, 1),
        "jumps": jumps / max(pairs, 1),
    }


def pole_levels(data: SceneData, paths: PathSet, weather: str) -> np.ndarray:
    """Return the levels of reflections at poles and traffic lights over free space of their length [dB]."""
    labels = np.array([item.label for item in data.objects])
    own = (paths.order == 1) & (paths.interaction[:, 0] == SPECULAR)
    own &= np.isin(labels[np.maximum(paths.object_id[:, 0], 0)], ("pole", "traffic_light"))
    free = SPEED_OF_LIGHT / paths.carriers_hz[0] / (4.0 * np.pi * paths.tau[own] * SPEED_OF_LIGHT)
    level = np.abs(paths.transfer[weather][own, 0]).max(axis=(1, 2))
    return 20.0 * np.log10(np.maximum(level / free, 1e-12))


def measure(scenario: str, physics: str, frame_count: int, device: str) -> dict[str, object]:
    """Return the statistics of the first frames of a scenario of the paper."""
    whole = load_config("full", [f"channel.physics={physics}"])
    scene = load_scene(whole, scenario=scenario, weather=["sunny"], device=device)
    data, on_device = scene.arrays, DeviceScene(scene.arrays, scene.device, frame_count)
    frames = list(data.frames[:frame_count])
    on_device.load_batch(frames)
    config = whole.channel
    links = make_links(data, frames, config)
    table = make_surface_table(on_device, **config.surface_options)
    began = time.perf_counter()
    paths = solve_paths(on_device, links, config, data.materials, table, air=scene.weathers)
    poles = pole_levels(data, paths, "sunny")
    return {
        "scenario": scenario,
        "physics": physics,
        "frames": len(frames),
        "links": len(links),
        "solve_s": round(time.perf_counter() - began, 2),
        "without_path": float((paths.count == 0).mean()),
        "paths_per_link": len(paths) / len(links),
        **lives(links, paths, "sunny"),
        "pole_paths": len(poles),
        "pole_level_db": float(np.median(poles)) if len(poles) else None,
    }


def main() -> None:
    """Print the statistics."""
    names = [scenario.name for scenario in load_config("full").scenarios]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--physics", nargs="+", default=["paper", "standard"], choices=list(PHYSICS_PRESETS))
    parser.add_argument("--scenarios", nargs="+", default=names, choices=names, metavar="NAME")
    parser.add_argument("--frames", type=int, default=40, help="first frames of each scenario")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N")
    options = parser.parse_args()
    for scenario in options.scenarios:
        for physics in options.physics:
            print(json.dumps(measure(scenario, physics, options.frames, options.device)), flush=True)


if __name__ == "__main__":
    main()
