"""The page about a dataset: its numbers are those of the tables, and it asks no other file or host for anything."""

import base64
import io
import re
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image

from mmw.cli.report import main
from mmw.dataset.frame import PointCloud
from mmw.viz.plots import read_town_plan
from mmw.viz.plots.readings import draw_reading, read_readings
from mmw.viz.report import make_report
from mmw.viz.report.channel_statistics import AZIMUTH, BINS, draw_beams, draw_histogram
from mmw.viz.report.contact_sheets import Budget, picture_frames
from mmw.viz.report.css import COLORS
from mmw.viz.report.figures import EXTENT_M, figure_style, new_chart, svg, thumbnail
from mmw.viz.report.inventory import take_inventory
from mmw.viz.report.links import draw_gains, read_links
from mmw.viz.report.maps import draw_trajectories
from mmw.viz.report.page import MARKER
from mmw.viz.report.sampling import sample_range, sampled
from tests.fixtures.pages import HtmlPage
from tests.fixtures.small_dataset import SCENARIO, copy_of, part, small_dataset

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


def page_of(root: Path, out: Path, **options) -> HtmlPage:
    make_report(root, out, **options)
    return HtmlPage(out.read_text(encoding="utf-8"))


def charts_of(page: HtmlPage) -> list[str]:
    return page.values("svg", "aria-label")


@pytest.fixture(scope="module")
def path(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("report") / "page.html"
    make_report(small_dataset(), out)
    return out


@pytest.fixture(scope="module")
def page(path) -> HtmlPage:
    return HtmlPage(path.read_text(encoding="utf-8"))


def test_counts_and_sizes_are_those_of_the_files(data, page) -> None:
    rows = {row[0]: row[1:4] for row in page.table("table")}
    everything = [0, 0, 0]
    for name in data.tables:
        files = list((small_dataset() / name).rglob("*.parquet"))
        numbers = len(files), sum(pq.read_metadata(f).num_rows for f in files), sum(f.stat().st_size for f in files)
        everything = [a + b for a, b in zip(everything, numbers, strict=True)]
        assert [cell.replace(",", "") for cell in rows[name][:2]] == [str(number) for number in numbers[:2]]
        assert size_of(rows[name][2]) == pytest.approx(numbers[2], rel=0.06)
    assert rows["all"][1].replace(",", "") == str(everything[1]) and len(rows) == 1 + len(data.tables)
    matrix = {(row[0], row[1]): row for row in page.table("scenario")}
    names = next(rows[0] for rows in page.tables if rows[0][0] == "scenario")
    lidar = pq.read_metadata(small_dataset() / part("lidar")).num_rows * 2  # two shards
    assert matrix[SCENARIO, "rainy"][names.index("lidar")].startswith(f"{lidar} (")
    assert matrix[SCENARIO, "rainy"][2] == "4"


def size_of(words: str) -> float:
    number, unit = words.split()
    return float(number.replace(",", "")) * {"B": 1, "kB": 1e3, "MB": 1e6, "GB": 1e9}[unit]


def test_the_table_of_links_agrees_with_sql(data, page) -> None:
    query = (
        "SELECT peer || ' to ' || agent, link, weather, carrier_hz / 1e9, count(*), 100 * avg(is_los::int), "
        "avg(gain_db), min(gain_db), max(gain_db), avg(path_count), 1e9 * avg(rms_delay_s) FROM links GROUP BY ALL"
    )
    wanted = {(row[0], row[2], f"{row[3]:g}"): row for row in data.connect().sql(query).fetchall()}
    rows = page.table("link")
    assert len(rows) == len(wanted) == 12
    for row in rows:
        of_sql = wanted[row[0], row[2], row[3]]
        assert row[1] == of_sql[1]
        for cell, number in zip(row[4:], of_sql[4:], strict=True):
            assert number is None if cell == "-" else abs(float(cell) - number) <= 0.051


def test_a_line_is_the_gain_of_the_table_and_shade_where_it_is_blocked(data) -> None:
    rows = read_links(data, take_inventory(small_dataset()), SCENARIO)
    blocked = data.connect().sql("SELECT agent FROM links GROUP BY 1 HAVING NOT bool_or(is_los)").fetchall()
    for agent, carrier in (("cav_1", 28e9), (blocked[0][0], 4.9e9)):
        (axes,) = draw_gains(rows, ("rsu_1", agent), carrier, rows.frames).axes
        for line in axes.lines:
            where = f"weather = '{line.get_label()}' AND agent = '{agent}' AND carrier_hz = {carrier}"
            query = f"SELECT frame / 100, gain_db FROM links WHERE {where} ORDER BY 1"
            found = data.connect().sql(query).fetchall()
            np.testing.assert_allclose(line.get_xydata(), np.array(found, dtype=float))
        assert [line.get_label() for line in axes.lines] == ["sunny", "rainy"]
        spans = [patch.get_extents().transformed(axes.transData.inverted()) for patch in axes.patches]
        assert [(span.x0, span.x1) for span in spans] == ([] if agent == "cav_1" else [pytest.approx((-0.005, 0.035))])
    (axes,) = draw_gains(rows, ("rsu_1", "cav_1"), 28e9, rows.frames[::3]).axes
    assert len(axes.lines[0].get_xdata()) == 2


def test_a_frame_that_is_missing_is_a_gap(data) -> None:
    rows = read_links(data, take_inventory(small_dataset()), SCENARIO)
    for own in rows.by_weather.values():
        kept = own["frame"] != 1
        own.update({name: values[kept] for name, values in own.items()})
    line = draw_gains(rows, ("rsu_1", "cav_1"), 28e9, rows.frames).axes[0].lines[0]
    assert np.isnan(line.get_ydata()).tolist() == [False, True, False, False]


def test_histograms_count_every_path(data, page) -> None:
    where = "WHERE weather = 'sunny' AND carrier_hz = 28e9"
    rows = data.connect().sql(f"SELECT kind, degrees(aoa_az) FROM paths {where}").fetchall()
    kind, angle = (np.array(column) for column in zip(*rows, strict=True))
    edges = np.linspace(*AZIMUTH, BINS + 1)
    parts = [angle[kind == name] for name in np.unique(kind)]
    colors = [f"s{number}" for number in range(len(parts))]
    (axes,) = draw_histogram(parts, colors, edges, "azimuth [deg]", "paths").axes
    top = np.zeros(BINS)
    for patch in axes.patches:
        x, y = patch.get_xy().T
        middle = (edges[:-1] + edges[1:]) / 2
        top = np.maximum(top, [max(y[:-1][(x[:-1] <= m) & (x[1:] >= m)], default=0.0) for m in middle])
    np.testing.assert_array_equal(top, np.histogram(angle, edges)[0])
    assert f"{len(rows)} paths at 28 GHz in sunny, every frame" in page.words
    labels = ("delay [ns]", "RMS delay spread [ns]", "azimuth from the transmitter [deg]")
    labels += ("azimuth at the receiver [deg]", "zenith angle at the receiver [deg]")
    assert {f"Histogram: {label}" for label in labels} <= set(charts_of(page))


def test_the_heat_map_counts_the_best_beams(data, page) -> None:
    query = "SELECT tx_beam, rx_beam, count(*) FROM beams WHERE weather = 'sunny' AND carrier_hz = 28e9 GROUP BY ALL"
    rows = np.array([row for row in data.connect().sql(query).fetchall() if row[0] >= 0])
    assert f"Best pairs of {rows[:, 2].sum()} links and frames" in page.words and "Best pairs of beams" in page.values(
        "svg", "aria-label"
    )
    assert f"{rows[:, 2].max()} times" in page.words
    (axes,) = draw_beams(rows[:, 0], rows[:, 1], rows[:, 2] / rows[:, 2].max(), (64, 16)).axes
    (cells,) = axes.collections
    middle = [path.vertices[:4].mean(axis=0) for path in cells.get_paths()]
    np.testing.assert_allclose(middle, rows[:, :2])
    np.testing.assert_allclose(cells.get_facecolor()[:, 3], 0.15 + 0.85 * rows[:, 2] / rows[:, 2].max())


def test_a_chart_has_the_colors_of_the_page() -> None:
    with figure_style():
        figure, axes = new_chart("time [s]", "<gain>")
        axes.plot([0.0, 0.00123], [1.0, 2.0], color=COLORS["s0"])
        found, again = svg(figure, "a <chart>"), svg(figure, "a <chart>")
    assert found.startswith("<svg class=c viewBox=") and found.rstrip().endswith("</svg>")
    assert "stroke: var(--s0)" in found and "var(--muted)" in found and COLORS["s0"] not in found
    assert 'aria-label="a &lt;chart&gt;"' in found and "&lt;gain&gt;" in found and "0.0010" in found
    assert "<style" not in found and "//" not in found and "figure_1" not in found
    assert found == again


def test_every_sensor_has_its_pictures(page) -> None:
    wanted = {
        f"{agent} {sensor}, {weather}, frame {frame}"
        for weather in ("sunny", "rainy") for frame in (0, 2)
        for agent in ("cav_1", "cav_2", "cav_3", "rsu_1")
        for sensor in ("front", "lidar", *(("depth",) if agent == "rsu_1" else ()))
    }  # fmt: skip
    assert set(page.values("img", "alt")) == wanted and page.tags.count("img") == len(wanted)
    for source in page.values("img", "src"):
        kind, data = re.fullmatch(r"data:image/(\w+);base64,(.*)", source).groups()
        with Image.open(io.BytesIO(base64.b64decode(data))) as picture:
            assert picture.format.lower() == kind and min(picture.size) > 40
    assert "Shown: 2 frames of 4 frames" in page.words and "LiDAR: bright is a strong return." in page.words


def thumbnail_pixels(thumb) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(thumb[0][1])).convert("RGB"), dtype=int)


def agent_with(type_: str, **samples) -> SimpleNamespace:
    """Return an agent at the origin of the world with a sensor of a type and no boxes around."""
    pose, frame = np.array([0.0, 0, 0, 0, 0, 0, 1]), SimpleNamespace(boxes=())
    row = {"type": type_, "sensor": type_}
    given = {"sweeps": {}, "radars": {}, "views": {}} | samples
    return SimpleNamespace(name="cav", pose=pose, frame=frame, sensors={type_: row}, **given)


def test_points_of_a_thumbnail_are_where_they_are() -> None:
    pose, count, zero = np.array([0.0, 0, 0, 0, 0, 0, 1]), 40, np.zeros(40, dtype=int)
    place = np.tile([22.5, -15.0, 0.0], (count, 1)) + np.random.default_rng(1).normal(0.0, 0.5, (count, 3))
    columns = {"intensity": np.full(count, 0.5), "object_id": zero, "label": zero}
    cloud = PointCloud("cav", "lidar", pose, place, columns)
    image = thumbnail_pixels(thumbnail(agent_with("lidar", sweeps={"lidar": cloud}), "lidar"))
    per_m = 320 / (2 * EXTENT_M)
    yellow = np.argwhere((image[..., 0] > 200) & (image[..., 2] < 90))
    np.testing.assert_allclose(yellow.mean(axis=0), [120 - 22.5 * per_m, 160 + 15.0 * per_m], atol=2.5)
    place = np.array([[38.0, 12.0, 0.0], [38.0, -12.0, 0.0]])
    columns = {"range": np.full(2, 40.0), "velocity": np.array([-8.0, 8.0]), "label": zero[:2], "snr_db": np.ones(2)}
    cloud = PointCloud("cav", "radar", pose, place, columns)
    image = thumbnail_pixels(thumbnail(agent_with("radar", radars={"radar": cloud}), "radar"))
    blue, red = np.argwhere(image[..., 2] > image[..., 0] + 60), np.argwhere(image[..., 0] > image[..., 2] + 60)
    assert 100 < blue[:, 1].mean() < 160 < red[red[:, 0] < 180, 1].mean()  # the one that approaches is on the left


def test_near_is_bright_and_nothing_is_white() -> None:
    depth = np.repeat([3.0, 100.0, np.inf], 80).reshape(3, 80).repeat(40, axis=0)
    size = SimpleNamespace(intrinsics=SimpleNamespace(width=80, height=120))
    view = SimpleNamespace(depth=depth, camera=size, frame=SimpleNamespace(boxes=()))
    image = thumbnail_pixels(thumbnail(agent_with("depth", views={"depth": view}), "depth"))
    assert image.shape == (480, 320, 3)
    near, far, nothing = image[[80, 240, 400]].mean(axis=(1, 2))
    assert nothing > 250 > near > 180 > 60 > far


def test_scalar_sensors_are_lines_over_time(data, page) -> None:
    readings = read_readings(data, SCENARIO, "sunny", "gnss")
    column = next(column for column in readings.columns if column.name == "altitude_m")
    _, axes = new_chart("time [s]", "")
    draw_reading(axes, readings, column, ["red"])
    for line in axes.lines:
        rows = data.numpy("gnss", columns=["frame", "altitude_m"], weather="sunny", agent=line.get_label())
        np.testing.assert_allclose(line.get_xydata(), np.stack([rows["frame"] / 100, rows["altitude_m"]], axis=1))
    assert {"GNSS gnss: altitude [m] over time", "IMU imu: az [m/s²] over time"} <= set(charts_of(page))


def test_the_map_shows_trajectories_and_units(data, page) -> None:
    rows = data.read("poses", weather="sunny").to_pylist()
    places = {
        agent: np.array([(row["x"], row["y"]) for row in rows if row["agent"] == agent])
        for agent in ("cav_1", "cav_2", "cav_3", "rsu_1")
    }
    units = {"rsu_1": places.pop("rsu_1")[-1]}
    (axes,) = draw_trajectories(read_town_plan(data, SCENARIO), places, units, [places["cav_1"] + 5.0]).axes
    lines = {line.get_label(): line.get_xydata() for line in axes.lines}
    for name, place in {**places, "rsu_1": units["rsu_1"][None]}.items():
        np.testing.assert_array_equal(lines[name], place)
    assert {text.get_text() for text in axes.texts} == {"cav_1", "cav_2", "cav_3", "rsu_1"}
    counts = [len(part.get_paths()) for part in axes.collections]
    assert counts[0] == counts[1] > 20 and counts[2] > 5  # lanes with their middle lines, buildings
    low, high = np.array([axes.get_xlim(), axes.get_ylim()]).T
    assert all((place > low).all() and (place < high).all() for place in (*places.values(), units["rsu_1"]))
    assert f"Trajectories of the agents of {SCENARIO}" in charts_of(page)
    assert "Trajectories of 3 connected vehicles" in page.words and "Lanes and buildings from the stage." in page.words


def test_the_page_refers_to_no_other_file_or_host(path, page) -> None:
    source = path.read_text(encoding="utf-8")
    assert "script" not in page.tags and "object" not in page.tags and "iframe" not in page.tags
    for tag, name, value in page.attributes:
        if name in ("src", "href", "xlink:href", "srcset", "poster", "data", "action"):
            assert value.startswith(("data:", "#")), (tag, name, value[:60])
        assert not name.startswith("on"), (tag, name)
        assert "//" not in value or value.startswith("data:"), (tag, name, value[:60])
    (style,) = re.findall(r"<style>(.*?)</style>", source, re.DOTALL)
    assert "url(" not in style and "@import" not in style and "//" not in style
    assert "prefers-color-scheme:dark" in style and len(source) < 10_000_000
    assert {"#tables", "#check", "#provenance"} <= {value for _, name, value in page.attributes if name == "href"}
    targets = {value for _, name, value in page.attributes if name == "id"}
    assert all(value[1:] in targets for _, name, value in page.attributes if name == "href" and value[0] == "#")


def test_provenance_and_check(data, page) -> None:
    info = data.info
    rows = dict(next(rows for rows in page.tables if ["mmw", info["versions"]["mmw"]] in rows))
    assert rows["configuration SHA-256"] == info["config_sha256"] and rows["device"] == info["versions"]["device"]
    assert (small_dataset() / "config.yaml").read_text() in page.words
    weathers = {row[0]: row[1] for row in page.table("weather")}
    assert float(weathers["rainy"]) == info["config"]["air"]["rainy"]["rain_mm_h"]
    files = len(list(small_dataset().glob("*/**/part-*.parquet")))
    assert "No problem found." in page.words and f"{files} files that the markers list" in page.words
    assert "not finished" not in page.words


def test_the_same_dataset_gives_the_same_page(path, tmp_path) -> None:
    assert make_report(small_dataset(), tmp_path / "again.html") == path.stat().st_size
    assert (tmp_path / "again.html").read_bytes() == path.read_bytes()
    assert [file.name for file in tmp_path.iterdir()] == ["again.html"]


def test_an_unfinished_dataset_says_so(tmp_path) -> None:
    root = copy_of(small_dataset(), tmp_path / "d")
    (root / "_shards" / f"{SCENARIO}.rainy.000002.json").unlink()
    (root / part("lidar", "sunny", 2)).unlink()
    page = page_of(root, tmp_path / "page.html")
    assert "This dataset is not finished: 2 parts are pending (" in page.words and "of 4 planned shards" in page.words
    assert f"{SCENARIO}/rainy/2-3" in page.words and f"{SCENARIO}/sunny/2-3" in page.words
    assert f"{part('lidar', 'sunny', 2)}: is missing" in page.words and "_manifest.parquet: does not list" in page.words
    rows = {row[1]: row for row in page.table("scenario")}
    assert rows["rainy"][2] == "2" and rows["sunny"][2] == "4"


def test_a_dataset_without_tables_or_shards(tmp_path) -> None:
    root = copy_of(small_dataset(), tmp_path / "d")
    for name in ("links", "path_gains", "path_geometry", "rgb"):
        shutil.rmtree(root / name)
    (root / "config.yaml").unlink()
    page = page_of(root, tmp_path / "page.html")
    assert "The dataset has nothing for: radio links, radio paths." in page.words
    assert "config.yaml cannot be read" in page.words and page.tags.count("img") == 2 * 3 * 5  # LiDAR and depth alone
    shutil.rmtree(root / "poses")  # nothing has a place without them
    bare = page_of(root, tmp_path / "page.html")
    missing = "map, what the agents sense, radio links, radio paths"
    assert f"The dataset has nothing for: {missing}." in bare.words and "img" not in bare.tags
    (root / "_shards" / f"{SCENARIO}.json").unlink()  # of static tables: no sensor is known without them
    unknown = page_of(root, tmp_path / "page.html")
    assert "map, what the agents sense, scalar sensors, radio links, radio paths." in unknown.words
    for marker in (root / "_shards").glob("*.json"):
        marker.unlink()
    empty = page_of(root, tmp_path / "page.html")
    assert "no shard is complete yet" in empty.words and "img" not in empty.tags


def test_unusable_arguments_are_named(tmp_path, capsys) -> None:
    out, here = tmp_path / "page.html", str(small_dataset())
    for arguments, message in (
        ([str(tmp_path), "--out", str(out)], "has no dataset.json"),
        ([here, "--out", str(out), "--scenario", "town99"], f"has no scenario 'town99'; it has {SCENARIO}; name one"),
        ([here, "--out", str(tmp_path)], "is a folder; the name of an HTML file is needed"),
        (["s3://bucket/d", "--out", str(out)], "a local folder is needed"),
    ):
        assert main(arguments) == 2
        assert message in capsys.readouterr().err and not out.exists()
    root = copy_of(small_dataset(), tmp_path / "d")
    (root / part("links")).write_bytes(b"PAR1 and no more")
    assert main([str(root), "--out", str(out)]) == 2
    assert f"{part('links')}: cannot be read" in capsys.readouterr().err and not out.exists()


def test_only_an_earlier_page_is_replaced(tmp_path, capsys) -> None:
    out = tmp_path / "page.html"
    out.write_text("<html>mine</html>")
    assert main([str(small_dataset()), "--out", str(out)]) == 2
    assert "is a file that mmw report did not write; give another --out, or --force" in capsys.readouterr().err
    assert out.read_text() == "<html>mine</html>"
    assert main([str(small_dataset()), "--out", str(out), "--force", "--scenario", SCENARIO]) == 0
    assert MARKER in out.read_text()[:400] and capsys.readouterr().out.strip() == str(out)
    out.write_text(f"<!doctype html>{MARKER}old")
    assert main([str(small_dataset()), "--out", str(out)]) == 0 and "old" not in out.read_text()[-20:]


def test_samples_of_much_data() -> None:
    assert len(sample_range(range(100_000), 300)) <= 300 and sample_range(range(5, 9), 300) == range(5, 9)
    assert [sampled(range(0, 99, n)) for n in (1, 2, 3, 11, 21)] == [
        "every frame", "every 2nd frame", "every 3rd frame", "every 11th frame", "every 21st frame",
    ]  # fmt: skip
    assert picture_frames([set(range(0, 100, 10)), set(range(100)), {0}], 3) == [0]
    assert picture_frames([set(range(0, 100, 10)), set(range(100))], 3) == [0, 40, 90]
    budget = Budget(16)
    assert budget.each == 30 and budget.spend(b"x" * 5_999_999) and not budget.spend(b"xx") and not budget.spend(b"x")


@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium")
@pytest.mark.slow
def test_a_browser_finds_no_fault(path, tmp_path) -> None:
    probe = (
        "<script>addEventListener('load',()=>{const e=document.documentElement;document.title="
        "e.scrollWidth+' '+innerWidth+' '+[...document.images].filter(i=>i.complete&&!i.naturalWidth).length+' '+"
        "performance.getEntriesByType('resource').filter(r=>!r.name.startsWith('data:')).length})</script>"
    )
    copy = tmp_path / "probe.html"
    copy.write_text(path.read_text(encoding="utf-8").replace("</head>", probe + "</head>"))
    command = [
        CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--window-size=500,900",
        f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", copy.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=240, check=True)
    assert "CONSOLE" not in done.stderr
    wide, window, broken, requests = re.search(r"<title>(\d+) (\d+) (\d+) (\d+)</title>", done.stdout).groups()
    assert int(wide) <= int(window) and broken == "0" and requests == "0"
