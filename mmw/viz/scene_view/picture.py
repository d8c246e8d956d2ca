"""Draw paths, coverage and antennas of a scene into a picture by the RGB camera."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image, ImageDraw

from mmw.channel.radio_map.radio_map import RadioMap
from mmw.channel.scene_paths import Paths
from mmw.core.errors import InputError
from mmw.scene.radio_devices import finite_vector, unit_quaternion
from mmw.scene.scene import Scene
from mmw.sensors.render.projection import intrinsics_of
from mmw.sensors.rgb.config import RgbCamera
from mmw.sensors.rgb.simulate import rgb_renderer
from mmw.viz.plots.style import BLUE, ORANGE, scale_colors
from mmw.viz.scene_view.content import Antenna, antennas
from mmw.viz.scene_view.coverage import Coverage, choose_coverage
from mmw.viz.scene_view.legend import INK, PLATE, TEXT_PX, bars_of, font, legend_image
from mmw.viz.scene_view.overlay import PictureView, Run, triangles_in_pixels
from mmw.viz.scene_view.path_lines import PathLines, choose_paths
from mmw.viz.stills.renderer import StillRenderer, look_pose, street_camera
from mmw.viz.stills.still import resized

WIDTH_PX, HEIGHT_PX = 1280, 720
"""Size of a picture without a camera [px]."""

SMOOTH = 3
"""Side of the raster in a pixel on which lines are drawn, so that their edges are smooth."""

HIDDEN_ALPHA = 130
"""Opacity of hidden parts, 0 to 255. Design value."""

DASH_PX = 7.0
"""Length of a dash and of the gap behind it, of hidden parts [px]. Design value."""

COVERAGE_SHARE = 0.6
"""Share of the coverage's color in a pixel; the rest is the picture. Design value."""

MARK_PX, ANTENNA_PX = 3.0, 7.0
"""Radius of the mark of an interaction and of an antenna [px]. Design values."""

MARGIN_PX = 12
"""Distance of the legend from the border of the picture [px]."""


def render_picture(
    scene: Scene,
    *,
    eye: ArrayLike | None = None,
    look_at: ArrayLike | None = None,
    camera: RgbCamera | None = None,
    pose: ArrayLike | None = None,
    paths: Paths | None = None,
    radio_map: RadioMap | None = None,
    metric: str = "path_gain",
    max_paths: int = 200,
    carrier_hz: float | None = None,
    weather: str | None = None,
    width_px: int | None = None,
    height_px: int | None = None,
    path_width_px: float = 2.0,
    occlude: bool = True,
    show_devices: bool = True,
    show_legend: bool = True,
) -> Image.Image:
    """Return a picture by the RGB camera with paths, coverage and antennas in their places.

    Parts of paths behind surfaces are dashed and faint. What hides them is the first surface in the center of each
    pixel, so glass hides, and the holes of leaves do not.

    Args:
        scene: The scene; its frame is drawn.
        eye: Position of the camera, world frame [m], shape [3]; with `look_at`.
        look_at: Point in the middle of the picture, world frame [m], shape [3].
        camera: The camera; a pinhole of 70 deg by default.
        pose: Camera to world (x, y, z, qx, qy, qz, qw), x along the optical axis, y left, z up, shape [7]; instead of
            `eye` and `look_at`.
        paths: Paths that were solved in this scene.
        radio_map: Coverage to draw.
        metric: `path_gain`, `rss` or `sinr` of the radio map, the largest of all transmitters in each cell.
        max_paths: Draw so many of the strongest paths.
        carrier_hz: Carrier of the paths' gains [Hz]; None means the first.
        weather: Weather; None means the scene's first.
        width_px: Width [px]; the camera's, or 1280, by default.
        height_px: Height [px]; the camera's, or 720, by default.
        path_width_px: Width of a line [px].
        occlude: Let surfaces hide paths, coverage and antennas; False draws all of them over the picture.
        show_devices: Draw transmitters and receivers with their names.
        show_legend: Draw the color scales, and what was left out.

    Raises:
        InputError: If there is no view or more than one, an argument cannot be used, or the paths are of another scene.

    Examples:
        >>> import mmw
        >>> scene = mmw.load_scene("town03")
        >>> scene.render(eye=(-60, -60, 45), look_at=(0, 0, 0), width_px=320, height_px=180).save("town03.png")
    """
    if not 0.0 < path_width_px < np.inf:
        raise InputError(f"render: path_width_px = {path_width_px}; a finite number above 0 is needed; correct it")
    place = _view_pose(eye, look_at, pose)
    given = {"width_px": width_px, "height_px": height_px}
    size = {key: int(value) for key, value in given.items() if value is not None}
    camera = resized(camera or street_camera(WIDTH_PX, HEIGHT_PX), size)
    weather = scene.check_weather(weather)
    lines = None
    if paths is not None:
        lines = choose_paths(paths, carrier_hz=carrier_hz, max_paths=max_paths, scene=scene)
    coverage = None if radio_map is None else choose_coverage(radio_map, metric)
    renderer = _renderer(scene, weather)
    picture = renderer.look_from(weather, place, camera)
    view = PictureView(intrinsics_of(camera), place, renderer.distances(place, camera) if occlude else None)
    if coverage is not None:
        picture = _with_coverage(picture, view, coverage, scene.device)
    return Overlay(picture, view, path_width_px, show_legend).finished(
        lines,
        coverage,
        antennas(scene, scene.transmitters) if show_devices else {},
        antennas(scene, scene.receivers) if show_devices else {},
    )


def _view_pose(eye: ArrayLike | None, look_at: ArrayLike | None, pose: ArrayLike | None) -> np.ndarray:
    """Return the camera's pose, shape [7].

    Raises:
        InputError: If there is no view or more than one, or a number is not finite.
    """
    if (eye is None) != (look_at is None) or (eye is None) == (pose is None):
        names = [name for name, one in (("eye", eye), ("look_at", look_at), ("pose", pose)) if one is not None]
        raise InputError(
            f"render: {' and '.join(names) or 'no view'} given; eye and look_at, or pose, are needed; give one of them"
        )
    if pose is not None:
        place = finite_vector("render: pose", pose, 7)
        return np.concatenate([place[:3], unit_quaternion("render: rotation of the pose", place[3:])])
    return look_pose(finite_vector("render: eye", eye, 3), finite_vector("render: look_at", look_at, 3))


def _renderer(scene: Scene, weather: str) -> StillRenderer:
    """Return the renderer of a scene; its textures and skies are those that `scene.capture` keeps."""
    on_device, weathers = scene.device_scene.optical, {weather: scene.weathers[weather]}
    camera = rgb_renderer(scene.cache, on_device, weathers, scene.scene_seed, debug=False)
    return StillRenderer(on_device, weathers, seed=scene.scene_seed, camera=camera)


def _with_coverage(picture: Image.Image, view: PictureView, coverage: Coverage, device: str) -> Image.Image:
    """Return a picture with the colors of the cells that it shows."""
    triangle = triangles_in_pixels(view, coverage.triangles, device)
    pixels = np.asarray(picture).astype(np.float64)
    is_cell = triangle >= 0
    shown = coverage.colors[coverage.cell[triangle[is_cell]]]
    pixels[is_cell] = (1.0 - COVERAGE_SHARE) * pixels[is_cell] + COVERAGE_SHARE * shown
    return Image.fromarray(np.round(pixels).astype(np.uint8))


@dataclass(frozen=True)
class Overlay:
    """Draws over a picture."""

    picture: Image.Image
    view: PictureView
    path_width_px: float
    show_legend: bool

    def finished(
        self, lines: PathLines | None, coverage: Coverage | None, transmitters: dict[str, Antenna],
        receivers: dict[str, Antenna],
    ) -> Image.Image:  # fmt: skip
        """Return the picture with paths, antennas and a legend."""
        width, height = self.picture.size
        large = Image.new("RGBA", (SMOOTH * width, SMOOTH * height), (0, 0, 0, 0))
        draw = ImageDraw.Draw(large)
        runs = self._draw_paths(draw, lines) if lines is not None else []
        for found, color, corners in ((transmitters, BLUE, 3), (receivers, ORANGE, 0)):
            for antenna in found.values():
                self._draw_antenna(draw, antenna, color, corners)
        layer = large.resize((width, height), Image.Resampling.BOX)
        result = Image.alpha_composite(self.picture.convert("RGBA"), layer)
        for name, antenna in (*transmitters.items(), *receivers.items()):
            self._write_name(result, name, antenna)
        bars, text = bars_of(lines, coverage)
        if lines is not None and len(lines) < lines.total:
            text.append(f"the weakest {lines.total - len(lines):,} are left out")
        if any(run.is_hidden for run in runs):
            text.append("dashed: behind a surface")
        if self.show_legend and (bars or text):
            legend = legend_image(bars, text, float(np.clip(width / WIDTH_PX, 0.6, 2.0)))
            result.alpha_composite(legend, (MARGIN_PX, MARGIN_PX))
        return result.convert("RGB")

    def _draw_paths(self, draw: ImageDraw.ImageDraw, lines: PathLines) -> list[Run]:
        """Draw paths, hidden parts first and the strongest on top, and a mark at each visible interaction."""
        colors = scale_colors(lines.share, 0.0, 1.0)
        runs = self.view.runs(lines.lines)
        width = max(1, round(SMOOTH * self.path_width_px))
        for run in sorted(runs, key=lambda one: (not one.is_hidden, one.line)):
            color = (*colors[run.line].tolist(), HIDDEN_ALPHA if run.is_hidden else 255)
            for part in dashes(run.pixels) if run.is_hidden else [run.pixels]:
                draw.line([tuple(point) for point in (SMOOTH * part).tolist()], color, width)
        inner = np.concatenate([np.zeros((0, 3)), *(line[1:-1] for line in lines.lines)])
        owner = np.repeat(np.arange(len(lines)), [len(line) - 2 for line in lines.lines])
        seen = ~self.view.is_hidden(inner)
        for point, line in zip(self.view.pixels(inner)[seen], owner[seen], strict=True):
            if np.isfinite(point).all():
                x, y = SMOOTH * point
                r = SMOOTH * max(MARK_PX * (0.6 + 0.4 * lines.share[line]), 0.7 * self.path_width_px)
                draw.ellipse((x - r, y - r, x + r, y + r), (*colors[line].tolist(), 255), (255, 255, 255, 255), SMOOTH)
        return runs

    def _draw_antenna(self, draw: ImageDraw.ImageDraw, antenna: Antenna, color: str, corners: int) -> None:
        """Draw an antenna: a triangle or a disc, only its outline if a surface is in front of it."""
        point, is_hidden = self._place(antenna)
        if point is None:
            return
        (x, y), r = SMOOTH * point, SMOOTH * ANTENNA_PX
        rgb = tuple(bytes.fromhex(color.lstrip("#")))
        fill, outline = ((0, 0, 0, 0), (*rgb, 255)) if is_hidden else ((*rgb, 255), (255, 255, 255, 255))
        if corners:
            draw.regular_polygon((x, y, 1.25 * r), corners, fill=fill, outline=outline, width=2 * SMOOTH)
        else:
            draw.ellipse((x - r, y - r, x + r, y + r), fill, outline, 2 * SMOOTH)

    def _write_name(self, image: Image.Image, name: str, antenna: Antenna) -> None:
        point, _ = self._place(antenna)
        if point is None:
            return
        letters = font(TEXT_PX)
        x, y = point[0] + ANTENNA_PX + 4.0, point[1] - ANTENNA_PX - TEXT_PX
        draw = ImageDraw.Draw(image, "RGBA")
        x = min(x, image.width - letters.getlength(name) - 4.0)
        left, top, right, bottom = draw.textbbox((x, y), name, font=letters)
        draw.rectangle((left - 3, top - 2, right + 3, bottom + 2), PLATE)
        draw.text((x, y), name, INK, letters)

    def _place(self, antenna: Antenna) -> tuple[np.ndarray | None, bool]:
        """Return where an antenna is in the picture [px], shape [2], None beside it; and whether it is hidden."""
        point = self.view.pixels(antenna.position)
        if not ((point >= 0.0) & (point <= self.picture.size)).all():
            return None, False
        return point, bool(self.view.is_hidden(antenna.position[None])[0])


def dashes(pixels: np.ndarray) -> list[np.ndarray]:
    """Return the dashes of a line through points [px], shape [N, 2]: `DASH_PX` long, with gaps as long."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(pixels, axis=0), axis=1))])
    found = []
    for start in np.arange(0.0, along[-1], 2.0 * DASH_PX):
        stop = min(start + DASH_PX, float(along[-1]))
        inner = pixels[(along > start) & (along < stop)]
        ends = [[np.interp(place, along, pixels[:, axis]) for axis in range(2)] for place in (start, stop)]
        found.append(np.concatenate([ends[:1], inner, ends[1:]]))
    return found
