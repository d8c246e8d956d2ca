"""Work on a Ray cluster, of one machine or many: each worker is an actor, which keeps its scenario loaded.

Ray says where an actor runs and which GPU it has; everything else is as with processes. All machines need one file
system for the dataset, which every worker checks before it begins.
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
from mmw.generation.executors.ray_cluster import ClusterResources, cluster, machines, room_for
from mmw.generation.executors.supervisor import LostError, Supervisor
from mmw.generation.executors.work_queue import WorkerLostError
from mmw.generation.executors.worker_protocol import NOTE, Message, serve
from mmw.generation.progress import Console
from mmw.generation.provenance import versions
from mmw.generation.shards import Work, pending_work
from mmw.generation.worker import GenerationContext
from mmw.storage.store import LOCKS, Store

PATIENCE_S = 30.0
"""Time after which the user hears that no worker has begun [s]. Design value."""
SEEN_S = 120.0
"""Longest time until a shared file system shows here what another machine wrote [s]: twice what NFS keeps in mind by
default (`acdirmax`, nfs(5))."""


@contextmanager
def connected(compute: ComputeConfig, console: Console) -> Iterator["RayEngine"]:
    """Return an engine on a Ray cluster; see `cluster` for which.

    Raises:
        InputError: If the cluster cannot be reached or has no such device, or mmw is missing on it.
    """
    with cluster() as description:
        console.say(description)
        engine = RayEngine(machines(), compute, console)
        try:
            yield engine
        finally:
            engine.close()


class RayEngine:
    """Workers on a cluster that this process is connected to; see `Engine`."""

    def __init__(self, nodes: Sequence[Mapping[str, float]], compute: ComputeConfig, console: Console):
        """Start a first worker, and see what it runs on.

        Args:
            nodes: Resources of each machine.
            compute: The device, and how many workers.
            console: Where is said that Ray has no place for a worker.

        Raises:
            InputError: If the cluster has no such device, or a worker cannot run there.
        """
        self._room = room_for(nodes, compute.device, compute.workers)
        self._first: Any = self._new_actor()
        described = self._first.describe.remote(self._room.device)
        while not self._ready([described], console, nobody=True):
            pass
        try:
            self.device_name, self.machine, gpu_bytes = ray.get(described)
        except RayError as error:
            raise _meaning(error) from error
        room = room_for(nodes, compute.device, compute.workers, gpu_bytes)
        if room != self._room:  # fewer, so that each asks for more
            self.close()
            self._room = room
        self.devices: Sequence[str] = [room.device] * room.workers

    def make(self, making: GenerationContext, work: Sequence[Work], workers: int, console: Console) -> None:
        """Make all work; see `Engine.make`.

        Raises:
            InputError: If a worker's machine does not see the dataset's folder, or has other files or another mmw.
        """
        making = replace(making, base=making.base.absolute(), root=making.root.anywhere())
        here = versions(making.config, making.base, self.machine)

        def start(own: GenerationContext, device: str) -> _Link:
            actor, self._first = self._first or self._new_actor(), None
            return _Link(actor, device, task, own.owner)

        def wait(links: list[_Link]) -> list[_Link]:
            heard = {link.listen(): link for link in links}
            ready = self._ready(list(heard), console, nobody=not any(link.node for link in links))
            return [heard[reference] for reference in ready]

        with _sign(making.root) as sign:
            task = ray.put(Task(making, replace(self._room, workers=workers), sign, here))
            Supervisor(making, work, self.devices[:workers], console, start, wait).run()
        _wait_until_seen(making.root, work, console)

    def close(self) -> None:
        """Let go of a worker that has nothing to do."""
        if self._first is not None:
            ray.kill(self._first)
            self._first = None

    def _new_actor(self) -> Any:
        return ray.remote(Actor).options(**self._room.asks, scheduling_strategy="SPREAD", max_restarts=0).remote()

    def _ready(self, references: list[Any], console: Console, *, nobody: bool) -> list[Any]:
        """Return those that are ready, one at least; none if that takes long, said if nobody has begun yet."""
        ready, _ = ray.wait(references, timeout=PATIENCE_S)
        if ready:
            return ray.wait(references, num_returns=len(references), timeout=0)[0]
        if nobody:
            asks = " and ".join(f"{name} = {count:g}" for name, count in self._room.asks.items())
            console.warn_once(f"Ray has found no place yet for an actor with {asks}; `ray status` says why")
        return []


@dataclass(frozen=True)
class Task:
    """Arguments of an actor."""

    making: GenerationContext
    room: ClusterResources
    sign: str
    """Name of a file of this run alone in the dataset."""
    versions: Mapping[str, Any]
    """Result of `versions` on the machine of the run."""


class Actor:
    """Ray actor: a worker in a thread, and a method that exchanges work for messages."""

    def __init__(self) -> None:
        self._given: queue.SimpleQueue[Work | None] = queue.SimpleQueue()
        self._said: queue.SimpleQueue[Message] = queue.SimpleQueue()
        self._node = ray.util.get_node_ip_address()

    def describe(self, device: str) -> tuple[str, str, float]:
        """Return a device's name for people, the kind of machine, and a GPU's memory [bytes].

        Errors are those of `choose_device`.
        """
        chosen = choose_device(device)
        return device_name(chosen), machine_kind(chosen), gpu_bytes(device)

    def begin(self, device: str, task: Task, owner: Owner) -> tuple[str, list[Message]]:
        """Begin to work; see `talk` for what it returns.

        Args:
            device: Warp device name.
            task: What is made, and how.
            owner: Mark of this worker.
        """
        own = ray.get_runtime_context().get_node_id()
        has = next(node["Resources"] for node in ray.nodes() if node["NodeID"] == own)
        threads = writer_threads(task.making.config.compute.writer_threads, task.room.workers_on(has))
        making = replace(task.making, threads=threads, owner=owner)
        arguments = (making, device, self._given.get, self._said.put, lambda: self._check(task))
        threading.Thread(target=serve, args=arguments, daemon=True).start()
        return self._node, []

    def talk(self, *work: Work | None) -> tuple[str, list[Message]]:
        """Take work; wait until the worker says something, and return the name of this machine and all that it said."""
        for item in work:
            self._given.put(item)
        said = [self._said.get()]
        with suppress(queue.Empty):
            while True:
                said.append(self._said.get_nowait())
        return self._node, said

    def _check(self, task: Task) -> None:
        """See whether this machine has what the run's has; note where its packages differ.

        Raises:
            InputError: If it has not.
        """
        where, making, there = f"Ray node {self._node}", task.making, task.versions
        if __version__ != there["mmw"]:
            raise InputError(f"{where} has mmw {__version__}, the run {there['mmw']}; install the same on all nodes")
        if making.root.read(task.sign) is None:
            raise InputError(
                f"{making.root}: {where} does not see what this run wrote there; give an --out on a file system that "
                "all nodes share, or in a bucket, or use --engine local"
            )
        making.root.folder.mkdir(parents=True, exist_ok=True)  # of a bucket each machine has its own
        try:
            here = versions(making.config, making.base, there["device"])
        except InputError as error:
            raise InputError(f"{where}: {error}; all nodes need the files of the configuration") from error
        for scenario, files in there["sources"].items():
            if here["sources"][scenario] != files:
                raise InputError(
                    f"{where}: scenario {scenario!r}: {', '.join(files)}: other content than where the run is; all "
                    "nodes need the same files"
                )
        own = {"git": here["git"], **here["packages"]}
        for name, value in {"git": there["git"], **there["packages"]}.items():
            if own[name] != value:
                self._said.put((NOTE, f"{where} has {name} {own[name]!r}, the run {value!r}"))


class _Link:
    """The run's end of the connection to an actor."""

    def __init__(self, actor: Any, device: str, task: Any, owner: Owner):
        self.node = ""
        """Its machine; empty until it has begun."""
        self._actor = actor
        self._given: list[Work | None] = []
        self._heard: Any = actor.begin.remote(device, task, owner)

    def listen(self) -> Any:
        """Return Ray's reference to what the worker says next; hand over what it was given."""
        if self._heard is None:
            self._heard = self._actor.talk.remote(*self._given)
            self._given = []
        return self._heard

    def receive(self) -> list[Message]:
        heard, self._heard = self._heard, None
        try:
            self.node, said = ray.get(heard)
        except RayError as error:
            if isinstance(error, RayActorError | OutOfMemoryError) and not getattr(error, "actor_init_failed", False):
                raise LostError(f"on Ray node {self.node or _node(error)}: {_reason(error)}") from error
            raise _meaning(error) from error
        return said

    def send(self, work: Work | None) -> None:
        self._given.append(work)

    def close(self) -> None:
        ray.kill(self._actor)

    kill = close


@contextmanager
def _sign(root: Store) -> Iterator[str]:
    """Keep a file of this run alone in a dataset: who sees it sees that dataset, not another of the same name."""
    name = temporary_path(root.staging / LOCKS / "ray").relative_to(root.staging).as_posix()
    root.publish(name, b"")
    try:
        yield name
    finally:
        root.remove([name])


def _wait_until_seen(root: Store, work: Sequence[Work], console: Console) -> None:
    """Wait until this machine sees all that others wrote.

    Raises:
        WorkerLostError: If it does not.
    """
    end = time.monotonic() + SEEN_S
    while rest := pending_work(root, work):
        if time.monotonic() > end:
            raise WorkerLostError(
                f"{root}: {rest[0]} cannot be seen here {SEEN_S:.0f} s after another machine wrote them; see whether "
                "its file system is shared by all nodes, and run the same command again"
            )
        console.warn_once(f"{root}: waiting until the file system shows what other machines wrote")
        time.sleep(1.0)


def _meaning(error: RayError) -> Exception:
    """Return the error that stands for one of Ray's: its node is not fit for a worker, or Ray has failed."""
    cause = error.cause if isinstance(error, RayTaskError) else None
    if isinstance(cause, InputError):
        return InputError(f"Ray node {_node(error)}: {cause}")
    if isinstance(cause, ImportError) or getattr(error, "actor_init_failed", False):
        return InputError(f"Ray node {_node(error)}: {_reason(error)}; all nodes need the same mmw: {install('ray')}")
    if cause is not None:  # a bug: Ray's error holds the trace of the node
        return error
    return WorkerLostError(
        f"Ray has failed: {_reason(error)}; everything that was finished is kept, and the same command resumes"
    )


def _node(error: RayError) -> str:
    """Return the machine that a message of Ray names."""
    found = re.search(r"\bip[=:] ?([\w.:]+)", str(error))
    return found[1] if found else "(unknown)"


def _reason(error: RayError) -> str:
    """Return what a long message of Ray says last, without advice."""
    if isinstance(error, ActorUnavailableError):
        return "it cannot be reached"
    last = re.sub(r"\x1b\[[0-9;]*m", "", str(error)).strip().splitlines()[-1]
    return re.sub(r"^The actor (is dead|died) because ", "", last.split(" Worker exit type")[0]).rstrip(".")
