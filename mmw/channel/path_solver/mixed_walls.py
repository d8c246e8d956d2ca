"""Reflect at walls of several materials: each with its own coefficient and its own part of the Kirchhoff integral.

Near the seam of two panes both reflect. The integral over a plane is the sum of those over its panes, and the
coefficient of each stands before its own, so that the level goes on without a step from one pane to the next.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

WEAKEST_PIECE = 3e-3
"""Panes with a smaller share of the mirror's field at every carrier are left out [-]: steps of 0.03 dB. Design
value."""


@dataclass(frozen=True)
class MixedWalls:
    """Combinations of materials at the reflections of some paths, whose fields add; all those of these paths."""

    path: np.ndarray
    """Path of each combination, growing, shape [R]."""
    material_id: np.ndarray
    """Material at each interaction, shape [R, D]; -1 where that of the path counts."""
    weight: np.ndarray
    """Share of the field of an endless mirror of these materials, shape [R, C], complex128."""

    def take(self, rows: np.ndarray) -> "MixedWalls":
        """Return those of some of the paths, whose rows grow; `path` counts these."""
        own = np.flatnonzero(np.isin(self.path, rows))
        columns = (getattr(self, name)[own] for name in ("material_id", "weight"))
        return MixedWalls(np.searchsorted(rows, self.path[own]), *columns)


def join_walls(one: MixedWalls, other: MixedWalls) -> MixedWalls:
    """Return the combinations of two sets of different paths as one set."""
    order = np.argsort(np.concatenate([one.path, other.path]), kind="stable")
    columns = ("path", "material_id", "weight")
    return MixedWalls(*(np.concatenate([getattr(one, name), getattr(other, name)])[order] for name in columns))


def mix_walls(
    path: np.ndarray,
    step: np.ndarray,
    first: np.ndarray,
    material: np.ndarray,
    share: np.ndarray,
    rest: np.ndarray,
    depth: int,
) -> MixedWalls:
    """Return the combinations of materials at reflections of which several panes have a part.

    Args:
        path: Path of each reflection, growing, shape [Q].
        step: Number of the interaction, shape [Q].
        first: First pane of each, and the number of panes, shape [Q + 1].
        material: Material of each pane, shape [M].
        share: Share of the mirror's field of each pane, shape [M, C].
        rest: Product of the shares of all other interactions of each path, shape [P, C].
        depth: Interactions of a path, D.
    """
    rows: list[tuple[int, np.ndarray, np.ndarray]] = []
    begin = np.flatnonzero(np.append(True, path[1:] != path[:-1])[: len(path)])
    for low, high in zip(begin, np.append(begin, len(path))[1:], strict=True):
        strong = [
            [m for m in range(first[q], first[q + 1]) if np.abs(share[m]).max() >= WEAKEST_PIECE]
            for q in range(low, high)
        ]
        for chosen in product(*strong):
            own = np.full(depth, -1)
            own[step[low:high]] = material[list(chosen)]
            rows.append((int(path[low]), own, rest[path[low]] * share[list(chosen)].prod(axis=0)))
    count = len(rows)
    material_id = np.array([own for _, own, _ in rows], dtype=np.int64).reshape(count, depth)
    weight = np.array([weight for _, _, weight in rows], dtype=np.complex128).reshape(count, rest.shape[1])
    return MixedWalls(np.array([p for p, _, _ in rows], dtype=np.int64), material_id, weight)
