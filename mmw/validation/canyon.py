"""Build scenes of their own for checks: an urban canyon of tall houses of many heights, with gaps, and open ground."""

import numpy as np

from mmw.core.mesh import TriangleMesh, merge
from mmw.core.planar_surfaces import find_surfaces
from mmw.physics.materials.material import LIDAR_REFLECTANCE_905NM, Material
from mmw.scene.scene_data import SceneData, SceneObject
from mmw.usd.material_library import LIBRARY
from mmw.usd.semantics import CARLA_TAG
from mmw.usd.standard_materials import STANDARD

WIDTH_M, LENGTH_M = 24.0, 400.0
"""Distance between the rows, and their length."""

LOWEST_M, HIGHEST_M = 15.0, 50.0
"""Heights of the houses."""

FACADES = ("concrete_facade", "window_glass", "marble_facade")


def urban_canyon(seed: int = 0) -> SceneData:
    """Return the canyon, along x about the origin: houses 20 to 45 m wide, set back by up to 3 m, some 12 m apart.

    Args:
        seed: Seed of widths, heights, gaps and facades.
    """
    rng = np.random.default_rng(seed)
    half = LENGTH_M
    meshes = [_box((-half, -half, -1.0), (half, half, 0.0))]
    materials, names = ["asphalt"], ["/World/Town/Roads/ground"]
    for side in (-1, 1):
        begin = -LENGTH_M / 2
        while begin < LENGTH_M / 2:
            width, gap, height = rng.uniform(20, 45), rng.choice([0.0, 0.0, 12.0]), rng.uniform(LOWEST_M, HIGHEST_M)
            near = WIDTH_M / 2 + rng.uniform(0, 3)
            low, high = (near, near + 30.0) if side > 0 else (-near - 30.0, -near)
            meshes.append(_box((begin, low, 0.0), (begin + width, high, height)))
            materials.append(str(rng.choice(FACADES)))
            names.append(f"/World/Town/Buildings/house_{len(names)}")
            begin += width + gap
    return _scene(meshes, materials, names)


def open_ground() -> SceneData:
    """Return level asphalt, 800 m wide, and nothing else."""
    return _scene(
        [_box((-LENGTH_M, -LENGTH_M, -1.0), (LENGTH_M, LENGTH_M, 0.0))], ["asphalt"], ["/World/Town/Roads/ground"]
    )


def _box(low: tuple[float, float, float], high: tuple[float, float, float]) -> TriangleMesh:
    """Return a box between two corners [m], with faces outward."""
    ends = np.array([low, high])
    points = np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    return TriangleMesh(points, np.array(faces, dtype=np.int32))


def _scene(meshes: list[TriangleMesh], materials: list[str], names: list[str]) -> SceneData:
    """Return a scene of objects of one material each, without actors, in weather `sunny`."""
    whole, used = merge(meshes), list(dict.fromkeys(materials))
    counts = [len(mesh.faces) for mesh in meshes]
    ids = np.repeat(np.array([used.index(name) for name in materials], dtype=np.int32), counts)
    object_id = np.repeat(np.arange(len(meshes), dtype=np.int32), counts)
    by_id = tuple(_material(name) for name in used)
    labels = ["road" if "/Roads/" in name else "building" for name in names]
    objects = tuple(
        SceneObject(index, name, label, CARLA_TAG[label], (material,))
        for index, (name, label, material) in enumerate(zip(names, labels, materials, strict=True))
    )
    return SceneData(
        whole.points, whole.faces, ids, object_id, find_surfaces(whole.points, whole.faces, object_id, ids), (), (),
        range(1), np.zeros((1, 0, 7)), {"sunny": by_id}, objects,
    )  # fmt: skip


def _material(name: str) -> Material:
    """Return a material with the radio description of the preset `standard`."""
    base = LIBRARY[name].base
    return Material(name, STANDARD[name].radio, base, LIDAR_REFLECTANCE_905NM[base], (0.5,) * 3)
