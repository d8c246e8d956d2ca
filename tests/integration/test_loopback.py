"""No command listens where other machines can reach it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fixtures.kill_rounds import CHEAP
from tests.fixtures.listeners import is_loopback, listeners, watch
from tests.fixtures.own_world import command

LIMIT_S = 240.0
"""Longest time that a command may take on a busy machine [s]."""


def start(*arguments: str, **environment: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-m", "mmw", *arguments], text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        env={**os.environ, **environment},
    )  # fmt: skip


def test_the_addresses_that_other_machines_cannot_reach() -> None:
    assert all(map(is_loopback, ("127.0.0.1", "127.8.0.2", "::1", "::ffff:127.0.0.1")))
    assert not any(map(is_loopback, ("0.0.0.0", "::", "192.0.2.2", "::ffff:10.0.0.1")))


@pytest.mark.slow
def test_a_socket_that_listens_is_seen() -> None:
    code = "import socket; s = socket.create_server(('', 0)); print(flush=True); input()"
    process = subprocess.Popen([sys.executable, "-c", code], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdout
    process.stdout.readline()
    assert [address for _, address in listeners(process.pid)] == ["0.0.0.0"]
    process.communicate("\n")


@pytest.mark.slow
def test_a_run_with_workers_does_not_listen(own_world: Path) -> None:
    process = start("run", *command(own_world, "out", *CHEAP, "--workers", "2"))
    found = watch(process, LIMIT_S)
    assert process.wait() == 0, process.communicate()
    assert found == set()


@pytest.mark.slow
def test_ray_that_a_run_starts_listens_on_this_machine_only(own_world: Path) -> None:
    pytest.importorskip("ray", reason="Ray is not installed: pip install 'multimodal-wireless[ray]'")
    process = start(
        "run", *command(own_world, "out", *CHEAP, "--engine", "ray", "--workers", "2"), RAY_ADDRESS="local"
    )  # fmt: skip
    found = watch(process, LIMIT_S)
    assert process.wait() == 0, process.communicate()
    assert {name for name, _ in found} >= {"gcs_server", "raylet"}  # else nothing was looked at
    assert [where for where in sorted(found) if not is_loopback(where[1])] == []
