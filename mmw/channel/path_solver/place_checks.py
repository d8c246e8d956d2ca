"""Refuse transmitters and receivers that are inside objects."""

from collections.abc import Sequence

import numpy as np

from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.channel.radio_ends import RadioEnds
from mmw.core.errors import InputError
from mmw.scene.enclosing_objects import EnclosingQuery
from mmw.scene.scene import Scene


class PlaceCheck:
    """Check of the places of devices. Places that were checked before are not checked again."""

    def __init__(self, scene: Scene, ends: Sequence[tuple[str, RadioEnds]], table: SurfaceTable):
        """Begin the check; the device works on it while the paths are traced.

        Args:
            scene: The scene.
            ends: `transmitter` or `receiver`, and the devices of that kind.
            table: Surfaces that stop waves.
        """
        self._scene, self._ends = scene, ends
        self._kept: dict[int, dict[bytes, int]] = scene.cached(
            ("object around each place", table.foliage is None), dict
        )
        known = self._kept.get(scene.version, {})
        places = {place.tobytes(): place for _, own in ends for place in own.state.position}
        self._known = {key: known[key] for key in places if key in known}
        new = {key: place for key, place in places.items() if key not in known}
        self._new = list(new)
        on_device = scene.device_scene
        struct = table.scene_struct(on_device)
        self._query = EnclosingQuery(on_device, np.array(list(new.values())), struct) if new else None

    def finish(self) -> None:
        """Wait for the answer.

        Raises:
            InputError: If a device is inside an object.
        """
        if self._query is not None:
            self._known |= dict(zip(self._new, self._query.object_ids().tolist(), strict=True))
        self._kept.clear()
        self._kept[self._scene.version] = self._known  # of these places only, so that it stays small
        for kind, own in self._ends:
            for name, place in zip(own.names, own.state.position, strict=True):
                object_id = self._known[place.tobytes()]
                if object_id >= 0:
                    what = self._scene.arrays.objects[object_id]
                    raise InputError(
                        f"{kind} {name!r}: position = {tuple(place.round(3).tolist())} is inside {what.prim_path} "
                        f"({what.label}); no wave leaves a closed object; move it, or use "
                        "PathSolver(check_places=False)"
                    )
