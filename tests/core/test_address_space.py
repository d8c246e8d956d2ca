"""Limits of address space (ulimit -v) in which libraries would crash: one line before they are loaded."""

import subprocess
import sys

import pytest

from mmw.__main__ import HELP
from mmw.core.address_space import MIN_BYTES, MIN_TRACING_BYTES, TRACING, address_space_problem

resource = pytest.importorskip("resource", reason="Windows has no such limits")


@pytest.mark.parametrize(
    ("arguments", "limit"),
    [
        (["mmw", "status", "none"], 300_000_000),
        (["mmw", "verify", "none"], 700_000_000),
        (["mmw", "run", "--config", "quickstart"], 2_500_000_000),
        (["mmw.run", "--config", "quickstart"], 700_000_000),
        (["mmw.run", "--config", "quickstart"], 2_500_000_000),
    ],
)
@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not enforce the limit")
def test_too_little_is_one_line(arguments: list[str], limit: int) -> None:
    done = subprocess.run(
        [sys.executable, "-m", *arguments], capture_output=True, text=True, timeout=60,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)),
    )  # fmt: skip
    assert done.returncode == 1 and done.stdout == "" and done.stderr.count("\n") == 1
    assert done.stderr.startswith(f"mmw: the address space is limited to {limit / 1e9:.2f} GB (ulimit -v); mmw ")
    assert "ulimit -v unlimited" in done.stderr


@pytest.mark.parametrize("command", HELP)
def test_each_command_has_a_minimum(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    needed = MIN_TRACING_BYTES if command in TRACING else MIN_BYTES
    for limit, has_problem in ((needed - 1, True), (needed, False), (resource.RLIM_INFINITY, False)):
        monkeypatch.setattr(resource, "getrlimit", lambda _, limit=limit: (limit, limit))
        assert (address_space_problem(command) is not None) == has_problem
    assert set(TRACING) <= set(HELP)
