"""Describe transmitters and receivers that are added to a scene."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from mmw.core.errors import InputError
from mmw.core.transforms import multiply, normalize, quaternion_exp

if TYPE_CHECKING:
    from mmw.channel.antennas.arrays import PlanarArray

AT_ORIGIN = (0.0, 0.0, 0.0)
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


class RadioDevice:
    """A transmitter or a receiver: a place, an attitude and an antenna array.

    A device stands in the world, or rides on an actor, in whose frame its position and orientation then are. Values may
    change at any time; the next computation sees them.
    """

    kind = "radio device"

    def __init__(
        self,
        name: str,
        position: ArrayLike = AT_ORIGIN,
        *,
        orientation: ArrayLike = UPRIGHT,
        velocity: ArrayLike = AT_ORIGIN,
        array: "PlanarArray | None" = None,
        actor: str | None = None,
        look_at: ArrayLike | None = None,
    ):
        """Describe a device.

        Args:
            name: Name, unique among the devices of its kind in a scene.
            position: Phase center of the array [m], shape [3]: in the world, or in the frame of `actor`.
            orientation: Device-to-world (or device-to-actor) quaternion (x, y, z, w), shape [4], of any length.
            velocity: Velocity in the world [m/s], shape [3]; beside that of the actor, if there is one.
            array: Antenna array; None uses `tx_array` or `rx_array` of the scene.
            actor: Name of the actor that carries the device; None for the world.
            look_at: Point that the x axis of the device looks at [m], shape [3], instead of `orientation`.

        Raises:
            InputError: If the name is empty, or a value is not finite or has another shape.
        """
        if not isinstance(name, str) or not name:
            raise InputError(f"{self.kind}: name = {name!r}; a text is needed; give one")
        self._name = name
        self.position = position
        self.orientation = orientation
        self.velocity = velocity
        self.array = array
        self.actor = actor
        if look_at is not None:
            self.look_at(look_at)

    def __repr__(self) -> str:
        carrier = f", actor={self.actor!r}" if self.actor else ""
        return f"{type(self).__name__}({self.name!r}, position={tuple(self._position.tolist())}{carrier})"

    @property
    def name(self) -> str:
        """Name of the device."""
        return self._name

    @property
    def position(self) -> np.ndarray:
        """Phase center of the array [m], shape [3]: in the world, or in the frame of the actor; a copy."""
        return self._position.copy()

    @position.setter
    def position(self, value: ArrayLike) -> None:
        self._position = finite_vector(f"{self.kind} {self.name!r}: position", value, 3)

    @property
    def orientation(self) -> np.ndarray:
        """Unit quaternion (x, y, z, w) from the device to the world, or to the actor, shape [4]; a copy."""
        return self._orientation.copy()

    @orientation.setter
    def orientation(self, value: ArrayLike) -> None:
        self._orientation = unit_quaternion(f"{self.kind} {self.name!r}: orientation", value)

    @property
    def velocity(self) -> np.ndarray:
        """Velocity in the world, beside that of the actor [m/s], shape [3]; a copy."""
        return self._velocity.copy()

    @velocity.setter
    def velocity(self, value: ArrayLike) -> None:
        self._velocity = finite_vector(f"{self.kind} {self.name!r}: velocity", value, 3)

    @property
    def array(self) -> "PlanarArray | None":
        """Antenna array; None uses that of the scene."""
        return self._array

    @array.setter
    def array(self, value: "PlanarArray | None") -> None:
        if value is not None and not hasattr(value, "element_positions"):
            raise InputError(
                f"{self.kind} {self.name!r}: array = {value!r}; a mmw.PlanarArray is needed; give one, or None"
            )
        self._array = value

    def look_at(self, target: ArrayLike) -> None:
        """Turn the x axis, the boresight of an array, to a point, without a roll.

        Args:
            target: The point [m], shape [3], in the frame of `position`.

        Raises:
            InputError: If the point is the position itself, or not finite.
        """
        where = f"{self.kind} {self.name!r}: look_at"
        self._orientation = facing(where, finite_vector(where, target, 3) - self._position)


class Transmitter(RadioDevice):
    """A transmitter.

    Examples:
        >>> import mmw
        >>> panel = mmw.PlanarArray(num_rows=4, num_cols=8, pattern="tr38901")
        >>> transmitter = mmw.Transmitter("bs", position=(13.5, -29.5, 10.0), power_dbm=30.0, array=panel)
        >>> transmitter.look_at((0.0, 0.0, 1.5))
        >>> transmitter
        Transmitter('bs', position=(13.5, -29.5, 10.0))
    """

    kind = "transmitter"

    def __init__(
        self,
        name: str,
        position: ArrayLike = AT_ORIGIN,
        *,
        orientation: ArrayLike = UPRIGHT,
        velocity: ArrayLike = AT_ORIGIN,
        power_dbm: float = 44.0,
        array: "PlanarArray | None" = None,
        actor: str | None = None,
        look_at: ArrayLike | None = None,
    ):
        """Describe a transmitter.

        Args:
            name: Name, unique among the transmitters of a scene.
            position: Phase center of the array [m], shape [3]: in the world, or in the frame of `actor`.
            orientation: Device-to-world (or device-to-actor) quaternion (x, y, z, w), shape [4], of any length.
            velocity: Velocity in the world [m/s], shape [3]; beside that of the actor, if there is one.
            power_dbm: Transmit power [dBm], for radio maps. Source of the default: Sionna RT 2.2.
            array: Antenna array; None uses `tx_array` of the scene.
            actor: Name of the actor that carries the device; None for the world.
            look_at: Point that the x axis of the device looks at [m], shape [3], instead of `orientation`.

        Raises:
            InputError: If the name is empty, or a value is not finite or has another shape.
        """
        super().__init__(
            name, position, orientation=orientation, velocity=velocity, array=array, actor=actor, look_at=look_at
        )
        self.power_dbm = power_dbm

    @property
    def power_dbm(self) -> float:
        """Transmit power [dBm]."""
        return self._power_dbm

    @power_dbm.setter
    def power_dbm(self, value: float) -> None:
        self._power_dbm = float(finite_vector(f"{self.kind} {self.name!r}: power_dbm", [value], 1)[0])


class Receiver(RadioDevice):
    """A receiver.

    Examples:
        >>> import mmw
        >>> mmw.Receiver("roof", position=(0.0, 0.0, 1.6), actor="cav_1")  # rides on a car, 1.6 m above its origin
        Receiver('roof', position=(0.0, 0.0, 1.6), actor='cav_1')
    """

    kind = "receiver"


def finite_vector(where: str, value: ArrayLike, count: int) -> np.ndarray:
    """Return numbers as a new float64 array, shape [count].

    Raises:
        InputError: If they have another shape, or one is not finite; `where` begins the message.
    """
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{where} = {value!r}; {count} numbers are needed; correct it") from None
    if array.shape != (count,) or not np.isfinite(array).all():
        shown = tuple(array.tolist()) if array.ndim == 1 and len(array) < 9 else f"an array of shape {array.shape}"
        raise InputError(f"{where} = {shown}; {count} finite numbers are needed; correct it")
    return array


def unit_quaternion(where: str, value: ArrayLike) -> np.ndarray:
    """Return a quaternion (x, y, z, w) of length 1, shape [4].

    Raises:
        InputError: If it has another shape, is not finite or is zero.
    """
    array = finite_vector(where, value, 4)
    if not array.any():
        raise InputError(f"{where} = (0, 0, 0, 0); a rotation is needed; give (0, 0, 0, 1) for none")
    return normalize(array)


def facing(where: str, direction: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return the quaternion that turns the x axis into a direction without a roll, shape [4].

    Raises:
        InputError: If the direction is zero.
    """
    x, y, z = (float(value) for value in direction)
    if not (x or y or z):
        raise InputError(f"{where}: the target is the position itself; a direction is needed; give another target")
    yaw, pitch = np.arctan2(y, x), -np.arctan2(z, np.hypot(x, y))
    return multiply(quaternion_exp(np.array([0.0, 0.0, yaw])), quaternion_exp(np.array([0.0, pitch, 0.0])))
