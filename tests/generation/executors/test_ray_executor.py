"""Workers as actors of a Ray cluster on this machine: the same data, whichever of them dies."""

import re
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

ray = pytest.importorskip("ray", reason="Ray is not installed: pip install 'multimodal-wireless[ray]'")

import mmw.generation.executors.ray_cluster as ray_cluster  # noqa: E402
import mmw.generation.executors.ray_executor as ray_executor  # noqa: E402
from mmw.cli.run import main  # noqa: E402
from mmw.config import load_config  # noqa: E402
from mmw.generation.executors.ray_cluster import ClusterResources, connect_cluster, plan_workers  # noqa: E402
from mmw.generation.executors.work_queue import WorkerLostError  # noqa: E402
from mmw.generation.progress import Console  # noqa: E402
from mmw.generation.provenance import versions  # noqa: E402
from mmw.generation.shards import all_work  # noqa: E402
from mmw.generation.software import software_of  # noqa: E402
from mmw.generation.worker import GenerationContext  # noqa: E402
from mmw.scene.input_files import hash_inputs  # noqa: E402
from mmw.storage.file_checks import verify  # noqa: E402
from mmw.storage.lock import temporaries  # noqa: E402
from mmw.storage.manifest import read_dataset  # noqa: E402
from mmw.storage.store import Store  # noqa: E402
from tests.fixtures import dying_actors  # noqa: E402
from tests.fixtures.dying_workers import note_of  # noqa: E402
from tests.fixtures.own_world import SMALL, assert_same_files, command  # noqa: E402
from tests.fixtures.s3_server import Server, s3  # noqa: E402

__all__ = ["s3"]


@pytest.fixture(scope="module")
def here(s3: Server) -> Iterator[str]:
    """Start a cluster on this machine for all tests; its processes have the credentials of the bucket."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("RAY_ADDRESS", "local")
        with connect_cluster(print) as description:
            yield description
    assert not ray.is_initialized()


def run(world: Path, out: str, *extra: str) -> int:
    return main(command(world, out, "--engine", "ray", *extra))


@pytest.mark.slow
def test_parts_on_ray_generate_the_same_dataset(world: Path, here: str, capsys: pytest.CaptureFixture) -> None:
    assert run(world, "parts", "--workers", "2", "--shard", "1/2") == 0
    assert not (world / "parts" / "_manifest.parquet").exists()
    assert run(world, "parts", "--workers", "1", "--shard", "0/2") == 0
    assert here in capsys.readouterr().err
    assert_same_files(world / "single", world / "parts")
    assert verify(world / "parts") == []
    single, parts = (read_dataset(world / name) for name in ("single", "parts"))
    assert single["versions"] == parts["versions"] and single["config_sha256"] == parts["config_sha256"]


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="finds the names of open files in /proc")
def test_an_actor_killed_while_it_writes_is_replaced_and_leaves_nothing(
    world: Path, here: str, capfd: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ray_executor, "Actor", dying_actors.Actor)
    assert run(world, "writing", "--workers", "1") == 0
    out, err = capfd.readouterr()
    assert err.count("a worker on cpu died on Ray node") == 1 and "its worker process has died" in err
    assert out.startswith("20 frames in") and "raylet" not in out + err
    assert note_of(world / "writing", 0).read_text().startswith(".part-")
    assert temporaries(world / "writing") == [] and verify(world / "writing") == []
    assert_same_files(world / "single", world / "writing")


@pytest.mark.slow
def test_the_error_of_a_worker_is_one_line(world: Path, here: str, capfd: pytest.CaptureFixture) -> None:
    assert run(world, "long", "--workers", "1", "frames.count=20") == 2
    lines = [line for line in capfd.readouterr().err.splitlines() if line.startswith("mmw: ")]
    assert len(lines) == 1 and "mine.usda" in lines[0] and "19" in lines[0]


@pytest.mark.slow
def test_a_finished_dataset_needs_no_worker(world: Path, here: str, capsys: pytest.CaptureFixture) -> None:
    assert run(world, "single") == 0
    assert "20 of 20 frames are there already; nothing to make" in capsys.readouterr().err


@pytest.mark.slow
def test_a_node_without_mmw(
    world: Path, here: str, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = ModuleType("only_here")
    module.Actor = type("Actor", (ray_executor.Actor,), {"__module__": "only_here"})
    monkeypatch.setitem(sys.modules, "only_here", module)  # the actor's process has no such module
    monkeypatch.setattr(ray_executor, "Actor", module.Actor)
    assert run(world, "none") == 2
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == here and len(lines) == 2
    assert re.match(r"mmw: Ray node [\d.]+: ModuleNotFoundError: .*'only_here'; all nodes need the same mmw", lines[1])
    assert not (world / "none").exists()


@pytest.fixture
def context(world: Path) -> GenerationContext:
    config = load_config(world / "mine.yaml", SMALL)
    return GenerationContext(config, world, Store(world / "single"), {}, threads=1, inputs=hash_inputs(config, world))


def test_a_node_that_differs_is_refused(context: GenerationContext, tmp_path: Path) -> None:
    actor, own = ray_executor.Actor(), versions(context.config, context.base, "CPU")
    with ray_executor._probe_file(context.root) as probe:
        task = ray_executor.ActorTask(context, ClusterResources("cpu", 1), probe, own)
        actor._check(task)
        assert actor._messages.empty()
        with pytest.raises(ValueError, match=r"Ray node .* has mmw .*, the run 9\.9; install the same"):
            actor._check(replace(task, versions={**own, "mmw": "9.9"}))
        with pytest.raises(ValueError, match=r"mine\.usda.*no such file .*; all nodes need the files"):
            actor._check(replace(task, context=replace(context, base=tmp_path)))
        other = replace(context, inputs={"mine": {"mine.usda": "0"}})
        with pytest.raises(ValueError, match=r"mine: mine\.usda has changed: other content than where the run is"):
            actor._check(replace(task, context=other))
        old = software_of({**own, "packages": {**own["packages"], "numpy": "0.1"}})
        task = replace(task, versions={**own, "software": old})
        with pytest.raises(ValueError, match=r"other versions than the run: numpy 0\.1 -> .*; install the same"):
            actor._check(task)
        actor._check(replace(task, context=replace(context, meta={"accepted": "machine versions"})))
        kind, line = actor._messages.get_nowait()
        assert kind == "note" and "other versions than the run: numpy 0.1 -> " in line
    with pytest.raises(ValueError, match=r"single: Ray node .* does not see what this run wrote there; give an --out"):
        actor._check(task)


@pytest.mark.slow
def test_a_bucket_is_filled_by_actors(world: Path, here: str, s3: Server) -> None:
    staging = world / "staging"
    arguments = ["--config", str(world / "mine.yaml"), *SMALL, "--device", "cpu", "--engine", "ray", "--workers", "2"]
    assert main([*arguments, "--out", s3.address("ray"), f"output.staging={staging}"]) == 0
    there = s3.objects("ray")
    tables = {name: data for name, data in there.items() if "/part-" in name}
    single = world / "single"
    assert tables == {p.relative_to(single).as_posix(): p.read_bytes() for p in single.rglob("part-*.parquet")}
    assert "_manifest.parquet" in there and not [name for name in there if name.startswith("_locks/")]


def test_files_of_other_machines_may_become_visible_late(
    context: GenerationContext, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    work = all_work(context.config)
    looks = [work, work[1:], []]
    monkeypatch.setattr(ray_executor, "pending_work", lambda *_: looks.pop(0))
    monkeypatch.setattr(ray_executor.time, "sleep", lambda _: None)
    ray_executor._wait_until_visible(context.root, work, Console())
    assert looks == []
    assert capsys.readouterr().err.count("waiting until the file system shows") == 1
    monkeypatch.setattr(ray_executor, "pending_work", lambda *_: work)
    monkeypatch.setattr(ray_executor, "VISIBLE_TIMEOUT_S", -1.0)
    with pytest.raises(WorkerLostError, match="mine, frames 0 to 1 cannot be seen here"):
        ray_executor._wait_until_visible(context.root, work, Console())


def test_the_workers_that_a_cluster_gets() -> None:
    gb = float(1 << 30)
    big = {"CPU": 64.0, "GPU": 4.0, "memory": 300 * gb, "object_store_memory": 100 * gb}
    small, head = {"CPU": 8.0, "GPU": 2.0, "memory": 30 * gb}, {"CPU": 4.0, "memory": 8 * gb}
    assert plan_workers([big], "cuda:0", 2) == ClusterResources("cuda:0", 2, 1)
    assert plan_workers([big, head], "auto", 8) == ClusterResources("cuda:0", 8, 2)
    assert plan_workers([big], "auto", "auto") == ClusterResources("cuda:0", 32, 8)
    assert plan_workers([big], "auto", "auto", 40 * gb) == ClusterResources("cuda:0", 20, 5)
    assert plan_workers([big, small, head], "auto", "auto") == ClusterResources("cuda:0", 12, 2)
    assert plan_workers([big, head], "cpu", "auto") == ClusterResources("cpu", 68, 1)
    assert plan_workers([head], "auto", "auto") == ClusterResources("cpu", 4, 1)
    assert plan_workers([head], "auto", 6) == ClusterResources("cpu", 6, 2)
    with pytest.raises(ValueError, match="'cuda:0': the Ray cluster has no GPU"):
        plan_workers([head], "cuda:0", 1)
    with pytest.raises(ValueError, match="'cpu': the Ray cluster has no CPU"):
        plan_workers([{"GPU": 1.0}], "cpu", 1)
    with pytest.raises(ValueError, match="'cuda:3': with the engine ray Ray chooses a worker's GPU"):
        plan_workers([big], "cuda:3", 1)


def test_the_resources_that_an_actor_requests() -> None:
    assert ClusterResources("cuda:0", 4).actor_options == {"num_cpus": 0, "num_gpus": 1.0}
    assert ClusterResources("cuda:0", 12, 3).actor_options["num_gpus"] == 0.3333  # 0.3334 would not fit three times
    assert ClusterResources("cpu", 6, 2).actor_options == {"num_cpus": 0.5}
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


@contextmanager
def answering(answer: bytes, host: str = "127.0.0.1") -> Iterator[str]:
    """Listen on a free port; answer every connection with some bytes, none keeps it open and silent."""
    with socket.create_server((host, 0)) as server:
        kept: list[socket.socket] = []

        def accept() -> None:
            while True:
                try:
                    kept.append(server.accept()[0])
                except OSError:
                    return
                if answer:
                    with kept.pop() as connection:
                        connection.recv(len(ray_cluster.GREETING), socket.MSG_WAITALL)
                        connection.sendall(answer)

        threading.Thread(target=accept, daemon=True).start()
        yield f"127.0.0.1:{server.getsockname()[1]}"
        server.shutdown(socket.SHUT_RDWR)
        for connection in kept:
            connection.close()


@pytest.mark.parametrize(
    ("answer", "reason"), [(b"", "timed out"), (b"HTTP/1.0 400 Bad Request\r\n\r\n", "what listens there is not Ray")]
)
def test_what_listens_but_is_not_ray_is_said_early(
    world: Path, answer: bytes, reason: str, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ray itself tries again and again, without a line."""
    monkeypatch.setattr(ray, "is_initialized", lambda: False)
    monkeypatch.setattr(ray_cluster, "CONNECT_TIMEOUT_S", 0.3)
    with answering(answer) as address:
        monkeypatch.setenv("RAY_ADDRESS", address)
        assert run(world, "none") == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and f"Ray at {address} does not answer ({reason}); start it" in lines[0]


@pytest.mark.parametrize(("host", "is_private"), [("127.0.0.1", True), ("0.0.0.0", False)])
def test_a_head_that_listens_on_this_machine_only(host: str, is_private: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ray would look for it at the machine's address in the network, here one that is loopback too."""
    monkeypatch.setattr(ray.util, "get_node_ip_address", lambda: "127.0.0.2")
    with answering(bytes((0, 0, 0, ray_cluster.SETTINGS, 0, 0, 0, 0, 0)), host) as address:
        assert ray_cluster._check_address(address) is is_private


def test_a_slow_connection_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    said, told = list[str](), threading.Event()

    def say(line: str) -> None:
        said.append(line)
        told.set()

    monkeypatch.setattr(ray_cluster, "CONNECT_TIMEOUT_S", 0.01)
    monkeypatch.setattr(ray, "init", lambda **_: told.wait(30.0))
    ray_cluster._connect(None, say)
    assert said == ["Ray at this machine: no connection after 0 s; still trying"]
