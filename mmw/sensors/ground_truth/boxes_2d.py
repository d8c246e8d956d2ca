"""Compute 2-D boxes: of the pixels that show each vehicle and person, and of the whole 3-D box."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.core.camera_models import Intrinsics
from mmw.core.recorded_work import NewArrays
from mmw.core.transfer import to_host
from mmw.core.transforms import compose, invert, rotate, transform_points
from mmw.kernels.camera import boxes_2d as kernels
from mmw.scene.scene_data import SceneData
from mmw.scene.views import Views
from mmw.sensors.ground_truth.boxes_3d import Boxes
from mmw.sensors.ground_truth.visibility import boxed_actors
from mmw.sensors.render.projection import project, unproject
from mmw.sensors.samples import PointSamples

STRIP = 16
"""Pixels that one thread of the kernel reads."""

NEAR_M = 0.01
"""Depth at which 3-D boxes are cut, so that one that reaches behind the camera has an image [m]: one step of the depth
image. Design value."""

CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
"""Corners of a box of unit size."""

STEPS = 16
"""Pieces of an edge behind a lens that bends it. Design value: within 0.1 px of the curve in an image of 640 px."""

ASTERN_RAD = np.radians(170.0)
"""Angle from the optical axis beyond which a fisheye's image of an edge is left out: straight behind it would jump from
one side to the other. Design value, beyond the widest lens."""

EDGES = np.array([(i, i | bit) for bit in (1, 2, 4) for i in range(8) if not i & bit])
"""Corner numbers of the twelve edges of a box."""

PAIRS = np.array([(i, j) for i in range(len(EDGES)) for j in range(i)])
"""Pairs of edges: where two of them cross the near plane, what lies between is inside the box."""


@dataclass(frozen=True)
class VisiblePixels:
    """Pixels of each view that show each wanted object; K is the number of wanted objects."""

    pixels: np.ndarray
    """Number of pixels, shape [A, K], int32."""
    bounds: np.ndarray
    """Smallest rectangle around them, (u_min, v_min, u_max, v_max) at pixel edges [px], shape [A, K, 4], int32; no
    meaning where there is no pixel."""

    @classmethod
    def of(cls, pixels: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> "VisiblePixels":
        """Return what `count_pixels` found, on the host."""
        return cls(pixels, np.concatenate([lower, upper], axis=2))


@dataclass(frozen=True)
class Boxes2d(PointSamples):
    """2-D boxes of actors in the images of A views, or in that of a single view; N boxes, in the order of the actors.

    Rectangles are (u_min, v_min, u_max, v_max) [px].
    """

    object_id: np.ndarray
    """Object id of the actor, shape [N], int32."""
    pixels: np.ndarray
    """Number of pixels that show it, shape [N], int32."""
    bounds: np.ndarray
    """Rectangle around them, shape [N, 4], int32; no meaning where there is no pixel."""
    amodal: np.ndarray
    """Rectangle around the part of its 3-D box that the image frames, hidden or not, shape [N, 4], float32."""
    truncation: np.ndarray
    """Share of the rectangle around the whole 3-D box that `amodal` leaves out, 0 to 1, shape [N], float32."""
    distance: np.ndarray
    """Distance from the camera to the middle of the 3-D box [m], shape [N], float32."""


@dataclass(frozen=True)
class ProjectedBoxes:
    """3-D boxes that images frame; rows are ordered by view, then as the 3-D boxes are. N is their number."""

    view: np.ndarray
    """View, shape [N], int64."""
    box: np.ndarray
    """Row of the 3-D boxes, shape [N], int64."""
    amodal: np.ndarray
    """Rectangle around the part of the 3-D box that the image frames, hidden or not: (u_min, v_min, u_max, v_max) [px],
    shape [N, 4], float64."""
    truncation: np.ndarray
    """Share of the rectangle around the whole 3-D box that `amodal` leaves out, 0 to 1, shape [N]; close to 1 for a
    box that reaches behind the camera."""
    distance: np.ndarray
    """Distance from the camera to the middle of the 3-D box [m], shape [N]."""


def visible_pixels(object_id: wp.array, wanted: Sequence[int] | np.ndarray) -> VisiblePixels:
    """Return how many pixels show each wanted object, and the smallest rectangle around them, counted on the device.

    Args:
        object_id: Object in each pixel, -1 for nothing, shape [A, H, W], int32, on any device.
        wanted: K different object ids, such as those of the actors that have boxes.
    """
    ids = np.asarray(wanted, dtype=np.int32)
    arrays = NewArrays(object_id.device)
    place_of = wp.array(object_places(ids), dtype=int, device=object_id.device)
    return VisiblePixels.of(*to_host(count_pixels(object_id, place_of, len(ids), arrays)))


def object_places(wanted: np.ndarray) -> np.ndarray:
    """Return the place of each object among some wanted ids, -1 for the others, shape [largest id + 1], int32."""
    place_of = np.full(int(wanted.max(initial=-1)) + 1, -1, dtype=np.int32)
    place_of[wanted] = np.arange(len(wanted))
    return place_of


def count_pixels(object_id: wp.array, place_of: wp.array, wanted: int, arrays: NewArrays) -> list[wp.array]:
    """Return the pixels that show each wanted object, and the corners of the smallest rectangle around them.

    Args:
        object_id: Object in each pixel, -1 for nothing, shape [A, H, W], int32.
        place_of: From `object_places`.
        wanted: Wanted objects, K.
        arrays: Source of arrays.

    Returns:
        Number, (u_min, v_min) and (u_max, v_max) at pixel edges [px], shapes [A, K], [A, K, 2] and [A, K, 2], int32.
    """
    views, height, width = object_id.shape
    pixels = arrays.full((views, wanted), 0, int)
    lower = arrays.full((views, wanted, 2), max(height, width), int)
    upper = arrays.full((views, wanted, 2), 0, int)
    if views and wanted:
        launch = views, -(-height // STRIP), width
        inputs = [object_id, place_of]
        wp.launch(kernels.visible_boxes_kernel, launch, inputs, [pixels, lower, upper], device=object_id.device)
    return [pixels, lower, upper]


def image_boxes(arrays: SceneData, views: Views, camera: Intrinsics, boxes: Boxes, visible: VisiblePixels) -> Boxes2d:
    """Return the 2-D boxes in the images of some views.

    Args:
        arrays: The scene on the host.
        views: The views, A rows.
        camera: Intrinsics.
        boxes: 3-D boxes of the views' frames.
        visible: Pixels of the actors in the order of `boxed_actors`.
    """
    found = project_boxes(camera, views, boxes)
    place_of = np.full(len(arrays.actors), -1, dtype=np.int64)
    wanted = boxed_actors(arrays.actors)
    place_of[wanted] = np.arange(len(wanted))
    place = place_of[boxes.actor[found.box]]
    return Boxes2d(
        np.searchsorted(found.view, np.arange(len(views) + 1)).astype(np.int32),
        boxes.object_id[found.box],
        visible.pixels[found.view, place],
        visible.bounds[found.view, place],
        *(values.astype(np.float32) for values in (found.amodal, found.truncation, found.distance)),
    )


def project_boxes(camera: Intrinsics, views: Views, boxes: Boxes) -> ProjectedBoxes:
    """Return where the 3-D boxes of each view's frame lie in its image.

    A box is cut at the near plane (`NEAR_M`) and at the four sides of the image, not only its rectangle, so `amodal`
    is the tight rectangle around what is framed. There is a row for every box of which a part is framed, the view's
    own vehicle included, however far away, and whether anything hides it or not. A fisheye sees what is beside
    and behind it too, so nothing is cut at the near plane there.
    """
    view, box = np.nonzero(views.frame[:, None] == boxes.frame[None, :])
    to_camera = invert(views.pose)[view]
    middle = transform_points(to_camera, boxes.pose[box, :3])
    is_fisheye = camera.distortion.model == "fisheye"
    possible = _may_be_framed(camera, middle, 0.5 * np.linalg.norm(boxes.size[box], axis=1))
    view, box, to_camera, middle = view[possible], box[possible], to_camera[possible], middle[possible]
    local = CORNERS * boxes.size[box][:, None, :]
    corners = transform_points(to_camera[:, None], transform_points(boxes.pose[box][:, None], local))
    is_behind = (corners[..., 0] < NEAR_M) & (not is_fisheye)
    is_cut = is_behind.any(axis=1) & ~is_behind.all(axis=1)
    whole, framed = np.empty((len(box), 4)), np.empty((len(box), 4))
    for rows, segments in ((~is_cut, _edges), (is_cut, _cut_edges)):
        whole[rows], framed[rows] = _rectangles(camera, *segments(corners[rows], is_behind[rows]))
    framed = _with_image_corners(camera, framed, views.pose[view], boxes.pose[box], boxes.size[box])
    is_framed = (framed[:, 2] > framed[:, 0]) & (framed[:, 3] > framed[:, 1])
    rectangle = framed[is_framed]
    share = _area(rectangle) / np.maximum(_area(whole[is_framed]), np.finfo(np.float64).tiny)
    distance = np.linalg.norm(middle[is_framed], axis=1)
    return ProjectedBoxes(view[is_framed], box[is_framed], rectangle, np.clip(1.0 - share, 0.0, 1.0), distance)


def _may_be_framed(camera: Intrinsics, middle: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Return whether balls reach into what the camera sees, shape [N]; most boxes of a scene lie outside.

    Args:
        camera: Intrinsics.
        middle: Their middles in the sensor frame [m], shape [N, 3].
        radius: Their radii [m], shape [N].
    """
    if camera.distortion.model == "fisheye":
        return np.ones(len(middle), dtype=bool)
    possible = middle[:, 0] + radius > NEAR_M
    if camera.distortion.model != "pinhole":
        return possible
    x, y, z = middle.T
    for focal, most, least, aside in (
        (camera.fx, camera.cx, camera.cx - camera.width, y),
        (camera.fy, camera.cy, camera.cy - camera.height, z),
    ):  # the planes through the lens and two opposite sides of the image
        possible &= most * x - focal * aside >= -radius * np.hypot(most, focal)
        possible &= focal * aside - least * x >= -radius * np.hypot(least, focal)
    return possible


def _edges(corners: np.ndarray, is_behind: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the edges of boxes that lie on one side of the near plane: start, end [N, 12, 3], and whether in front."""
    start, end = corners[:, EDGES[:, 0]], corners[:, EDGES[:, 1]]
    return start, end, ~is_behind[:, EDGES[:, 0]]


def _cut_edges(corners: np.ndarray, is_behind: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return segments that outline boxes in front of the near plane: start, end [N, S, 3], and whether they exist.

    These are the edges, cut at the plane, and what joins any two places where edges cross it.
    """
    a, b = corners[:, EDGES[:, 0]], corners[:, EDGES[:, 1]]
    is_front_a, is_front_b = ~is_behind[:, EDGES[:, 0]], ~is_behind[:, EDGES[:, 1]]
    crosses = is_front_a != is_front_b
    along = np.where(crosses, b[..., 0] - a[..., 0], 1.0)
    cut = a + (b - a) * ((NEAR_M - a[..., 0]) / along)[..., None]
    cut[..., 0] = NEAR_M
    start = np.where((crosses & ~is_front_a)[..., None], cut, a)
    end = np.where((crosses & ~is_front_b)[..., None], cut, b)
    first, second = PAIRS[:, 0], PAIRS[:, 1]
    return (
        np.concatenate([start, cut[:, first]], axis=1),
        np.concatenate([end, cut[:, second]], axis=1),
        np.concatenate([is_front_a | is_front_b, crosses[:, first] & crosses[:, second]], axis=1),
    )


def _rectangles(
    camera: Intrinsics, start: np.ndarray, end: np.ndarray, exists: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the rectangles around all segments and around what the image frames of them, shape [N, 4] each."""
    if camera.distortion.model == "pinhole":
        a, b = _project(camera, start), _project(camera, end)
    else:
        a, b, exists = _project_curves(camera, start, end, exists)
    return _bounds(a, b, exists), _bounds(*_clip(camera, a, b, exists))


def _project(camera: Intrinsics, points: np.ndarray) -> np.ndarray:
    """Return column and row [px] of points in the sensor frame, [..., 2]; no meaning behind the near plane."""
    focal, depth = np.array([camera.fx, camera.fy]), np.maximum(points[..., :1], NEAR_M)
    return np.array([camera.cx, camera.cy]) - focal * points[..., 1:] / depth


def _project_curves(
    camera: Intrinsics, start: np.ndarray, end: np.ndarray, exists: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return segments through a lens that bends them, in `STEPS` straight pieces: both ends, and whether they exist."""
    count, pieces = len(start), start.shape[1] * STEPS
    share = np.linspace(0.0, 1.0, STEPS + 1)[:, None]
    points = start[:, :, None] + share * (end - start)[:, :, None]
    aside = np.hypot(points[..., 1], points[..., 2])
    is_seen = np.arctan2(aside, points[..., 0]) < ASTERN_RAD
    image = np.nan_to_num(project(camera, points), posinf=0.0, neginf=0.0)
    exists = exists[..., None] & is_seen[..., :-1] & is_seen[..., 1:]
    a, b = image[:, :, :-1].reshape(count, pieces, 2), image[:, :, 1:].reshape(count, pieces, 2)
    return a, b, exists.reshape(count, pieces)


def _clip(
    camera: Intrinsics, start: np.ndarray, end: np.ndarray, exists: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the part of each segment that lies in the image: both ends [..., 2], and whether there is one.

    Source: Y.-D. Liang, B. A. Barsky, "A new concept and method for line clipping", ACM Trans. Graphics 3(1), 1984.
    """
    size, step = np.array([camera.width, camera.height]), end - start
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = -start / step, (size - start) / step
    is_parallel = step == 0.0
    enter = np.where(is_parallel, 0.0, np.minimum(low, high)).max(axis=-1, initial=0.0)
    leave = np.where(is_parallel, 1.0, np.maximum(low, high)).min(axis=-1, initial=1.0)
    is_beside = (is_parallel & ((start < 0.0) | (start > size))).any(axis=-1)
    first, last = (np.clip(start + t[..., None] * step, 0.0, size) for t in (enter, leave))
    return first, last, exists & ~is_beside & (enter <= leave)


def _bounds(start: np.ndarray, end: np.ndarray, exists: np.ndarray) -> np.ndarray:
    """Return the rectangle around the segments that exist, shape [N, 4]; inf and -inf where none does."""
    ends = np.where(exists[..., None], [start, end], np.nan)
    low = np.fmin.reduce(ends, axis=(0, 2), initial=np.inf)
    return np.concatenate([low, np.fmax.reduce(ends, axis=(0, 2), initial=-np.inf)], axis=1)


def _with_image_corners(
    camera: Intrinsics, bounds: np.ndarray, view_pose: np.ndarray, box_pose: np.ndarray, size: np.ndarray
) -> np.ndarray:
    """Return rectangles [N, 4] grown to those corners of the image whose rays enter the box before it ends.

    Only there can the image frame a part of a box beyond all its edges: a box that fills a corner, or everything.
    """
    corners = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)]) * (camera.width, camera.height)
    through = unproject(camera, corners)
    if camera.distortion.model != "fisheye":
        through /= through[:, :1]  # a ray's parameter is its depth
    to_box = compose(invert(box_pose), view_pose)
    origin, direction = to_box[:, :3], rotate(to_box[:, None, 3:], through)
    direction = np.where(direction == 0.0, np.finfo(np.float64).tiny, direction)
    with np.errstate(over="ignore"):
        a = (-0.5 * size - origin)[:, None] / direction
        b = (0.5 * size - origin)[:, None] / direction
    enter = np.maximum(np.minimum(a, b).max(axis=2), NEAR_M)
    is_hit = (enter <= np.maximum(a, b).min(axis=2))[..., None]
    low = np.minimum(bounds[:, :2], np.where(is_hit, corners, np.inf).min(axis=1))
    return np.concatenate([low, np.maximum(bounds[:, 2:], np.where(is_hit, corners, -np.inf).max(axis=1))], axis=1)


def _area(bounds: np.ndarray) -> np.ndarray:
    return (bounds[:, 2] - bounds[:, 0]) * (bounds[:, 3] - bounds[:, 1])
