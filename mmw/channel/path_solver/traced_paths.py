"""Hold the geometry of traced paths, and allocate the device buffers that tracing fills."""

from dataclasses import dataclass
from operator import attrgetter

import numpy as np
import warp as wp

from mmw.kernels.channel.segments import HitBuffers
from mmw.physics.em.interaction import TRANSMISSION


@dataclass(frozen=True)
class TracedPaths:
    """Geometry of P paths of at most D interactions."""

    link: np.ndarray
    """Shape [P], int32."""
    order: np.ndarray
    """Interactions of each path, shape [P], int32."""
    kind: np.ndarray
    """Kind of each interaction, 0 behind the last, shape [P, D], int32; D is at least 1."""
    surface: np.ndarray
    """Global surface id of each interaction, wedge id for a diffraction, -1 behind the last, shape [P, D], int32."""
    vertex: np.ndarray
    """Shape [P, D, 3], NaN behind the last."""
    normal: np.ndarray
    """Unit normal, turned to where the wave comes from, 0 for a diffraction, NaN behind the last, shape [P, D, 3]."""
    ray: np.ndarray
    """Ray that hit the rough patch of a diffuse path: r for the transmitter's, -2 - r for the receiver's, -1 for the
    other paths, shape [P], int32."""
    solid_angle: np.ndarray
    """Solid angle of that ray, times those of rays between patches, times the share that rays of one end have where
    those of both find a patch [sr, or a power of it], shape [P]; 0 for the other paths."""

    def __len__(self) -> int:
        return len(self.link)

    @property
    def kinds(self) -> int:
        """All kinds of interactions that there are: their numbers are bits."""
        return int(np.bitwise_or.reduce(self.kind, axis=None))

    @property
    def columns(self) -> tuple[np.ndarray, ...]:
        """Values of all fields."""
        return _COLUMNS(self)

    def take(self, rows: np.ndarray) -> "TracedPaths":
        """Return some of the paths, by their numbers."""
        return TracedPaths(*[values.take(rows, axis=0) for values in self.columns])

    def reverse(self, link: np.ndarray) -> "TracedPaths":
        """Return diffuse paths of the transmitters' rays as paths of the receivers' rays of other links, shape [P]."""
        kind, surface = (
            reverse_columns(values, self.order, fill) for values, fill in ((self.kind, 0), (self.surface, -1))
        )
        vertex, normal = (reverse_columns(values, self.order, np.nan) for values in (self.vertex, self.normal))
        normal *= np.where(kind == TRANSMISSION, -1.0, 1.0)[..., None]  # that of a patch looks to both ends
        return TracedPaths(
            link.astype(np.int32), self.order, kind, surface, vertex, normal, -2 - self.ray, self.solid_angle
        )


_COLUMNS = attrgetter(*TracedPaths.__dataclass_fields__)


def reverse_columns(values: np.ndarray, count: np.ndarray, fill: float) -> np.ndarray:
    """Return the first `count` [P] columns of each row from the last to the first, then `fill`, shape [P, D, ...]."""
    column = count[:, None].astype(np.int64) - 1 - np.arange(values.shape[1])
    taken = values[np.arange(len(values))[:, None], np.maximum(column, 0)]
    is_there = (column >= 0).reshape(column.shape + (1,) * (values.ndim - 2))
    return np.where(is_there, taken, fill).astype(values.dtype)


def make_hit_buffers(shape: tuple[int, int], device: str) -> HitBuffers:
    """Return empty rows for the kernels that trace segments, shape [C, D]."""
    hits = HitBuffers()
    hits.kind, hits.surface = (wp.zeros(shape, dtype=wp.int32, device=device) for _ in range(2))
    hits.vertex, hits.normal = (wp.zeros(shape, dtype=wp.vec3d, device=device) for _ in range(2))
    return hits
