"""The altimeter of `examples/altimeter`: a sensor in a package of its own needs no change in mmw."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
CONFIG = ("frames.count=4", "weathers=[sunny, rainy]", "channel.enabled=false", "output.shard_frames=2")
SENSORS = "sensors=[{type: altimeter, noise_m: 0, range_m: 50}, {type: imu}]"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Install the package into a folder, and return the environment of a process that sees it and its entry point."""
    folder = tmp_path_factory.mktemp("altimeter")
    source = folder / "source"
    source.mkdir()
    for name in ("pyproject.toml", "mmw_altimeter.py"):
        (source / name).write_text((ROOT / "examples" / "altimeter" / name).read_text())
    command = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", str(folder / "site"), str(source)]
    subprocess.run(command, check=True)
    return os.environ | {"PYTHONPATH": os.pathsep.join([str(folder / "site"), str(ROOT)])}


@pytest.fixture(scope="module")
def dataset(installed: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("data") / "altimeter"
    mmw(installed, "run", "--config", "quickstart", *CONFIG, SENSORS, "--out", str(out), "--device", "cpu")
    return out


def run(environment: dict[str, str], *arguments: str, code: int = 0) -> str:
    """Run Python with the package installed, and return its standard output."""
    result = subprocess.run(
        [sys.executable, *arguments], env=environment, capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert result.returncode == code, result.stdout + result.stderr
    return result.stdout + result.stderr


def mmw(environment: dict[str, str], *arguments: str, code: int = 0) -> str:
    """Run a command of mmw with the package installed."""
    return run(environment, "-m", "mmw", *arguments, code=code)


def test_the_configuration_knows_its_keys(installed: dict[str, str]) -> None:
    quickstart = ("run", "--config", "quickstart", "--dry-run", "--quick")
    text = mmw(installed, *quickstart, "sensors=[{type: altimeter, rangem: 3}]", code=2)
    assert "sensors[0].rangem = 3: unknown key; did you mean `range_m`?" in text
    assert "altimeter 3" in mmw(installed, *quickstart, *CONFIG, SENSORS)  # one ray for each of three vehicles
    code = "from mmw.config.load import json_schema; import json; print(json.dumps(json_schema()))"
    text = run(installed, "-c", code)
    assert "Altimeter" in json.loads(text.splitlines()[0])["$defs"]


def test_heights_are_those_of_a_ray_down(dataset: Path) -> None:
    """An agent's origin is on the ground below its body, so the first surface below is the road, a few mm away."""
    rows = pq.ParquetDataset(dataset / "altimeter").read().to_pydict()
    assert len(rows["frame"]) == 2 * 4 * 3 and set(rows["sensor"]) == {"altimeter"}
    heights = np.array(rows["height"])
    assert np.isfinite(heights).all() and (np.abs(heights) < 1.0).all()
    assert set(rows["weather"]) == {"sunny", "rainy"}


def test_nothing_in_range_is_null(installed: dict[str, str], tmp_path: Path) -> None:
    out = tmp_path / "high"
    sensor = "sensors=[{type: altimeter, range_m: 1, mount: {cav: {position_m: [0, 0, 30]}}}]"
    mmw(installed, "run", "--config", "quickstart", *CONFIG, sensor, "--out", str(out), "--device", "cpu")
    rows = pq.ParquetDataset(out / "altimeter").read(["height", "object_id"]).to_pydict()
    assert set(rows["height"]) == {None} and set(rows["object_id"]) == {-1}
    mmw(installed, "verify", str(out))


def test_the_dataset_reads_it(dataset: Path, installed: dict[str, str]) -> None:
    code = (
        "import mmw\n"
        "from mmw.dataset.windows import WindowSpec, open_windows, Feature\n"
        f"data = mmw.open({str(dataset)!r})\n"
        "sample = data.frame('town03_roundabout', 'sunny', 0).agents['cav_1'].sensor('altimeter')\n"
        "print('height', float(sample.height), sample.object_id)\n"
        "windows = open_windows(data, WindowSpec([Feature('altimeter')], past=2, future=1))\n"
        "print('windows', len(windows), windows[0]['altimeter'].shape)\n"
    )
    text = run(installed, "-c", code)
    assert "height " in text and "windows " in text


def test_verify_finds_a_removed_row(dataset: Path, installed: dict[str, str], tmp_path: Path) -> None:
    mmw(installed, "verify", str(dataset), "--rerender", "5", "--device", "cpu")
    damaged = tmp_path / "damaged"
    shutil.copytree(dataset, damaged)
    path = next((damaged / "altimeter").rglob("part-000002.parquet"))
    table = pq.ParquetFile(path).read()
    kept = table.filter(pc.not_equal(table["agent"].cast("string"), "cav_2"))
    meta = {key: text for key, text in table.schema.metadata.items() if key != b"mmw.rows"}
    pq.write_table(kept.replace_schema_metadata(meta), path)
    for marker in (damaged / "_shards").glob("*.json"):  # as a wrong run would have left it
        content = json.loads(marker.read_text())
        for file in content["files"]:
            if file["path"] == path.relative_to(damaged).as_posix():
                data = path.read_bytes()
                file.update(bytes=len(data), rows=kept.num_rows, sha256=hashlib.sha256(data).hexdigest())
        marker.write_text(json.dumps(content))
    mmw(installed, "finalize", str(damaged))
    text = mmw(installed, "verify", str(damaged), code=1)
    assert "altimeter" in text and "rows are missing, the first frame 2, agent cav_2, sensor altimeter" in text


def test_rows_are_regenerated(dataset: Path, installed: dict[str, str]) -> None:
    options = ("frame=3", "weather=rainy", "agent=cav_1", "--compare", "--device", "cpu")
    assert "equal" in mmw(installed, "regenerate", "altimeter", str(dataset), *options)


def test_it_is_a_time_series_in_viewer_report_and_figures(
    dataset: Path, installed: dict[str, str], tmp_path: Path
) -> None:
    """The package gives no view: its kind, `scalar`, decides."""
    mmw(installed, "report", str(dataset), "--out", str(tmp_path / "report.html"))
    page = (tmp_path / "report.html").read_text()
    assert "Radar altimeter samples" in page and "Radar altimeter altimeter: height [m] over time" in page
    mmw(installed, "view", str(dataset), "--weather", "sunny", "--save", str(tmp_path / "view.rrd"))
    code = (
        "import mmw\n"
        "from mmw.viz.plots import plot_readings, plot_sensor\n"
        "from mmw.viz.rerun.entities import reading_entity\n"
        "from tests.fixtures.rrd_files import read_recording\n"
        f"data, scenario = mmw.open({str(dataset)!r}), 'town03_roundabout'\n"
        f"recording = read_recording({str(tmp_path / 'view.rrd')!r})\n"
        "rows = data.numpy('altimeter', weather='sunny', agent='cav_2')\n"
        "for frame, height in zip(rows['frame'], rows['height']):\n"
        "    entity = reading_entity('altimeter', 'height', 'cav_2')\n"
        "    assert recording.array(entity, frame, 'Scalars:scalars')[0] == height\n"
        "(axes,) = plot_readings(data, scenario, 'sunny', 'altimeter').axes\n"
        "assert axes.get_ylabel() == 'height [m]' and len(axes.lines) == 3\n"
        "(axes,) = plot_sensor(data, scenario, ['sunny'], 0, 'cav_2', 'altimeter').axes\n"
        "assert (axes.lines[0].get_ydata() == rows['height']).all()\n"
    )
    run(installed, "-c", code)


def test_a_dataset_without_its_package_is_named(dataset: Path, installed: dict[str, str], tmp_path: Path) -> None:
    hidden = (  # an environment of this machine may have the package installed
        "import importlib.metadata as metadata, sys\n"
        "found = metadata.entry_points\n"
        "metadata.entry_points = lambda **group: [e for e in found(**group) if e.name != 'altimeter']\n"
        "import mmw, mmw.__main__\n"
    )
    environment = installed | {"PYTHONPATH": str(ROOT)}
    code = (
        f"data = mmw.open({str(dataset)!r})\n"
        "print('height', data.frame('town03_roundabout', 'sunny', 0).agents['cav_1'].sensor('altimeter').height)\n"
    )
    text = run(environment, "-c", hidden + code)
    assert "table 'altimeter' is read as its files describe it; install the package of mmw-altimeter (sensor" in text
    assert "\nheight " in text or text.startswith("height ")
    text = run(environment, "-c", f"{hidden}sys.exit(mmw.__main__.main(['verify', {str(dataset)!r}]))", code=1)
    assert "table 'altimeter' is not known" in text and '"altimeter" is unknown' in text and "manifest" not in text
    view = ["view", str(dataset), "--save", str(tmp_path / "view.rrd"), "--no-town"]
    text = run(environment, "-c", f"{hidden}sys.exit(mmw.__main__.main({view!r}))")
    assert "altimeter: no installed package provides this type of sensor" in text
