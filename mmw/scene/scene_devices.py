"""Hold the transmitters and receivers of a scene, and compute where they are."""

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from mmw.core.errors import InputError
from mmw.core.registry import load_reference
from mmw.core.transforms import quaternion_to_matrix
from mmw.scene.mounted_antennas import RadioDevices, mounted_antennas, mounts_at
from mmw.scene.named_items import NamedItems
from mmw.scene.radio_devices import RadioDevice, Receiver, Transmitter
from mmw.scene.scene_state import SceneState

if TYPE_CHECKING:
    from mmw.channel.antennas.arrays import PlanarArray


class SceneDevices:
    """Transmitters and receivers of a scene by name, in the order in which they were added."""

    def __init__(self, state: SceneState):
        """Start without any."""
        self._state = state
        self._transmitters: NamedItems[Transmitter] = NamedItems("transmitter")
        self._receivers: NamedItems[Receiver] = NamedItems("receiver")

    @property
    def transmitters(self) -> dict[str, Transmitter]:
        """Transmitters by name; a copy."""
        return NamedItems("transmitter", self._transmitters)

    @property
    def receivers(self) -> dict[str, Receiver]:
        """Receivers by name; a copy."""
        return NamedItems("receiver", self._receivers)

    def add(self, device: RadioDevice) -> None:
        """Add a transmitter or a receiver.

        Raises:
            InputError: If it is neither, the name is taken, or the scene is closed.
        """
        name, _ = self._state.name, self._state.data
        if isinstance(device, Transmitter):
            known = self._transmitters
        elif isinstance(device, Receiver):
            known = self._receivers
        else:
            raise InputError(f"scene {name!r}: add({device!r}); a mmw.Transmitter or mmw.Receiver is needed; give one")
        if device.name in known:
            raise InputError(
                f"{device.kind} {device.name!r}: the scene has one of this name; rename it, or remove the other"
            )
        known[device.name] = device

    def remove(self, name: str) -> None:
        """Remove a transmitter or a receiver, or both if both have the name.

        Raises:
            InputError: If there is none, or the scene is closed.
        """
        scene, _ = self._state.name, self._state.data
        found = [devices.pop(name, None) for devices in (self._transmitters, self._receivers)]
        if found == [None, None]:
            listed = ", ".join((*self._transmitters, *self._receivers)) or "none"
            raise InputError(f"scene {scene!r}: no transmitter or receiver {name!r}; it has {listed}; name one")


@cache
def default_array() -> "PlanarArray":
    """Return the array of a device without one: a vertical short dipole."""
    return load_reference("mmw.channel.antennas.arrays:PlanarArray")()


def antenna_states(state: SceneState, devices: Sequence[RadioDevice]) -> RadioDevices:
    """Return where the phase centers of devices are in the current frame, how they are turned and move.

    Raises:
        InputError: If an actor is not in the scene, or absent in the frame.
    """
    count, arrays = len(devices), state.arrays
    position, velocity, rotation = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3, 3))
    riders = [row for row, device in enumerate(devices) if device.actor is not None]
    if riders:
        actor = np.array([device_actor(state, devices[row]) for row in riders])
        mount = np.stack([devices[row].position for row in riders])
        rows, first = np.array([arrays.frame_row(state.frame)]), np.zeros(len(riders), dtype=np.int64)
        found = mounted_antennas(arrays, rows, first, actor, mounts_at(mount))
        position[riders], rotation[riders], velocity[riders] = found.position, found.rotation, found.velocity
    for row, device in enumerate(devices):
        turn, extra = device.orientation, device.velocity
        if device.actor is None:
            position[row], rotation[row], velocity[row] = device.position, quaternion_to_matrix(turn), extra
        else:  # left alone where nothing is added, so that rows equal those of a run bit for bit
            if turn[:3].any():
                rotation[row] = rotation[row] @ quaternion_to_matrix(turn)
            velocity[row] += extra
    return RadioDevices(position, rotation, velocity)


def device_actor(state: SceneState, device: RadioDevice) -> int:
    """Return the index of the actor that carries a device, -1 for none.

    Raises:
        InputError: If the actor is not in the scene, or absent in the current frame.
    """
    if device.actor is None:
        return -1
    actors = NamedItems("actor", {actor.name: index for index, actor in enumerate(state.arrays.actors)})
    index = actors[device.actor]
    if not np.isfinite(state.arrays.poses[state.arrays.frame_row(state.frame), index]).all():
        raise InputError(
            f"{device.kind} {device.name!r}: actor {device.actor!r} is absent in frame {state.frame}; choose another "
            "frame, or another actor"
        )
    return index
