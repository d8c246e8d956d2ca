"""Choose the executor of a run."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol

from mmw.config.compute import ComputeConfig
from mmw.core.device import device_name, machine_kind, worker_devices
from mmw.core.errors import InputError
from mmw.core.extras import install
from mmw.generation.executors.local_processes import run_in_processes
from mmw.generation.progress import Console
from mmw.generation.shards import Work
from mmw.generation.worker import GenerationContext, Worker


class Executor(Protocol):
    """Runs the work of a dataset."""

    devices: Sequence[str]
    """Warp device of each available worker, by its name on the worker's machine."""
    device_name: str
    """Name of the first device for people."""
    machine: str
    """Kind of the machine of the first device, see `machine_kind`."""

    def run(self, context: GenerationContext, work: Sequence[Work], workers: int, console: Console) -> None:
        """Generate all work; see `Supervisor.run` for errors."""


class LocalExecutor:
    """Workers on this machine: this process if there is one, else one process each."""

    def __init__(self, devices: Sequence[str]):
        self.devices = devices
        self.device_name = device_name(devices[0])
        self.machine = machine_kind(devices[0])

    def run(self, context: GenerationContext, work: Sequence[Work], workers: int, console: Console) -> None:
        """Generate all work; see `Executor.run`."""
        if workers > 1:
            run_in_processes(context, work, self.devices[:workers], console)
        elif work:
            with Worker(context, self.devices[0], console) as worker:
                for item in work:
                    worker.trace(item)
                worker.finish()


@contextmanager
def open_executor(compute: ComputeConfig, console: Console) -> Iterator[Executor]:
    """Return the configured executor; the processes that it started end with the block.

    Raises:
        InputError: If it is not installed, cannot be reached, or has no such device.
    """
    if compute.engine == "local":
        yield LocalExecutor(worker_devices(compute.device, compute.workers))
        return
    try:
        from mmw.generation.executors.ray_executor import open_ray_executor
    except ModuleNotFoundError as error:
        if error.name != "ray":
            raise
        raise InputError(
            f"compute.engine = 'ray': the package ray is missing; {install('ray')}, or use --engine local"
        ) from None
    with open_ray_executor(compute, console) as executor:
        yield executor
