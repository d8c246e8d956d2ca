"""Make radio links: one row for each pair of antennas and frame, with the poses of both."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mmw.config import ChannelConfig
from mmw.config.links import LinkEnds
from mmw.core.kinematics import Motion
from mmw.core.remember import remembered
from mmw.scene.mounted_antennas import Mounts, RadioDevices, antenna_pose, mounted_antennas, mounts_at
from mmw.scene.scene_data import Actor, SceneData

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


@remembered(owners=2, size=8)
def _antenna_number(actor: np.ndarray, antenna: np.ndarray) -> np.ndarray:
    """Return one number of actor and antenna; that of the actor for its first antenna."""
    return actor.astype(np.int64) + (antenna.astype(np.int64) << 32)


@dataclass(frozen=True)
class _Present:
    """Links of a set of present agents."""

    ends: tuple[np.ndarray, ...]
    """Fields of `Links` of the names in `_ARRAYS` but `frame`."""
    row: np.ndarray
    """Batch index of each transmitting, then of each receiving antenna, shape [2 L]."""
    actor: np.ndarray
    """Actor of each, shape [2 L]."""
    mounts: Mounts
    """Place of each on its actor."""


def make_links(arrays: SceneData, frames: Sequence[int], config: ChannelConfig, motion: Motion | None = None) -> Links:
    """Return the links of a batch of frames.

    Args:
        arrays: The scene on the host.
        frames: Frames of the batch; batch index b is `frames[b]`.
        config: Which links there are, and which antennas agents have.
        motion: Derivatives of all `poses` of the scene, if they are known.

    Returns:
        Every link of two present agents that a rule of `channel.links` makes.

    Raises:
        ValueError: If the scene does not cover a frame.
    """
    rows = arrays.frame_rows(frames)
    is_finite = np.isfinite(arrays.poses.take(rows, axis=0))
    present = _present_links(arrays.actors, config, len(rows), is_finite.tobytes())
    antennas = mounted_antennas(arrays, rows, present.row, present.actor, present.mounts, motion)
    middle = len(present.row) // 2
    tx, rx = antennas.take(slice(None, middle)), antennas.take(slice(middle, None))
    return Links(np.array(frames, dtype=np.int32).take(present.ends[0]), *present.ends, tx, rx)


@remembered(owners=2, size=32)
def _present_links(actors: tuple[Actor, ...], config: ChannelConfig, frames: int, presence: bytes) -> _Present:
    """Return the links of the agents that are present in each frame.

    Args:
        actors: All actors.
        config: Which links there are, and which antennas agents have.
        frames: Number of frames.
        presence: Bytes of flags, shape [frames, actors, 7]: whether a number of a pose is finite.
    """
    table, mount = _plan(actors, config)
    is_here = np.logical_and.reduce(np.frombuffer(presence, dtype=bool).reshape(frames, -1, 7), axis=2)
    batch_index, row = np.nonzero(is_here[:, table[:, 1]] & is_here[:, table[:, 2]])
    kind, tx_actor, rx_actor, tx_antenna, rx_antenna = (np.ascontiguousarray(column) for column in table[row].T)
    ends = batch_index.astype(np.int32), kind.astype(np.int8), tx_actor, rx_actor, tx_antenna, rx_antenna
    mounts = mounts_at(mount[:, row].reshape(-1, 7))
    return _Present(ends, np.tile(batch_index, 2), np.append(tx_actor, rx_actor), mounts)


@remembered(owners=2, size=8)
def _plan(actors: tuple[Actor, ...], config: ChannelConfig) -> tuple[np.ndarray, np.ndarray]:
    """Return the links that there can be, a row of `LinkEnds` each, [N, 5], and the mounts of both ends, [2, N, 7]."""
    identities = [actor.identity for actor in actors]
    ends = config.link_ends(identities)
    table = np.array(ends, dtype=np.int32).reshape(-1, len(LinkEnds._fields))
    antennas = config.antennas
    used = sorted({*zip(table[:, 1], table[:, 3], strict=True), *zip(table[:, 2], table[:, 4], strict=True)})
    pose = {(actor, antenna): antenna_pose(antennas[antenna], *identities[actor]) for actor, antenna in used}
    mount = [[pose[end] for end in zip(table[:, 1 + k], table[:, 3 + k], strict=True)] for k in range(2)]
    return table, np.array(mount, dtype=np.float64).reshape(2, -1, 7)
