"""List the transmitters of a radio map: those of a scene, or the actors of a role."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from mmw.channel.antennas.arrays import PlanarArray
from mmw.channel.antennas.link_elements import configured_array
from mmw.config.antennas import AntennaConfig
from mmw.core.errors import InputError
from mmw.core.transforms import compose, make_pose, normalize, quaternion_to_matrix
from mmw.scene.mounted_antennas import antenna_pose
from mmw.scene.scene_data import SceneData


@dataclass(frozen=True, eq=False)
class Transmitters:
    """The transmitters of a map.

    Raises:
        InputError: If a field has another length than the names, a number is not finite, or precoding does not fit.
    """

    names: tuple[str, ...]
    position: np.ndarray
    """Phase center of the array, world frame [m], shape [T, 3], float64."""
    rotation: np.ndarray
    """Agent-to-world rotation, shape [T, 3, 3], float64; the array may be turned against its agent."""
    power_dbm: np.ndarray
    """Transmit power of each [dBm], shape [T]."""
    array: PlanarArray | tuple[PlanarArray, ...] = field(default_factory=PlanarArray)
    """The array that every transmitter has, or one for each."""
    precoding: ArrayLike | Sequence[ArrayLike | None] | None = None
    """Weights p of the antennas of each transmitter, shape [T, K], complex, or T rows of K_t, each of which may be
    None: the field is h^T p, p not conjugated. Equal weights of unit norm if None. The norm of p counts as gain."""

    def __post_init__(self) -> None:
        count = len(self.names)
        if not count:
            raise InputError("radio map: no transmitter; a map needs at least one; add one")
        shapes = {"position": (count, 3), "rotation": (count, 3, 3), "power_dbm": (count,)}
        for name, shape in shapes.items():
            values = np.asarray(getattr(self, name))
            if values.shape != shape or not np.isfinite(values).all():
                raise InputError(
                    f"radio map: {name} of shape {values.shape}; finite numbers of shape {shape} are needed for "
                    f"{count} transmitters; correct it"
                )
        if len(self.arrays) != count:
            raise InputError(f"radio map: {len(self.arrays)} arrays of {count} transmitters; give one, or one for each")
        _ = self.weights

    def __len__(self) -> int:
        return len(self.names)

    @property
    def arrays(self) -> tuple[PlanarArray, ...]:
        """Array of each transmitter, T of them."""
        return (self.array,) * len(self) if isinstance(self.array, PlanarArray) else tuple(self.array)

    @property
    def weights(self) -> list[np.ndarray]:
        """Weights of the antennas of each transmitter, T rows of shape [K_t], complex128."""
        rows = [None] * len(self) if self.precoding is None else list(self.precoding)  # pyright: ignore[reportArgumentType]
        if len(rows) != len(self):
            raise InputError(
                f"radio map: precoding of {len(rows)} rows; one row of weights for each of {len(self)} transmitters is "
                "needed; correct it"
            )
        return [
            _weights(name, array.antenna_count, row)
            for name, array, row in zip(self.names, self.arrays, rows, strict=True)
        ]

    def rows_by_array(self) -> list[np.ndarray]:
        """Return the rows of the transmitters that share an array, one row vector for each array."""
        rows: dict[int, list[int]] = {}
        for row, array in enumerate(self.arrays):
            rows.setdefault(id(array), []).append(row)
        return [np.array(own) for own in rows.values()]


def _weights(name: str, count: int, given: ArrayLike | None) -> np.ndarray:
    """Return the weights of a transmitter of `count` antennas, shape [count], complex128."""
    if given is None:
        return np.full(count, count**-0.5, dtype=np.complex128)
    try:
        weight = np.asarray(given, dtype=np.complex128)
    except (TypeError, ValueError):
        weight = np.full(1, np.nan + 0j)
    if weight.shape != (count,) or not np.isfinite(weight).all() or not weight.any():
        raise InputError(
            f"transmitter {name!r}: precoding of shape {weight.shape}; {count} finite numbers are needed, one for each "
            "antenna of its array, not all 0; correct it"
        )
    return weight


def named_precoding(
    names: Sequence[str], precoding: Mapping[str, ArrayLike] | ArrayLike | None
) -> Sequence[ArrayLike | None] | None:
    """Return precoding as one row for each transmitter.

    Args:
        names: Names of the transmitters, T of them.
        precoding: Weights by name, equal ones for those that are not there; or weights for all, shape [K], or for each
            in the order of the names, shape [T, K]; None for equal ones.

    Raises:
        InputError: If a name is no transmitter, or the weights are no numbers.
    """
    if precoding is None:
        return None
    if isinstance(precoding, Mapping):
        unknown = [name for name in precoding if name not in names]
        if unknown:
            raise InputError(
                f"radio map: precoding of {unknown[0]!r}; there is no such transmitter; use {', '.join(names)}"
            )
        return [precoding.get(name) for name in names]
    try:
        rows = np.asarray(precoding, dtype=np.complex128)
    except (TypeError, ValueError):
        raise InputError(
            "radio map: precoding is no array of numbers; weights of shape [K] or [T, K] are needed, or a dict of "
            "transmitter -> weights; correct it"
        ) from None
    return [rows] * len(names) if rows.ndim < 2 else list(rows)


def actor_transmitters(
    arrays: SceneData,
    frame: int,
    *,
    antennas: Sequence[AntennaConfig] = (AntennaConfig(),),
    roles: Sequence[str] = ("rsu", "bs"),
    power_dbm: float | None = None,
) -> Transmitters:
    """Return the antennas of the agents of some roles that are present in a frame, as transmitters.

    A transmitter has the name of its agent, with that of the antenna behind it (`rsu_1.sector_2`) where the agent has
    several.

    Args:
        arrays: The scene.
        frame: Frame number.
        antennas: Antennas of the agents.
        roles: Roles of the agents.
        power_dbm: Transmit power of each [dBm]; None for that of its antenna.

    Raises:
        InputError: If the scene does not cover the frame, or has no such agent with an antenna in it.
    """
    pose = arrays.poses[arrays.frame_row(frame)]
    rows = [i for i, actor in enumerate(arrays.actors) if actor.role in roles and np.isfinite(pose[i]).all()]
    found: list[tuple[str, np.ndarray, AntennaConfig]] = []
    for row in rows:
        agent = arrays.actors[row].identity
        own = [antenna for antenna in antennas if antenna.is_on(*agent)]
        unit = make_pose(pose[row, :3], normalize(pose[row, 3:]))
        for antenna in own:
            name = agent[1] if len(own) == 1 else f"{agent[1]}.{antenna.name}"
            found.append((name, compose(unit, antenna_pose(antenna, *agent)), antenna))
    if not found:
        raise InputError(
            f"frame {frame}: no actor of role {' or '.join(map(repr, roles))} has an antenna; a map needs a "
            "transmitter; add one to the scenario"
        )
    place = np.array([pose for _, pose, _ in found])
    power = [antenna.power_dbm if power_dbm is None else power_dbm for _, _, antenna in found]
    return Transmitters(
        names=tuple(name for name, _, _ in found),
        position=place[:, :3],
        rotation=quaternion_to_matrix(place[:, 3:]),
        power_dbm=np.array(power, dtype=np.float64),
        array=tuple(configured_array(antenna) for _, _, antenna in found),
    )
