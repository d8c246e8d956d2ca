"""Float64 oracles of the radio channel: the image method by brute force, dyadic fields, exact wedges, 60 digits."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal, localcontext
from itertools import product

import numpy as np
from scipy.special import hankel2, jv

from mmw.channel.paths import PathSet
from mmw.config import ChannelConfig
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.transforms import pose_from_ypr
from mmw.physics.materials.material import Material, RadioMaterial
from mmw.physics.materials.permittivity import relative_permittivity
from mmw.scene.scene_data import SceneData
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.antennas import antenna_at
from tests.fixtures.scenes import arrays_from_parts, box_model, pose, street_canyon
from tests.oracles.solved_paths import solve
from tests.oracles.tracing import OracleScene, oracle_scene, triangle_hits

SPECULAR, DIFFUSE, TRANSMISSION, DIFFRACTION = 1, 2, 4, 8
SHIFT_M = 1e-4
"""An answer that changes when the end of a segment, or an edge, is moved by this is in doubt."""
MIN_SEGMENT_M = 1e-5
"""A segment shorter than this is none: its ends are one point."""
SURE_SEGMENT_M = 1e-3
"""A path with a segment shorter than this is in doubt."""

Interactions = tuple[tuple[int, int], ...]
"""(interaction, surface) from transmitter to receiver; of a diffraction, the number of its edge."""


def channel(pattern: str = "dipole", polarization: str = "V", **changes) -> ChannelConfig:
    """Return a configuration that tries every candidate, with both antennas at their agents' origins."""
    at_origins = {"cav": (0.0, 0.0, 0.0), "rsu": (0.0, 0.0, 0.0)}
    values = {
        "carriers_hz": (28e9, 4.9e9),
        "candidates": "exhaustive",
        "antennas": antenna_at(at_origins, pattern=pattern, polarization=polarization),
    }
    return ChannelConfig(**{**values, **changes})


def radio_materials(radio: Mapping[str, RadioMaterial]) -> dict[str, Material]:
    """Return materials by name that differ in their radio properties only."""
    return {name: Material(name, values, "none", 0.3, (0.5,) * 3) for name, values in radio.items()}


def link_scene(parts: Sequence[MeshPart], tx: Sequence, *rx: Sequence, **options) -> SceneData:
    """Return parts with a roadside unit and CAVs without bodies at (x, y, z, ...); `options` of `arrays_from_parts`."""
    actors = [("rsu_1", "rsu", -1), *((f"cav_{k + 1}", "cav", -1) for k in range(len(rx)))]
    return arrays_from_parts(parts, actors=actors, poses=[[pose(*at) for at in (tx, *rx)]], **options)


DRIVING = (("cav_1", "cav", 0), ("cav_2", "cav", 0), ("veh_001", "vehicle", 1), ("rsu_1", "rsu", -1))
"""Actors of `driving`; model 0 is a car, 1 a truck."""


def driving(times: np.ndarray, truck_y: float = 6.5) -> np.ndarray:
    """Return poses of two CAVs, a turning truck and a roadside unit in a street along x, shape [times, 4, 7]."""
    rows = [
        [
            pose_from_ypr([-20 + 12 * t, -3 + 0.5 * t, 0.02 * t], 0.05 + 0.3 * t, 0.01, 0.02 * t),
            pose_from_ypr([15 - 9 * t, 3.0, 0.0], np.pi - 0.2 * t),
            pose_from_ypr([-2 + 5 * t, truck_y - t, 0.0], 0.15 + 0.6 * t),
            np.array(pose(0.0, -9.0, 5.0)),
        ]
        for t in times
    ]
    return np.array(rows)


def traffic(poses: np.ndarray, paint: int = 3) -> SceneData:
    """Return `DRIVING` in the street canyon; `paint` is the material of the truck."""
    models = (box_model("sedan", material=3), box_model("truck", (8.0, 2.5, 3.5), (0.5, 0.0, 1.75), material=paint))
    return street_canyon(models, DRIVING, poses)


def paths_by_interactions(paths: PathSet, link: int) -> dict[Interactions, int]:
    """Return the row of every path of a link by its interactions."""
    rows = np.nonzero(paths.link == link)[0]
    keys = [
        tuple(zip(*(v[p, : paths.order[p]].tolist() for v in (paths.interaction, paths.surface)), strict=True))
        for p in rows
    ]
    assert len(set(keys)) == len(keys), "a path was found twice"
    return dict(zip(keys, rows.tolist(), strict=True))


def matched(
    own: dict[Interactions, int], wanted: dict[Interactions, "OraclePath"]
) -> tuple[list[tuple[Interactions, int, "OraclePath"]], int]:
    """Return the paths that are in both, after a check that the others are in doubt, and how many are in doubt."""
    doubtful = {without_slabs(steps) for steps, path in wanted.items() if not path.is_sure}
    for steps, path in wanted.items():
        assert steps in own or not path.is_sure, f"{steps} is missing"
    for steps in own:
        assert steps in wanted or without_slabs(steps) in doubtful, f"{steps} is no path"
    return [(steps, row, wanted[steps]) for steps, row in own.items() if steps in wanted], len(doubtful)


def launched_share(arrays: SceneData, device: str, **changes) -> tuple[int, int]:
    """Return how many paths there are and how many launched rays miss, after a check that they find no others."""
    every, launched = (
        solve(arrays, channel(candidates=mode, **changes), device)[1] for mode in ("exhaustive", "launch")
    )
    found, missed = 0, 0
    for link in range(len(every.count)):
        own, all_own = set(paths_by_interactions(launched, link)), set(paths_by_interactions(every, link))
        assert own <= all_own and {steps for steps in all_own if len(steps) < 2} <= own
        found, missed = found + len(all_own), missed + len(all_own - own)
    return found, missed


def without_slabs(steps: Interactions) -> Interactions:
    return tuple(step for step in steps if step[0] != TRANSMISSION)


@dataclass(frozen=True)
class OraclePath:
    """A path by brute force."""

    point: np.ndarray
    """Transmitter, interactions, receiver [m], shape [order + 2, 3]."""
    normal: np.ndarray
    """Unit normals of the surfaces, either side, shape [order, 3]."""
    is_sure: bool
    """Whether no rounding could make or break it."""

    @property
    def length(self) -> float:
        return float(np.linalg.norm(np.diff(self.point, axis=0), axis=1).sum())


@dataclass(frozen=True)
class ConvexEdge:
    """An edge that may diffract: its ends [m], and normals and surfaces of both faces."""

    ends: np.ndarray
    normal: np.ndarray
    surface: tuple[int, int]


def brute_force(
    arrays: SceneData,
    frame: int,
    tx: np.ndarray,
    rx: np.ndarray,
    depth: int,
    slabs: frozenset[int] = frozenset(),
    edges: tuple[ConvexEdge, ...] = (),
) -> dict[Interactions, OraclePath]:
    """Return every path of at most `depth` interactions: sequences of planes, passages of slabs, one edge at most."""
    scene, found = oracle_scene(arrays, frame), {}
    ids = np.unique(scene.surface)
    corner = scene.corners[[int(np.argmax(scene.surface == i)) for i in ids]]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    offset = np.einsum("ix,ix->i", normal, corner[:, 0])
    for order in range(depth + 1):
        rows = _sequences(len(ids), order)
        plane = normal[rows], offset[rows]
        point, sure = _specular_points(tx, rx, *plane)
        _keep(
            found, scene, [[(SPECULAR, int(ids[i])) for i in row] for row in rows], point, plane[0], sure, depth, slabs
        )
    for number, edge in enumerate(edges):
        for cut, behind in ((a, b) for a in range(depth) for b in range(depth - a)):
            one, two = _sequences(len(ids), cut), _sequences(len(ids), behind)
            rows = np.concatenate([np.repeat(one, len(two), axis=0), np.tile(two, (len(one), 1))], axis=1)
            point, sure = _diffracted_points(tx, rx, normal[rows], offset[rows], cut, edge)
            axis = np.insert(normal[rows], cut, 0.0, axis=1)
            steps = [[(SPECULAR, int(ids[i])) for i in row] for row in rows]
            steps = [[*row[:cut], (DIFFRACTION, number), *row[cut:]] for row in steps]
            _keep(found, scene, steps, point, axis, sure, depth, slabs, edge)
    return found


def _sequences(count: int, order: int) -> np.ndarray:
    """Return all sequences of planes without the same one twice in a row, shape [N, order]."""
    rows = np.array(list(product(range(count), repeat=order)), dtype=int).reshape(count**order, order)
    return rows[(rows[:, 1:] != rows[:, :-1]).all(axis=1)]


def _specular_points(
    tx: np.ndarray, rx: np.ndarray, normal: np.ndarray, offset: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return tx, the points of reflection and rx, NaN where there are none, [N, K + 2, 3], and what is beyond doubt."""
    count, order = offset.shape
    rx = np.broadcast_to(rx, (count, 3))
    image, sure = [np.broadcast_to(tx, (count, 3))], np.ones(count, dtype=bool)
    for k in range(order):
        height = np.einsum("nx,nx->n", normal[:, k], image[-1]) - offset[:, k]
        image.append(image[-1] - 2 * height[:, None] * normal[:, k])
    point = np.full((count, order + 2, 3), np.nan)
    point[:, 0], point[:, -1], target = image[0], rx, rx
    for k in reversed(range(order)):
        near, far = (np.einsum("nx,nx->n", normal[:, k], p) - offset[:, k] for p in (target, image[k + 1]))
        sure &= ~(np.minimum(np.abs(near), np.abs(far)) < 1e-3)
        with np.errstate(divide="ignore", invalid="ignore"):
            target = np.where(
                (near * far < 0)[:, None], target + (near / (near - far))[:, None] * (image[k + 1] - target), np.nan
            )
        point[:, k + 1] = target
    return point, sure


def _diffracted_points(
    tx: np.ndarray, rx: np.ndarray, normal: np.ndarray, offset: np.ndarray, cut: int, edge: ConvexEdge
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points of `cut` reflections, a diffraction and the other reflections, as `_specular_points` does.

    The point on the edge is that of the shortest way, by golden section.
    """
    count, order = offset.shape
    images = []
    for start, steps in ((tx, range(cut)), (rx, reversed(range(cut, order)))):
        image = np.broadcast_to(start, (count, 3))
        for k in steps:
            height = np.einsum("nx,nx->n", normal[:, k], image) - offset[:, k]
            image = image - 2 * height[:, None] * normal[:, k]
        images.append(image)
    low, high, ratio = np.zeros(count), np.ones(count), (np.sqrt(5) - 1) / 2

    def at(share: np.ndarray) -> np.ndarray:
        return edge.ends[0] + share[:, None] * (edge.ends[1] - edge.ends[0])

    def length(share: np.ndarray) -> np.ndarray:
        return sum(np.linalg.norm(at(share) - image, axis=1) for image in images)

    for _ in range(45):
        one, two = high - ratio * (high - low), low + ratio * (high - low)
        is_low = length(one) < length(two)
        low, high = np.where(is_low, low, one), np.where(is_low, two, high)
    share = 0.5 * (low + high)
    slack = SHIFT_M / np.linalg.norm(edge.ends[1] - edge.ends[0])
    point, sure = np.full((count, order + 3, 3), np.nan), np.ones(count, dtype=bool)
    for row, bend in enumerate(at(share)):
        one, sure_one = _specular_points(tx, bend, normal[row : row + 1, :cut], offset[row : row + 1, :cut])
        two, sure_two = _specular_points(bend, rx, normal[row : row + 1, cut:], offset[row : row + 1, cut:])
        point[row], sure[row] = np.concatenate([one[0], two[0, 1:]]), sure_one[0] and sure_two[0]
    point[(share < slack) | (share > 1 - slack), cut + 1] = np.nan  # an end of an edge is no place to diffract
    for side in (cut, cut + 2):
        height = np.einsum("fx,nfx->nf", edge.normal, (point[:, side] - edge.ends[0])[:, None])
        sure &= ~((np.abs(height) < 1e-3).any(axis=1))
        point[(height < 0).all(axis=1), cut + 1] = np.nan
    return point, sure


def _keep(
    found: dict[Interactions, OraclePath],
    scene: OracleScene,
    steps: list[list[tuple[int, int]]],
    point: np.ndarray,
    normal: np.ndarray,
    sure: np.ndarray,
    depth: int,
    slabs: frozenset[int],
    edge: ConvexEdge | None = None,
) -> None:
    """Add the rows that are paths: points in their triangles, segments that hit nothing but slabs."""
    for row in np.nonzero(np.isfinite(point).all(axis=(1, 2)))[0]:
        at, is_sure = point[row], bool(sure[row])
        margin = [_margin(at[k + 1], scene, own) for k, (kind, own) in enumerate(steps[row]) if kind == SPECULAR]
        segments = np.linalg.norm(np.diff(at, axis=0), axis=1)
        if min(margin, default=1.0) < -SHIFT_M or segments.min() < MIN_SEGMENT_M:
            continue
        is_sure &= min(margin, default=1.0) > SHIFT_M and bool(segments.min() > SURE_SEGMENT_M)
        on = [{-1}, *({own} if kind == SPECULAR else set(edge.surface) for kind, own in steps[row]), {-1}]
        full, points, normals, is_open = [], [at[0]], [], True
        for k in range(len(at) - 1):
            hits, at_t, is_clear = _crossings(scene, at[k], at[k + 1], on[k] | on[k + 1])
            is_sure &= is_clear
            is_open &= set(hits) <= slabs
            for own, t in zip(hits, at_t, strict=True):
                full.append((TRANSMISSION, own))
                points.append(at[k] + t * (at[k + 1] - at[k]) / segments[k])
                first = scene.corners[int(np.argmax(scene.surface == own))]
                axis = np.cross(first[1] - first[0], first[2] - first[0])
                normals.append(axis / np.linalg.norm(axis))
            if k < len(steps[row]):
                full.append(steps[row][k])
                points.append(at[k + 1])
                normals.append(normal[row, k])
        points.append(at[-1])
        if not is_sure or (is_open and len(full) <= depth):
            found[tuple(full)] = OraclePath(np.array(points), np.array(normals).reshape(-1, 3), is_sure)


def _margin(point: np.ndarray, scene: OracleScene, surface: int) -> float:
    """Return how far a point of a plane lies inside the nearest of a surface's triangles [m], negative outside."""
    corners = scene.corners[scene.surface == surface]
    edge = np.roll(corners, -1, axis=1) - corners
    normal = np.cross(edge[:, 0], edge[:, 1])
    inward = np.cross(normal[:, None], edge)
    inward /= np.linalg.norm(inward, axis=2, keepdims=True)
    return float(np.einsum("mkx,mkx->mk", inward, point - corners).min(axis=1).max())


def _crossings(
    scene: OracleScene, start: np.ndarray, end: np.ndarray, own: set[int]
) -> tuple[list[int], list[float], bool]:
    """Return the surfaces on a segment and their distances, without those on its ends; and whether that is sure."""
    rng, answers, places = np.random.default_rng(0), [], []
    shifts = np.concatenate([np.zeros((1, 2, 3)), SHIFT_M * rng.normal(size=(3, 2, 3))])
    origin, segment = start + shifts[:, 0], end + shifts[:, 1] - start - shifts[:, 0]
    length = np.linalg.norm(segment, axis=1)
    ray, triangle, t = triangle_hits(origin, segment / length[:, None], scene.corners)
    for k in range(len(shifts)):
        at = (ray == k) & (t < length[k]) & ~np.isin(scene.surface[triangle], list(own))
        order = np.argsort(t[at], kind="stable")
        hits, place = scene.surface[triangle[at]][order], t[at][order]
        new = np.append(True, hits[1:] != hits[:-1]) if len(hits) else np.zeros(0, bool)
        answers.append(hits[new].tolist())
        places.append(place[new].tolist())
    ends = np.concatenate([[0.0], places[0], [length[0]]])
    apart = np.diff(ends).min() > 1e-3 if len(places[0]) else True
    return answers[0], places[0], bool(apart and all(answer == answers[0] for answer in answers))


def slab_coefficients(eta: complex, cosine: float, thickness: float, carrier_hz: float) -> tuple[complex, ...]:
    """Return (r_TE, r_TM, t_TE, t_TM) of a slab in air by characteristic matrices; of a half-space for thickness 0.

    Source: M. Born and E. Wolf, Principles of Optics, section 1.6, for e^{+jwt}; r_TM as for the field across the ray.
    """
    inner = np.sqrt(complex(eta) - (1 - cosine**2))
    out = []
    for outside, inside in ((cosine, inner), (1 / cosine, eta / inner)):
        if thickness == 0:
            out.append(((outside - inside) / (outside + inside), 0.0))
            continue
        turn = 2 * np.pi * carrier_hz / SPEED_OF_LIGHT * thickness * inner
        m11, m12, m21 = np.cos(turn), 1j * np.sin(turn) / inside, 1j * np.sin(turn) * inside
        straight, across = 2 * m11 * outside, m12 * outside**2 + m21
        out.append(((m12 * outside**2 - m21) / (straight + across), 2 * outside / (straight + across)))
    (r_te, t_te), (r_tm, t_tm) = out
    return r_te, -r_tm, t_te, t_tm


def dyadic_transfer(path: OraclePath, kinds: list[int], radio: list[RadioMaterial], carrier_hz: float) -> np.ndarray:
    """Return the 2x2 transfer of reflections and transmissions by dyads on field vectors in space."""
    segment = np.diff(path.point, axis=0)
    unit = segment / np.linalg.norm(segment, axis=1, keepdims=True)
    field = np.stack(sphere_axes(unit[0]), axis=1).astype(complex)
    for k, (kind, material) in enumerate(zip(kinds, radio, strict=True)):
        axis = np.cross(unit[k], path.normal[k])
        axis /= np.linalg.norm(axis)
        cosine = abs(float(unit[k] @ path.normal[k]))
        eta = relative_permittivity(material, carrier_hz)
        r_te, r_tm, t_te, t_tm = slab_coefficients(eta, cosine, material.thickness, carrier_hz)
        te, tm = (r_te, r_tm) if kind == SPECULAR else (t_te, t_tm)
        dyad = te * np.outer(axis, axis) + tm * np.outer(np.cross(unit[k + 1], axis), np.cross(unit[k], axis))
        field = dyad @ field
    wave = SPEED_OF_LIGHT / carrier_hz / (4 * np.pi * path.length)
    return wave * np.stack(sphere_axes(-unit[-1])) @ field


def sphere_axes(direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return theta and phi unit vectors of a direction, shape [3] each."""
    x, y, z = direction
    across = np.hypot(x, y)
    phi = np.array([-y, x, 0.0]) / across
    return np.array([x * z / across, y * z / across, -across]), phi


def wedge_field(n: float, k: float, rho: float, phi: float, rho_s: float, phi_s: float, *, soft: bool) -> complex:
    """Return the field of a line source, H0(2)(k R) alone, at a perfectly conducting wedge whose open angle is n pi.

    Source: R. F. Harrington, Time-Harmonic Electromagnetic Fields, section 5-8; C. A. Balanis, Advanced Engineering
    Electromagnetics, section 11.7.
    """
    low, high = min(rho, rho_s), max(rho, rho_s)
    order = np.arange(int(n * (k * low + 12 * (k * low) ** (1 / 3) + 20))) / n
    weight = np.where(order == 0, 1.0, 2.0) / n * jv(order, k * low) * hankel2(order, k * high)
    minus, plus = np.cos(order * (phi - phi_s)), np.cos(order * (phi + phi_s))
    return complex((weight * (minus - plus if soft else minus + plus)).sum())


def exact_length(tx: np.ndarray, rx: np.ndarray, planes: list[np.ndarray]) -> Decimal:
    """Return the length of the path from `tx` to `rx` over planes through three points each, to some 50 digits [m]."""
    with localcontext() as context:
        context.prec = 60
        image, end = ([Decimal(float(x)) for x in p] for p in (tx, rx))
        for corners in planes:
            a, b, c = ([Decimal(float(x)) for x in p] for p in corners)
            u, v = ([q[i] - a[i] for i in range(3)] for q in (b, c))
            n = [u[(i + 1) % 3] * v[(i + 2) % 3] - u[(i + 2) % 3] * v[(i + 1) % 3] for i in range(3)]
            share = 2 * sum((image[i] - a[i]) * n[i] for i in range(3)) / sum(x * x for x in n)
            image = [image[i] - share * n[i] for i in range(3)]
        return sum(((image[i] - end[i]) ** 2 for i in range(3)), Decimal(0)).sqrt()
