"""Plot paths with matplotlib (extra `plot`): from above over the scene, by delay, or by direction."""

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mmw.channel.scene_paths import Paths
from mmw.core.choices import check_choice
from mmw.core.errors import InputError
from mmw.scene.scene import Scene
from mmw.viz.plots.link import draw_angles, draw_profile
from mmw.viz.plots.paths import draw_end, draw_path_lines, frame_map, path_legend
from mmw.viz.plots.radio_map_plot import draw_scene
from mmw.viz.plots.style import carrier_name, new_figure
from mmw.viz.scene_view.path_lines import PathLines, choose_paths

if TYPE_CHECKING:
    from matplotlib.figure import Figure

View = Literal["top", "delay", "angles"]
"""Plot: the world from above, the power-delay profile, or the azimuths at both ends."""

SIZES = {"top": (9.0, 6.5), "delay": (8.0, 4.0), "angles": (8.5, 4.6)}
"""View -> size of a new figure [inch]."""

FEW_PATHS = 100
"""Paths among which a place for the legend is searched, which takes seconds among many. Design value."""

MAX_NAMES = 20
"""Transmitters, and receivers, up to which each has its name in the plot. Design value."""


def plot_paths(
    paths: Paths,
    *,
    scene: Scene | None = None,
    view: View = "top",
    ax: Any = None,
    carrier_hz: float | None = None,
    max_paths: int | None = None,
) -> "Figure":
    """Plot paths, and return the figure.

    Args:
        paths: Paths of a solver; `paths.select(rx="car")` gives those of one receiver.
        scene: Scene that they were solved in, whose buildings and vehicles view `top` draws below them.
        view: `top`, `delay` or `angles`.
        ax: matplotlib axes to draw on; a pair of polar ones for `angles`. None makes a new figure.
        carrier_hz: Carrier of the gains [Hz]; None means the first.
        max_paths: Draw so many of the strongest paths; None draws all.

    Raises:
        InputError: If there is no such view or carrier, the axes do not fit the view, or the paths are of another
            scene.
        MissingPackageError: If matplotlib is not installed.

    Examples:
        >>> import mmw
        >>> scene = mmw.load_scene("town03")
        >>> _ = scene.add(mmw.Transmitter("bs", position=(13.5, -29.5, 10.0)))
        >>> _ = scene.add(mmw.Receiver("ue", position=(-2.0, 45.0, 1.5)))
        >>> paths = mmw.PathSolver(max_depth=1, samples_per_tx=10_000)(scene)
        >>> paths.plot(scene=scene).savefig("paths.png")
    """
    check_choice("plot: view", view, View)
    lines = choose_paths(paths, carrier_hz=carrier_hz, max_paths=max_paths, scene=scene)
    axes = _axes(view, ax)
    if view == "top":
        _draw_top(axes[0], lines, scene)
    elif view == "delay":
        draw_profile(axes[0], lines.tau_s, lines.gain_db, lines.kind)
        axes[0].set_title(_title(lines), fontsize="medium")
    else:
        for one, azimuth, name in ((axes[0], lines.departure, "departure"), (axes[1], lines.arrival, "arrival")):
            draw_angles(one, azimuth, lines.gain_db, lines.kind)
            one.set_title(f"azimuth of {name}", fontsize="small", pad=10)
        if len(lines):
            axes[1].legend(loc="upper left", bbox_to_anchor=(1.05, 1.05), fontsize="small")
        if ax is None:
            axes[0].figure.suptitle(_title(lines), fontsize="medium")
    return axes[0].figure


def _axes(view: View, ax: Any) -> list[Any]:
    """Return the axes of a view, of a new figure if none are given.

    Raises:
        InputError: If they do not fit the view.
    """
    wanted = 2 if view == "angles" else 1
    kind = {"projection": "polar"} if view == "angles" else {}
    if ax is None:
        figure = new_figure(None, SIZES[view])
        return list(figure.subplots(1, wanted, subplot_kw=kind, squeeze=False)[0])
    axes = list(np.ravel(np.asarray(ax, dtype=object)))
    if len(axes) != wanted or any(getattr(one, "name", "") != kind.get("projection", "rectilinear") for one in axes):
        needed = "a pair of polar axes is" if view == "angles" else "one axes with x and y is"
        raise InputError(f"plot: ax does not fit view {view!r}; {needed} needed; give it, or leave ax out")
    return axes


def _draw_top(axes: Any, lines: PathLines, scene: Scene | None) -> None:
    flat = [line[:, :2] for line in lines.lines]
    ends = np.array([*lines.transmitters.values(), *lines.receivers.values()]).reshape(-1, 3)
    shown = np.concatenate([ends[:, :2], *flat])
    if len(shown):
        frame_map(axes, shown)
    if scene is not None:
        (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
        draw_scene(axes, scene.arrays, scene.frame, (np.array([left, bottom]), np.array([right, top])))
    drawn = draw_path_lines(axes, flat, lines.gain_db, lines.kind == "los", lines.interactions)
    if drawn is not None:
        axes.figure.colorbar(drawn, ax=axes, label="path gain |a|² [dB]", shrink=0.85, pad=0.01)
    for found, is_tx in ((lines.transmitters, True), (lines.receivers, False)):
        for name, place in found.items():
            draw_end(axes, place[:2], name if len(found) <= MAX_NAMES else "", is_tx=is_tx)
    present = {kind for own in lines.interactions for kind in own}
    has_los, place = bool((lines.kind == "los").any()), "best" if len(lines) <= FEW_PATHS else "upper left"
    path_legend(axes, present, has_los=has_los, place=place)
    axes.set_title(_title(lines), fontsize="medium")


def _title(lines: PathLines) -> str:
    """Return the ends, the carrier, and the number and gain of paths."""
    ends = [
        next(iter(found)) if len(found) == 1 else f"{len(found)} {kind}s"
        for found, kind in ((lines.transmitters, "transmitter"), (lines.receivers, "receiver"))
    ]
    count = f"{len(lines):,} paths" if len(lines) == lines.total else f"{len(lines):,} of {lines.total:,} paths"
    best = f", strongest {lines.gain_db[-1]:.1f} dB" if len(lines) else ""
    return f"{ends[0]} to {ends[1]} at {carrier_name(lines.carrier_hz)}: {count}{best}"
