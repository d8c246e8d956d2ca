"""Rays that `test_bvh.py` casts on both kinds of trees: `MMW_BVH=... python -m tests.bvh_rays DEVICE FILE.npz`.

A case whose name begins with `outline` has rays that pass the outline of a thing, or start at a surface, closer than
float32 resolves.
"""

import sys
from collections.abc import Iterator

import numpy as np

from bench.scenes import grid_town, with_vehicles
from mmw.ray_tree import RayMesh
from mmw.scene import Scene
from tests.oracles import sphere_directions
from tests.scenes import arrays_from_parts, box_model, closed_box, pose, random_triangles
from tests.test_trace import SWEEP_S, cast, fast_vehicles, frame_of_its_own, loaded, random_rays
from tests.test_tree import grid, soup

DOWN = (0.0, 0.0, -1.0)


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def on_mesh(device: str, corners: np.ndarray, origin, direction, t_max: float = 1e4) -> np.ndarray:
    """Return distance and face of rays on one mesh, shape [R, 2]."""
    mesh = RayMesh(corners.reshape(-1, 3).astype(float), np.arange(3 * len(corners)).reshape(-1, 3), device)
    origin, direction = np.broadcast_arrays(np.atleast_2d(origin).astype(float), np.atleast_2d(direction))
    return np.stack(mesh.cast(origin, direction, t_max), axis=1)


def in_scene(scene: Scene, slot, origin, direction, **options) -> np.ndarray:
    """Return distance, face, instance and whether the ray is blocked, shape [R, 4]."""
    found = cast(scene, slot, origin, direction, **options)
    return np.stack([found.t, found.face, found.instance, found.is_blocked], axis=1)


def edge_points(corners: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return corners of triangles, and points on their edges as exactly as float32 tells."""
    along = rng.uniform(0.0, 1.0, (len(corners), 3, 1))
    on_edge = corners + along * (np.roll(corners, 1, axis=1) - corners)
    return np.concatenate([corners, on_edge]).reshape(-1, 3).astype(np.float32).astype(float)


def edges_of_sheets(device: str) -> Iterator[tuple[str, np.ndarray]]:
    cells = 24
    sheet, flat = grid(cells), grid(cells) * (1.0, 1.0, 0.0)
    target = edge_points(sheet, np.random.default_rng(7))
    is_inner = np.all((target[:, :2] > 0.5) & (target[:, :2] < cells - 0.5), axis=1)
    inner, level = target[is_inner], target[is_inner] * (1.0, 1.0, 0.0)
    for k, start in enumerate([(12.3, 11.1, 30.0), (-5.0, 40.0, 17.0), (12.0, 12.0, 8.0)]):
        yield f"edges of an uneven sheet {k}", on_mesh(device, sheet, start, unit(inner - start))
        yield f"outline of an uneven sheet {k}", on_mesh(device, sheet, start, unit(target[~is_inner] - start))
    for k, start in enumerate([(12.3, 11.1, 30.0), (12.0, 12.0, 8.0), (-300.0, 12.0, 3.0)]):
        yield f"edges of a flat sheet {k}", on_mesh(device, flat, start, unit(level - start))
    start = (-300.0, 12.0, 3.0)
    yield "outline of every bump of a sheet", on_mesh(device, sheet, start, unit(target - start))
    above = level + np.array((0.0, 0.0, 9.0))
    yield "straight down on edges", on_mesh(device, sheet, above, DOWN)
    yield "that end at a surface", on_mesh(device, flat, above, DOWN, 9.0)
    yield "that end behind it", on_mesh(device, flat, above, DOWN, 9.0001)
    yield "without an end", on_mesh(device, sheet, above, DOWN, np.inf)
    rng = np.random.default_rng(8)
    graze = np.stack([np.ones(2000), rng.uniform(-0.2, 0.2, 2000), -(10.0 ** rng.uniform(-6, -1, 2000))], axis=1)
    yield "grazing", on_mesh(device, sheet * (1.0, 1.0, 0.01), (-2.0, 12.1, 0.05), unit(graze))


def planes(device: str) -> Iterator[tuple[str, np.ndarray]]:
    rng = np.random.default_rng(9)
    flat = grid(6) * (1.0, 1.0, 0.0)
    wall = flat[:, :, [2, 0, 1]] + np.array((3.0, 0.0, 0.0))
    room = np.concatenate([flat, wall, flat + np.array((0.0, 0.0, 6.0)), flat[:, :, [0, 2, 1]]])
    along = np.array([(x, y, z) for x in (0, 0.5, 1, 3) for y in (0, 0.5, 2, 6) for z in (0, 0.25, 3, 6)], float)
    for axis in np.concatenate([np.eye(3), -np.eye(3)]):
        yield f"along {axis}, in planes and beside them", on_mesh(device, room, along, axis)
    yield "tiny parts of directions", on_mesh(device, room, along, (1.0, 1e-25, -1e-33))
    # Two squares in one plane that overlap, and one of them twice.
    square = np.array([[(0, 0, 0), (4, 0, 0), (4, 4, 0)], [(0, 0, 0), (4, 4, 0), (0, 4, 0)]], float)
    smaller = square * (0.9, 0.7, 1.0) + np.array((0.2, 0.3, 0.0))
    faces = np.concatenate([square, smaller, square, square + np.array((1.0, 0.0, 0.0))])
    turned = faces @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    for seed in range(3):
        order = np.random.default_rng(seed).permutation(len(faces))
        start = np.column_stack([rng.uniform(0.0, 5.0, (2000, 2)), np.full(2000, 3.0)])
        yield f"coplanar faces, straight {seed}", on_mesh(device, faces[order], start, DOWN)
        yield f"coplanar faces, slanted {seed}", on_mesh(device, faces[order], start, unit(np.array((0.1, 0.2, -1.0))))
        yield f"coplanar faces, turned {seed}", on_mesh(device, turned[order], *random_rays(seed, 4000, 6.0))
    same = np.concatenate([soup(3, 300) + np.array((0, 0, 40.0)), np.repeat(flat[:1] - (0, 0, 5.0), 40, axis=0)])
    start = np.array((0.7, 0.2, -9.0)) + rng.normal(size=(200, 3)) * 0.05
    yield "equal faces", on_mesh(device, same[rng.permutation(len(same))], start, (0, 0, 1.0))
    yield "one face", on_mesh(device, flat[:1], rng.uniform(-1, 2, (500, 3)), DOWN)
    line = np.array([[(0, 0, 0), (1, 1, 0), (2, 2, 0)], [(1, 0, 0), (1, 0, 0), (1, 0, 0)]], float)
    yield "faces without area", on_mesh(device, np.concatenate([line, flat - (0, 0, 7.0)]), (1.0, 1.0, 5.0), DOWN)


def triangles(device: str) -> Iterator[tuple[str, np.ndarray]]:
    for seed in range(3):
        yield f"random triangles {seed}", on_mesh(device, soup(seed, 900), *random_rays(seed, 4000, 12.0))
    corners = soup(5, 500)
    weight = np.random.default_rng(5).dirichlet((1.0, 1.0, 1.0), len(corners))
    surface = np.einsum("mc,mcx->mx", weight, corners).astype(np.float32).astype(float)
    way = random_rays(9, len(corners))[1]
    yield "outline: from a surface", on_mesh(device, corners, surface, way)
    yield "from a little off a surface", on_mesh(device, corners, surface + 1e-3 * way, way)


def in_scenes(device: str) -> Iterator[tuple[str, np.ndarray]]:
    for seed in range(2):
        arrays = random_triangles(seed, vehicles=40, frames=3)
        scene = loaded(arrays, device)
        for slot in range(3):
            yield f"town and vehicles {seed} {slot}", in_scene(scene, slot, *random_rays(seed, 3000))
            yield f"short rays {seed} {slot}", in_scene(scene, slot, *random_rays(seed, 3000), t_max=8.0)
    yield "inside of a box", in_scene(loaded(closed_box(), device), 0, (0.3, -0.2, 0.1), sphere_directions(5000))
    lone = loaded(frame_of_its_own(), device)
    yield "frames without vehicles", in_scene(lone, np.arange(5), (0, 0, 0.75), np.tile([1.0, 0, 0], (5, 1)))
    nothing = loaded(arrays_from_parts([]), device)
    yield "nothing", in_scene(nothing, 0, (0, 0, 0), sphere_directions(16))
    rows = np.array([[pose(*np.random.default_rng(v % 5).uniform(-30, 30, 2)) for v in range(12)]])
    actors = [(f"veh_{v}", "vehicle", 0) for v in range(12)]
    doubled = loaded(arrays_from_parts([], [box_model("car")], actors, rows), device)
    over = np.repeat(rows[0, :, :3] + [0.1, 0.2, 10.0], 50, axis=0)
    yield "vehicles in one place", in_scene(doubled, 0, over, np.tile(DOWN, (len(over), 1)))
    fast, _ = fast_vehicles(11)
    swept = loaded(fast, device, sweep_s=SWEEP_S)
    start, way = random_rays(11, 3000)
    yield "a sweep", in_scene(swept, 1, start, way, time_offset=-0.004)
    arrays = with_vehicles(grid_town(), 2)
    town = loaded(arrays, device)
    start = arrays.poses[1, :, :3] + (0.0, 0.0, 2.5)
    for k in range(4):
        yield f"a large town {k}", in_scene(town, 1, start[k], sphere_directions(20000), ignore=k)


def all_rays(device: str) -> dict[str, np.ndarray]:
    """Return what the rays of every case find, shape [R, 2] or [R, 4] each."""
    return {name: found for part in (triangles, edges_of_sheets, planes, in_scenes) for name, found in part(device)}


if __name__ == "__main__":
    np.savez(sys.argv[2], **all_rays(sys.argv[1]))  # pyright: ignore[reportArgumentType]
