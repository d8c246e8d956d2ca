"""Make radio links: one row for each pair of antennas and frame, with the poses of both."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mmw.config import ChannelConfig
from mmw.config.links import LinkEnds
from mmw.scene.mounted_antennas import RadioDevices, antenna_pose, mounted_antennas
from mmw.scene.scene_data import SceneData

_ARRAYS = ("frame", "batch_index", "kind", "tx_actor", "rx_actor", "tx_antenna", "rx_antenna")
"""Fields of `Links` that are arrays, in their order."""


@dataclass(frozen=True)
class Links:
    """Pairs of antennas, one row a pair and frame; rows are in the order of frames, rules, actors and antennas."""

    frame: np.ndarray
    """Frame number, shape [L], int32."""
    batch_index: np.ndarray
    """Position of the frame in the batch, shape [L], int32."""
    kind: np.ndarray
    """Rule of the link, an index into `ChannelConfig.link_rules`, shape [L], int8."""
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

    @property
    def tx_number(self) -> np.ndarray:
        """Number of each transmitting antenna, one for every actor and antenna, shape [L], int64."""
        return _antenna_number(self.tx_actor, self.tx_antenna)

    @property
    def rx_number(self) -> np.ndarray:
        """Number of each receiving antenna, one for every actor and antenna, shape [L], int64."""
        return _antenna_number(self.rx_actor, self.rx_antenna)

    def __len__(self) -> int:
        return len(self.frame)

    def take(self, rows: np.ndarray) -> "Links":
        """Return some of the links."""
        return Links(
            *(getattr(self, name)[rows] for name in _ARRAYS),
            tx=self.tx.take(rows),
            rx=self.rx.take(rows),
        )


def _antenna_number(actor: np.ndarray, antenna: np.ndarray) -> np.ndarray:
    """Return one number of actor and antenna; that of the actor for its first antenna."""
    return actor.astype(np.int64) + (antenna.astype(np.int64) << 32)


def make_links(arrays: SceneData, frames: Sequence[int], config: ChannelConfig) -> Links:
    """Return the links of a batch of frames.

    Args:
        arrays: The scene on the host.
        frames: Frames of the batch; batch index b is `frames[b]`.
        config: Which links there are, and which antennas agents have.

    Returns:
        Every link of two present agents that a rule of `channel.links` makes.

    Raises:
        ValueError: If the scene does not cover a frame.
    """
    actors = arrays.actors
    ends = config.link_ends([actor.identity for actor in actors])
    table = np.array(ends, dtype=np.int32).reshape(-1, len(LinkEnds._fields))
    rows = np.array([arrays.frame_row(int(frame)) for frame in frames], dtype=np.int64)
    is_here = np.asarray(np.isfinite(arrays.poses[rows]).all(axis=2))
    batch_index, row = np.nonzero(is_here[:, table[:, 1]] & is_here[:, table[:, 2]])
    kind, tx_actor, rx_actor, tx_antenna, rx_antenna = table[row].T
    mount = np.array([[antenna_pose(own, *actor.identity) for own in config.antennas] for actor in actors])
    mount = mount.reshape(-1, len(config.antennas), 7)
    return Links(
        frame=np.array(frames, dtype=np.int32)[batch_index],
        batch_index=batch_index.astype(np.int32),
        kind=kind.astype(np.int8),
        tx_actor=tx_actor,
        rx_actor=rx_actor,
        tx_antenna=tx_antenna,
        rx_antenna=rx_antenna,
        tx=mounted_antennas(arrays, rows, batch_index, tx_actor, mount[tx_actor, tx_antenna]),
        rx=mounted_antennas(arrays, rows, batch_index, rx_actor, mount[rx_actor, rx_antenna]),
    )
