"""Find the Ray cluster of a run, connect to it, and plan its workers."""

import logging
import math
import os
import signal
import socket
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import ray
from ray._private import ray_constants
from ray.exceptions import RayError

from mmw.core.device import workers_that_fit
from mmw.core.errors import InputError

OBJECT_STORE_BYTES = 100 * 2**20
"""Size of Ray's object store where this run starts Ray itself [bytes]; it holds only messages. Ray needs 75 MiB."""
CONNECT_TIMEOUT_S = 10.0
"""Time that a cluster has to accept a connection [s], and after which the user is told that Ray is still trying. Design
value."""
LOOPBACK = ("localhost", "127.0.0.1", "::1")
"""Names of this machine that Ray replaces by its address in the network."""
GREETING = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes((0, 0, 0, 4, 0, 0, 0, 0, 0))
"""First bytes of a client of gRPC, with empty settings (RFC 9113, 3.4); the server answers with its settings."""
SETTINGS = 4
"""Type of a frame of settings, which is the fourth byte of its header (RFC 9113, 4.1 and 6.5)."""


@dataclass(frozen=True)
class ClusterResources:
    """Resources of a cluster for workers."""

    device: str
    """Warp device, by its name in a worker."""
    workers: int
    workers_per_device: int = 1
    """Workers that share a GPU or a CPU."""

    @property
    def kind(self) -> str:
        """Resource of a worker, as Ray names it."""
        return "CPU" if self.device == "cpu" else "GPU"

    @property
    def actor_options(self) -> dict[str, float]:
        """Resources that a worker requests from Ray."""
        share = math.floor(1e4 / self.workers_per_device) / 1e4  # Ray counts in steps of 1e-4
        return {"num_cpus": share} if self.kind == "CPU" else {"num_cpus": 0, "num_gpus": share}

    def workers_on(self, node: Mapping[str, float]) -> int:
        """Return how many of the workers may run on a machine with some resources, at least one."""
        return max(min(self.workers, int(node.get(self.kind, 0)) * self.workers_per_device), 1)


def plan_workers(
    nodes: Sequence[Mapping[str, float]], device: str, workers: int | str, gpu_bytes: float = math.inf
) -> ClusterResources:
    """Return the resources of a cluster that its workers use.

    Args:
        nodes: Resources of each machine, as `ray.nodes` names them.
        device: Configured device: `auto` (GPUs, else CPUs), `cpu`, or `cuda:0` for a GPU that Ray chooses.
        workers: Number of workers, or `auto`: one per CPU, or on each GPU as many as fit on the machine that has least
            memory and cores for each. If there are more than GPUs or CPUs, some share one.
        gpu_bytes: Memory of a GPU [bytes]; infinite if unknown.

    Raises:
        InputError: If the cluster has no such device, or the configuration names a specific GPU.
    """
    if device not in ("auto", "cpu", "cuda", "cuda:0"):
        raise InputError(
            f"compute.device = {device!r}: with the engine ray Ray chooses a worker's GPU; use auto, cuda:0 or cpu"
        )
    gpu_nodes = [node for node in nodes if node.get("GPU", 0) >= 1]
    on_cpus = device == "cpu" or (device == "auto" and not gpu_nodes)
    kind = "CPU" if on_cpus else "GPU"
    count = sum(int(node.get(kind, 0)) for node in nodes)
    if not count:
        raise InputError(f"compute.device = {device!r}: the Ray cluster has no {kind}; start nodes that have one")
    name = "cpu" if on_cpus else "cuda:0"
    if workers != "auto":
        return ClusterResources(name, int(workers), math.ceil(int(workers) / count))
    workers_per_device = 1 if on_cpus else min(_workers_per_gpu(node, gpu_bytes) for node in gpu_nodes)
    return ClusterResources(name, count * workers_per_device, workers_per_device)


def _workers_per_gpu(node: Mapping[str, float], gpu_bytes: float) -> int:
    """Return how many workers can share each GPU of a machine with some resources."""
    memory = node.get("memory", math.inf) + node.get("object_store_memory", 0)  # Ray splits it into these two
    return workers_that_fit(int(node["GPU"]), node.get("CPU", 0), memory, gpu_bytes)


@contextmanager
def connect_cluster(say: Callable[[str], None]) -> Iterator[str]:
    """Connect to the cluster of RAY_ADDRESS, else to the latest that was started on this machine, else start one here.

    An existing connection is used and left open. A cluster that is started here listens on 127.0.0.1 only.

    Args:
        say: Receives one line if it takes long.

    Yields:
        Description of the cluster for people.

    Raises:
        InputError: If it cannot be reached.
    """
    is_own = not ray.is_initialized()
    if is_own:
        _connect(_address(), say)
    try:
        with _quiet():
            nodes = node_resources()
            counts = ", ".join(f"{sum(int(node.get(kind, 0)) for node in nodes)} {kind}s" for kind in ("CPU", "GPU"))
            where = f"{len(nodes)} machine{'s' * (len(nodes) != 1)}"
            yield f"Ray at {ray.get_runtime_context().gcs_address}: {counts} on {where}"
    finally:
        if is_own:
            ray.shutdown(wait_for_processes=True)


def node_resources() -> list[dict[str, float]]:
    """Return the resources of each machine of the cluster."""
    return [node["Resources"] for node in ray.nodes() if node["Alive"]]


def _connect(address: str | None, say: Callable[[str], None]) -> None:
    options: dict[str, Any] = {}  # Ray finds the same address itself, and the token that may belong to it
    if address is None:
        options = {"address": "local", "include_dashboard": False, "object_store_memory": OBJECT_STORE_BYTES}
        is_private = True
    else:
        is_private = _check_address(address)
    where = address or "this machine"
    terminated = signal.getsignal(signal.SIGTERM)
    line = f"Ray at {where}: no connection after {CONNECT_TIMEOUT_S:.0f} s; still trying"
    slow = threading.Timer(CONNECT_TIMEOUT_S, say, [line])
    slow.daemon = True
    slow.start()
    try:
        with _loopback(is_private):
            ray.init(**options, log_to_driver=False, logging_level=logging.ERROR)
    except (ConnectionError, RuntimeError, RayError) as error:
        raise InputError(
            f"Ray at {where}: {' '.join(str(error).split())}; Ray and Python must have the same "
            "versions there, and if it wants a token, the same ~/.ray/auth_token and RAY_AUTH_MODE=token"
        ) from error
    finally:
        slow.cancel()
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, terminated)  # Ray's handler aborts the process; Ray ends with it anyway


@contextmanager
def _loopback(is_wanted: bool) -> Iterator[None]:
    """Let Ray call this machine 127.0.0.1 if `is_wanted`: what it starts then listens there only.

    Ray replaces 127.0.0.1 in all its options by the machine's address in the network, on Linux; this is its switch for
    systems where it does not.
    """
    before = ray_constants.ENABLE_RAY_CLUSTER
    ray_constants.ENABLE_RAY_CLUSTER = before and not is_wanted
    try:
        yield
    finally:
        ray_constants.ENABLE_RAY_CLUSTER = before


def _address() -> str | None:
    """Return the address of the existing cluster, by Ray's own rules (`ray.init`); None if there is none."""
    named = os.environ.get("RAY_ADDRESS") or "auto"
    if named != "auto":
        return None if named == "local" else named
    folder = os.environ.get("RAY_TMPDIR") or tempfile.gettempdir()
    with suppress(OSError):
        return (Path(folder) / "ray" / "ray_current_cluster").read_text().strip() or None
    return None


def _check_address(address: str) -> bool:
    """Check that a cluster answers, for which Ray itself would wait for minutes or for ever.

    Returns:
        True if it does so on 127.0.0.1 only.
    """
    host, _, port = address.rpartition(":")
    if "://" in address or not host or not port.isdecimal():
        raise InputError(
            f"RAY_ADDRESS = {address!r}: is not host:port of a cluster's head, such as 10.0.0.1:6379; give that, or "
            "local for this machine alone"
        )
    cure = (
        "start it (ray start), tidy up after one that crashed (ray stop), or set RAY_ADDRESS: host:port of another "
        "one, or local for this machine alone"
    )
    try:
        _greet(host, int(port))
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"Ray at {address} does not answer ({reason}); {cure}") from error
    if host.strip("[]") not in LOOPBACK:
        return False
    try:
        _greet(ray.util.get_node_ip_address(), int(port))
    except OSError:
        return True
    return False


def _greet(host: str, port: int) -> None:
    """Connect to a server of gRPC and wait for its first answer.

    Raises:
        OSError: If nothing listens there, or what does is no such server.
    """
    with socket.create_connection((host.strip("[]"), port), timeout=CONNECT_TIMEOUT_S) as connection:
        if os.environ.get("RAY_USE_TLS", "0") not in ("0", ""):
            return  # the greeting is encrypted
        connection.sendall(GREETING)
        answer = connection.recv(9, socket.MSG_WAITALL)
        if len(answer) < 9 or answer[3] != SETTINGS:
            raise OSError("what listens there is not Ray")


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress Ray's lines about dead workers on standard output, where the summary goes; the console reports them."""
    worker = ray._private.worker  # Ray has no option for this
    before = worker._worker_logs_enabled
    worker._worker_logs_enabled = False
    try:
        yield
    finally:
        worker._worker_logs_enabled = before
