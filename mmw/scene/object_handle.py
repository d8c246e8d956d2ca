"""Read and change an object of a scene: its pose, motion and material."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from mmw.core.errors import InputError
from mmw.core.transforms import compose, normalize
from mmw.scene.radio_devices import finite_vector, unit_quaternion
from mmw.scene.scene_data import SceneObject
from mmw.scene.scene_edits import actor_of

if TYPE_CHECKING:
    from mmw.scene.scene_state import SceneState


class ObjectHandle:
    """An object of a scene: an actor, or a part of the static town, which becomes an actor when it is moved.

    An actor of a recording follows its track until its pose or velocity is set. Then it moves in a straight line
    through that pose, at rest unless a velocity is set, until `scene.frame` is set.

    Examples:
        >>> import mmw
        >>> scene = mmw.load_scene("town03")
        >>> house = scene.objects["b_086"]
        >>> house.label, house.is_static, house.size.round().tolist()
        ('building', True, [28.0, 25.0, 28.0])
    """

    def __init__(self, scene: "SceneState", object_id: int):
        """Refer to an object of a scene by its row of `objects`; `scene.actors` and `scene.objects` do this."""
        self._scene = scene
        self._object_id = object_id

    def __repr__(self) -> str:
        return f"<object {self.name!r}, id {self._object_id}, {self.label}, at {self.position.round(2).tolist()}>"

    @property
    def object_id(self) -> int:
        """Row of `objects`: what sensors and paths report."""
        return self._object_id

    @property
    def name(self) -> str:
        """Name of the actor, or the last part of the prim path."""
        row = self._row
        return row.actor or row.prim_path.rpartition("/")[2]

    @property
    def prim_path(self) -> str:
        """Path of the USD prim."""
        return self._row.prim_path

    @property
    def label(self) -> str:
        """Semantic class, such as `building`."""
        return self._row.label

    @property
    def role(self) -> str:
        """Role of an actor: `cav`, `vehicle`, `rsu`, `pedestrian` or `object`; empty for the static town."""
        index = self._actor
        return "" if index < 0 else self._scene.arrays.actors[index].role

    @property
    def is_static(self) -> bool:
        """True if it is a part of the static town."""
        return self._actor < 0

    @property
    def is_present(self) -> bool:
        """True if it is there in the current frame."""
        return bool(np.isfinite(self._pose()).all())

    @property
    def materials(self) -> tuple[str, ...]:
        """Names of the materials on its faces, sorted."""
        return self._row.materials

    @property
    def size(self) -> np.ndarray:
        """Extent along the axes of its frame [m], shape [3]."""
        index = self._actor
        if index >= 0:
            return np.array(self._scene.arrays.actors[index].size)
        low, high = self._box()
        return high - low

    @property
    def pose(self) -> np.ndarray:
        """Object to world (x, y, z, qx, qy, qz, qw) in the current frame, shape [7]; NaN where it is absent.

        Of a part of the town it is the middle of its box, without a rotation.
        """
        return self._pose()

    @pose.setter
    def pose(self, value: ArrayLike) -> None:
        where = f"object {self.name!r}: pose"
        pose = finite_vector(where, value, 7)
        self._move(np.concatenate([pose[:3], unit_quaternion(f"{where}, quaternion", pose[3:])]))

    @property
    def position(self) -> np.ndarray:
        """Origin in the world in the current frame [m], shape [3]."""
        return self._pose()[:3]

    @position.setter
    def position(self, value: ArrayLike) -> None:
        position = finite_vector(f"object {self.name!r}: position", value, 3)
        self._move(np.concatenate([position, self._there()[3:]]))

    @property
    def orientation(self) -> np.ndarray:
        """Unit quaternion (x, y, z, w) to the world in the current frame, shape [4]."""
        return self._pose()[3:]

    @orientation.setter
    def orientation(self, value: ArrayLike) -> None:
        turned = unit_quaternion(f"object {self.name!r}: orientation", value)
        self._move(np.concatenate([self._there()[:3], turned]))

    @property
    def velocity(self) -> np.ndarray:
        """Velocity of the origin in the world [m/s], shape [3]."""
        return self._scene.object_motion(self._object_id)[0]

    @velocity.setter
    def velocity(self, value: ArrayLike) -> None:
        velocity = finite_vector(f"object {self.name!r}: velocity", value, 3)
        self._scene.move_object(self._object_id, self._there(), velocity, self.angular_velocity)

    @property
    def angular_velocity(self) -> np.ndarray:
        """Angular velocity about the axes of the world [rad/s], shape [3]."""
        return self._scene.object_motion(self._object_id)[1]

    @angular_velocity.setter
    def angular_velocity(self, value: ArrayLike) -> None:
        rate = finite_vector(f"object {self.name!r}: angular_velocity", value, 3)
        self._scene.move_object(self._object_id, self._there(), self.velocity, rate)

    @property
    def material(self) -> str:
        """Name of its only material.

        Raises:
            InputError: If it has several; `materials` lists them.
        """
        if len(self.materials) != 1:
            raise InputError(
                f"object {self.name!r}: has {len(self.materials)} materials; `material` is of an object with one; "
                "read `materials`"
            )
        return self.materials[0]

    @material.setter
    def material(self, name: str) -> None:
        self._scene.paint_object(self._object_id, name)

    def clone(self, name: str, position: ArrayLike | None = None) -> "ObjectHandle":
        """Add another actor of the same shape, materials and role to the scene, and return it.

        Args:
            name: Name of the new actor, not taken yet.
            position: Its place in the world [m], shape [3]; None for where this one is.

        Raises:
            InputError: If the name is taken, or the position is not finite.
        """
        pose = self._there()
        if position is not None:
            pose = np.concatenate([finite_vector(f"object {name!r}: position", position, 3), pose[3:]])
        return ObjectHandle(self._scene, self._scene.clone_object(self._object_id, name, pose))

    def remove(self) -> None:
        """Take the object out of the scene."""
        self._scene.remove_object(self._object_id)

    def to_world(self, pose: ArrayLike) -> np.ndarray:
        """Return a pose in the object's frame as one in the world, shape [7]."""
        return compose(self._there(), finite_vector(f"object {self.name!r}: to_world", pose, 7))

    @property
    def _row(self) -> SceneObject:
        return self._scene.object_row(self._object_id)

    @property
    def _actor(self) -> int:
        return actor_of(self._scene.arrays, self._row.object_id)

    def _box(self) -> tuple[np.ndarray, np.ndarray]:
        arrays = self._scene.arrays
        points = arrays.points[arrays.faces[arrays.object_id == self._object_id]].reshape(-1, 3)
        return points.min(axis=0), points.max(axis=0)

    def _pose(self) -> np.ndarray:
        index, arrays = self._actor, self._scene.arrays
        if index < 0:
            low, high = self._box()
            return np.array([*(0.5 * (low + high)), 0.0, 0.0, 0.0, 1.0])
        pose = arrays.poses[arrays.frame_row(self._scene.frame), index].copy()
        return np.concatenate([pose[:3], normalize(pose[3:])]) if np.isfinite(pose).all() else pose

    def _there(self) -> np.ndarray:
        pose = self._pose()
        if not np.isfinite(pose).all():
            raise InputError(
                f"object {self.name!r}: is absent in frame {self._scene.frame}; a pose is needed; set its whole pose"
            )
        return pose

    def _move(self, pose: np.ndarray) -> None:
        still = np.zeros(3), np.zeros(3)  # a velocity that was set stays, that of a recording does not
        motion = self._scene.object_motion(self._object_id) if self._scene.is_moved(self._object_id) else still
        self._scene.move_object(self._object_id, pose, *motion)
