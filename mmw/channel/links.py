"""Make radio links: one row a link and frame, with the poses of both antennas."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mmw.config import ChannelConfig
from mmw.scene.mounted_antennas import RadioDevices, mounted_antennas
from mmw.scene.scene_data import SceneData

LINK_V2I, LINK_V2V = range(2)
"""`Links.kind` of a downlink from a roadside unit to a CAV, and of a link between two CAVs."""
LINK_KINDS = ("v2i", "v2v")
"""Name of each kind."""

_ARRAYS = ("frame", "batch_index", "kind", "tx_actor", "rx_actor", "tx_antenna", "rx_antenna")
"""Fields of `Links` that are arrays, in their order."""


@dataclass(frozen=True)
class Links:
    """Transmitter-receiver pairs, one row a pair and frame; rows are in the order of frames, kinds and actors."""

    frame: np.ndarray
    """Frame number, shape [L], int32."""
    batch_index: np.ndarray
    """Position of the frame in the batch, shape [L], int32."""
    kind: np.ndarray
    """`LINK_V2I` or `LINK_V2V`, shape [L], int8."""
    tx_actor: np.ndarray
    """Actor index of the transmitter, shape [L], int32."""
    rx_actor: np.ndarray
    """Actor index of the receiver, shape [L], int32."""
    tx_antenna: np.ndarray
    """Antenna of the transmitter, an index into `ChannelConfig.antenna_names`, shape [L], int32."""
    rx_antenna: np.ndarray
    """Antenna of the receiver, shape [L], int32."""
    tx: RadioDevices
    rx: RadioDevices

    def __len__(self) -> int:
        return len(self.frame)

    def take(self, rows: np.ndarray) -> "Links":
        """Return some of the links."""
        return Links(
            *(getattr(self, name)[rows] for name in _ARRAYS),
            tx=self.tx.take(rows),
            rx=self.rx.take(rows),
        )


def make_links(arrays: SceneData, frames: Sequence[int], config: ChannelConfig) -> Links:
    """Return the links of a batch of frames.

    Args:
        arrays: The scene on the host.
        frames: Frames of the batch; batch index b is `frames[b]`.
        config: Which links there are, and where antennas sit on their agents.

    Returns:
        Every configured pair of present agents: RSU -> CAV for `v2i`, every ordered pair of CAVs for `v2v`.

    Raises:
        ValueError: If the scene does not cover a frame.
    """
    actors = arrays.actors
    cavs = [i for i, actor in enumerate(actors) if actor.role == "cav"]
    rsus = [i for i, actor in enumerate(actors) if actor.role == "rsu"]
    pairs = [(LINK_V2I, t, r) for t in rsus for r in cavs] if "v2i" in config.links else []
    if "v2v" in config.links:
        pairs += [(LINK_V2V, t, r) for t in cavs for r in cavs if t != r]
    pair = np.array(pairs, dtype=np.int32).reshape(-1, 3)
    rows = np.array([arrays.frame_row(int(frame)) for frame in frames], dtype=np.int64)
    is_here = np.asarray(np.isfinite(arrays.poses[rows]).all(axis=2))
    batch_index, column = np.nonzero(is_here[:, pair[:, 1]] & is_here[:, pair[:, 2]])
    kind, tx_actor, rx_actor = pair[column].T
    mount = np.array([config.antenna_on(actor.role, actor.name) for actor in actors]).reshape(-1, 3)
    return Links(
        frame=np.array(frames, dtype=np.int32)[batch_index],
        batch_index=batch_index.astype(np.int32),
        kind=kind.astype(np.int8),
        tx_actor=tx_actor,
        rx_actor=rx_actor,
        tx_antenna=np.zeros(len(column), dtype=np.int32),
        rx_antenna=np.zeros(len(column), dtype=np.int32),
        tx=mounted_antennas(arrays, rows, batch_index, tx_actor, mount[tx_actor]),
        rx=mounted_antennas(arrays, rows, batch_index, rx_actor, mount[rx_actor]),
    )
