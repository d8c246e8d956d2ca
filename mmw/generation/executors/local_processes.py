"""Run work in several processes of this machine, which end with their parent, whatever ends it."""

from collections.abc import Iterable, Sequence
from multiprocessing.connection import Connection, wait

from mmw.generation.executors.child_process import ChildProcess
from mmw.generation.executors.supervisor import Supervisor
from mmw.generation.executors.worker_protocol import Message, serve
from mmw.generation.progress import Console
from mmw.generation.shards import Work
from mmw.generation.worker import GenerationContext


def run_in_processes(
    context: GenerationContext, work: Sequence[Work], devices: Sequence[str], console: Console
) -> None:
    """Generate all work; see `Supervisor.run` for errors."""
    Supervisor(context, work, devices, console, _WorkerProcess, _wait).run()


class _WorkerProcess(ChildProcess):
    """One worker process and the connection to it; see `WorkerConnection`."""

    def __init__(self, context: GenerationContext, device: str):
        super().__init__(_serve, context, device)

    def receive(self) -> Iterable[Message]:
        return [super().receive()]

    def send(self, work: Work | None) -> None:
        super().send(work)


def _wait(workers: list[_WorkerProcess]) -> list[_WorkerProcess]:
    ready = wait([worker.connection for worker in workers])
    return [worker for worker in workers if worker.connection in ready]


def _serve(connection: Connection, context: GenerationContext, device: str) -> None:
    """Run a worker in this process."""
    serve(context, device, connection.recv, connection.send)
