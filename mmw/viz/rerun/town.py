"""The static town of a dataset's stage as colored meshes."""

from pathlib import Path

import numpy as np
import rerun as rr

from mmw.core.errors import InputError
from mmw.dataset.camera_geometry import POSE_COLUMNS
from mmw.generation.provenance import stored_config
from mmw.scene.foliage import optical_arrays
from mmw.scene.prepare import read_frame, stored_stage
from mmw.scene.scene_data import SceneData
from mmw.viz.rerun.entities import TOWN
from mmw.viz.rerun.selection import Scope
from mmw.viz.scene_view.surfaces import SurfaceMesh, faces_with_normals, group_meshes, material_styles

MARGIN_M = 150.0
"""The town is shown this far around the rectangle of all agents' places [m]: the LiDAR's range and more. Design
value."""


def town_meshes(arrays: SceneData, weather: str, low: np.ndarray, high: np.ndarray) -> list[SurfaceMesh]:
    """Return the faces of the static town, one mesh a material; vertices of equal place and normal are joined.

    Args:
        arrays: The scene.
        weather: Weather of the materials.
        low: Least x and y of a face's middle [m], shape [2].
        high: Largest x and y.
    """
    corners = faces_with_normals(arrays)
    middle = corners[..., :2].mean(axis=1)
    is_near = ((middle >= low) & (middle <= high)).all(axis=1)
    return group_meshes(corners[is_near], arrays.material[is_near], material_styles(arrays.materials[weather]))


def read_town(scope: Scope) -> list[SurfaceMesh]:
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
    stage = stored_stage(root, scenario)
    arrays = optical_arrays(read_frame(config, scenario, stage, scope.frames[0], scope.weather))
    rows = data.numpy(
        "poses", columns=["agent", *POSE_COLUMNS[:2]], scenario=scope.scenario, weather=scope.weather, frames=scope.span
    )
    is_own = np.isin(rows["agent"].astype(str), scope.agents)
    places = np.stack([rows["x"], rows["y"]], axis=1)[is_own]
    return town_meshes(arrays, scope.weather, places.min(axis=0) - MARGIN_M, places.max(axis=0) + MARGIN_M)


def log_town(stream: rr.RecordingStream, meshes: list[SurfaceMesh]) -> None:
    """Log the town: what does not change."""
    for mesh in meshes:
        stream.log([*TOWN.split("/"), mesh.name], mesh_shape(mesh), static=True)


def mesh_shape(mesh: SurfaceMesh) -> rr.Mesh3D:
    """Return a mesh as Rerun's archetype."""
    return rr.Mesh3D(
        vertex_positions=mesh.points,
        vertex_normals=mesh.normals,
        triangle_indices=mesh.faces,
        albedo_factor=mesh.color,
    )
