"""The static town of a dataset's stage as colored meshes."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr

from mmw.core.errors import InputError
from mmw.core.mesh import TriangleMesh
from mmw.dataset.camera_geometry import POSE_COLUMNS
from mmw.generation.provenance import stored_config
from mmw.scene.prepare import read_frame, stored_stage
from mmw.scene.scene_data import SceneData
from mmw.viz.rerun.entities import TOWN
from mmw.viz.rerun.selection import Scope
from mmw.worlds.materials.textures import srgb

MARGIN_M = 150.0
"""The town is shown this far around the rectangle of all agents' places [m]: the LiDAR's range and more. Design
value."""


@dataclass(frozen=True)
class TownMesh:
    """All faces of one material."""

    name: str
    points: np.ndarray
    """Vertices in the world [m], shape [N, 3], float32."""
    normals: np.ndarray
    """Unit normals at the vertices, shape [N, 3], float32."""
    faces: np.ndarray
    """Triangles, counter-clockwise seen from outside, shape [M, 3], uint32."""
    color: tuple[int, int, int]
    """8-bit sRGB."""


def town_meshes(arrays: SceneData, weather: str, low: np.ndarray, high: np.ndarray) -> list[TownMesh]:
    """Return the faces of the static town, one mesh a material; vertices of equal place and normal are joined.

    Args:
        arrays: The scene.
        weather: Weather of the materials.
        low: Least x and y of a face's middle [m], shape [2].
        high: Largest x and y.
    """
    mesh = TriangleMesh(arrays.points, arrays.faces)
    middle = mesh.corners[..., :2].mean(axis=1)
    is_near = ((middle >= low) & (middle <= high)).all(axis=1)
    normals = np.where((arrays.normals == 0.0).all(axis=-1, keepdims=True), mesh.normals[:, None], arrays.normals)
    found = []
    for index, material in enumerate(arrays.materials[weather]):
        own = is_near & (arrays.material == index)
        if not own.any():
            continue
        both = np.concatenate([mesh.corners[own], normals[own]], axis=-1).reshape(-1, 6).astype(np.float32)
        vertices, place = np.unique(both, axis=0, return_inverse=True)
        red, green, blue = (int(value) for value in srgb(np.asarray(material.color)))
        faces = place.reshape(-1, 3).astype(np.uint32)
        found.append(TownMesh(material.name, vertices[:, :3], vertices[:, 3:], faces, (red, green, blue)))
    return found


def read_town(scope: Scope) -> list[TownMesh]:
    """Return the town of a dataset's stored stage around the agents.

    Raises:
        InputError: If the dataset is not on this machine, or its stage is not there or cannot be read.
    """
    data = scope.data
    if data.filesystem is not None:
        raise InputError(f"{data.root}: the stage of a dataset elsewhere is not read; copy `stages` and `assets` too")
    root = Path(data.root)
    config = stored_config(root)
    scenario = config.scenario(scope.scenario)
    arrays = read_frame(config, scenario, stored_stage(root, scenario), scope.frames[0], scope.weather)
    rows = data.numpy(
        "poses", columns=["agent", *POSE_COLUMNS[:2]], scenario=scope.scenario, weather=scope.weather, frames=scope.span
    )
    is_own = np.isin(rows["agent"].astype(str), scope.agents)
    places = np.stack([rows["x"], rows["y"]], axis=1)[is_own]
    return town_meshes(arrays, scope.weather, places.min(axis=0) - MARGIN_M, places.max(axis=0) + MARGIN_M)


def log_town(stream: rr.RecordingStream, meshes: list[TownMesh]) -> None:
    """Log the town: what does not change."""
    for mesh in meshes:
        shape = rr.Mesh3D(
            vertex_positions=mesh.points,
            vertex_normals=mesh.normals,
            triangle_indices=mesh.faces,
            albedo_factor=mesh.color,
        )
        stream.log([*TOWN.split("/"), mesh.name], shape, static=True)
