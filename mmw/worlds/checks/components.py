"""Pieces of a stage: triangles that hang together over shared vertices, across prims."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mmw.core.planar_surfaces import components, weld
from mmw.worlds.checks.stage_model import StageModel


@dataclass(frozen=True)
class ConnectedComponents:
    """Triangles of a world that are no ground, by piece."""

    model: StageModel
    face: np.ndarray
    """Triangles of the world, shape [M]."""
    corner: np.ndarray
    """Welded vertex of each corner, shape [M, 3]."""
    component: np.ndarray
    """Piece of each triangle, 0 to K - 1, shape [M]."""

    @cached_property
    def count(self) -> int:
        """Number of pieces."""
        return int(self.component.max(initial=-1)) + 1

    @cached_property
    def part(self) -> np.ndarray:
        """Part of the first triangle of each piece, shape [K]."""
        return self.model.part_of[self.face[np.unique(self.component, return_index=True)[1]]]

    @cached_property
    def lowest(self) -> np.ndarray:
        """Lowest height of each piece [m], shape [K]."""
        z = np.full(self.count, np.inf)
        np.minimum.at(z, self.component, self.model.mesh.corners[self.face, :, 2].min(axis=1))
        return z


def find_components(model: StageModel) -> ConnectedComponents:
    """Return the pieces of everything that is no ground. The parts of one actor are one piece."""
    face = np.setdiff1d(np.arange(len(model.mesh.faces)), model.ground)
    mesh = model.mesh.select(face)
    corner = weld(mesh.points)[mesh.faces] if len(face) else np.zeros((0, 3), dtype=int)
    first, second = [corner[:, 0], corner[:, 0]], [corner[:, 1], corner[:, 2]]
    owner = np.array([part.object_path if part.is_actor else "" for part in model.parts], dtype=object)[
        model.part_of[face]
    ]
    for name in dict.fromkeys(owner[owner != ""].tolist()):
        own = corner[owner == name, 0]
        first.append(own[:-1])
        second.append(own[1:])
    label = components(len(mesh.points), np.concatenate(first), np.concatenate(second))
    component = np.unique(label[corner[:, 0]], return_inverse=True)[1]
    return ConnectedComponents(model, face, corner, component)
