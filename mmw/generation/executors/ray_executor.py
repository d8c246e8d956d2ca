"""Run work on a Ray cluster of one machine or several: each worker is an actor, which keeps its scenario loaded.

Ray chooses the machine and the GPU of an actor; everything else is as with local processes. All machines need access to
the dataset, on a shared file system or in a bucket, which every worker checks before it starts.
"""

import queue
import re
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any

import ray
from ray.exceptions import ActorUnavailableError, OutOfMemoryError, RayActorError, RayError, RayTaskError

from mmw import __version__
from mmw.config.compute import ComputeConfig
from mmw.core.device import choose_device, device_name, gpu_bytes, machine_kind, writer_threads
from mmw.core.errors import InputError
from mmw.core.extras import install
from mmw.core.temp_files import Owner, temporary_path
from mmw.generation.continuation import VERSIONS
from mmw.generation.executors.child_process import WorkerDiedError
from mmw.generation.executors.ray_cluster import ClusterResources, connect_cluster, node_resources, plan_workers
from mmw.generation.executors.supervisor import Supervisor
from mmw.generation.executors.work_queue import WorkerLostError
from mmw.generation.executors.worker_protocol import NOTE, Message, serve
from mmw.generation.progress import Console
from mmw.generation.provenance import versions
from mmw.generation.shards import Work, pending_work
from mmw.generation.software import own_software, software_differences, software_of
from mmw.generation.worker import GenerationContext
from mmw.scene.input_files import hash_inputs
from mmw.storage.identity import changed_inputs
from mmw.storage.store import LOCKS, Store

SLOW_START_S = 30.0
"""Time after which the user is told that no worker has started [s]. Design value."""
VISIBLE_TIMEOUT_S = 120.0
"""Longest time until a shared file system shows what another machine wrote [s]: twice the time that NFS caches folders
by default (`acdirmax`, nfs(5))."""


@contextmanager
def open_ray_executor(compute: ComputeConfig, console: Console) -> Iterator["RayExecutor"]:
    """Return an executor on the Ray cluster that `connect_cluster` finds.

    Raises:
        InputError: If the cluster cannot be reached or has no such device, or mmw is missing on it.
    """
    with connect_cluster(console.say) as description:
        console.say(description)
        executor = RayExecutor(node_resources(), compute, console)
        try:
            yield executor
        finally:
            executor.close()


class RayExecutor:
    """Workers on a cluster that this process is connected to; see `Executor`."""

    def __init__(self, nodes: Sequence[Mapping[str, float]], compute: ComputeConfig, console: Console):
        """Start a first worker and ask it for its device.

        Raises:
            InputError: If the cluster has no such device, or a worker cannot run there.
        """
        self._resources = plan_workers(nodes, compute.device, compute.workers)
        self._first: Any = self._new_actor()
        described = self._first.describe.remote(self._resources.device)
        while not self._ready([described], console, is_first=True):
            pass
        try:
            self.device_name, self.machine, gpu_bytes = ray.get(described)
        except RayError as error:
            raise _translated(error) from error
        resources = plan_workers(nodes, compute.device, compute.workers, gpu_bytes)
        if resources != self._resources:  # fewer workers, so each requests a larger share
            self.close()
            self._resources = resources
        self.devices: Sequence[str] = [resources.device] * resources.workers

    def run(self, context: GenerationContext, work: Sequence[Work], workers: int, console: Console) -> None:
        """Generate all work; see `Executor.run`.

        Raises:
            InputError: If a worker's machine does not see the dataset's folder, or has other files or another mmw.
        """
        context = replace(context, base=context.base.absolute(), root=context.root.resolved())
        own_versions = versions(context.config, context.base, self.machine)

        def connect(worker_context: GenerationContext, device: str) -> _ActorConnection:
            actor, self._first = self._first or self._new_actor(), None
            return _ActorConnection(actor, device, task, worker_context.owner)

        def wait(connections: list[_ActorConnection]) -> list[_ActorConnection]:
            replies = {connection.request(): connection for connection in connections}
            is_first = not any(connection.node for connection in connections)
            ready = self._ready(list(replies), console, is_first=is_first)
            return [replies[reference] for reference in ready]

        with _probe_file(context.root) as probe:
            task = ray.put(ActorTask(context, replace(self._resources, workers=workers), probe, own_versions))
            Supervisor(context, work, self.devices[:workers], console, connect, wait).run()
        _wait_until_visible(context.root, work, console)

    def close(self) -> None:
        """Stop the first worker if it has no work."""
        if self._first is not None:
            ray.kill(self._first)
            self._first = None

    def _new_actor(self) -> Any:
        options = self._resources.actor_options
        return ray.remote(Actor).options(**options, scheduling_strategy="SPREAD", max_restarts=0).remote()

    def _ready(self, references: list[Any], console: Console, *, is_first: bool) -> list[Any]:
        """Wait, and return the references that are ready; none, with a warning if no worker has started, on timeout."""
        ready, _ = ray.wait(references, timeout=SLOW_START_S)
        if ready:
            return ray.wait(references, num_returns=len(references), timeout=0)[0]
        if is_first:
            options = " and ".join(f"{name} = {count:g}" for name, count in self._resources.actor_options.items())
            console.warn_once(f"Ray has found no place yet for an actor with {options}; `ray status` says why")
        return []


@dataclass(frozen=True)
class ActorTask:
    """Arguments of an actor."""

    context: GenerationContext
    resources: ClusterResources
    probe: str
    """Name of a file in the dataset that only this run has written."""
    versions: Mapping[str, Any]
    """Result of `versions` on the machine of the run."""


class Actor:
    """Ray actor: a worker in a thread, and a method that exchanges work for messages."""

    def __init__(self) -> None:
        self._work: queue.SimpleQueue[Work | None] = queue.SimpleQueue()
        self._messages: queue.SimpleQueue[Message] = queue.SimpleQueue()
        self._node = ray.util.get_node_ip_address()

    def describe(self, device: str) -> tuple[str, str, float]:
        """Return a device's name for people, the kind of machine, and a GPU's memory [bytes].

        Errors are those of `choose_device`.
        """
        chosen = choose_device(device)
        return device_name(chosen), machine_kind(chosen), gpu_bytes(device)

    def start(self, device: str, task: ActorTask, owner: Owner) -> tuple[str, list[Message]]:
        """Start the worker; see `exchange` for the result."""
        own = ray.get_runtime_context().get_node_id()
        node = next(node["Resources"] for node in ray.nodes() if node["NodeID"] == own)
        threads = writer_threads(task.context.config.compute.writer_threads, task.resources.workers_on(node))
        meta = {**task.context.meta, "software": software_of(own_software(task.context.config))}
        context = replace(task.context, threads=threads, owner=owner, meta=meta)
        arguments = (context, device, self._work.get, self._messages.put, lambda: self._check(task))
        threading.Thread(target=serve, args=arguments, daemon=True).start()
        return self._node, []

    def exchange(self, *work: Work | None) -> tuple[str, list[Message]]:
        """Queue work, wait for a message, and return the name of this machine and all messages of the worker."""
        for item in work:
            self._work.put(item)
        messages = [self._messages.get()]
        with suppress(queue.Empty):
            while True:
                messages.append(self._messages.get_nowait())
        return self._node, messages

    def _check(self, task: ActorTask) -> None:
        """Check that this machine has the software and the files of the run's; report packages that differ."""
        where, context, wanted = f"Ray node {self._node}", task.context, task.versions
        if __version__ != wanted["mmw"]:
            raise InputError(f"{where} has mmw {__version__}, the run {wanted['mmw']}; install the same on all nodes")
        if context.root.read(task.probe) is None:
            raise InputError(
                f"{context.root}: {where} does not see what this run wrote there; give an --out on a file system that "
                "all nodes share, or in a bucket, or use --engine local"
            )
        context.root.folder.mkdir(parents=True, exist_ok=True)  # each machine has its own if the root is a bucket
        try:
            found = versions(context.config, context.base, wanted["device"])
            changes = changed_inputs({"inputs": context.inputs}, hash_inputs(context.config, context.base))
        except InputError as error:
            raise InputError(f"{where}: {error}; all nodes need the files of the configuration") from error
        if changes:
            raise InputError(
                f"{where}: {'; '.join(changes)}: other content than where the run is; all nodes need the same files"
            )
        towns = changed_inputs({"inputs": wanted["sources"]}, found["sources"])
        differences = ", ".join(filter(None, [software_differences(wanted["software"], found["software"]), *towns]))
        if differences and VERSIONS not in str(context.meta.get("accepted")).split():
            raise InputError(
                f"{where} has other versions than the run: {differences}; install the same on all nodes, or use "
                f"--accept {VERSIONS}"
            )
        if differences:
            self._messages.put((NOTE, f"{where} has other versions than the run: {differences}"))


class _ActorConnection:
    """Connection of the run to an actor; see `WorkerConnection`."""

    def __init__(self, actor: Any, device: str, task: Any, owner: Owner):
        self.node = ""
        """Machine of the actor; empty until it has started."""
        self._actor = actor
        self._unsent: list[Work | None] = []
        self._reply: Any = actor.start.remote(device, task, owner)

    def request(self) -> Any:
        """Return Ray's reference to the next messages; send the work that is queued for the worker."""
        if self._reply is None:
            self._reply = self._actor.exchange.remote(*self._unsent)
            self._unsent = []
        return self._reply

    def receive(self) -> list[Message]:
        reply, self._reply = self._reply, None
        try:
            self.node, messages = ray.get(reply)
        except RayError as error:
            if isinstance(error, RayActorError | OutOfMemoryError) and not getattr(error, "actor_init_failed", False):
                raise WorkerDiedError(f"on Ray node {self.node or _node(error)}: {_reason(error)}") from error
            raise _translated(error) from error
        return messages

    def send(self, work: Work | None) -> None:
        self._unsent.append(work)

    def close(self) -> None:
        ray.kill(self._actor)

    kill = close


@contextmanager
def _probe_file(root: Store) -> Iterator[str]:
    """Write a file into a dataset while the block runs: a machine that sees it sees this dataset and no other."""
    name = temporary_path(root.staging / LOCKS / "ray").relative_to(root.staging).as_posix()
    root.write_atomically(name, b"")
    try:
        yield name
    finally:
        root.remove([name])


def _wait_until_visible(root: Store, work: Sequence[Work], console: Console) -> None:
    """Wait until this machine sees all files that others wrote."""
    end = time.monotonic() + VISIBLE_TIMEOUT_S
    while rest := pending_work(root, work):
        if time.monotonic() > end:
            raise WorkerLostError(
                f"{root}: {rest[0]} cannot be seen here {VISIBLE_TIMEOUT_S:.0f} s after another machine wrote them; "
                "check that all nodes share its file system, and run the same command again"
            )
        console.warn_once(f"{root}: waiting until the file system shows what other machines wrote")
        time.sleep(1.0)


def _translated(error: RayError) -> Exception:
    """Return the error of mmw for one of Ray: the node is not fit for a worker, or Ray has failed."""
    cause = error.cause if isinstance(error, RayTaskError) else None
    if isinstance(cause, InputError):
        return InputError(f"Ray node {_node(error)}: {cause}")
    if isinstance(cause, ImportError) or getattr(error, "actor_init_failed", False):
        return InputError(f"Ray node {_node(error)}: {_reason(error)}; all nodes need the same mmw: {install('ray')}")
    if cause is not None:  # a bug: Ray's error holds the stack trace of the node
        return error
    reason = f"Ray has failed: {_reason(error)}; all finished work is stored, and the same command resumes"
    return WorkerLostError(reason)


def _node(error: RayError) -> str:
    """Return the machine that a message of Ray names."""
    found = re.search(r"\bip[=:] ?([\w.:]+)", str(error))
    return found[1] if found else "(unknown)"


def _reason(error: RayError) -> str:
    """Return the last sentence of a long message of Ray, without advice."""
    if isinstance(error, ActorUnavailableError):
        return "it cannot be reached"
    last = re.sub(r"\x1b\[[0-9;]*m", "", str(error)).strip().splitlines()[-1]
    return re.sub(r"^The actor (is dead|died) because ", "", last.split(" Worker exit type")[0]).rstrip(".")
