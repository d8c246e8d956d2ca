"""Figures of a dataset: what is drawn is what the tables hold, and lands where geometry puts it."""

import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from scipy.spatial import ConvexHull

from mmw.core.camera_models import Distortion, Intrinsics
from mmw.dataset import Dataset
from mmw.dataset.camera_geometry import Camera
from mmw.viz.plots import (
    draw_camera,
    draw_depth,
    draw_lidar,
    draw_radar,
    plot_link,
    plot_paths,
    plot_readings,
    plot_sensor,
    read_town_plan,
    render_frame,
)
from mmw.viz.plots.frame import choose_panels, sensors_of
from mmw.viz.plots.images import box_lines, seen_objects
from mmw.viz.plots.map import convex_outline
from mmw.viz.plots.style import box_kind
from tests.fixtures.doc_pages import ROOT, run_python
from tests.fixtures.export_data import box_matrix, matrix
from tests.fixtures.small_dataset import SCENARIO, small_dataset

AT = (SCENARIO, "sunny")
CARRIER = 28e9


def axes_of(figure, text: str):
    """Return the axes whose y label, x label or title holds a text."""
    stack, found = [figure], []
    while stack:
        one = stack.pop()
        stack += list(getattr(one, "subfigs", []))
        found += [axes for axes in one.axes if axes not in found]
    return next(a for a in found if any(text in words for words in (a.get_ylabel(), a.get_xlabel(), a.get_title())))


def antenna(data: Dataset, agent: str, frame: int) -> np.ndarray:
    pose = data.read("poses", weather="sunny", agent=agent, frames=range(frame, frame + 1)).to_pylist()[0]
    mount = data.read("sensors", agent=agent, sensor="antenna").to_pylist()[0]
    return (matrix(pose) @ matrix(mount))[:3, 3]


def test_gain_spread_and_beams_are_those_of_the_tables(data) -> None:
    figure = plot_link(data, *AT, "rsu_1", "cav_1", carrier_hz=CARRIER)
    where = f"WHERE weather = 'sunny' AND peer = 'rsu_1' AND agent = 'cav_1' AND carrier_hz = {CARRIER} ORDER BY frame"
    columns = "frame / 100, gain_db, rms_delay_s * 1e9, is_los"
    rows = data.connect().sql(f"SELECT {columns} FROM links {where}").fetchall()
    time, gain, spread, is_los = (np.array(column) for column in zip(*rows, strict=True))
    for label, values in (("path gain [dB]", gain), ("RMS delay spread [ns]", spread)):
        line = axes_of(figure, label).lines[0]
        np.testing.assert_allclose(line.get_xdata(), time)
        np.testing.assert_array_equal(line.get_ydata(), values.astype(float))
    assert len(axes_of(figure, "path gain [dB]").patches) == (0 if is_los.all() else 1)
    beams = data.connect().sql(f"SELECT tx_beam, rx_beam FROM beams {where}").fetchall()
    lines = axes_of(figure, "best beam").lines
    for line, values in zip(lines, zip(*beams, strict=True), strict=False):
        np.testing.assert_array_equal(line.get_ydata(), np.array(values, dtype=float))
    assert axes_of(figure, "time [s]").get_xlabel() == "time [s]"


def test_a_blocked_link_is_shaded_while_it_is_blocked(data) -> None:
    query = "SELECT agent, min(frame), max(frame) FROM links WHERE weather = 'sunny' AND NOT is_los AND peer = 'rsu_1' "
    rows = data.connect().sql(query + f"AND carrier_hz = {CARRIER} GROUP BY agent HAVING count(*) = 4").fetchall()
    assert rows, "the small dataset has a link that is blocked in all of its frames"
    agent, first, last = rows[0]
    figure = plot_link(data, *AT, "rsu_1", agent, carrier_hz=CARRIER, beam_frames=0)
    (span,) = axes_of(figure, "path gain [dB]").patches
    ends = span.get_extents().transformed(axes_of(figure, "path gain [dB]").transData.inverted())
    assert (ends.x0, ends.x1) == pytest.approx((first / 100 - 0.005, last / 100 + 0.005))


def test_delay_profile_and_angles_are_those_of_the_paths(data) -> None:
    figure = plot_link(data, *AT, "rsu_1", "cav_1", carrier_hz=CARRIER, frame=2, beam_frames=0)
    where = f"weather = 'sunny' AND agent = 'cav_1' AND carrier_hz = {CARRIER} AND frame = 2"
    columns = "tau_s * 1e9, 10 * log10(a_re ^ 2 + a_im ^ 2), aod_az, aoa_az"
    rows = np.array(data.connect().sql(f"SELECT {columns} FROM paths WHERE {where} ORDER BY 1").fetchall())

    def drawn(axes) -> np.ndarray:
        points = np.concatenate([np.stack(line.get_data(), axis=1) for line in axes.lines])
        return points[np.lexsort((points[:, 1], points[:, 0]))]

    def expected(column: int) -> np.ndarray:
        points = rows[:, [column, 1]]
        return points[np.lexsort((points[:, 1], points[:, 0]))]

    np.testing.assert_allclose(drawn(axes_of(figure, "power-delay profile")), expected(0), rtol=1e-6)
    np.testing.assert_allclose(drawn(axes_of(figure, "departure from rsu_1")), expected(2), rtol=1e-6)
    np.testing.assert_allclose(drawn(axes_of(figure, "arrival at cav_1")), expected(3), rtol=1e-6)


def test_paths_go_from_antenna_to_antenna_and_are_as_long_as_their_delay(data) -> None:
    figure = plot_paths(data, *AT, 1, "rsu_1", "cav_1", carrier_hz=CARRIER, town=False)
    above, aside = axes_of(figure, "x east"), axes_of(figure, "height z")
    plan, side = (
        next(c for c in axes.collections if isinstance(c, LineCollection) and c.get_array() is not None)
        for axes in (above, aside)
    )
    ends = antenna(data, "rsu_1", 1), antenna(data, "cav_1", 1)
    where = f"weather = 'sunny' AND agent = 'cav_1' AND carrier_hz = {CARRIER} AND frame = 1"
    columns = "10 * log10(a_re ^ 2 + a_im ^ 2) AS gain, tau_s"
    rows = data.connect().sql(f"SELECT {columns} FROM paths WHERE {where} ORDER BY gain").fetchall()
    np.testing.assert_allclose(plan.get_array(), [row[0] for row in rows], rtol=1e-6)
    for flat, tall, (_, tau) in zip(plan.get_segments(), side.get_segments(), rows, strict=True):
        np.testing.assert_allclose(flat[[0, -1]], [end[:2] for end in ends], atol=1e-9)
        np.testing.assert_allclose(tall[[0, -1], 1], [end[2] for end in ends], atol=1e-9)
        np.testing.assert_allclose(tall[-1, 0], np.hypot(*(ends[1] - ends[0])[:2]), rtol=1e-9)
        points = np.column_stack([flat, tall[:, 1]])
        assert np.linalg.norm(np.diff(points, axis=0), axis=1).sum() == pytest.approx(299_792_458.0 * tau, rel=1e-6)
    few = plot_paths(data, *AT, 1, "rsu_1", "cav_1", carrier_hz=CARRIER, town=False, strongest=1)
    assert len(next(c for c in axes_of(few, "x east").collections if isinstance(c, LineCollection)).get_segments()) == 1


def test_boxes_land_where_a_pinhole_camera_sees_them(data) -> None:
    frame = data.frame(*AT, 0)
    view = frame.agents["cav_1"].views["front"]
    axes = Figure().subplots()
    draw_camera(axes, view, boxes="all")
    lines = [line for c in axes.collections for line in c.get_segments()]
    assert lines
    drawn = np.concatenate([line[[0, -1]] for line in lines])
    to_camera = np.linalg.inv(
        matrix(data.read("poses", weather="sunny", agent="cav_1", frames=range(1)).to_pylist()[0])
        @ matrix(data.read("sensors", agent="cav_1", sensor="front").to_pylist()[0])
    )
    size, found = view.camera.intrinsics, 0
    for box in data.read("boxes", weather="sunny", frames=range(1)).to_pylist():
        turn = box_matrix(box)
        half = np.array([box["length"], box["width"], box["height"]]) / 2
        for signs in np.ndindex(2, 2, 2):
            x, y, z, _ = to_camera @ turn @ [*(half * (2 * np.array(signs) - 1)), 1.0]
            pixel = np.array([size.cx - size.fx * y / x, size.cy - size.fy * z / x])
            is_in = x > 0.05 and (pixel >= 0).all() and (pixel < [size.width, size.height]).all()
            if is_in and np.linalg.norm([x, y, z]) < 90.0 and box["agent"] != "cav_1":
                assert np.abs(drawn - pixel).max(axis=1).min() < 1e-6
                found += 1
    assert found >= 8


def test_only_boxes_with_a_pixel_are_drawn_on_an_image(data) -> None:
    query = "SELECT agent, sensor, object_id FROM box_visibility WHERE weather = 'sunny' AND frame = 0 AND pixels > 0"
    rows = data.connect().sql(query).fetchall()
    frame = data.frame(*AT, 0)
    for agent in ("cav_1", "cav_2", "rsu_1"):
        for name, view in frame.agents[agent].views.items():
            seen = {row[2] for row in rows if row[:2] == (agent, name)}
            assert set(seen_objects(view).tolist()) == seen
            axes = Figure().subplots()
            (draw_depth if name == "depth" else draw_camera)(axes, view, farthest_m=1e6)
            assert len(axes.collections) == len(seen - {frame.agents[agent].row["object_id"]})
    assert box_kind("cav_1", "car") == "connected" and box_kind(None, "pedestrian") == "person"


@pytest.mark.parametrize("model", ["pinhole", "fisheye"])
def test_a_box_around_the_camera_is_cut_off_and_bends_with_the_lens(model) -> None:
    lens = Distortion() if model == "pinhole" else Distortion("fisheye", radial=(0.0, 0.0, 0.0, 0.0))
    camera = Camera(Intrinsics(200, 100, 80.0, 80.0, 100.0, 50.0, lens), np.array([0.0, 0, 0, 0, 0, 0, 1]))
    corners = np.array([[sx, sy, sz] for sx in (-2.0, 6.0) for sy in (-2.0, 2.0) for sz in (-1.0, 1.0)])
    lines = box_lines(SimpleNamespace(camera=camera), corners)
    assert all(np.isfinite(line).all() for line in lines)
    ahead = camera.pixels(corners[4:])  # the far side, which is whole
    assert all(np.abs(np.concatenate(lines) - pixel).max(axis=1).min() < 1e-9 for pixel in ahead)
    long = [line for line in lines if np.ptp(line[:, 0]) > 30]
    bends = [abs(np.linalg.det([line[8] - line[0], line[-1] - line[0]])) / np.ptp(line[:, 0]) for line in long]
    assert (max(bends) > 0.2) == (model == "fisheye")  # straight edges stay straight in a pinhole camera


def test_a_sweep_is_drawn_in_the_frame_of_its_agent(data) -> None:
    agent = data.frame(*AT, 0).agents["cav_2"]
    axes = Figure().subplots()
    points = draw_lidar(axes, agent, color="intensity", extent_m=50.0)
    row = data.read("lidar", weather="sunny", agent="cav_2", frames=range(1)).to_pylist()[0]
    mount = matrix(data.read("sensors", agent="cav_2", sensor="lidar").to_pylist()[0])
    xyz = (mount @ np.array([row["x"], row["y"], row["z"], np.ones(row["point_count"])]))[:3].T
    is_in = (np.abs(xyz[:, :2]) <= 50.0).all(axis=1)
    np.testing.assert_allclose(points.get_offsets(), np.stack([-xyz[is_in, 1], xyz[is_in, 0]], axis=1), atol=1e-5)
    np.testing.assert_allclose(points.get_array(), np.array(row["intensity"])[is_in])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("right of the agent [m]", "ahead of the agent [m]")
    boxes = data.frame(*AT, 0).boxes
    axes = Figure().subplots()
    assert draw_lidar(axes, agent, color="object", boxes=False) is None
    actors = sum(np.isin(np.array(row["object_id"]), boxes["object_id"]) & (np.abs(xyz[:, :2]) <= 60.0).all(axis=1))
    assert [len(c.get_offsets()) for c in axes.collections][1] == actors > 0


def test_a_radar_sample_is_drawn_by_label_and_velocity(data) -> None:
    from mmw.dataset.frame import PointCloud

    columns = {
        "range": np.array([20.0, 10.0, 30.0]), "velocity": np.array([1.0, -2.0, 3.0]), "label": np.array([0, 1, 0]),
        "snr_db": np.array([20.0, 12.0, 15.0]),
    }  # fmt: skip
    place = np.array([[20.0, 0, 0], [0, 10.0, 0], [30.0, -5.0, 0]])
    pose = np.array([1.0, 2, 0, 0, 0, 0, 1])
    frame = SimpleNamespace(boxes=data.frame(*AT, 0).boxes)
    agent = SimpleNamespace(
        pose=pose, radars={"radar": PointCloud("x", "radar", pose, place, columns)}, sweeps={}, frame=frame
    )
    axes = Figure().subplots()
    points = draw_radar(axes, agent, boxes=False)
    np.testing.assert_allclose(points.get_offsets(), [[0, 20], [5, 30]], atol=1e-12)
    np.testing.assert_array_equal(points.get_array(), [1.0, 3.0])
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["object (2)", "rain (1)"]


def test_a_frame_shows_the_sensors_of_its_agents(data) -> None:
    figure = render_frame(data, *AT, 0)
    titles = {axes.get_title().split(":")[0] for part in figure.subfigs for axes in part.axes} - {""}
    assert titles == {"cav_1 front", "cav_1 lidar", "rsu_1 depth"}  # the first CAV's; it carries no depth camera
    cameras, others = choose_panels(data.frame(*AT, 0), "cav_1")
    assert [name for _, name in cameras] == ["front"] and [name for _, name in others] == ["lidar"]
    blank = render_frame(data, *AT, 1, "cav_1", boxes="none", color="height")
    words = [text.get_text() for part in blank.subfigs for axes in part.axes for text in axes.texts]
    assert words == ["no image stored in this frame"]  # cameras take every second frame
    outer = Figure()
    given = outer.subfigures(1, 2)[1]
    assert render_frame(data, *AT, 0, "rsu_1", figure=given) is given


def test_cameras_go_from_left_to_rear() -> None:
    def row(yaw_deg: float) -> dict:
        half = np.radians(yaw_deg) / 2
        return {"type": "rgb", "qx": 0.0, "qy": 0.0, "qz": np.sin(half), "qw": np.cos(half)}

    sensors = {"back": row(180), "front": row(0), "left": row(90), "rear_right": row(-135), "right": row(-90)}
    agent = SimpleNamespace(sensors=sensors)
    assert sensors_of(agent, "rgb") == ["left", "front", "right", "rear_right", "back"]
    assert sensors_of(agent, "depth") == []


def test_the_plan_of_a_town_has_lanes_and_buildings(data) -> None:
    plan = read_town_plan(data, SCENARIO)
    assert len(plan.lanes) == len(plan.widths) > 100 and len(plan.buildings) > 50
    assert read_town_plan(data, "another").lanes == ()
    pose = data.read("poses", weather="sunny", agent="cav_1", frames=range(1)).to_pylist()[0]
    near = min(np.hypot(*(line - [pose["x"], pose["y"]]).T).min() for line in plan.lanes)
    assert near < 2.0  # the vehicle drives on a lane
    part = plan.within(np.array([-50.0, -50.0]), np.array([50.0, 50.0]))
    assert 0 < len(part.lanes) < len(plan.lanes)
    points = np.random.default_rng(1).normal(size=(200, 2)).round(2)
    assert set(map(tuple, convex_outline(points))) == set(map(tuple, points[ConvexHull(points).vertices]))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda d: plot_link(d, *AT, "rsu_1", "cav_9"), "sunny has no link rsu_1 to cav_9; it has rsu_1 to cav_1"),
        (lambda d: plot_link(d, *AT, "rsu_1", "cav_1", carrier_hz=1e9), "no carrier 1e.09 Hz; it has 4.9e.09, 2.8e.10"),
        (lambda d: plot_paths(d, *AT, 0, "cav_1", "rsu_1"), "no link cav_1 to rsu_1"),
        (lambda d: plot_paths(d, *AT, 99, "rsu_1", "cav_1"), "no frame 99"),
        (lambda d: render_frame(d, *AT, 0, "cav_9"), "no agent 'cav_9'; it has cav_1, cav_2, cav_3, rsu_1"),
        (lambda d: plot_sensor(d, SCENARIO, ["sunny"], 0, "cav_9", "imu"), "no agent 'cav_9'; it has cav_1"),
        (
            lambda d: plot_sensor(d, SCENARIO, ["sunny"], 0, "cav_1", "radar"),
            "sensor 'radar': cav_1 has antenna",
        ),
        (lambda d: plot_readings(d, *AT, "lidar"), "no scalar sensor 'lidar'; it has gnss, imu"),
        (lambda d: render_frame(d, *AT, 0, color="red"), "color='red': one of intensity"),
        (lambda d: render_frame(d, *AT, 0, boxes="some"), "boxes='some': seen, all or none"),
        (lambda d: draw_lidar(None, d.frame(*AT, 0).agents["cav_1"], "radar"), "no LiDAR sweep of 'radar'"),
    ],
)
def test_errors_list_the_known_names(data, call, message) -> None:
    with pytest.raises(ValueError, match=message):
        call(data)


@pytest.mark.slow
def test_the_examples_of_the_docs_run(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    show = import_module("mmw.viz.scene_view.show")  # the package has a function of this name
    monkeypatch.setattr(show, "_has_display", lambda: False)  # no window is opened
    run_python(ROOT / "docs" / "guides" / "viewer.md", "out/quickstart", small_dataset())
    assert {file.name for file in tmp_path.iterdir()} == {
        "frame.png", "paths.png", "link.png", "panels.png", "street.png", "above.png", "delay.png", "angles.png",
    }  # fmt: skip


def test_no_window_is_needed(tmp_path: Path) -> None:
    code = (
        "import sys, warnings, mmw\nfrom mmw.viz.plots import plot_link\n"
        r"warnings.filterwarnings('error', module=r'(mmw|__main__)(\.|$)')  # what others are warned of is theirs"
        f"\nplot_link(mmw.open({str(small_dataset())!r}), {SCENARIO!r}, 'sunny', 'rsu_1', 'cav_1', beam_frames=0)"
        f".savefig({str(tmp_path / 'link.png')!r})\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)
    assert (tmp_path / "link.png").stat().st_size > 10_000
