"""Whole runs into a bucket: the same dataset as in a folder, whatever fails, stops or is killed."""

import os
import re
import signal
import subprocess
import sys
from itertools import count
from pathlib import Path

import numpy as np
import pytest

import mmw
import mmw.generation.pipeline
import mmw.scene.prepare
from mmw.__main__ import main as mmw_main
from mmw.cli.run import main
from mmw.config import load_config
from mmw.core.resources import configs_dir
from mmw.scene.prepare import cached_stage
from mmw.storage import s3_store as bucket
from mmw.storage.file_checks import verify
from mmw.storage.manifest import prepare_root
from mmw.storage.s3_store import Bucket
from tests.fixtures import own_world
from tests.fixtures.s3_server import Answer, Server, puts, s3, server

__all__ = ["s3", "server"]

ROOT = Path(__file__).parents[2]
FRAMES = 2 * 4


def command(world: Path, out: str | Path, *extra: str) -> list[str]:
    return own_world.command(world, out, "frames.count=4", "--workers", "1", *extra)


def files_of(root: Path) -> dict[str, bytes]:
    """Return what is in a dataset's folder but the locks."""
    found = {path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("*") if path.is_file()}
    return {name: data for name, data in found.items() if not name.startswith("_locks/")}


def tables_of(files: dict[str, bytes]) -> dict[str, bytes]:
    return {name: data for name, data in files.items() if "/part-" in name}


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a small stage of one's own, and its dataset in a folder."""
    folder = own_world.write_own_world(tmp_path_factory.mktemp("s3"))
    assert main(command(folder, folder / "local")) == 0
    return folder


@pytest.fixture(scope="module")
def local(world: Path) -> dict[str, bytes]:
    return files_of(world / "local")


@pytest.fixture(scope="module")
def made(s3: Server, world: Path) -> str:
    """Address of the same dataset made into the bucket; at no moment did a marker name what is not there."""
    wrong: list[str] = []
    s3.before = lambda method, path: wrong.extend(s3.false_markers("made"))
    assert main(command(world, s3.address("made"))) == 0
    assert wrong == []
    return s3.address("made")


def test_a_bucket_holds_what_a_folder_does(server: Server, made: str, local: dict[str, bytes]) -> None:
    there = server.objects("made")
    assert there.keys() == local.keys() and tables_of(there) == tables_of(local)
    assert verify(Bucket(made)) == []
    here = [path.relative_to(bucket.cache_dir()).as_posix() for path in bucket.cache_dir().rglob("*") if path.is_file()]
    assert all("/_locks/" in name for name in here)  # uploaded files are deleted


def test_a_dataset_that_is_there_is_not_made_again(server: Server, world: Path, made: str, capsys) -> None:
    assert main(command(world, made)) == 0
    assert f"{FRAMES} of {FRAMES} frames are there already; nothing to make" in capsys.readouterr().err
    assert puts(server.requests) == ["made/dataset.json", "made/_manifest.parquet", "made/README.md"]
    assert main(command(world, made, "--dry-run", "--quick")) == 0
    assert mmw_main(["status", made]) == 0
    assert "8/8" in capsys.readouterr().out


def test_python_generates_into_a_bucket_and_opens_it(server: Server, world: Path, local: dict[str, bytes]) -> None:
    changes = [*own_world.SMALL, "frames.count=4"]
    how = {"overrides": changes, "device": "cpu", "workers": 1, "progress": False}
    dataset = mmw.generate(world / "mine.yaml", server.address("python"), **how)
    assert tables_of(server.objects("python")) == tables_of(local)
    assert dataset.read("lidar").equals(mmw.open(world / "local").read("lidar"))


def test_every_check_reads_a_bucket(server: Server, made: str, capsys: pytest.CaptureFixture) -> None:
    assert mmw_main(["verify", made, "--rerender", "2", "--device", "cpu"]) == 0
    assert capsys.readouterr().out.count(": equal") == 2
    assert (
        mmw_main(["regenerate", "imu", made, "frame=3", "weather=sunny", "agent=Ego", "--compare", "--device", "cpu"])
        == 0
    )
    name = "poses/scenario=mine/weather=sunny/part-000002.parquet"
    whole = server.objects("made")[name]
    Bucket(made).remove([name])
    try:
        assert mmw_main(["verify", made]) == 1
        assert f"missing: {name}: the marker lists it" in capsys.readouterr().out
    finally:
        Bucket(made).write_atomically(name, whole)


def test_readers(server: Server, world: Path, made: str, capsys: pytest.CaptureFixture) -> None:
    """Buckets are read as docs/guides/running.md and docs/guides/query.md say."""
    one, other = mmw.open(world / "local"), mmw.open(made)
    assert (other.tables, other.info["config"]) == (one.tables, one.info["config"])
    assert other.read("lidar").equals(one.read("lidar"))
    clouds = [data.frame("mine", "sunny", 3).agents["Ego"].sweeps["lidar"].points for data in (one, other)]
    np.testing.assert_array_equal(*clouds)
    for query in ("SELECT * FROM beams ORDER BY ALL", "SELECT count(*), sum(x) FROM lidar_points WHERE frame = 1"):
        assert other.connect().sql(query).fetchall() == one.connect().sql(query).fetchall() != []
    with pytest.raises(ValueError, match=r"bucket/none: has no dataset\.json"):
        mmw.open(server.address("none"))
    (block,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs/guides/running.md").read_text(), re.DOTALL)
    assert 's3://my-bucket/full?region=eu-central-1"' in block
    names: dict = {}
    exec(block.replace("s3://my-bucket/full?region=eu-central-1", made), names)
    assert "avg(gain_db)" in capsys.readouterr().out
    where = [("frame", "==", 3), ("agent", "==", "Ego")]
    rows = names["pd"].read_parquet(f"{names['folder']}/imu", filesystem=names["store"], filters=where)
    assert len(rows) == 2 and rows.equals(names["pd"].read_parquet(world / "local/imu", filters=where))


def test_a_run_that_cannot_put_stops_and_goes_on(server: Server, world: Path, local, capsys, monkeypatch) -> None:
    """The bucket refuses after some objects; shards that were traced and not put are put by the next run."""
    address, numbers = server.address("stops"), count(1)
    server.before = lambda method, path: (403, "AccessDenied") if method == "PUT" and next(numbers) > 22 else None
    assert main(command(world, address)) == 1
    lines = capsys.readouterr().err.strip().splitlines()
    assert lines[-1].startswith("mmw: s3://bucket/stops/") and "permission is denied" in lines[-1]
    assert lines[-1].endswith("every finished shard is kept and the same command resumes")
    server.reset()
    assert server.false_markers("stops") == [] and "_manifest.parquet" not in server.objects("stops")
    assert mmw_main(["status", address]) == 1
    assert "the command that began it resumes" in capsys.readouterr().out
    finished = list(bucket.cache_dir().rglob("mine.*.*.json"))
    assert finished, "nothing was traced that could not be put: the test is of no use"
    markers = [*server.objects("stops/_shards"), *(path.name for path in finished)]
    done = {(name.split(".")[-3], int(name.split(".")[-2])) for name in markers if name.count(".") == 3}
    record, traced = mmw.generation.pipeline.capture_frames, []

    def counted(job, frames, collected) -> None:
        traced.extend((weather, frame) for weather in collected for frame in frames)
        record(job, frames, collected)

    monkeypatch.setattr(mmw.generation.pipeline, "capture_frames", counted)
    assert main(command(world, address)) == 0
    left = {(weather, frame) for weather in ("sunny", "rainy") for frame in range(4)}
    assert sorted(traced) == sorted(key for key in left if (key[0], key[1] - key[1] % 2) not in done)
    assert tables_of(server.objects("stops")) == tables_of(local) and verify(Bucket(address)) == []


@pytest.mark.slow
def test_parts_on_machines_of_their_own(server: Server, world: Path, local, tmp_path: Path, capsys) -> None:
    """Two parts that share nothing but the bucket; the second finds everything there and writes the manifest."""
    address = server.address("parts")
    for index in (1, 0):
        assert "_manifest.parquet" not in server.objects("parts")
        staging = f"output.staging={tmp_path / str(index)}"
        assert main(command(world, address, "--shard", f"{index}/2", staging)) == 0
        assert mmw_main(["status", address]) == (1 if index else 0)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[1] for line in lines if line.startswith("all ")] == ["4/8", "8/8"]
    assert tables_of(server.objects("parts")) == tables_of(local) and verify(Bucket(address)) == []
    manifest = server.objects("parts")["_manifest.parquet"]
    Bucket(address).remove(["_manifest.parquet", "README.md", "_shards/mine.sunny.000000.json"])
    assert mmw_main(["finalize", address]) == 1
    assert "2 frames are missing" in capsys.readouterr().err
    assert main(command(world, address, "--shard", "0/2", f"output.staging={tmp_path / 'new'}")) == 0
    Bucket(address).remove(["_manifest.parquet"])
    assert mmw_main(["finalize", address]) == 0
    assert len(server.objects("parts")["_manifest.parquet"]) == pytest.approx(len(manifest), rel=0.1)
    assert [path for path in tmp_path.rglob("*") if path.is_file() and "_locks" not in path.parts] == []


@pytest.mark.parametrize(
    ("out", "words"),
    [
        ("NO_BUCKET", "s3://nowhere/x/dataset.json: cannot be written: there is no such bucket"),
        ("START", "s3://bucket/start/dataset.json: cannot be written: permission is denied"),
        ("s3://me:secret@bucket/x", "credentials must not be in an address"),
        ("gs://bucket/x", "gs://bucket/x: is not the address of a dataset"),
    ],
)
def test_a_place_that_cannot_be_used_is_said_before_anything_is_made(
    server: Server, world: Path, capsys, monkeypatch: pytest.MonkeyPatch, out: str, words: str
) -> None:
    monkeypatch.setattr("mmw.generation.worker.Worker.__init__", lambda *_: pytest.fail("begun"))
    server.before = lambda method, path: (403, "AccessDenied") if method == "PUT" and "/bucket/" in path else None
    places = {"NO_BUCKET": server.address("x", bucket="nowhere"), "START": server.address("start")}
    assert main(command(world, places.get(out, out))) == 2
    error = capsys.readouterr().err
    assert words in error and "secret" not in error and error.count("\n") == 1


def test_a_staging_folder_that_is_a_file_is_refused(server: Server, world: Path, tmp_path: Path, capsys) -> None:
    (tmp_path / "file").write_text("")
    assert main(command(world, server.address("start"), f"output.staging={tmp_path / 'file'}")) == 2
    assert "is a file; the dataset needs a folder" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL")
def test_a_killed_run_of_two_workers_is_completed(server: Server, world: Path, local, tmp_path: Path) -> None:
    address, numbers, running = server.address("killed"), count(1), []

    def kill(method: str, path: str) -> Answer:
        assert server.false_markers("killed") == []
        if method == "PUT" and next(numbers) == 20:
            os.kill(running[0].pid, signal.SIGKILL)
        return None

    server.before = kill
    arguments = [*command(world, address, f"output.staging={tmp_path}"), "--workers", "2"]
    running.append(subprocess.Popen([sys.executable, "-m", "mmw.run", *arguments], stderr=subprocess.DEVNULL))
    assert running[0].wait() == -signal.SIGKILL
    there = tables_of(server.objects("killed"))
    assert {name: local[name] for name in there} == there and server.false_markers("killed") == []
    server.before = lambda method, path: None
    assert main(arguments[:-2]) == 0
    assert tables_of(server.objects("killed")) == tables_of(local) and verify(Bucket(address)) == []


@pytest.mark.slow
def test_a_stage_is_made_once_for_all_machines(server: Server, tmp_path: Path, monkeypatch) -> None:
    """Stage and copies of its assets are put, the file with its hash last; another machine downloads them."""
    config = load_config(configs_dir() / "quickstart.yaml", ["frames.count=2"])
    one, other, third = (Bucket(server.address("stage"), tmp_path / name) for name in ("one", "other", "third"))
    prepare_root(one, config.identity(), config.sha256(), {}, False)
    scenario = config.scenarios[0]
    made = cached_stage(config, scenario, configs_dir(), one)
    note = f"stages/{scenario.name}.json"
    there = server.objects("stage")
    assert {name: data for name, data in there.items() if "/" in name} == files_of(one.folder)
    assert puts(server.requests)[-1] == f"stage/{note}" and len(there) > 20
    monkeypatch.setattr(mmw.scene.prepare, "make_tracks", lambda *_: pytest.fail("made again"))
    server.requests.clear()
    for root in (one, other, other):  # as a second worker, and as another machine with two
        prepare_root(root, config.identity(), config.sha256(), {}, False)
        stage = cached_stage(config, scenario, configs_dir(), root)
        assert stage.read_bytes() == made.read_bytes() and files_of(root.folder) == files_of(one.folder)
    assert set(puts(server.requests)) == {"stage/dataset.json"}
    Bucket(server.address("stage")).remove([note])  # as if it were killed before the last object
    third.start_writing(there["dataset.json"])
    parts = (f"stages/{scenario.name}.usdc", "assets")
    third.download(parts, note)
    assert files_of(third.folder) == {}
    Bucket(server.address("stage"), tmp_path / "one").upload(parts, note)
    assert server.objects("stage") == there
