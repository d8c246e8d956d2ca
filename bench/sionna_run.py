"""Sionna RT on the same problem: the same meshes, materials, links and ray count, and its paths beside ours.

Sionna RT is no dependency of mmw. This is the only file that imports it, and it does so when a function is called.
"""

import importlib
import importlib.metadata
import statistics
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from bench.channel_scenes import ObjectMesh
from mmw.core.constants import SPEED_OF_LIGHT, VACUUM_PERMITTIVITY
from mmw.physics.materials.permittivity import relative_permittivity
from mmw.scene.scene_data import SceneData

SAME_LENGTH_M = 5e-3
"""Two paths of one link and order whose lengths differ by less may be one path; Sionna RT's delays are float32."""

SAME_VERTEX_M = 0.05
"""Two paths of Sionna RT of one link and length whose points all lie closer are one path, listed twice."""

SIONNA_PATHS = 1_000_000
"""Sionna RT's default of the largest number of paths of a source, which also sizes its table of candidates."""

INSTALL = (
    "pip install 'sionna-rt>=2.2,<3'; on the CPU also LLVM (19 works, 14 does not), its library in DRJIT_LIBLLVM_PATH"
)


@dataclass(frozen=True)
class PathList:
    """Paths of many links, one row a path, as both sides can say them."""

    link: np.ndarray
    """Frame x receivers + receiver, shape [P]."""
    order: np.ndarray
    """Number of reflections, shape [P]."""
    length: np.ndarray
    """Delay times the speed of light [m], shape [P]."""
    gain: np.ndarray
    """Absolute value of the coefficient [-], shape [P]."""
    repeated: np.ndarray
    """True where an earlier row is the same path, shape [P], bool."""


@dataclass(frozen=True)
class Comparison:
    """Numbers of common paths, and differences of their gains."""

    own: int
    """Paths of mmw."""
    other: int
    """Paths of Sionna RT."""
    repeated: int
    """Paths of Sionna RT that repeat another of its paths; they are not counted in `only_other`."""
    matched: int
    only_own: int
    only_other: int
    gain_median: float
    """Relative difference of the gains of matched paths, the middle one [-]; NaN without matched paths."""
    gain_worst: float
    """The same, the largest one [-]."""
    length_worst_m: float
    """Largest difference of the lengths of matched paths [m]."""


def compare(own: PathList, other: PathList) -> Comparison:
    """Match two lists of paths one to one, by link, number of reflections and length.

    Pairs whose lengths differ least go first. Where that is below the float32 noise of the delays, the nearest gain
    decides: paths of equal length in a symmetric street are told apart by nothing else.
    """
    unique = np.nonzero(~other.repeated)[0]
    one, two = _pairs(own, other, unique)
    apart = np.abs(own.length[one] - other.length[two])
    scale = np.maximum(np.maximum(own.gain[one], other.gain[two]), 1e-300)
    gain = np.abs(own.gain[one] - other.gain[two]) / scale
    taken_one, taken_two = np.zeros(len(own.link), dtype=bool), np.zeros(len(other.link), dtype=bool)
    matched = []
    for k in np.lexsort((gain, np.floor(apart / 5e-4))):
        if not (taken_one[one[k]] or taken_two[two[k]]):
            taken_one[one[k]] = taken_two[two[k]] = True
            matched.append(k)
    return Comparison(
        own=len(own.link),
        other=len(other.link),
        repeated=int(other.repeated.sum()),
        matched=len(matched),
        only_own=int((~taken_one).sum()),
        only_other=int((~taken_two[unique]).sum()),
        gain_median=float(np.median(gain[matched])) if matched else float("nan"),
        gain_worst=float(gain[matched].max()) if matched else float("nan"),
        length_worst_m=float(apart[matched].max()) if matched else float("nan"),
    )


def _pairs(own: PathList, other: PathList, unique: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of all pairs of one link and order whose lengths differ by less than `SAME_LENGTH_M`."""
    levels = int(max(own.order.max(initial=0), other.order.max(initial=0))) + 1
    key_own, key_other = own.link * levels + own.order, (other.link * levels + other.order)[unique]
    order = unique[np.lexsort((other.length[unique], key_other))]
    sorted_key = (other.link * levels + other.order)[order]
    one, two = [], []
    for i in range(len(key_own)):
        begin, end = np.searchsorted(sorted_key, key_own[i]), np.searchsorted(sorted_key, key_own[i], "right")
        rows = order[begin:end]
        near = rows[np.abs(other.length[rows] - own.length[i]) < SAME_LENGTH_M]
        one += [i] * len(near)
        two += near.tolist()
    return np.array(one, dtype=np.int64), np.array(two, dtype=np.int64)


def missing() -> str:
    """Return what is there instead of Sionna RT 2.2 and what to install, empty if it is there."""
    try:
        version = importlib.metadata.version("sionna-rt")
    except importlib.metadata.PackageNotFoundError:
        version = "not installed"
    if version.startswith("2.") and int(version.split(".")[1]) >= 2:
        return ""
    return f"Sionna RT: {version}; needed for --against sionna and the scene munich, left out now; {INSTALL}"


@dataclass(frozen=True)
class Timing:
    """Time of a solve of Sionna RT, with the results on the host."""

    median_s: float
    """Seconds a solve: median over passes of the mean over solves."""
    best_s: float
    """The same of the fastest pass."""
    first_s: float
    """Seconds of the very first solve, with compilation."""
    rows: PathList


class SionnaScene:
    """One scene of Sionna RT with a transmitter and receivers."""

    def __init__(self, device: str, threads: int | None = None):
        """Choose Dr.Jit's back end: OptiX on `cuda:N`, LLVM with Embree on `cpu`.

        Args:
            device: `cpu` or `cuda:N`; with CUDA, N comes from CUDA_VISIBLE_DEVICES alone.
            threads: CPU threads of Dr.Jit; all if None.

        Raises:
            ImportError: If Sionna RT or the back end is not there.
        """
        self._mi: Any = importlib.import_module("mitsuba")
        wanted = "cuda_ad_mono_polarized" if device.startswith("cuda") else "llvm_ad_mono_polarized"
        if self._mi.variant() != wanted:
            self._mi.set_variant(wanted)
        self._rt: Any = importlib.import_module("sionna.rt")
        self._dr: Any = importlib.import_module("drjit")
        if threads:
            self._dr.set_thread_count(threads)
        self.threads = int(self._dr.thread_count()) if wanted.startswith("llvm") else 0
        self.name = f"Sionna RT {self._rt.__version__}, Mitsuba {self._mi.__version__}, Dr.Jit {self._dr.__version__}"
        self._scene: Any = None
        self._solver: Any = None

    def builtin_objects(self, name: str) -> list[ObjectMesh]:
        """Return the objects of one of Sionna RT's own scenes; their data are OpenStreetMap's (ODbL) for the towns."""
        scene = self._rt.load_scene(getattr(self._rt.scene, name), merge_shapes=False)
        found = []
        for key, item in scene.objects.items():
            values = self._mi.traverse(item.mi_mesh)
            points = np.array(values["vertex_positions"], dtype=np.float64).reshape(-1, 3)
            faces = np.array(values["faces"], dtype=np.int32).reshape(-1, 3)
            material = item.radio_material
            found.append(ObjectMesh(key, material.itu_type, round(float(material.thickness[0]), 6), points, faces))
        return found

    def load_builtin(self, name: str, carrier_hz: float) -> None:
        """Load one of Sionna RT's own scenes as Sionna RT does by default, shapes of one material merged."""
        self._scene = self._rt.load_scene(getattr(self._rt.scene, name))
        self._scene.frequency = carrier_hz

    def load_arrays(self, arrays: SceneData, carrier_hz: float) -> None:
        """Load a scene of ours, one mesh a material, with our permittivities at the carrier."""
        with tempfile.TemporaryDirectory() as folder:
            self._scene = self._rt.load_scene_from_string(scene_xml(arrays, carrier_hz, Path(folder)))
        self._scene.frequency = carrier_hz

    def place(self, tx: np.ndarray, receivers: int) -> None:
        """Put the transmitter in place and add receivers; both have one vertically polarised dipole.

        Args:
            tx: Transmitter [m], shape [3].
            receivers: Number of receivers of a solve.
        """
        scene, rt = self._scene, self._rt
        for name in [*scene.transmitters, *scene.receivers]:
            scene.remove(name)
        one = {"num_rows": 1, "num_cols": 1, "pattern": "dipole", "polarization": "V"}
        scene.tx_array, scene.rx_array = rt.PlanarArray(**one), rt.PlanarArray(**one)
        scene.add(rt.Transmitter("tx", position=tx.tolist()))
        for k in range(receivers):
            scene.add(rt.Receiver(f"rx_{k}", position=[0.0, 0.0, 0.0]))
        self._solver = rt.PathSolver()

    def solve(self, rx: np.ndarray, depth: int, rays: int, most_paths: int) -> Any:
        """Move the receivers, find the paths, and bring coefficients and delays to the host.

        Args:
            rx: Receivers [m], shape [R, 3].
            depth: Most reflections on a path.
            rays: Rays of the transmitter.
            most_paths: `max_num_paths_per_src`.
        """
        for k, place in enumerate(rx.tolist()):
            self._scene.get(f"rx_{k}").position = place
        paths = self._solver(
            self._scene, max_depth=depth, samples_per_src=rays, max_num_paths_per_src=most_paths, synthetic_array=True,
            los=True, specular_reflection=True, diffuse_reflection=False, refraction=False, diffraction=False,
        )  # fmt: skip
        return paths, paths.a[0].numpy(), paths.a[1].numpy(), paths.tau.numpy()

    def time_solves(self, rx: np.ndarray, depth: int, rays: int, most_paths: int, repeats: int) -> Timing:
        """Time one solve for every row of receivers; a first pass warms up and brings the paths.

        Args:
            rx: Receivers of each solve [m], shape [S, R, 3].
            depth: Most reflections on a path.
            rays: Rays of the transmitter, in every solve.
            most_paths: `max_num_paths_per_src`.
            repeats: Timed passes over all solves.

        Returns:
            Seconds a solve, and the rows of all solves; link = solve x R + receiver.
        """
        start = time.perf_counter()
        self.solve(rx[0], depth, rays, most_paths)
        first = time.perf_counter() - start
        found = [path_list(self.solve(places, depth, rays, most_paths), s * rx.shape[1]) for s, places in enumerate(rx)]
        passes = []
        for _ in range(repeats):
            start = time.perf_counter()
            for places in rx:
                self.solve(places, depth, rays, most_paths)
            passes.append((time.perf_counter() - start) / len(rx))
        return Timing(statistics.median(passes), min(passes), first, join(found))


def path_list(solved: tuple[Any, np.ndarray, np.ndarray, np.ndarray], first_link: int) -> PathList:
    """Return the paths of one solve of Sionna RT; a path that repeats an earlier one of its link is marked."""
    paths, real, imaginary, tau = solved
    receiver, transmitter, column = np.nonzero(paths.valid.numpy())
    gain = np.hypot(real, imaginary)[receiver, 0, transmitter, 0, column].astype(np.float64)
    length = tau[receiver, transmitter, column].astype(np.float64) * SPEED_OF_LIGHT
    is_bounce = paths.interactions.numpy()[:, receiver, transmitter, column] != 0
    vertex = paths.vertices.numpy()[:, receiver, transmitter, column]
    vertex = np.where(is_bounce[..., None], vertex, 0.0)
    order = is_bounce.sum(axis=0)
    return PathList(receiver + first_link, order, length, gain, repeats_of(receiver, order, length, vertex))


def repeats_of(link: np.ndarray, order: np.ndarray, length: np.ndarray, vertex: np.ndarray) -> np.ndarray:
    """Return which paths are an earlier one again: same link, order and length, and all points in the same places.

    Args:
        link: Shape [P].
        order: Shape [P].
        length: Shape [P] [m].
        vertex: Points of reflection, zero where there is none [m], shape [D, P, 3].
    """
    repeated = np.zeros(len(link), dtype=bool)
    for i in range(1, len(link)):
        same = (link[:i] == link[i]) & (order[:i] == order[i]) & (np.abs(length[:i] - length[i]) < SAME_LENGTH_M)
        apart = np.linalg.norm(vertex[:, :i] - vertex[:, i : i + 1], axis=-1).max(axis=0, initial=0.0)
        repeated[i] = bool((same & (apart < SAME_VERTEX_M)).any())
    return repeated


def join(parts: Sequence[PathList]) -> PathList:
    """Return several lists of paths as one."""
    fields = ("link", "order", "length", "gain", "repeated")
    return PathList(*(np.concatenate([getattr(part, field) for part in parts]) for field in fields))


def scene_xml(arrays: SceneData, carrier_hz: float, folder: Path) -> str:
    """Write one PLY a material and return the scene as Mitsuba's XML.

    Raises:
        ValueError: If a material is a half-space, which Sionna RT does not have.
    """
    materials = next(iter(arrays.materials.values()))
    lines = ['<scene version="2.1.0">']
    for index in np.unique(arrays.material):
        material = materials[index]
        if not material.radio.thickness:
            raise ValueError(f"material {material.name!r}: a half-space; Sionna RT has slabs only; give it a thickness")
        eta = relative_permittivity(material.radio, carrier_hz, material.name)
        sigma = -eta.imag * 2.0 * np.pi * carrier_hz * VACUUM_PERMITTIVITY
        path, faces = folder / f"m{index}.ply", arrays.faces[arrays.material == index]
        used, corner = np.unique(faces, return_inverse=True)
        trimesh.Trimesh(arrays.points[used], corner.reshape(-1, 3), process=False).export(path)
        lines += [
            f'<bsdf type="radio-material" id="m{index}">',
            f'<float name="relative_permittivity" value="{eta.real!r}"/><float name="conductivity" value="{sigma!r}"/>',
            f'<float name="thickness" value="{material.radio.thickness!r}"/>',
            f'<float name="scattering_coefficient" value="{material.radio.scattering!r}"/></bsdf>',
            f'<shape type="ply" id="s{index}"><string name="filename" value="{path}"/>',
            f'<boolean name="face_normals" value="true"/><ref id="m{index}" name="bsdf"/></shape>',
        ]
    return "\n".join([*lines, "</scene>"])
