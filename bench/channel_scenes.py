"""Scenes of the channel benchmark: a static scene, one transmitter, and antennas that drive along streets."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh

from bench.scenes import shipped_town
from mmw.channel.links import Links
from mmw.core.planar_surfaces import find_surfaces
from mmw.physics.materials.material import Material, RadioMaterial
from mmw.scene.mounted_antennas import RadioDevices
from mmw.scene.scene_data import SceneData, SceneObject

SPEED_MPS = 10.0
"""Speed of everything that drives [m/s]."""

FRAME_S = 0.01
"""Time from frame to frame [s]."""

HEIGHT_M = 1.5
"""Height of the driving antennas above level ground [m]."""

SLAB_M = 0.1
"""Thickness of a wall where the scene gives none [m]; it is the one that Sionna RT gives its own scenes."""

VEHICLES_V2I = 3
"""Receivers of the transmitter; `V2V` has one vehicle more."""

REFERENCE = Path(__file__).resolve().parent.parent / "tests" / "reference" / "sionna"


@dataclass(frozen=True)
class ObjectMesh:
    """One object of a scene that does not come from USD."""

    name: str
    itu: str
    """Name in ITU-R P.2040, such as `concrete`."""
    thickness: float
    """Thickness of the slab [m]."""
    points: np.ndarray
    """Vertices [m], shape [N, 3]."""
    faces: np.ndarray
    """Triangles, shape [M, 3]."""


@dataclass(frozen=True)
class Tracks:
    """Places of antennas: one that stands, and straight tracks along streets."""

    tx: tuple[float, float, float]
    """Transmitter, world frame [m]."""
    start: tuple[tuple[float, float], ...]
    """First place of each vehicle, x and y [m]."""
    heading: tuple[tuple[float, float], ...]
    """Direction of each, x and y, any length."""


TRACKS = {
    "street": Tracks((-33.0, 0.0, 32.0), ((20, 3.3), (-60, 2), (5, -3), (60, -4)), ((1, 0), (1, 0), (-1, 0), (-1, 0))),
    "munich": Tracks(
        (8.5, 21.0, 27.0),
        ((45, 90), (-37, 30), (85, 25), (10, 75)),
        ((0.957, -0.29), (0.287, 0.958), (0.29, 0.957), (0.957, -0.29)),
    ),
    "town03": Tracks(
        (13.5, -29.5, 4.0), ((-2, 45), (-45, -2.3), (50, -6), (2, -60)), ((0, 1), (-1, 0), (1, 0), (0, -1))
    ),
}
"""Transmitters: as in Sionna RT's reference cases and examples, and the roadside unit of the roundabout."""


@dataclass(frozen=True)
class Course:
    """A static scene with antennas; node 0 stands, the others drive."""

    name: str
    arrays: SceneData
    position: np.ndarray
    """Place of each node in each frame [m], shape [F, N, 3]."""
    velocity: np.ndarray
    """Velocity of each node [m/s], shape [N, 3]."""

    @property
    def rx(self) -> np.ndarray:
        """Receivers of the transmitter in every frame [m], shape [F, R, 3]."""
        return self.position[:, 1 : 1 + VEHICLES_V2I]


def make_course(name: str, arrays: SceneData, frames: int) -> Course:
    """Put the antennas of a scene in place.

    Args:
        name: A key of `TRACKS`.
        arrays: The static scene.
        frames: Number of frames, `FRAME_S` apart.

    Raises:
        ValueError: If a track leaves the open street (see `check_outdoors`).
    """
    tracks = TRACKS[name]
    heading = np.array([(*h, 0.0) for h in tracks.heading])
    velocity = SPEED_MPS * heading / np.linalg.norm(heading, axis=1, keepdims=True)
    start = np.array([(*s, HEIGHT_M) for s in tracks.start])
    driven = start + velocity * (FRAME_S * np.arange(frames))[:, None, None]
    for track in range(len(start)):
        check_outdoors(arrays, driven[:, track], f"{name}, track {track} from {tracks.start[track]}")
    standing = np.broadcast_to(np.array(tracks.tx), (frames, 1, 3))
    position = np.concatenate([standing, driven], axis=1)
    over = replace(arrays, frames=range(frames), poses=np.zeros((frames, 0, 7)), models=(), actors=())
    return Course(name, over, position, np.concatenate([np.zeros((1, 3)), velocity]))


def make_links(course: Course, kind: str, *, one_frame: bool = False) -> Links:
    """Return the links of all frames, antennas level and turned along x.

    Args:
        course: The nodes.
        kind: `v2i`: node 0 to the first three vehicles; `v2v`: every ordered pair of all vehicles.
        one_frame: Put all links into the first frame, as if all frames' receivers were there at once: rays are launched
            once.
    """
    frames, nodes = course.position.shape[:2]
    if kind == "v2i":
        pairs = [(0, r) for r in range(1, 1 + VEHICLES_V2I)]
    else:
        pairs = [(t, r) for t in range(1, nodes) for r in range(1, nodes) if t != r]
    frame = np.repeat(np.arange(frames), len(pairs))
    tx, rx = np.tile(np.array(pairs), (frames, 1)).T
    batch_index = np.zeros_like(frame) if one_frame else frame

    def ends(node: np.ndarray) -> RadioDevices:
        turn = np.broadcast_to(np.eye(3), (len(node), 3, 3)).copy()
        return RadioDevices(course.position[frame, node], turn, course.velocity[node])

    return Links(
        frame=batch_index.astype(np.int32),
        batch_index=batch_index.astype(np.int32),
        kind=np.zeros(len(frame), dtype=np.int8),
        tx_actor=tx.astype(np.int32),
        rx_actor=(rx + nodes * frame if one_frame else rx).astype(np.int32),
        tx_antenna=np.zeros(len(frame), dtype=np.int32),
        rx_antenna=np.zeros(len(frame), dtype=np.int32),
        tx=ends(tx),
        rx=ends(rx),
    )


def street_objects() -> list[ObjectMesh]:
    """Return Sionna RT's `simple_street_canyon` from the reference meshes of the tests."""
    case = json.loads((REFERENCE / "manifest.json").read_text())["cases"]["ssc_d1_f28"]["config"]["scene"]
    found = []
    for item in case["objects"]:
        mesh = trimesh.load_mesh(REFERENCE / item["ply"], process=False)
        material = case["materials"][item["material"]]
        points, faces = np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int32)
        found.append(ObjectMesh(item["name"], material["itu"], material["thickness"], points, faces))
    return found


def arrays_of(objects: Sequence[ObjectMesh]) -> SceneData:
    """Return a scene of objects, one frame, one material for each ITU name and thickness."""
    kinds = sorted({(o.itu, o.thickness) for o in objects})
    names = [f"{itu}_{round(thickness * 1e3)}mm" for itu, thickness in kinds]
    materials = tuple(
        Material(name, RadioMaterial("itu", itu=f"itu_{itu}", thickness=thickness), "none", 0.3, (0.5, 0.5, 0.5))
        for name, (itu, thickness) in zip(names, kinds, strict=True)
    )
    offsets = np.cumsum([0] + [len(o.points) for o in objects])
    counts = [len(o.faces) for o in objects]
    points = np.concatenate([o.points for o in objects]).astype(np.float64)
    faces = np.concatenate([o.faces + offset for o, offset in zip(objects, offsets[:-1], strict=True)]).astype(np.int32)
    own = [kinds.index((o.itu, o.thickness)) for o in objects]
    material = np.repeat(np.array(own, dtype=np.int32), counts)
    object_id = np.repeat(np.arange(len(objects), dtype=np.int32), counts)
    described = tuple(
        SceneObject(k, f"/World/{o.name}", "building", 0, (names[own[k]],)) for k, o in enumerate(objects)
    )
    surface = find_surfaces(points, faces, object_id, material)
    return SceneData(
        points, faces, material, object_id, surface, (), (), range(1), np.zeros((1, 0, 7)),
        {"sunny": materials}, described,
    )  # fmt: skip


def town_arrays(name: str) -> SceneData:
    """Return a shipped town whose half-spaces are slabs of `SLAB_M`, because Sionna RT has slabs only."""
    town = shipped_town(name)
    return replace(town, materials={w: tuple(map(_as_slab, by_id)) for w, by_id in town.materials.items()})


def _as_slab(material: Material) -> Material:
    return replace(material, radio=replace(material.radio, thickness=material.radio.thickness or SLAB_M))


def check_outdoors(arrays: SceneData, places: np.ndarray, where: str) -> None:
    """Raise unless a straight track of an antenna lies in the open: ground below, only sky above, nothing across.

    Args:
        arrays: The static scene.
        places: Places from first to last [m], shape [F, 3].
        where: Name of the track for the message.

    Raises:
        ValueError: If a place has no ground within 3 m below or something above it, or a face crosses the track.
    """
    corners = arrays.points[arrays.faces]
    low, high = places.min(axis=0), places.max(axis=0)
    near = (corners.min(axis=1)[:, :2] <= high[:2] + 0.01).all(axis=1)
    near &= (corners.max(axis=1)[:, :2] >= low[:2] - 0.01).all(axis=1)
    corners = corners[near]
    up = np.broadcast_to(np.array([0.0, 0.0, 1.0]), places.shape)
    faults = {
        "something above": np.isfinite(_distance(places, up, corners)).any(),
        "no ground within 3 m below": (_distance(places, -up, corners) > 3.0).any(),
        "a face across": (_distance(places[:1], places[-1:] - places[:1], corners) < 1.0).any(),
    }
    for fault, is_there in faults.items():
        if is_there:
            raise ValueError(
                f"{where}: {fault}; the tracks must stay on open streets; use fewer frames or another start"
            )


def _distance(origin: np.ndarray, direction: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the nearest crossing of each ray with any triangle, in lengths of its direction, inf for none; shape [R].

    Source: Moeller and Trumbore, Fast, Minimum Storage Ray/Triangle Intersection, 1997.
    """
    edge_1, edge_2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = np.cross(direction[:, None], edge_2)
    determinant = np.einsum("rtx,tx->rt", p, edge_1)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = origin[:, None] - corners[:, 0]
        u = np.einsum("rtx,rtx->rt", s, p) / determinant
        q = np.cross(s, edge_1)
        v = np.einsum("rx,rtx->rt", direction, q) / determinant
        t = np.einsum("tx,rtx->rt", edge_2, q) / determinant
        is_hit = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 0.0)
    return np.where(is_hit, t, np.inf).min(axis=1, initial=np.inf)
