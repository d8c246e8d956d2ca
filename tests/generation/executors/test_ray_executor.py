"""Workers as actors of a Ray cluster, which a run starts on this machine: the same data, whoever dies."""

import os
import re
import signal
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

ray = pytest.importorskip("ray", reason="Ray is not installed: pip install 'multimodal-wireless[ray]'")

import mmw.generation.executors.ray_executor as engine  # noqa: E402
from mmw.cli.run import main  # noqa: E402
from mmw.config import load_config  # noqa: E402
from mmw.generation.executors.ray_cluster import ClusterResources, cluster, room_for  # noqa: E402
from mmw.generation.executors.work_queue import WorkerLostError  # noqa: E402
from mmw.generation.progress import Console  # noqa: E402
from mmw.generation.provenance import versions  # noqa: E402
from mmw.generation.shards import all_work  # noqa: E402
from mmw.generation.worker import GenerationContext  # noqa: E402
from mmw.storage.file_checks import verify  # noqa: E402
from mmw.storage.lock import temporaries  # noqa: E402
from mmw.storage.manifest import read_dataset  # noqa: E402
from mmw.storage.store import Folder  # noqa: E402
from tests.fixtures import dying_actors  # noqa: E402
from tests.fixtures.dying_workers import note_of  # noqa: E402
from tests.fixtures.own_world import SMALL, assert_same_rows, command, write_own_world  # noqa: E402
from tests.fixtures.s3_server import Server, s3  # noqa: E402

__all__ = ["s3"]


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small stage of one's own, ten frames, two a shard, in two weathers, and its dataset made in one process."""
    folder = write_own_world(tmp_path_factory.mktemp("ray"))
    assert main(command(folder, "alone", "--workers", "1")) == 0
    return folder


@pytest.fixture(scope="module")
def here(s3: Server) -> Iterator[str]:
    """A cluster of this machine alone, for all tests; its processes have the credentials of the bucket."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("RAY_ADDRESS", "local")
        with cluster() as description:
            yield description
    assert not ray.is_initialized()


def run(world: Path, out: str, *extra: str) -> int:
    return main(command(world, out, "--engine", "ray", *extra))


def actors() -> list[int]:
    """Return the processes of this cluster's actors: they are children of a child of this process."""
    parents, names = {}, {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
            names[int(path.parent.name)] = path.with_name("cmdline").read_bytes()
        except OSError:
            continue
        parents[int(path.parent.name)] = int(fields[1])
    return [
        process
        for process, name in names.items()
        if name.startswith(b"ray::Actor") and parents.get(parents[process]) == os.getpid()
    ]


@pytest.mark.slow
def test_parts_on_ray_make_the_same_dataset(world: Path, here: str, capsys: pytest.CaptureFixture) -> None:
    assert run(world, "parts", "--workers", "2", "--shard", "1/2") == 0
    assert not (world / "parts" / "_manifest.parquet").exists()
    assert run(world, "parts", "--workers", "1", "--shard", "0/2") == 0
    assert here in capsys.readouterr().err
    assert_same_rows(world / "alone", world / "parts")
    assert verify(world / "parts") == []
    alone, parts = (read_dataset(world / name) for name in ("alone", "parts"))
    assert alone["versions"] == parts["versions"] and alone["config_sha256"] == parts["config_sha256"]


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="finds processes in /proc")
def test_a_killed_actor_is_replaced(
    world: Path, here: str, capfd: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    advance, killed = Console.advance, []

    def advance_and_kill(console: Console, frames: int, where: str) -> None:
        advance(console, frames, where)
        if not killed:
            killed.append(actors()[0])
            os.kill(killed[0], signal.SIGKILL)

    monkeypatch.setattr(Console, "advance", advance_and_kill)
    assert run(world, "killed", "--workers", "1", "compute.batch_frames=1") == 0
    assert killed and killed[0] not in actors()
    out, err = capfd.readouterr()
    assert err.count("a worker on cpu died on Ray node") == 1 and "its worker process has died" in err
    assert out.startswith("20 frames in") and "raylet" not in out + err
    assert_same_rows(world / "alone", world / "killed")
    assert verify(world / "killed") == []


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="finds the names of open files in /proc")
def test_an_actor_killed_while_it_writes_leaves_nothing(
    world: Path, here: str, capfd: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine, "Actor", dying_actors.Actor)
    assert run(world, "writing", "--workers", "1") == 0
    assert capfd.readouterr().err.count("a worker on cpu died on Ray node") == 1
    assert note_of(world / "writing", 0).read_text().startswith(".part-")
    assert temporaries(world / "writing") == [] and verify(world / "writing") == []
    assert_same_rows(world / "alone", world / "writing")


@pytest.mark.slow
def test_the_error_of_a_worker_is_one_line(world: Path, here: str, capfd: pytest.CaptureFixture) -> None:
    assert run(world, "long", "--workers", "1", "frames.count=20") == 2
    lines = [line for line in capfd.readouterr().err.splitlines() if line.startswith("mmw: ")]
    assert len(lines) == 1 and "mine.usda" in lines[0] and "19" in lines[0]


@pytest.mark.slow
def test_a_finished_dataset_needs_no_worker(world: Path, here: str, capsys: pytest.CaptureFixture) -> None:
    assert run(world, "alone") == 0
    assert "20 of 20 frames are there already; nothing to make" in capsys.readouterr().err


@pytest.mark.slow
def test_a_node_without_mmw(
    world: Path, here: str, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = ModuleType("only_here")
    module.Actor = type("Actor", (engine.Actor,), {"__module__": "only_here"})
    monkeypatch.setitem(sys.modules, "only_here", module)  # the actor's process has no such module
    monkeypatch.setattr(engine, "Actor", module.Actor)
    assert run(world, "none") == 2
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == here and len(lines) == 2
    assert re.match(r"mmw: Ray node [\d.]+: ModuleNotFoundError: .*'only_here'; all nodes need the same mmw", lines[1])
    assert not (world / "none").exists()


@pytest.fixture
def making(world: Path) -> GenerationContext:
    return GenerationContext(load_config(world / "mine.yaml", SMALL), world, Folder(world / "alone"), {}, threads=1)


def test_a_node_that_differs_is_refused(making: GenerationContext, tmp_path: Path) -> None:
    actor, own = engine.Actor(), versions(making.config, making.base, "CPU")
    with engine._sign(making.root) as sign:
        task = engine.Task(making, ClusterResources("cpu", 1), sign, own)
        actor._check(task)
        assert actor._said.empty()
        with pytest.raises(ValueError, match=r"Ray node .* has mmw .*, the run 9\.9; install the same"):
            actor._check(replace(task, versions={**own, "mmw": "9.9"}))
        with pytest.raises(ValueError, match=r"mine\.usda.*no such file .*; all nodes need the files"):
            actor._check(replace(task, making=replace(making, base=tmp_path)))
        with pytest.raises(ValueError, match=r"scenario 'mine': mine\.usda: other content than where the run is"):
            actor._check(replace(task, versions={**own, "sources": {"mine": {"mine.usda": "0"}}}))
        actor._check(replace(task, versions={**own, "packages": {**own["packages"], "numpy": "0.1"}}))
        kind, line = actor._said.get_nowait()
        assert kind == "note" and "has numpy" in line and "the run '0.1'" in line
    with pytest.raises(ValueError, match=r"alone: Ray node .* does not see what this run wrote there; give an --out"):
        actor._check(task)


@pytest.mark.slow
def test_a_bucket_is_filled_by_actors(world: Path, here: str, s3: Server) -> None:
    staging = world / "staging"
    arguments = ["--config", str(world / "mine.yaml"), *SMALL, "--device", "cpu", "--engine", "ray", "--workers", "2"]
    assert main([*arguments, "--out", s3.address("ray"), f"output.staging={staging}"]) == 0
    there = s3.objects("ray")
    tables = {name: data for name, data in there.items() if "/part-" in name}
    alone = world / "alone"
    assert tables == {p.relative_to(alone).as_posix(): p.read_bytes() for p in alone.rglob("part-*.parquet")}
    assert "_manifest.parquet" in there and not [name for name in there if name.startswith("_locks/")]


def test_what_other_machines_wrote_may_be_seen_late(
    making: GenerationContext, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    work = all_work(making.config)
    looks = [work, work[1:], []]
    monkeypatch.setattr(engine, "pending_work", lambda *_: looks.pop(0))
    monkeypatch.setattr(engine.time, "sleep", lambda _: None)
    engine._wait_until_seen(making.root, work, Console())
    assert looks == []
    assert capsys.readouterr().err.count("waiting until the file system shows") == 1
    monkeypatch.setattr(engine, "pending_work", lambda *_: work)
    monkeypatch.setattr(engine, "SEEN_S", -1.0)
    with pytest.raises(WorkerLostError, match="mine, frames 0 to 1 cannot be seen here"):
        engine._wait_until_seen(making.root, work, Console())


def test_what_a_cluster_has_for_workers() -> None:
    gb = float(1 << 30)
    big = {"CPU": 64.0, "GPU": 4.0, "memory": 300 * gb, "object_store_memory": 100 * gb}
    small, head = {"CPU": 8.0, "GPU": 2.0, "memory": 30 * gb}, {"CPU": 4.0, "memory": 8 * gb}
    assert room_for([big], "cuda:0", 2) == ClusterResources("cuda:0", 2, 1)
    assert room_for([big, head], "auto", 8) == ClusterResources("cuda:0", 8, 2)
    assert room_for([big], "auto", "auto") == ClusterResources("cuda:0", 32, 8)
    assert room_for([big], "auto", "auto", 40 * gb) == ClusterResources("cuda:0", 20, 5)
    assert room_for([big, small, head], "auto", "auto") == ClusterResources("cuda:0", 12, 2)
    assert room_for([big, head], "cpu", "auto") == ClusterResources("cpu", 68, 1)
    assert room_for([head], "auto", "auto") == ClusterResources("cpu", 4, 1)
    assert room_for([head], "auto", 6) == ClusterResources("cpu", 6, 2)
    with pytest.raises(ValueError, match="'cuda:0': the Ray cluster has no GPU"):
        room_for([head], "cuda:0", 1)
    with pytest.raises(ValueError, match="'cpu': the Ray cluster has no CPU"):
        room_for([{"GPU": 1.0}], "cpu", 1)
    with pytest.raises(ValueError, match="'cuda:3': with the engine ray Ray chooses a worker's GPU"):
        room_for([big], "cuda:3", 1)


def test_what_a_worker_asks_for() -> None:
    assert ClusterResources("cuda:0", 4).asks == {"num_cpus": 0, "num_gpus": 1.0}
    assert ClusterResources("cuda:0", 12, 3).asks["num_gpus"] == 0.3333  # a step more, and the third has no place
    assert ClusterResources("cpu", 6, 2).asks == {"num_cpus": 0.5}
    assert ClusterResources("cuda:0", 24, 6).workers_on({"CPU": 32.0, "GPU": 2.0}) == 12
    assert ClusterResources("cuda:0", 3, 6).workers_on({"CPU": 32.0, "GPU": 2.0}) == 3
    assert ClusterResources("cpu", 6, 2).workers_on({"CPU": 2.0}) == 4


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("127.0.0.1:1", "Ray at 127.0.0.1:1 does not answer"),
        ("ray://head:10001", "is not host:port of a cluster's"),
    ],
)
def test_a_cluster_that_is_not_there(
    world: Path, address: str, message: str, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ray, "is_initialized", lambda: False)
    monkeypatch.setenv("RAY_ADDRESS", address)
    assert run(world, "none") == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and message in lines[0]
    assert not (world / "none").exists()
