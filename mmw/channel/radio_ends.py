"""Describe the transmitters or the receivers of solved paths."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mmw.channel.antennas.arrays import PlanarArray
from mmw.core.errors import InputError
from mmw.scene.mounted_antennas import RadioDevices


@dataclass(frozen=True, eq=False, kw_only=True)
class RadioEnds:
    """Transmitters or receivers of solved paths."""

    names: tuple[str, ...]
    """Name of each device."""
    state: RadioDevices
    """Place, rotation and velocity of each, world frame, shape [N, ...]."""
    arrays: tuple[PlanarArray, ...]
    """Array of each."""

    def __len__(self) -> int:
        return len(self.names)

    def rows(self, wanted: str | Sequence[str] | None, kind: str) -> np.ndarray:
        """Return the indices of devices by name; all for None.

        Raises:
            InputError: If there is no such device, or one is named twice.
        """
        if wanted is None:
            return np.arange(len(self))
        given = [wanted] if isinstance(wanted, str) else list(wanted)
        if len(set(given)) != len(given):
            raise InputError(f"{kind}s {given}: one is named twice; name each once")
        for name in given:
            if name not in self.names:
                raise InputError(f"{kind} {name!r}: the paths have {', '.join(self.names)}; name one of them")
        return np.array([self.names.index(name) for name in given], dtype=np.int64)

    def take(self, rows: np.ndarray) -> "RadioEnds":
        """Return some of the devices."""
        own = [int(row) for row in rows]
        return RadioEnds(
            names=tuple(self.names[row] for row in own),
            state=self.state.take(rows),
            arrays=tuple(self.arrays[row] for row in own),
        )
