"""Gather the strongest paths as lines with gains, and check that they belong to the scene they are drawn in."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mmw.channel.scene_paths import Paths
from mmw.core.errors import InputError
from mmw.scene.scene import Scene
from mmw.viz.plots.paths import gain_limits, gains_db

MOVED_M = 1e-3
"""Distance between an antenna of the paths and that of the scene beyond which it has moved [m]. Design value."""


@dataclass(frozen=True)
class PathLines:
    """Paths as lines from transmitter to receiver, the weakest first."""

    carrier_hz: float
    """Carrier of the gains [Hz]."""
    lines: tuple[np.ndarray, ...]
    """Antennas and interactions of each path, world frame [m], shape [2 + interactions, 3] each."""
    gain_db: np.ndarray
    """Gain of each path, 20 log10 |a| [dB], shape [P], float64; growing."""
    kind: np.ndarray
    """Kind of each path, such as `specular`, shape [P]."""
    interactions: tuple[tuple[int, ...], ...]
    """Interactions of each path in order, numbers in `PATH_MARKS`."""
    tau_s: np.ndarray
    """Delay of each path [s], shape [P], float64."""
    departure: np.ndarray
    """Azimuth of departure of each path, from east [rad], shape [P], float64."""
    arrival: np.ndarray
    """Azimuth of arrival, from the receiver back along the path [rad], shape [P], float64."""
    tx: np.ndarray
    """Name of the transmitter of each path, shape [P]."""
    rx: np.ndarray
    """Name of the receiver of each path, shape [P]."""
    transmitters: Mapping[str, np.ndarray]
    """Transmitter -> position of its antenna, world frame [m], shape [3]."""
    receivers: Mapping[str, np.ndarray]
    """Receiver -> position of its antenna, world frame [m], shape [3]."""
    total: int
    """Number of paths before the weakest were left out."""

    def __len__(self) -> int:
        """Return the number of paths."""
        return len(self.lines)

    @property
    def limits_db(self) -> tuple[float, float]:
        """Ends of the color scale of the gains [dB]; (-1, 0) without any path."""
        return gain_limits(self.gain_db) if len(self) else (-1.0, 0.0)

    @property
    def share(self) -> np.ndarray:
        """Place of each gain on the color scale, 0 to 1, shape [P], float64."""
        low, high = self.limits_db
        return np.clip((self.gain_db - low) / (high - low), 0.0, 1.0)

    @property
    def labels(self) -> list[str]:
        """Kind and gain of each path for people."""
        return [f"{kind}, {gain:.1f} dB" for kind, gain in zip(self.kind, self.gain_db, strict=True)]


def choose_paths(
    paths: Paths, *, carrier_hz: float | None = None, max_paths: int | None = None, scene: Scene | None = None
) -> PathLines:
    """Return the strongest paths at a carrier.

    Args:
        paths: Paths of a solver.
        carrier_hz: Carrier of the gains [Hz]; None means the first.
        max_paths: Number of paths at most; None keeps all.
        scene: Scene that they are drawn in; None checks nothing.

    Raises:
        InputError: If the carrier is not there, the number is below 0, or the paths are of another scene.
    """
    carriers = np.asarray(paths.carriers_hz, dtype=np.float64)
    column = np.flatnonzero(carriers == carrier_hz) if carrier_hz is not None else np.zeros(1, dtype=int)
    if not len(column):
        known = ", ".join(f"{carrier:g}" for carrier in carriers)
        raise InputError(f"paths: carrier_hz = {carrier_hz:g}; they have {known} Hz; name one of these")
    if max_paths is not None and not (isinstance(max_paths, int | np.integer) and max_paths >= 0):
        raise InputError(f"paths: max_paths = {max_paths!r}; a whole number from 0 on is needed; correct it")
    transmitters = {name: paths.tx_positions[index] for index, name in enumerate(paths.tx_names)}
    receivers = {name: paths.rx_positions[index] for index, name in enumerate(paths.rx_names)}
    if scene is not None:
        _check_scene(scene, paths, transmitters, receivers)
    gain_db = gains_db(paths.a[:, column[0]])
    order = np.argsort(gain_db, kind="stable")
    order = order[max(len(order) - max_paths, 0) :] if max_paths is not None else order
    tx, rx, lines = paths.tx[order], paths.rx[order], []
    for path, one, other in zip(order, tx, rx, strict=True):
        inner = paths.vertices[path, : paths.depth[path]]
        lines.append(np.stack([paths.tx_positions[one], *inner, paths.rx_positions[other]]))
    return PathLines(
        carrier_hz=float(carriers[column[0]]),
        lines=tuple(lines),
        gain_db=gain_db[order],
        kind=paths.kind[order],
        interactions=tuple(tuple(paths.interaction_types[path, : paths.depth[path]].tolist()) for path in order),
        tau_s=paths.tau[order],
        departure=paths.phi_t[order],
        arrival=paths.phi_r[order],
        tx=np.array(paths.tx_names, dtype=str)[tx],
        rx=np.array(paths.rx_names, dtype=str)[rx],
        transmitters=transmitters,
        receivers=receivers,
        total=len(paths.tau),
    )


def _check_scene(
    scene: Scene, paths: Paths, transmitters: Mapping[str, np.ndarray], receivers: Mapping[str, np.ndarray]
) -> None:
    """Raise InputError unless the scene has the frame of paths, and their antennas in their places."""
    if paths.scenario != scene.name or paths.frame != scene.frame:
        raise InputError(
            f"paths: they are of scene {paths.scenario!r}, frame {paths.frame}; the scene is {scene.name!r}, frame "
            f"{scene.frame}; draw paths in the scene and frame that they were solved in"
        )
    for kind, known, used in (
        ("transmitter", scene.transmitters, transmitters),
        ("receiver", scene.receivers, receivers),
    ):
        for name, place in used.items():
            if name not in known:
                raise InputError(
                    f"paths: {kind} {name!r} is not in scene {scene.name!r}, which has {', '.join(known) or 'none'}; "
                    "draw paths in the scene that they were solved in"
                )
            now = scene.antenna_state(known[name])[0]
            if not np.linalg.norm(now - place) <= MOVED_M:
                was, now = (tuple(np.round(point, 3).tolist()) for point in (place, now))
                raise InputError(
                    f"paths: {kind} {name!r} was at {was} m when they were solved, and is at {now} m in scene "
                    f"{scene.name!r}; solve the paths again"
                )
