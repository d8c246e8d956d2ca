"""Hold the scene on the host: plain arrays, made by `read_stage` from a USD stage or by tests from code."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from mmw.config.agent_keys import AgentIdentity, Body
from mmw.config.foliage import FoliageModel
from mmw.core.constants import FRAME_RATE_HZ
from mmw.core.frame_rate import pose_stride
from mmw.physics.materials.material import Material

MODEL_NONE = -1
"""`Actor.model` of an actor without geometry, such as a roadside unit that is only a pose."""


@dataclass(frozen=True)
class Prototype:
    """One vehicle shape, shared by all actors that look the same, in the actor's frame."""

    name: str
    points: np.ndarray
    """Vertices in the frame of the actor [m], shape [N, 3], float64."""
    faces: np.ndarray
    """Triangles, counter-clockwise from outside, shape [M, 3], int32."""
    material: np.ndarray
    """Material id of each face, shape [M], int32."""
    surface: np.ndarray
    """Local surface index of each face, 0 to K - 1, shape [M], int32."""
    wheels: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))
    """Wheels: center x, y, z in the frame of the actor [m] and radius [m], shape [W, 4], float64. A wheel turns about
    the actor's y axis through its center."""
    wheel: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    """Wheel of each face, -1 for a face that is fixed to the body, shape [M], int32; by default no face turns."""
    uv: np.ndarray = field(default_factory=lambda: np.zeros((0, 3, 2), dtype=np.float32))
    """Texture coordinates of the corners of each face, shape [M, 3, 2], float32; zeros where there are none."""
    normals: np.ndarray = field(default_factory=lambda: np.zeros((0, 3, 3), dtype=np.float32))
    """Unit normals at the corners of each face in the actor's frame, shape [M, 3, 3], float32; zeros: it is flat."""

    def __post_init__(self) -> None:
        _fill_corners(self, f"model {self.name}")
        if len(self.wheel) == 0:
            object.__setattr__(self, "wheel", np.full(len(self.faces), -1, dtype=np.int32))
        if len(self.wheel) != len(self.faces):
            raise ValueError(
                f"model {self.name}: wheel has {len(self.wheel)} rows; the model has {len(self.faces)} faces; "
                "give every face a wheel, or -1"
            )
        if self.wheel.max(initial=-1) >= len(self.wheels) or self.wheel.min(initial=0) < -1:
            raise ValueError(
                f"model {self.name}: wheel {self.wheel.max(initial=-1)} of a face; the model has {len(self.wheels)} "
                "wheels; number them from 0, or -1 for none"
            )
        if not (self.wheels[:, 3] > 0.0).all():
            raise ValueError(f"model {self.name}: a wheel's radius is not above 0 m; give the radius of its tyre")


def _fill_corners(shape: "Prototype | SceneData", where: str) -> None:
    """Fill missing texture coordinates or normals with zeros, and check that no face lacks them."""
    for name, values in (("uv", 2), ("normals", 3)):
        found, needed = getattr(shape, name), (len(shape.faces), 3, values)
        if len(found) == 0:
            object.__setattr__(shape, name, np.zeros(needed, dtype=np.float32))
        elif found.shape != needed:
            raise ValueError(
                f"{where}: {name} has shape {found.shape}; its faces need {needed}; give every corner a row, or none"
            )


@dataclass(frozen=True)
class SceneObject:
    """Object that an `object_id` refers to."""

    object_id: int
    prim_path: str
    label: str
    """Semantic class, a key of `CARLA_TAG`."""
    tag: int
    """CARLA tag of the label."""
    materials: tuple[str, ...]
    """Names of the materials on its faces, sorted."""
    actor: str = ""
    """Name of the actor, empty for the static town."""


@dataclass(frozen=True)
class Actor:
    """An actor that moves, or an infrastructure unit that carries sensors."""

    name: str
    role: str
    """One of `mmw.usd.actors.ROLES`; `free` for a pose in the world that a single sample is taken at."""
    prim_path: str
    model: int
    """Index into `SceneData.models`, -1 for an actor without geometry."""
    object_id: int
    size: tuple[float, float, float]
    """Length, width and height of the box [m]."""
    center: tuple[float, float, float]
    """Middle of the box in the actor's frame [m]."""
    label: str
    is_parked: bool = False
    """True if it is a parked vehicle, whose lamps are always off."""
    model_name: str = ""
    """Name of its model, such as `city_bus`."""

    @property
    def identity(self) -> AgentIdentity:
        """Role, name, model, class and body: what sensors choose agents by, see `SensorConfig.is_on`."""
        return AgentIdentity(self.role, self.name, self.model_name, self.label, Body.of_box(self.size, self.center))


@dataclass(frozen=True)
class SceneData:
    """One scenario: a static town, models, and where the actors are in every frame. World frame, meters."""

    points: np.ndarray
    """Town vertices [m], shape [N, 3], float64."""
    faces: np.ndarray
    """Town triangles, shape [M, 3], int32."""
    material: np.ndarray
    """Material id of each town face, shape [M], int32."""
    object_id: np.ndarray
    """Object id of each town face, shape [M], int32."""
    surface: np.ndarray
    """Surface id of each town face, 0 to Ns - 1, shape [M], int32."""
    models: tuple[Prototype, ...]
    actors: tuple[Actor, ...]
    frames: range
    """Frames that `poses` covers, F of them, consecutive."""
    poses: np.ndarray
    """Actor-to-world (x, y, z, qx, qy, qz, qw), shape [(F - 1) S + 1, V, 7], float64; NaN where an actor is absent. S
    is `pose_stride`: derivatives take neighboring rows, `pose_dt` apart, which is at most 10 ms at any frame rate."""
    materials: dict[str, tuple[Material, ...]]
    """Weather -> materials by id; an id means the same prim in every weather."""
    objects: tuple[SceneObject, ...] = field(default=())
    """Objects by id."""
    uv: np.ndarray = field(default_factory=lambda: np.zeros((0, 3, 2), dtype=np.float32))
    """Texture coordinates of the corners of each town face, shape [M, 3, 2], float32; zeros where there are none."""
    normals: np.ndarray = field(default_factory=lambda: np.zeros((0, 3, 3), dtype=np.float32))
    """Unit normals at the corners of each town face, world frame, shape [M, 3, 3], float32; zeros: it is flat."""
    look_notes: tuple[str, ...] = ()
    """Notes for users of the RGB camera on the stage's materials, one line each."""
    sensing: frozenset[str] | None = None
    """Names of the agents whose sensors are traced; None for all of them."""
    material_notes: tuple[str, ...] = ()
    """Notes on the user's material map, one line each."""
    rate_hz: int = FRAME_RATE_HZ
    """Frames a second."""
    foliage: FoliageModel = "hull"
    """Crowns of trees of the static world as light and radar meet them, see `mmw.config.foliage`."""

    def __post_init__(self) -> None:
        _fill_corners(self, "the town")
        shape = (self.pose_rows(len(self.frames)), len(self.actors), 7)
        if self.poses.shape != shape:
            raise ValueError(f"poses have shape {self.poses.shape}; the scene's frames and actors need {shape}")
        if self.frames.step != 1:
            raise ValueError(f"frames in steps of {self.frames.step}; poses are those of all frames; give every frame")
        for name in ("material", "object_id", "surface"):
            if len(getattr(self, name)) != len(self.faces):
                raise ValueError(f"{name} has {len(getattr(self, name))} rows; the town has {len(self.faces)} faces")

    @property
    def town_surface_count(self) -> int:
        """Ns, the number of surfaces of the static town."""
        return int(self.surface.max()) + 1 if len(self.surface) else 0

    @property
    def pose_stride(self) -> int:
        """S, rows of `poses` from one frame to the next."""
        return pose_stride(self.rate_hz)

    @property
    def pose_dt(self) -> float:
        """Time between neighboring rows of `poses` [s]."""
        return 1.0 / (self.rate_hz * self.pose_stride)

    @property
    def frame_poses(self) -> np.ndarray:
        """The rows of `poses` that are frames, shape [F, V, 7]."""
        return self.poses[:: self.pose_stride]

    def pose_rows(self, frame_count: int) -> int:
        """Return the rows of poses from the first to the last of a number of consecutive frames."""
        return max((frame_count - 1) * self.pose_stride + 1, 0)

    def numbers(self, frames: ArrayLike) -> np.ndarray:
        """Return the numbers that some of `frames` have in their scenario, by which samples and times go, int64."""
        return np.asarray(frames, dtype=np.int64)

    def seeds(self, frames: Sequence[int] | np.ndarray, seed: int) -> list[int]:
        """Return the seed of the random numbers of each of some frames; `seed` is that of the configuration."""
        return [seed] * len(frames)

    def at(self, frames: range, poses: np.ndarray) -> Self:
        """Return the scene in other frames, with poses as of `poses`; all else is shared and not checked again."""
        if len(poses) != self.pose_rows(len(frames)) or poses.shape[1:] != self.poses.shape[1:]:
            raise ValueError(f"poses have shape {poses.shape}; {len(frames)} frames of these actors need another one")
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__, frames=frames, poses=poses)
        return other

    def frame_row(self, frame: int) -> int:
        """Return the row of `poses` that holds a frame.

        Raises:
            ValueError: If the scene does not cover the frame.
        """
        if frame not in self.frames:
            first, last = (self.frames[0], self.frames[-1]) if self.frames else ("none", "none")
            raise ValueError(f"frame {frame} is not in the scene, which covers {first} to {last}; read more frames")
        return self.frames.index(frame) * self.pose_stride

    def frame_rows(self, frames: ArrayLike) -> np.ndarray:
        """Return the rows of `poses` that hold some frames, int64; errors as of `frame_row`."""
        if isinstance(frames, (tuple, list, range)) and len(frames) == 1:
            return np.array([self.frame_row(int(frames[0]))])
        found = np.asarray(frames, dtype=np.int64)
        outside = (found < self.frames.start) | (found >= self.frames.stop)
        if outside.any():
            self.frame_row(int(found[outside][0]))
        return (found - self.frames.start) * self.pose_stride
