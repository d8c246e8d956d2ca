"""Project lines and areas of the world into a camera's picture, and find what surfaces hide of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mmw.core.camera_models import Intrinsics
from mmw.core.mesh import separate
from mmw.core.transforms import rotate
from mmw.dataset.camera_geometry import from_world
from mmw.scene.device_scene import DeviceScene
from mmw.scene.ray_casting import cast_rays
from mmw.scene.scene_data import SceneData
from mmw.sensors.render.projection import project, unproject

PIECE_PX = 3.0
"""Longest piece of a line that is hidden or visible as a whole [px]. Design value."""

FIRST_PIECES = 8
"""Pieces of a segment at first: a lens that bends makes it a curve."""

MAX_ROUNDS = 24
"""Halvings of a piece at most; what still has an end behind the camera then is left out."""

SLACK = 2e-3
"""A point is hidden if it is farther than the surface by more than this share of its distance. Design value: depth is
known in pixel centers only."""

SLACK_M = 0.05
"""The same as a distance [m]: interactions and antennas lie on surfaces. Design value."""


@dataclass(frozen=True)
class Run:
    """Part of a line in the picture, all of it visible or all of it hidden."""

    line: int
    """Index of the line."""
    pixels: np.ndarray
    """Points along it, column and row [px], pixel edges at whole numbers, shape [N, 2]."""
    is_hidden: bool
    """True if a surface is in front of it."""


@dataclass(frozen=True)
class PictureView:
    """A camera's view of the world, with the distance of what it sees."""

    intrinsics: Intrinsics
    pose: np.ndarray
    """Camera to world, x along the optical axis, y left, z up, shape [7]."""
    distance: np.ndarray | None
    """Distance of the first surface in each pixel's center [m], inf for none, shape [H, W]; None hides nothing."""

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Return where points of the world [m], shape [..., 3], lie in the picture [px], shape [..., 2]; see
        `project`."""
        return project(self.intrinsics, from_world(self.pose, points))

    def is_hidden(self, points: np.ndarray) -> np.ndarray:
        """Return whether a surface is in front of points of the world [m], shape [N, 3] -> [N].

        A point is hidden if it lies behind the surfaces in its pixel and in the eight around it, so that a point on a
        surface that the camera sees at a grazing angle is not.
        """
        hidden = np.zeros(len(points), dtype=bool)
        if self.distance is None:
            return hidden
        height, width = self.distance.shape
        pixels = self.pixels(points)
        inside = (pixels >= 0.0).all(axis=1) & (pixels[:, 0] < width) & (pixels[:, 1] < height)
        column, row = np.floor(pixels[inside]).astype(np.int64).T
        around = np.pad(self.distance, 1, mode="edge")
        nearest = np.max([around[row + dv, column + du] for dv in range(3) for du in range(3)], axis=0)
        away = np.linalg.norm(points[inside] - self.pose[:3], axis=1)
        hidden[inside] = away * (1.0 - SLACK) - SLACK_M > nearest
        return hidden

    def runs(self, lines: Sequence[np.ndarray]) -> list[Run]:
        """Return the parts of lines that lie in the picture, from the first to the last line and along each.

        Args:
            lines: Points of each line, world frame [m], shape [K, 3] each.
        """
        starts, steps, owner = _segments(lines)
        segment, low, high = self._pieces(starts, steps)
        order = np.lexsort((low, segment))
        segment, low, high = segment[order], low[order], high[order]

        def at(t: np.ndarray) -> np.ndarray:
            return starts[segment] + t[:, None] * steps[segment]

        hidden = self.is_hidden(at(0.5 * (low + high)))
        first, last = self.pixels(at(low)), self.pixels(at(high))
        # A run goes on while pieces follow each other within a segment, or from its end into the next of one line.
        is_next = (segment[1:] == segment[:-1]) & (low[1:] == high[:-1])
        follows = (segment[1:] == segment[:-1] + 1) & (high[:-1] == 1.0) & (low[1:] == 0.0)
        is_next |= follows & (owner[segment[1:]] == owner[segment[:-1]])
        breaks = np.flatnonzero(~is_next | (hidden[1:] != hidden[:-1])) + 1
        found = []
        for begin, end in zip([0, *breaks], [*breaks, len(segment)], strict=True):
            if end > begin:
                pixels = np.concatenate([first[begin : begin + 1], last[begin:end]])
                found.append(Run(int(owner[segment[begin]]), pixels, bool(hidden[begin])))
        return found

    def _pieces(self, starts: np.ndarray, steps: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return pieces of segments within the picture, none longer than `PIECE_PX`.

        Returns:
            Segment of each piece, and where along it the piece begins and ends, 0 to 1, shape [N] each.
        """
        size = np.array([self.intrinsics.width, self.intrinsics.height], dtype=np.float64)
        segment = np.repeat(np.arange(len(starts)), FIRST_PIECES)
        low = np.tile(np.arange(FIRST_PIECES) / FIRST_PIECES, len(starts))
        high = low + 1.0 / FIRST_PIECES
        done: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = [(segment[:0], low[:0], high[:0])]
        for _ in range(MAX_ROUNDS):
            ends = [self.pixels(starts[segment] + t[:, None] * steps[segment]) for t in (low, high)]
            is_ahead = [np.isfinite(one).all(axis=1) for one in ends]
            with np.errstate(invalid="ignore"):
                below, above = np.minimum(*ends), np.maximum(*ends)
                overlaps = ((above >= 0.0) & (below <= size)).all(axis=1)
                is_short = np.linalg.norm(ends[1] - ends[0], axis=1) <= PIECE_PX
            both = is_ahead[0] & is_ahead[1]
            is_done = both & overlaps & is_short
            done.append((segment[is_done], low[is_done], high[is_done]))
            is_open = (both & overlaps & ~is_short) | (is_ahead[0] != is_ahead[1])
            segment, low, high = segment[is_open], low[is_open], high[is_open]
            if not len(segment):
                break
            middle = 0.5 * (low + high)
            segment = np.concatenate([segment, segment])
            low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
        segment, low, high = (np.concatenate([part[k] for part in done]) for k in range(3))
        return segment, low, high


def _segments(lines: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return start [S, 3] and step to the end [S, 3] of each segment of lines, and the line of each, shape [S]."""
    starts = np.concatenate([np.zeros((0, 3)), *(line[:-1] for line in lines)])
    steps = np.concatenate([np.zeros((0, 3)), *(np.diff(line, axis=0) for line in lines)])
    owner = np.repeat(np.arange(len(lines)), [len(line) - 1 for line in lines])
    return starts, steps, owner


def triangles_in_pixels(view: PictureView, triangles: np.ndarray, device: str) -> np.ndarray:
    """Return which triangle each pixel's center shows, -1 for none or one behind what the camera sees.

    Args:
        view: The camera's view.
        triangles: Corners of the triangles, world frame [m], shape [F, 3, 3].
        device: Warp device that traces.

    Returns:
        Index of the triangle, shape [H, W], int32.
    """
    camera = view.intrinsics
    shape = (camera.height, camera.width)
    if not len(triangles):
        return np.full(shape, -1, dtype=np.int32)
    row, column = np.indices(shape)
    directions = unproject(camera, np.stack([column + 0.5, row + 0.5], axis=-1).reshape(-1, 2))
    scene = DeviceScene(_triangle_scene(triangles), device, 1)
    scene.load_batch([0])
    hits = cast_rays(scene, np.broadcast_to(view.pose[:3], directions.shape), rotate(view.pose[3:], directions))
    found = hits.object_id.reshape(shape)
    if view.distance is None:
        return found
    away = hits.distance.reshape(shape)
    return np.where(away * (1.0 - SLACK) - SLACK_M > view.distance, -1, found).astype(np.int32)


def _triangle_scene(triangles: np.ndarray) -> SceneData:
    """Return triangles as a scene in which each is an object."""
    mesh, number = separate(triangles), np.arange(len(triangles), dtype=np.int32)
    return SceneData(
        points=mesh.points, faces=mesh.faces, material=np.zeros_like(number), object_id=number, surface=number,
        models=(), actors=(), frames=range(1), poses=np.zeros((1, 0, 7)), materials={},
    )  # fmt: skip
