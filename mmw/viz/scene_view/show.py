"""Show a scene in 3-D, from Python: in a notebook, in a window, or in a file."""

import logging
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

from mmw.channel.radio_map.radio_map import RadioMap
from mmw.channel.scene_paths import Paths
from mmw.core.choices import check_choice
from mmw.core.errors import InputError
from mmw.core.extras import install, needed_by
from mmw.scene.scene import Scene
from mmw.viz.notebook import notebook_shell
from mmw.viz.scene_view.content import SceneContent, gather
from mmw.viz.scene_view.surfaces import ClipBox, ColorBy

LOGGER = logging.getLogger(__name__)

Renderer = Literal["auto", "rerun", "matplotlib"]
"""Program that draws."""

PLOT_SUFFIXES = (".png", ".pdf", ".svg", ".jpg", ".jpeg")
"""Endings of files that matplotlib writes."""

MIN_HEIGHT_PX = 100
"""Least height of a view [px]."""


def show(
    scene: Scene,
    *,
    paths: Paths | None = None,
    radio_map: RadioMap | None = None,
    metric: str = "path_gain",
    clip_z_m: float | None = None,
    clip: Sequence[float] | None = None,
    max_paths: int = 2000,
    carrier_hz: float | None = None,
    weather: str | None = None,
    color_by: ColorBy = "material",
    renderer: Renderer = "auto",
    save: str | Path | None = None,
    height_px: int = 600,
) -> Any:
    """Show a scene in 3-D with its actors and antennas, paths and coverage.

    `auto` draws with Rerun (extra `viz`) and falls back to matplotlib (extra `plot`) where Rerun is not installed or
    there is no display; a line in the log of `mmw` says which and why. Clipping cuts the surfaces of town, actors and
    coverage; antennas and paths stay whole.

    Args:
        scene: The scene; its frame is shown.
        paths: Paths that were solved in this scene.
        radio_map: Coverage to draw.
        metric: `path_gain`, `rss` or `sinr` of the radio map, the largest of all transmitters in each cell.
        clip_z_m: Cut off what is above this height [m].
        clip: Show the inside of a box: (xmin, ymin, zmin, xmax, ymax, zmax) [m]; inf leaves a side open.
        max_paths: Show so many of the strongest paths.
        carrier_hz: Carrier of the paths' gains [Hz]; None means the first.
        weather: Weather of the materials; None means the scene's first.
        color_by: Color surfaces by `material` or by `class`.
        renderer: `auto`, `rerun` or `matplotlib`.
        save: Write a file instead: `.rrd` by Rerun, `.png`, `.pdf`, `.svg` or `.jpg` by matplotlib.
        height_px: Height of the view in a notebook, and of matplotlib's figure [px].

    Returns:
        In a notebook Rerun's widget, in a script the window (`wait()` returns when it is closed, `close()` closes it;
        it stays when the script ends); of matplotlib the Figure; with `save` the file.

    Raises:
        InputError: If an argument cannot be used, the paths are of another scene, or no window can be opened.
        MissingPackageError: If the renderer is not installed.

    Examples:
        >>> import mmw
        >>> scene = mmw.load_scene("town03")
        >>> str(scene.show(clip_z_m=8.0, save="town03.rrd"))
        'town03.rrd'
    """
    if not height_px >= MIN_HEIGHT_PX:
        raise InputError(f"show: height_px = {height_px}; at least {MIN_HEIGHT_PX} is needed; correct it")
    file = None if save is None else Path(save)
    chosen, reason = choose_renderer(renderer, file)
    content = gather(
        scene, paths=paths, radio_map=radio_map, metric=metric, box=ClipBox.of(clip_z_m, clip), max_paths=max_paths,
        carrier_hz=carrier_hz, weather=weather, color_by=color_by,
    )  # fmt: skip
    is_fallback = renderer == "auto" and chosen == "matplotlib" and file is None
    LOGGER.log(logging.WARNING if is_fallback else logging.INFO, "show: drawn by %s: %s", chosen, reason)
    for note in content.notes:
        LOGGER.info("show: %s", note)
    if chosen == "rerun":
        return _show_rerun(content, file, height_px)
    figure = _plot(content, reason, height_px)
    if file is None:
        return figure
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=100)
    return file


def choose_renderer(renderer: str, file: Path | None) -> tuple[str, str]:
    """Return the program that draws, `rerun` or `matplotlib`, and why it is that.

    Args:
        renderer: One of `Renderer`.
        file: File to write; None opens a view.

    Raises:
        InputError: If the renderer is unknown, cannot write the file, or has no display.
        MissingPackageError: If Rerun is asked for and is not installed.
    """
    check_choice("show: renderer", renderer, Renderer)
    if file is not None:
        suffix = file.suffix.lower()
        writer = "rerun" if suffix == ".rrd" else "matplotlib" if suffix in PLOT_SUFFIXES else ""
        if not writer or renderer not in ("auto", writer):
            raise InputError(
                f"show: save = {str(file)!r} with renderer {renderer}; Rerun writes .rrd, matplotlib "
                f"{', '.join(PLOT_SUFFIXES)}; rename it"
            )
        if writer == "rerun":
            _need("rerun")
        return writer, f"{suffix} is a file of it"
    if renderer == "matplotlib":
        return "matplotlib", "as asked for"
    in_notebook = notebook_shell() is not None
    missing = [name for name in ("rerun", *(["rerun_notebook"] if in_notebook else [])) if not _is_installed(name)]
    if missing:
        if renderer == "rerun":
            _need(missing[0])
        return "matplotlib", f"{missing[0]} is not installed; {install('viz')} for Rerun"
    if not in_notebook and not _has_display():
        if renderer == "rerun":
            raise InputError(
                "show: there is no display for a window (neither DISPLAY nor WAYLAND_DISPLAY is set); give "
                "save='scene.rrd', or renderer='matplotlib'"
            )
        return "matplotlib", "there is no display for Rerun's window; save='scene.rrd' writes a file for it"
    return "rerun", "as asked for" if renderer == "rerun" else "it is installed"


def _is_installed(package: str) -> bool:
    # A package that a test or a user has blocked is None in `sys.modules`.
    return sys.modules.get(package, False) is not None and (package in sys.modules or find_spec(package) is not None)


def _need(package: str) -> None:
    """Raise MissingPackageError unless a package is installed."""
    with needed_by("show"):
        if not _is_installed(package):
            raise ModuleNotFoundError(f"no module {package}", name=package)


def _has_display() -> bool:
    from mmw.viz.rerun.viewer import has_display

    return has_display()


def _show_rerun(content: SceneContent, file: Path | None, height_px: int) -> Any:
    """Write a recording, or return the widget of a notebook or a window."""
    from mmw.viz.rerun.viewer import new_stream, open_window, write_recording
    from mmw.viz.scene_view.recording import APPLICATION, log_scene

    stream = new_stream(APPLICATION)
    if file is not None:
        write_recording(file, stream, lambda one: log_scene(one, content))
        return file
    if notebook_shell() is not None:
        import rerun.notebook

        widget = rerun.notebook.Viewer(width="auto", height=height_px, recording=stream)
        log_scene(stream, content)
        return widget

    def log(one: Any, flush: Any) -> None:
        log_scene(one, content)
        flush()

    return open_window(stream, log)


def _plot(content: SceneContent, reason: str, height_px: int) -> Any:
    from mmw.viz.scene_view.mesh_plot import plot_scene

    return plot_scene(content, f"drawn by matplotlib: {reason}", height_px)
