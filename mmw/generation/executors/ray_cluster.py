"""The Ray cluster of a run: how it is found, what it has for workers, and how it stays quiet."""

import logging
import math
import os
import signal
import socket
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import ray
from ray.exceptions import RayError

from mmw.core.device import workers_that_fit
from mmw.core.errors import InputError

STORE_BYTES = 100 * 2**20
"""Ray's object store where this run starts Ray itself; only messages go through it. Ray wants 75 MiB at least."""
ANSWER_S = 10.0
"""Time that a cluster has to answer [s]. Design value."""


@dataclass(frozen=True)
class ClusterResources:
    """Resources of a cluster for workers."""

    device: str
    """Warp device, by the name that it has in a worker."""
    workers: int
    sharing: int = 1
    """Workers that share a GPU or a CPU."""

    @property
    def kind(self) -> str:
        """Resource of a worker, as Ray names it."""
        return "CPU" if self.device == "cpu" else "GPU"

    @property
    def asks(self) -> dict[str, float]:
        """Resources that a worker requests from Ray."""
        share = math.floor(1e4 / self.sharing) / 1e4  # Ray counts in steps of 1e-4
        return {"num_cpus": share} if self.kind == "CPU" else {"num_cpus": 0, "num_gpus": share}

    def workers_on(self, node: Mapping[str, float]) -> int:
        """Return how many of the workers a machine with some resources may have, at least one."""
        return max(min(self.workers, int(node.get(self.kind, 0)) * self.sharing), 1)


def room_for(
    nodes: Sequence[Mapping[str, float]], device: str, workers: int | str, gpu_bytes: float = math.inf
) -> ClusterResources:
    """Return which workers a cluster gets.

    Args:
        nodes: Resources of each machine, as `ray.nodes` names them.
        device: Configured device: `auto` (GPUs, else CPUs), `cpu`, or `cuda:0` for a GPU that Ray chooses.
        workers: How many, or `auto`: one a CPU, or on each GPU as many as fit on the machine that has least for each.
            If there are more than GPUs or CPUs, some share one.
        gpu_bytes: Memory of a GPU [bytes], as far as it is known.

    Raises:
        InputError: If the cluster has no such device, or a certain one is named.
    """
    if device not in ("auto", "cpu", "cuda", "cuda:0"):
        raise InputError(
            f"compute.device = {device!r}: with the engine ray Ray chooses a worker's GPU; use auto, cuda:0 or cpu"
        )
    gpu_nodes = [node for node in nodes if node.get("GPU", 0) >= 1]
    on_cpus = device == "cpu" or (device == "auto" and not gpu_nodes)
    kind = "CPU" if on_cpus else "GPU"
    there = sum(int(node.get(kind, 0)) for node in nodes)
    if not there:
        raise InputError(f"compute.device = {device!r}: the Ray cluster has no {kind}; start nodes that have one")
    name = "cpu" if on_cpus else "cuda:0"
    if workers != "auto":
        return ClusterResources(name, int(workers), math.ceil(int(workers) / there))
    sharing = 1 if on_cpus else min(_workers_a_gpu(node, gpu_bytes) for node in gpu_nodes)
    return ClusterResources(name, there * sharing, sharing)


def _workers_a_gpu(node: Mapping[str, float], gpu_bytes: float) -> int:
    """Return how many workers each GPU of a machine with some resources can have."""
    memory = node.get("memory", math.inf) + node.get("object_store_memory", 0)  # Ray divides it in these two
    return workers_that_fit(int(node["GPU"]), node.get("CPU", 0), memory, gpu_bytes)


@contextmanager
def cluster() -> Iterator[str]:
    """Connect to the cluster of RAY_ADDRESS, else to the latest that was started on this machine, else start one here.

    A connection that is there stays as it is.

    Yields:
        What the cluster is, for people.

    Raises:
        InputError: If it cannot be reached.
    """
    is_own = not ray.is_initialized()
    if is_own:
        _connect(_address())
    try:
        with _quiet():
            nodes = machines()
            counts = ", ".join(f"{sum(int(node.get(kind, 0)) for node in nodes)} {kind}s" for kind in ("CPU", "GPU"))
            where = f"{len(nodes)} machine{'s' * (len(nodes) != 1)}"
            yield f"Ray at {ray.get_runtime_context().gcs_address}: {counts} on {where}"
    finally:
        if is_own:
            ray.shutdown(wait_for_processes=True)


def machines() -> list[dict[str, float]]:
    """Return the resources of each machine of the cluster."""
    return [node["Resources"] for node in ray.nodes() if node["Alive"]]


def _connect(address: str | None) -> None:
    options: dict[str, Any] = {}  # Ray finds the same address, and the token that may belong to it
    if address is None:
        options = {"address": "local", "include_dashboard": False, "object_store_memory": STORE_BYTES}
    else:
        _knock(address)
    terminated = signal.getsignal(signal.SIGTERM)
    try:
        ray.init(**options, log_to_driver=False, logging_level=logging.ERROR)
    except (ConnectionError, RuntimeError, RayError) as error:
        raise InputError(
            f"Ray at {address or 'this machine'}: {' '.join(str(error).split())}; Ray and Python must have the same "
            "versions there, and if it wants a token, the same ~/.ray/auth_token and RAY_AUTH_MODE=token"
        ) from error
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, terminated)  # Ray's own aborts the process; Ray ends with it anyway


def _address() -> str | None:
    """Return the address of the cluster there is, by Ray's own rules (`ray.init`); None if there is none."""
    named = os.environ.get("RAY_ADDRESS") or "auto"
    if named != "auto":
        return None if named == "local" else named
    folder = os.environ.get("RAY_TMPDIR") or tempfile.gettempdir()
    with suppress(OSError):
        return (Path(folder) / "ray" / "ray_current_cluster").read_text().strip() or None
    return None


def _knock(address: str) -> None:
    """See whether a cluster answers, for which Ray itself would wait many minutes.

    Raises:
        InputError: If it does not.
    """
    host, _, port = address.rpartition(":")
    if "://" in address or not host or not port.isdecimal():
        raise InputError(
            f"RAY_ADDRESS = {address!r}: is not host:port of a cluster's head, such as 10.0.0.1:6379; give that, or "
            "local for this machine alone"
        )
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=ANSWER_S).close()
    except OSError as error:
        raise InputError(
            f"Ray at {address} does not answer ({error.strerror or error}); start it (ray start), tidy up after one "
            "that crashed (ray stop), or set RAY_ADDRESS: host:port of another one, or local for this machine alone"
        ) from error


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Ray's lines about workers that died off standard output, where the summary goes; the console has its own."""
    worker = ray._private.worker  # no option does this
    before = worker._worker_logs_enabled
    worker._worker_logs_enabled = False
    try:
        yield
    finally:
        worker._worker_logs_enabled = before
