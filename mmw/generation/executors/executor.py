"""Choose the executor of a run."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol

from mmw.config.compute import ComputeConfig
from mmw.core.device import device_name, machine_kind, worker_devices
from mmw.core.errors import InputError
from mmw.core.extras import install
from mmw.generation.executors.in_process import make_alone
from mmw.generation.executors.local_processes import make_in_processes
from mmw.generation.progress import Console
from mmw.generation.shards import Work
from mmw.generation.worker import GenerationContext


class Engine(Protocol):
    """Makes the work of a dataset."""

    devices: Sequence[str]
    """Warp device of each worker that there is room for, by the name that it has where the worker is."""
    device_name: str
    """The first one's name for people."""
    machine: str
    """Kind of machine that it is on, see `machine_kind`."""

    def make(self, making: GenerationContext, work: Sequence[Work], workers: int, console: Console) -> None:
        """Make all work; see `Supervisor.run` for errors.

        Args:
            making: What is made.
            work: The work.
            workers: How many of the workers are worth it.
            console: Where progress goes.
        """


class LocalEngine:
    """Workers on this machine: this process if it is one, else a process each."""

    def __init__(self, devices: Sequence[str]):
        """Take the devices.

        Args:
            devices: Device of each worker; the same may stand there more than once.
        """
        self.devices = devices
        self.device_name = device_name(devices[0])
        self.machine = machine_kind(devices[0])

    def make(self, making: GenerationContext, work: Sequence[Work], workers: int, console: Console) -> None:
        """Make all work; see `Engine.make`."""
        if workers == 1:
            make_alone(making, work, self.devices[0], console)
        else:
            make_in_processes(making, work, self.devices[:workers], console)


@contextmanager
def open_engine(compute: ComputeConfig, console: Console) -> Iterator[Engine]:
    """Return the configured engine; what it started ends with the block.

    Raises:
        InputError: If it is not installed, cannot be reached, or has no such device.
    """
    if compute.engine == "local":
        yield LocalEngine(worker_devices(compute.device, compute.workers))
        return
    try:
        from mmw.generation.executors.ray_executor import connected
    except ModuleNotFoundError as error:
        if error.name != "ray":
            raise
        raise InputError(
            f"compute.engine = 'ray': the package ray is missing; {install('ray')}, or use --engine local"
        ) from None
    with connected(compute, console) as engine:
        yield engine
