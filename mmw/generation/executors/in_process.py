"""All work in this process, on one device."""

from collections.abc import Sequence

from mmw.generation.progress import Console
from mmw.generation.shards import Work
from mmw.generation.worker import GenerationContext, Worker


def make_alone(making: GenerationContext, work: Sequence[Work], device: str, console: Console) -> None:
    """Make all work; see `Worker.make` for errors."""
    if not work:
        return
    with Worker(making, device, console) as worker:
        for item in work:
            worker.make(item)
        worker.finish()
