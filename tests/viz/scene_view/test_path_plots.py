"""Plots of paths: lines from above, delays and azimuths, against the paths themselves."""

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from mmw.channel import Paths, PathSolver
from mmw.core.errors import InputError
from mmw.scene import Receiver, Scene
from mmw.viz.plots.radio_map_plot import draw_scene
from mmw.viz.scene_view import plot_paths
from tests.fixtures.scenes import arrays_from_parts, box_part
from tests.fixtures.street_scene import street_scene


def gains(paths: Paths, column: int = 0) -> np.ndarray:
    return 20.0 * np.log10(np.abs(paths.a[:, column]))


def test_from_above_paths_lie_over_the_scene(street: Scene, street_paths: Paths) -> None:
    figure = plot_paths(street_paths, scene=street)
    axes = figure.axes[0]
    (lines,) = [one for one in axes.collections if isinstance(one, LineCollection) and one.get_array() is not None]
    order = np.argsort(gains(street_paths), kind="stable")
    np.testing.assert_allclose(lines.get_array(), gains(street_paths)[order])
    for path, line in zip(order, lines.get_segments(), strict=True):
        inner = street_paths.vertices[path, : street_paths.depth[path], :2]
        end = street_paths.rx_positions[street_paths.rx[path], :2]
        np.testing.assert_allclose(line, [(-30, 6), *inner, end])
    walls = [one for one in axes.collections if isinstance(one, LineCollection) and one.get_array() is None]
    drawn = {tuple(np.round(line, 6).ravel()) for one in walls for line in one.get_segments()}
    assert drawn == {(-100, 10, 100, 10), (-100, -10, 100, -10)}
    cars = [one for one in axes.collections if isinstance(one, PolyCollection)][-1].get_paths()
    assert [np.round(path.vertices.min(axis=0), 6).tolist() for path in cars] == [[-22.25, -3.9], [16.95, 2.0]]
    assert {text.get_text() for text in axes.texts} == {"bs", "car", "ue"}
    assert axes.get_title() == f"bs to 2 receivers at 28 GHz: 15 paths, strongest {gains(street_paths).max():.1f} dB"
    legend = [text.get_text() for text in axes.get_legend().get_texts()]
    assert legend == ["transmitter", "receiver", "specular reflection", "line of sight"]


def test_delays_and_gains_are_those_of_the_paths(street_paths: Paths) -> None:
    own = street_paths.select(rx="ue")
    figure = plot_paths(own, view="delay", carrier_hz=3.5e9)
    found = np.concatenate([line.get_xydata() for line in figure.axes[0].lines])
    expected = np.stack([own.tau * 1e9, gains(own, 1)], axis=1)
    np.testing.assert_allclose(found[np.argsort(found[:, 1])], expected[np.argsort(expected[:, 1])])
    assert {line.get_label() for line in figure.axes[0].lines} == {"los", "specular"}
    assert figure.axes[0].get_title().startswith("bs to ue at 3.5 GHz: 8 paths")


def test_azimuths_are_those_of_the_paths(street_paths: Paths) -> None:
    figure = plot_paths(street_paths, view="angles", max_paths=4)
    strongest = np.argsort(gains(street_paths), kind="stable")[-4:]
    for axes, azimuth in zip(figure.axes, (street_paths.phi_t, street_paths.phi_r), strict=True):
        found = np.concatenate([line.get_xydata() for line in axes.lines])
        expected = np.stack([azimuth, gains(street_paths)], axis=1)[strongest]
        np.testing.assert_allclose(found[np.argsort(found[:, 1])], expected)
    assert "4 of 15 paths" in figure.get_suptitle()


def test_paths_are_drawn_on_given_axes(street_paths: Paths) -> None:
    figure = Figure()
    flat, round_ = figure.subplots(1, 2), [figure.add_subplot(2, 2, k, projection="polar") for k in (3, 4)]
    assert plot_paths(street_paths, ax=flat[0]) is figure
    assert plot_paths(street_paths, view="delay", ax=flat[1]) is figure
    assert plot_paths(street_paths, view="angles", ax=round_) is figure
    assert flat[1].get_xlabel() == "delay [ns]" and round_[1].get_title() == "azimuth of arrival"
    for view, ax, needed in (("angles", flat, "a pair of polar axes"), ("delay", round_[0], "one axes with x and y")):
        with pytest.raises(InputError, match=f"ax does not fit view '{view}'; {needed} is needed"):
            plot_paths(street_paths, view=view, ax=ax)


def test_no_path_is_a_plot_without_paths() -> None:
    scene = street_scene()
    scene.add(Receiver("cellar", position=(0.0, 0.0, -30.0)))
    paths = PathSolver(max_depth=0, check_places=False)(scene).select(rx="cellar")
    assert len(paths) == 0
    for view in ("top", "delay", "angles"):
        figure = paths.plot(view=view, scene=scene)
        figure.canvas.draw()
        assert "bs to cellar at 28 GHz: 0 paths" in (figure.get_suptitle() or figure.axes[0].get_title())


def test_views_that_are_none_are_refused(street: Scene, street_paths: Paths) -> None:
    with pytest.raises(InputError, match="view = 'inside'; one of top, delay, angles"):
        plot_paths(street_paths, view="inside")  # pyright: ignore[reportArgumentType]
    other = street_scene()
    other.frame = 1
    with pytest.raises(InputError, match="frame 0; the scene is 'street', frame 1"):
        plot_paths(street_paths, scene=other)


def test_only_buildings_near_the_map_are_drawn() -> None:
    houses = [
        box_part(f"Buildings/{name}", (4, 4, 3), (x, 0, 1.5), "wood", "building")
        for name, x in (("near", 0.0), ("far", 50.0))
    ]
    axes = Figure().subplots()
    draw_scene(axes, arrays_from_parts(houses), 0, (np.array([-5.0, -5.0]), np.array([5.0, 5.0])))
    roofs, walls = axes.collections[:2]
    corners = np.concatenate([path.vertices for path in roofs.get_paths()])
    np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], [(-2, -2), (2, 2)])
    square = {(-2, -2, -2, 2), (-2, -2, 2, -2), (-2, 2, 2, 2), (2, -2, 2, 2)}
    assert {tuple(line.ravel()) for line in walls.get_segments()} == square
