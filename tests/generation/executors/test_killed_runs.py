"""Processes of every kind killed at random moments: the resumed dataset is the undisturbed one, with no file more."""

import os
from collections.abc import Iterator

import pytest

from mmw.generation.executors.process_pool import CAN_FORK
from tests.fixtures.kill_rounds import Rounds

KILL_ROUNDS = int(os.environ.get("MMW_KILL_ROUNDS", "1"))
"""Rounds of each kind. By hand: MMW_KILL_ROUNDS=20 pytest -s tests/generation/executors/test_killed_runs.py"""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not CAN_FORK, reason="workers are forked on Linux only"),
]


@pytest.fixture(scope="module")
def rounds(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rounds]:
    made = Rounds(tmp_path_factory.mktemp("kills"))
    yield made
    made.close()


@pytest.mark.parametrize("kind", ["driver", "worker", "shard", "finalize", "ray"])
def test_killed_processes_leave_nothing_wrong(rounds: Rounds, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if kind == "ray":
        pytest.importorskip("ray", reason="Ray is not installed: pip install 'multimodal-wireless[ray]'")
        monkeypatch.setenv("RAY_ADDRESS", rounds.nodes.address)
    played = []
    for seed in range(KILL_ROUNDS):
        played.append(rounds.play(kind, seed))
        resumed = [count for one in played for count in one.resumed]
        print(
            f"{kind}: {len(played)} rounds, {sum(one.kills for one in played)} kills, {len(resumed)} resumed runs, "
            f"{sum(count > 0 for count in resumed)} of them found finished shards",
            flush=True,
        )
    assert all(one.kills for one in played)
