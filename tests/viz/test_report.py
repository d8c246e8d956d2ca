"""The page about a dataset: its numbers are those of the tables, and it asks no other file or host for anything."""

import base64
import io
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image

from mmw.cli.report import main
from mmw.dataset import open_dataset
from mmw.viz.report import make_report
from mmw.viz.report.contact_sheets import Budget, picture_frames
from mmw.viz.report.page import MARKER
from mmw.viz.report.sampling import sample_range, sampled
from mmw.viz.report.svg import nice_step, ticks
from mmw.viz.report.thumbnails import VIEW_M, VIEW_PX, radar_thumb, sweep_thumb
from tests.fixtures.small_dataset import SCENARIO, copy_of, part, small_dataset

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


class Page(HTMLParser):
    """Tables, charts, pictures and attributes of a page."""

    def __init__(self, source: str) -> None:
        super().__init__()
        self.tables: list[list[list[str]]] = []
        self.attributes: list[tuple[str, str, str]] = []
        self.charts: dict[str, list[tuple[str, dict, str]]] = {}
        self.images: list[dict] = []
        self.tags: list[str] = []
        self.words, self._cell, self._chart = "", False, None
        self.feed(source)

    def handle_starttag(self, tag: str, attributes: list) -> None:
        values = {name: value or "" for name, value in attributes}
        self.tags.append(tag)
        self.attributes += [(tag, name, value) for name, value in values.items()]
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self.tables[-1][-1].append("")
            self._cell = True
        elif tag == "svg":
            self._chart = self.charts.setdefault(values["aria-label"], [])
        elif tag == "img":
            self.images.append(values)
        elif self._chart is not None:
            self._chart.append((tag, values, ""))

    def handle_endtag(self, tag: str) -> None:
        self._cell = self._cell and tag not in ("td", "th")
        if tag == "svg":
            self._chart = None

    def handle_data(self, data: str) -> None:
        self.words += data
        if self._cell:
            self.tables[-1][-1][-1] += data
        elif self._chart:
            tag, values, text = self._chart[-1]
            self._chart[-1] = tag, values, text + data

    def table(self, heading: str) -> list[list[str]]:
        """Return the rows below the heading that begins a table."""
        return next(rows[1:] for rows in self.tables if rows[0][0] == heading)

    def scale(self, chart: str, anchor: str) -> tuple[float, float]:
        """Return factor and offset from pixels to values, from the ticks of an axis: `end` is y, `middle` x."""
        axis = "y" if anchor == "end" else "x"
        found = []
        for tag, values, text in self.charts[chart]:
            if tag == "text" and values["text-anchor"] == anchor and re.fullmatch(r"-?[\d.]+", text):
                found.append((float(values[axis]) - (4 if axis == "y" else 0), float(text)))
        return tuple(np.polyfit(*zip(*found, strict=True), 1))


def page_of(root: Path, out: Path, **options) -> Page:
    make_report(root, out, **options)
    return Page(out.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def path(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("report") / "page.html"
    make_report(small_dataset(), out)
    return out


@pytest.fixture(scope="module")
def page(path) -> Page:
    return Page(path.read_text(encoding="utf-8"))


def test_counts_and_sizes_are_those_of_the_files(page) -> None:
    rows = {row[0]: row[1:4] for row in page.table("table")}
    everything = [0, 0, 0]
    for name in open_dataset(small_dataset()).tables:
        files = list((small_dataset() / name).rglob("*.parquet"))
        numbers = len(files), sum(pq.read_metadata(f).num_rows for f in files), sum(f.stat().st_size for f in files)
        everything = [a + b for a, b in zip(everything, numbers, strict=True)]
        assert [cell.replace(",", "") for cell in rows[name][:2]] == [str(number) for number in numbers[:2]]
        assert size_of(rows[name][2]) == pytest.approx(numbers[2], rel=0.06)
    assert rows["all"][1].replace(",", "") == str(everything[1]) and len(rows) == 1 + len(
        open_dataset(small_dataset()).tables
    )
    matrix = {(row[0], row[1]): row for row in page.table("scenario")}
    names = next(rows[0] for rows in page.tables if rows[0][0] == "scenario")
    lidar = pq.read_metadata(small_dataset() / part("lidar")).num_rows * 2  # two shards
    assert matrix[SCENARIO, "rainy"][names.index("lidar")].startswith(f"{lidar} (")
    assert matrix[SCENARIO, "rainy"][2] == "4"


def size_of(words: str) -> float:
    number, unit = words.split()
    return float(number.replace(",", "")) * {"B": 1, "kB": 1e3, "MB": 1e6, "GB": 1e9}[unit]


def test_the_table_of_links_is_what_sql_says(page) -> None:
    query = (
        "SELECT peer || ' to ' || agent, link, weather, carrier_hz / 1e9, count(*), 100 * avg(is_los::int), "
        "avg(gain_db), min(gain_db), max(gain_db), avg(path_count), 1e9 * avg(rms_delay_s) FROM links GROUP BY ALL"
    )
    wanted = {
        (row[0], row[2], f"{row[3]:g}"): row for row in open_dataset(small_dataset()).connect().sql(query).fetchall()
    }
    rows = page.table("link")
    assert len(rows) == len(wanted) == 12
    for row in rows:
        of_sql = wanted[row[0], row[2], row[3]]
        assert row[1] == of_sql[1]
        for cell, number in zip(row[4:], of_sql[4:], strict=True):
            assert number is None if cell == "-" else abs(float(cell) - number) <= 0.051


def test_a_line_is_the_gain_of_the_table(page) -> None:
    chart = "Path gain of rsu_1 to cav_1 at 28 GHz over time"
    query = (
        "SELECT frame, gain_db FROM links WHERE weather = 'rainy' AND agent = 'cav_1' AND carrier_hz = 28e9 ORDER BY 1"
    )
    rows = np.array(open_dataset(small_dataset()).connect().sql(query).fetchall(), dtype=float)
    (line,) = (values["d"] for tag, values, _ in page.charts[chart] if values.get("class") == "s1")
    points = np.array(re.findall(r"[ML]([\d.]+) ([\d.]+)", line), dtype=float)
    across, up = page.scale(chart, "middle"), page.scale(chart, "end")
    np.testing.assert_allclose(np.polyval(across, points[:, 0]), rows[:, 0] / 100, atol=2e-5)
    np.testing.assert_allclose(np.polyval(up, points[:, 1]), rows[:, 1], atol=0.01)
    strips = [values for tag, values, _ in page.charts[chart] if values.get("class") in ("free", "blocked")]
    assert [values["class"] for values in strips] == ["free"] and float(strips[0]["width"]) > 300


def test_histograms_count_every_path(page) -> None:
    connection = open_dataset(small_dataset()).connect()
    where = "WHERE weather = 'sunny' AND carrier_hz = 28e9"
    total = connection.sql(f"SELECT count(*) FROM paths {where}").fetchall()[0][0]
    spreads = connection.sql(f"SELECT count(*) FROM links {where} AND rms_delay_s IS NOT NULL").fetchall()[0][0]
    for label, wanted in (
        ("delay [ns]", total), ("azimuth from the transmitter [deg]", total), ("RMS delay spread [ns]", spreads),
        ("azimuth at the receiver [deg]", total), ("zenith angle at the receiver [deg]", total),
    ):  # fmt: skip
        chart = f"Histogram: {label}"
        heights = [float(values["height"]) for tag, values, _ in page.charts[chart] if tag == "rect"]
        assert sum(heights) * abs(page.scale(chart, "end")[0]) == pytest.approx(wanted, rel=0.002), label
    assert f"{total} paths at 28 GHz in sunny, every frame" in page.words


def test_the_heat_map_counts_the_best_beams(page) -> None:
    query = "SELECT tx_beam, rx_beam, count(*) FROM beams WHERE weather = 'sunny' AND carrier_hz = 28e9 GROUP BY ALL"
    rows = open_dataset(small_dataset()).connect().sql(query).fetchall()
    wanted = {row[:2]: row[2] for row in rows if row[0] >= 0}
    chart, found = "Best pairs of beams", {}
    across, up = page.scale(chart, "middle"), page.scale(chart, "end")
    for tag, values, _ in page.charts[chart]:
        if tag == "rect":
            x, y = (float(values[a]) + float(values[s]) / 2 for a, s in (("x", "width"), ("y", "height")))
            found[round(np.polyval(across, x)), round(np.polyval(up, y))] = float(values["opacity"])
    most = max(wanted.values())
    assert found == {pair: pytest.approx(0.15 + 0.85 * n / most, abs=0.006) for pair, n in wanted.items()}
    assert f"Best pairs of {sum(wanted.values())} links and frames" in page.words


def test_every_sensor_has_its_pictures(page) -> None:
    wanted = {
        f"{agent} {sensor}, {weather}, frame {frame}"
        for weather in ("sunny", "rainy") for frame in (0, 2)
        for agent in ("cav_1", "cav_2", "cav_3", "rsu_1")
        for sensor in ("front", "lidar", *(("depth",) if agent == "rsu_1" else ()))
    }  # fmt: skip
    assert {image["alt"] for image in page.images} == wanted and len(page.images) == len(wanted)
    for image in page.images:
        kind, data = re.fullmatch(r"data:image/(\w+);base64,(.*)", image["src"]).groups()
        with Image.open(io.BytesIO(base64.b64decode(data))) as picture:
            assert picture.format.lower() == kind and min(picture.size) > 40
    assert "Shown: 2 frames of 4 frames" in page.words


def test_points_are_drawn_where_they_are() -> None:
    def pixels(thumb) -> np.ndarray:
        return np.asarray(Image.open(io.BytesIO(thumb[1])).convert("RGB"), dtype=int)

    image = pixels(sweep_thumb(np.array([22.5]), np.array([-15.0]), np.array([0.5])))
    per_m = VIEW_PX[0] / VIEW_M
    row, column = round((VIEW_M / 2 - 22.5) * per_m), round(VIEW_PX[1] / 2 + 15.0 * per_m)
    bright = np.argwhere(image[..., 0] > 240)
    assert [row, column] in bright.tolist()  # to the right of the cross in the middle, ahead of it
    image = pixels(radar_thumb(np.array([40.0, 40.0]), np.array([0.3, -0.3]), np.array([-8.0, 8.0])))
    blue, orange = np.argwhere(image[..., 2] > image[..., 0] + 60), np.argwhere(image[..., 0] > image[..., 2] + 60)
    assert blue[:, 1].mean() < VIEW_PX[1] / 2 < orange[:, 1].mean()  # approaching on the left


def test_the_map_shows_ways_and_units(page) -> None:
    shapes = page.charts[f"Ways of the agents of {SCENARIO}"]
    rows = open_dataset(small_dataset()).read("poses", weather="sunny").to_pylist()
    for number, agent in enumerate(("cav_1", "cav_2", "cav_3")):
        (way,) = (values["d"] for _, values, _ in shapes if values.get("class") == f"t s{number}")
        points = np.array([pair.split() for pair in way[1:].split("L")], dtype=float)
        wanted = np.array([(row["x"], -row["y"]) for row in rows if row["agent"] == agent])
        assert np.abs(points[[0, -1]] - wanted[[0, -1]]).max() <= 0.11
    assert {text for tag, _, text in shapes if tag == "text"} >= {"cav_1", "cav_2", "cav_3", "rsu_1"}
    kinds = [values.get("class") for _, values, _ in shapes]
    assert kinds.count("road") > 20 and kinds.count("b") > 5 and kinds.count("r") == 1


def test_the_page_asks_no_other_file_or_host(path, page) -> None:
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


def test_provenance_and_check(page) -> None:
    info = open_dataset(small_dataset()).info
    rows = dict(next(rows for rows in page.tables if ["mmw", info["versions"]["mmw"]] in rows))
    assert rows["configuration SHA-256"] == info["config_sha256"] and rows["device"] == info["versions"]["device"]
    assert (small_dataset() / "config.yaml").read_text() in page.words
    weathers = {row[0]: row[1] for row in page.table("weather")}
    assert float(weathers["rainy"]) == info["config"]["air"]["rainy"]["rain_mm_h"]
    files = len(list(small_dataset().glob("*/**/part-*.parquet")))
    assert "Nothing wrong found." in page.words and f"{files} files that the markers list" in page.words
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
    assert (
        "This dataset is not finished: 2 parts are still to make (" in page.words
        and "of 4 planned shards" in page.words
    )
    assert f"{SCENARIO}/rainy/2-3" in page.words and f"{SCENARIO}/sunny/2-3" in page.words
    assert f"{part('lidar', 'sunny', 2)}: is missing" in page.words and "_manifest.parquet: does not list" in page.words
    rows = {row[1]: row for row in page.table("scenario")}
    assert rows["rainy"][2] == "2" and rows["sunny"][2] == "4"


def test_a_dataset_without_tables_or_shards(tmp_path) -> None:
    root = copy_of(small_dataset(), tmp_path / "d")
    for name in ("links", "paths", "rgb", "poses", "_shards/" + f"{SCENARIO}.json"):
        shutil.rmtree(root / name) if (root / name).is_dir() else (root / name).unlink()
    (root / "config.yaml").unlink()
    page = page_of(root, tmp_path / "page.html")
    assert "Nothing in the dataset yet, or at all, for: map, radio links, radio paths." in page.words
    assert "config.yaml cannot be read" in page.words and len(page.images) == 2 * 3 * 5  # LiDAR and depth alone
    for marker in (root / "_shards").glob("*.json"):
        marker.unlink()
    empty = page_of(root, tmp_path / "page.html")
    assert "no shard is complete yet" in empty.words and not empty.images


def test_what_cannot_be_used_is_named(tmp_path, capsys) -> None:
    out = tmp_path / "page.html"
    assert main([str(tmp_path), "--out", str(out)]) == 2
    assert "has no dataset.json" in capsys.readouterr().err and not out.exists()
    assert main([str(small_dataset()), "--out", str(out), "--scenario", "town99"]) == 2
    assert f"has no scenario 'town99'; it has {SCENARIO}; name one" in capsys.readouterr().err
    assert main([str(small_dataset()), "--out", str(tmp_path)]) == 2
    assert "is a folder; the name of an HTML file is needed" in capsys.readouterr().err
    assert main(["s3://bucket/d", "--out", str(out)]) == 2
    assert "a local folder is needed" in capsys.readouterr().err
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
    assert budget.each == 30 and budget.take(b"x" * 5_999_999) and not budget.take(b"xx") and not budget.take(b"x")
    assert ticks(-0.1, 2.0) == [0.0, 0.5, 1.0, 1.5, 2.0] and nice_step(0.3) == 0.5 and ticks(0, 90, 30.0)[-1] == 90.0


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
