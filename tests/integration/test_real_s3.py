"""Runs into a real S3 server in a process of its own: faults of the network, kills of the run and of the server."""

import os
import random
import signal
import subprocess
import sys
from collections.abc import Iterator
from itertools import count
from pathlib import Path

import pytest

from mmw.__main__ import main as mmw_main
from mmw.cli.run import main
from mmw.storage import s3_store
from mmw.storage.s3_store import MAX_SINGLE_PUT_BYTES, Bucket
from tests.fixtures import own_world
from tests.fixtures.faulty_proxy import Fault, Proxy
from tests.fixtures.rclone_server import RcloneServer, rclone_server

__all__ = ["rclone_server"]

FAULTS = {"busy": 0.2, "cut": 0.15, "lose": 0.15, "truncate": 0.3, "slow": 0.3}
"""Fault -> the share of requests that meet it."""

IS_LONG = "MMW_EACH_FAULT" in os.environ
"""Each fault alone, and kills with one worker as well as with two, take minutes of retries: by hand, with
MMW_EACH_FAULT=1."""
TESTED = [*FAULTS, "all"] if IS_LONG else ["all"]

FEW = "frames.count=2"
ROUNDS = 4
"""Kills of each dataset."""
MANY = "output.shard_frames=1"
"""Setting for kills: a dataset of twelve shards, of which a run finishes one to three before it is killed."""


def command(world: Path, out: str | Path, *extra: str) -> list[str]:
    return own_world.command(world, out, "frames.count=6", "--workers", "1", *extra)


def tables_of(files: dict[str, bytes]) -> dict[str, bytes]:
    return {name: data for name, data in files.items() if "/part-" in name}


def drawn(seed: int, shares: dict[str, float]):
    """Return a function that draws the fault of each request, the same for a seed."""
    draw = random.Random(seed)

    def decide(method: str, path: str) -> Fault:
        at = draw.random()
        for name, share in shares.items():
            if (at := at - share) < 0:
                return name
        return None

    return decide


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a small stage of one's own, and its dataset in a folder."""
    folder = own_world.write_own_world(tmp_path_factory.mktemp("s3"))
    assert main(command(folder, "local")) == 0
    return folder


@pytest.fixture(scope="module")
def few(world: Path) -> dict[str, bytes]:
    """Return the files of a dataset in a folder that has two frames."""
    return files_of_local(world, "few", FEW)


@pytest.fixture(scope="module")
def many(world: Path) -> dict[str, bytes]:
    """Return the files of a dataset in a folder whose shards have one frame each."""
    return files_of_local(world, "many", MANY)


def files_of_local(world: Path, name: str, change: str) -> dict[str, bytes]:
    """Make a dataset in a folder and return its files, without the locks."""
    assert main(command(world, name, change)) == 0
    root = world / name
    found = {path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("*") if path.is_file()}
    return {name: data for name, data in found.items() if not name.startswith("_locks/")}


@pytest.fixture
def proxy(rclone_server: RcloneServer) -> Iterator[Proxy]:
    proxy = Proxy(rclone_server.port)
    yield proxy
    proxy.stop()


@pytest.fixture(scope="module")
def local(world: Path) -> dict[str, bytes]:
    """Return the tables of the same dataset in a folder."""
    return own_world.table_files(world / "local")


def assert_sound(address: str, capsys: pytest.CaptureFixture, frames: int = 12) -> None:
    """Check what `mmw verify` and `mmw status` say of a finished dataset."""
    capsys.readouterr()
    assert mmw_main(["verify", address]) == 0
    assert mmw_main(["status", address]) == 0
    assert f"{frames}/{frames}" in capsys.readouterr().out


def test_a_run_needs_no_setting(rclone_server, world, local, capsys) -> None:
    address = rclone_server.address("plain")
    assert main(command(world, address)) == 0
    assert tables_of(rclone_server.files("plain")) == local
    assert_sound(address, capsys)


def test_uploads_that_the_server_does_not_take_are_explained(rclone_server, world, capsys, monkeypatch) -> None:
    monkeypatch.setenv("AWS_REQUEST_CHECKSUM_CALCULATION", "when_supported")
    assert main(command(world, rclone_server.address("chunked"))) == 2
    error = capsys.readouterr().err
    assert "the server does not take aws-chunked uploads" in error and error.count("\n") == 1
    assert "set AWS_REQUEST_CHECKSUM_CALCULATION=when_required" in error
    assert rclone_server.files("chunked") == {}


@pytest.mark.slow
@pytest.mark.parametrize("fault", TESTED)
def test_faults_of_the_network_change_nothing(rclone_server, proxy, world, few, capsys, fault: str) -> None:
    shares = {name: share / len(FAULTS) for name, share in FAULTS.items()} if fault == "all" else {fault: FAULTS[fault]}
    proxy.decide = drawn(7, shares)
    address = rclone_server.address(f"fault-{fault}", proxy.port)
    assert main(command(world, address, FEW)) == 0
    error = capsys.readouterr().err
    assert "Traceback" not in error and "internal error" not in error
    assert proxy.faults > 5
    files = rclone_server.files(f"fault-{fault}")
    assert files.keys() == few.keys() and tables_of(files) == tables_of(few)
    assert mmw_main(["verify", address]) == 0
    proxy.decide = lambda method, path: None
    assert_sound(address, capsys, frames=4)


@pytest.mark.slow
def test_a_server_that_dies_ends_a_run_that_goes_on(rclone_server, proxy, world, local, capsys, monkeypatch) -> None:
    monkeypatch.setattr(s3_store, "RETRY_DELAYS_S", ())  # the client's own retries take long enough
    numbers = count(1)

    def die(method: str, path: str) -> None:
        if method == "PUT" and next(numbers) == 20:
            rclone_server.kill()

    proxy.done = die
    address = rclone_server.address("dies", proxy.port)
    assert main(command(world, address)) == 1
    error = capsys.readouterr().err.strip().splitlines()
    assert error[-1].startswith("mmw: s3://bucket/dies") and "it cannot be reached" in error[-1]
    assert error[-1].endswith("every finished shard is kept and the same command resumes")
    assert len([line for line in error if line.startswith("mmw: ")]) == 1 and "Traceback" not in "".join(error)
    there = tables_of(rclone_server.files("dies"))
    rclone_server.start()
    assert len(there) > 5 and {name: local[name] for name in there} == there
    assert main(command(world, address)) == 0
    assert tables_of(rclone_server.files("dies")) == local
    assert_sound(address, capsys)


def is_shard_marker(name: str) -> bool:
    """Return whether an object is the marker of a shard; that of static tables has no weather and no frame."""
    return "_shards/mine." in name and name.count(".") > 2


class Killer:
    """Kills a run some requests after it finished a shard."""

    def __init__(self, after: int) -> None:
        self.run: subprocess.Popen | None = None
        self.left = after
        self.has_finished = False

    def done(self, method: str, path: str) -> None:
        self.has_finished |= method == "PUT" and is_shard_marker(path.partition("?")[0])

    def decide(self, method: str, path: str) -> Fault:
        if not self.has_finished:
            return None
        self.left -= 1
        if self.left >= 0 or self.run is None:
            return None
        os.kill(self.run.pid, signal.SIGKILL)
        return "cut"


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL")
@pytest.mark.parametrize("workers", ["1", "2"] if IS_LONG else ["2"])
def test_a_run_that_is_killed_again_and_again_is_completed(
    rclone_server, proxy, world, many, tmp_path, capsys, workers: str
) -> None:
    """Each run is killed some requests after it finished one more shard, so that the next one finds finished shards."""
    key, draw = f"killed-{workers}", random.Random(int(workers))
    address = rclone_server.address(key, proxy.port)
    arguments = [*command(world, address, MANY, f"output.staging={tmp_path}"), "--workers", workers]
    for number in range(1, ROUNDS + 1):
        killer = Killer(draw.randrange(8))
        proxy.decide, proxy.done = killer.decide, killer.done
        run = subprocess.Popen([sys.executable, "-m", "mmw.run", *arguments], stderr=subprocess.PIPE, text=True)
        killer.run = run
        _, error = run.communicate(timeout=300)
        assert run.returncode == -signal.SIGKILL, error
        assert "Traceback" not in error
        files = rclone_server.files(key)
        finished = [name for name in files if is_shard_marker(name)]
        assert len(finished) >= number  # what the next run finds
        listed = {name: data for name, data in tables_of(files).items() if is_listed(files, name)}
        assert [name for name, data in listed.items() if many[name] != data] == []
    proxy.decide, proxy.done = lambda method, path: None, lambda method, path: None
    assert main(arguments[:-2]) == 0
    files = rclone_server.files(key)
    assert files.keys() == many.keys() and tables_of(files) == tables_of(many)
    assert_sound(address, capsys)


def is_listed(files: dict[str, bytes], name: str) -> bool:
    """Return whether a marker says that a file is complete."""
    return any(name.encode() in data for path, data in files.items() if path.startswith("_shards/"))


@pytest.mark.parametrize("step", ["begin", "part", "complete"])
@pytest.mark.parametrize("fault", ["busy", "cut", "lose"])
def test_a_large_object_survives_a_fault(rclone_server, proxy, tmp_path: Path, step: str, fault: str) -> None:
    """Each step of an upload in parts fails once."""
    data, faults = random.Random(1).randbytes(1000) * 11_000, iter([fault])
    assert len(data) > 2 * MAX_SINGLE_PUT_BYTES

    def decide(method: str, path: str) -> Fault:
        is_at = {
            "begin": method == "POST" and "uploads" in path.partition("?")[2],
            "part": "partNumber=2" in path,
            "complete": method == "POST" and "uploadId=" in path,
        }  # fmt: skip
        return next(faults, None) if is_at[step] else None

    proxy.decide = decide
    key = f"large-{step}-{fault}"
    Bucket(rclone_server.address(key, proxy.port), tmp_path).write_atomically("big.usdc", data)
    assert proxy.faults == 1 and rclone_server.files(key) == {"big.usdc": data}
    assert Bucket(rclone_server.address(key, proxy.port), tmp_path).read("big.usdc") == data
