"""Showing a scene: the program that draws, files, windows, notebooks, and what is refused."""

import logging
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import psutil
import pytest

pytest.importorskip("matplotlib")

from mmw.channel import Paths
from mmw.channel.radio_map.radio_map import RadioMap
from mmw.core.errors import InputError, MissingPackageError
from mmw.scene import Scene
from mmw.viz.scene_view import mesh_plot
from mmw.viz.scene_view.content import gather
from mmw.viz.scene_view.show import choose_renderer
from mmw.viz.scene_view.surfaces import ClipBox
from tests.fixtures.listeners import listeners

SHOW = sys.modules["mmw.viz.scene_view.show"]
"""The module; the package has a function of this name."""


@pytest.fixture
def no_rerun(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)


@pytest.fixture
def no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def notebook(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SHOW, "notebook_shell", lambda: SimpleNamespace())


# --- the program that draws ------------------------------------------------------------------------------------------


def test_without_rerun_matplotlib_draws_and_the_log_says_why(
    street: Scene, no_rerun: None, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING, "mmw"):
        figure = street.show()
    (record,) = caplog.records
    assert record.levelno == logging.WARNING
    assert "drawn by matplotlib: rerun is not installed; pip install 'multimodal-wireless[viz]'" in record.message
    assert "rerun is not installed" in figure.texts[0].get_text()


def test_without_rerun_rerun_cannot_be_asked_for(street: Scene, no_rerun: None, tmp_path: Path) -> None:
    for options in ({"renderer": "rerun"}, {"save": tmp_path / "scene.rrd"}):
        with pytest.raises(MissingPackageError, match=r"show needs the package rerun.*multimodal-wireless\[viz\]"):
            street.show(**options)


def test_without_a_display_a_file_is_advised(street: Scene, no_display: None) -> None:
    pytest.importorskip("rerun")
    assert choose_renderer("auto", None)[0] == "matplotlib"
    assert "no display" in choose_renderer("auto", None)[1]
    with pytest.raises(InputError, match=r"no display.*save='scene.rrd', or renderer='matplotlib'"):
        street.show(renderer="rerun")


def test_a_display_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rerun")
    monkeypatch.setenv("DISPLAY", ":0")
    assert choose_renderer("auto", None)[0] == choose_renderer("rerun", None)[0] == "rerun"


def test_a_notebook_needs_the_widget_and_no_display(
    notebook: None, no_display: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("rerun")
    monkeypatch.setitem(sys.modules, "rerun_notebook", None)
    assert choose_renderer("auto", None)[0] == "matplotlib"
    with pytest.raises(MissingPackageError, match=r"rerun_notebook.*multimodal-wireless\[viz\]"):
        choose_renderer("rerun", None)
    monkeypatch.setitem(sys.modules, "rerun_notebook", ModuleType("rerun_notebook"))
    assert choose_renderer("auto", None)[0] == "rerun"


@pytest.mark.parametrize(
    ("renderer", "file", "message"),
    [
        ("opengl", None, "renderer = 'opengl'; one of auto, rerun, matplotlib"),
        ("auto", "scene.gltf", "save = 'scene.gltf' with renderer auto; Rerun writes .rrd, matplotlib .png"),
        ("matplotlib", "scene.rrd", "save = 'scene.rrd' with renderer matplotlib"),
        ("rerun", "scene.png", "save = 'scene.png' with renderer rerun"),
    ],
)
def test_renderers_and_files_that_do_not_fit_are_refused(renderer: str, file: str | None, message: str) -> None:
    with pytest.raises(InputError, match=message):
        choose_renderer(renderer, None if file is None else Path(file))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"height_px": 20}, "height_px = 20; at least 100"),
        ({"clip_z_m": float("nan")}, r"clip_z_m = \(nan,\)"),
        ({"weather": "snowy"}, "weather 'snowy'"),
        ({"color_by": "taste"}, "color_by = 'taste'"),
    ],
)
def test_options_that_cannot_be_are_refused(street: Scene, options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        street.show(renderer="matplotlib", **options)


def test_an_unknown_metric_is_refused(street: Scene, street_map: RadioMap) -> None:
    with pytest.raises(InputError, match="metric = 'joy'; one of path_gain, rss, sinr"):
        street.show(renderer="matplotlib", radio_map=street_map, metric="joy")


# --- matplotlib ------------------------------------------------------------------------------------------------------


def collections_of(figure: Any) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for one in figure.axes[0].collections:
        found.setdefault(type(one).__name__, []).append(one)
    return found


def test_matplotlib_draws_surfaces_paths_coverage_and_names(
    street: Scene, street_paths: Paths, street_map: RadioMap, tmp_path: Path
) -> None:
    file = street.show(paths=street_paths, radio_map=street_map, save=tmp_path / "new" / "scene.png", height_px=300)
    assert file.read_bytes()[:4] == b"\x89PNG"
    figure = street.show(paths=street_paths, radio_map=street_map, renderer="matplotlib", height_px=300)
    assert tuple(figure.get_size_inches() * figure.dpi) == (480.0, 300.0)
    found = collections_of(figure)
    (lines,) = found["Line3DCollection"]
    assert len(lines.get_color()) == len(street_paths)
    _, cells = found["Poly3DCollection"]
    figure.canvas.draw()
    assert len(cells.get_facecolor()) == 2 * int((street_map.path_gain > 0.0).any(axis=0).sum())
    texts = {text.get_text().strip() for text in figure.axes[0].texts}
    assert texts >= {"bs", "car", "ue", "cav_1", "veh_001"} and "rsu_1" not in texts
    assert [axes.get_ylabel() for axes in figure.axes[1:]] == ["coverage: path gain [dB]", "path gain [dB]"]


def test_matplotlib_draws_the_largest_triangles(street: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh_plot, "MAX_TRIANGLES", 10)
    content = gather(street, box=ClipBox.of(5.0, None))
    corners, _, total = mesh_plot._triangles(content, mesh_plot._region(content))
    assert len(corners) == 10 < total
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    assert areas.min() > 10.0 and corners[..., 2].max() <= 5.0
    figure = street.show(renderer="matplotlib", clip_z_m=5.0)
    assert f"the largest 10 of {total:,} triangles" in figure.texts[0].get_text()


# --- Rerun -----------------------------------------------------------------------------------------------------------


def test_in_a_notebook_the_widget_gets_the_scene(
    street: Scene, street_paths: Paths, notebook: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pytest.importorskip("rerun")
    import rerun.notebook

    from tests.fixtures.rrd_files import read_recording

    monkeypatch.setitem(sys.modules, "rerun_notebook", ModuleType("rerun_notebook"))
    made: list[dict] = []

    def viewer(**options: Any) -> str:
        options["recording"].save(tmp_path / "sent.rrd")
        made.append(options)
        return "widget"

    monkeypatch.setattr(rerun.notebook, "Viewer", viewer)
    assert street.show(paths=street_paths, height_px=450) == "widget"
    assert (made[0]["width"], made[0]["height"]) == ("auto", 450)
    made[0]["recording"].disconnect()
    assert "/world/town/asphalt" in read_recording(tmp_path / "sent.rrd").rows


def test_the_widget_of_rerun_is_made(street: Scene, notebook: None) -> None:
    pytest.importorskip("rerun_notebook")
    import rerun.notebook

    assert isinstance(street.show(height_px=300), rerun.notebook.Viewer)


def test_a_window_gets_the_scene_from_this_machine_only(
    street: Scene, street_paths: Paths, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A data server stands in for the window, which needs a display."""
    pytest.importorskip("rerun")
    from mmw.viz.rerun import viewer

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(viewer, "WINDOW", ("--serve-grpc",))
    window = street.show(paths=street_paths)
    try:
        assert window.process.poll() is None
        sockets = listeners(window.process.pid)
        assert sockets and {one.address for one in sockets} == {"127.0.0.1"}
    finally:
        window.close()
    assert not psutil.pid_exists(window.process.pid) or window.process.poll() is not None


def test_a_window_that_cannot_open_is_one_line(street: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rerun")
    from mmw.viz.rerun import viewer

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(viewer, "COMMAND", "import sys; print('no screen here', file=sys.stderr); sys.exit(3)")
    with pytest.raises(
        InputError, match=r"ended with code 3: no screen here; give save='scene.rrd', or renderer="
    ) as told:
        street.show()
    assert "\n" not in str(told.value)
