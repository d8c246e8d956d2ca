"""Workers on Ray that die while they write a file; see `tests/dying_workers.py`."""

from typing import Any

import mmw.engines.ray
from tests.dying_workers import die_while_writing


class Actor(mmw.engines.ray.Actor):
    """Stands in for `mmw.engines.ray.Actor`."""

    def begin(self, device: str, task: Any, owner: Any) -> Any:
        die_while_writing(task.making.root.staging)
        return super().begin(device, task, owner)
