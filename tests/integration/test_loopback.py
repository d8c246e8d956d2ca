"""No run listens where other machines can reach it; of the web viewer see `tests/cli/test_view.py`."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fixtures.kill_rounds import CHEAP
from tests.fixtures.listeners import Listener, is_loopback, listeners, watch
from tests.fixtures.own_world import command

LIMIT_S = 240.0
"""Longest time that a command may take on a busy machine [s]."""


def assert_runs(log: Path, *arguments: str, **environment: str) -> set[Listener]:
    """Run a command, whose output goes to a file, and return its listeners."""
    command = [sys.executable, "-m", "mmw", *arguments]
    with log.open("w") as file:
        process = subprocess.Popen(command, stdout=file, stderr=file, env={**os.environ, **environment})
        found = watch(process, LIMIT_S)
    assert process.wait() == 0, log.read_text()
    return found


def test_the_addresses_that_other_machines_cannot_reach() -> None:
    assert all(map(is_loopback, ("127.0.0.1", "127.8.0.2", "::1", "::ffff:127.0.0.1")))
    assert not any(map(is_loopback, ("0.0.0.0", "::", "192.0.2.2", "::ffff:10.0.0.1")))


@pytest.mark.slow
def test_a_socket_that_listens_is_seen() -> None:
    code = "import socket; s = socket.create_server(('', 0)); print(flush=True); input()"
    process = subprocess.Popen([sys.executable, "-c", code], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdout
    process.stdout.readline()
    assert [one.address for one in listeners(process.pid)] == ["0.0.0.0"]
    process.communicate("\n")


@pytest.mark.slow
def test_a_run_with_workers_does_not_listen(own_world: Path, tmp_path: Path) -> None:
    assert assert_runs(tmp_path / "log", "run", *command(own_world, "out", *CHEAP, "--workers", "2")) == set()


@pytest.mark.slow
def test_ray_that_a_run_starts_listens_on_this_machine_only(own_world: Path, tmp_path: Path) -> None:
    pytest.importorskip("ray", reason="Ray is not installed: pip install 'multimodal-wireless[ray]'")
    arguments = command(own_world, "out", *CHEAP, "--engine", "ray", "--workers", "2")
    found = assert_runs(tmp_path / "log", "run", *arguments, RAY_ADDRESS="local")
    assert {one.process for one in found} >= {"gcs_server", "raylet"}  # else nothing was looked at
    assert [one for one in found if not is_loopback(one.address)] == []
