"""Triangles as solids: which side is out, and triangles that are none."""

import numpy as np

from mmw.worlds.checks.components import Pieces
from mmw.worlds.checks.findings import Finding, as_place, does_not_apply
from mmw.worlds.checks.stage_model import World

MIN_AREA_M2 = 1.0e-10
"""Triangles with less are degenerate [m2]; design value: an equilateral one with sides of 15 um."""

MIN_VOLUME_M3 = 1.0e-6
"""Closed pieces with less than this are not asked which side is out [m3]."""

EYE_HEIGHT_M = 1.6
"""Height of the eyes that look for backs of faces [m]; design value, a driver's or a pedestrian's."""

EYE_STEP_M = 25.0
"""Distance between the eyes along a lane [m]."""

EYE_RAYS = 400
"""Rays of an eye."""

MIN_HITS = 12
"""A prim is judged by at least this many rays."""

BACK_SHARE = 0.5
"""Share of rays that meet a back from which on a prim counts as inside out [-]; below, as open."""

OPEN_SHARE = 0.05
"""Share of rays that meet a back which is let pass [-]: a view past an edge."""

GOLDEN_RATIO_INVERSE = 0.6180339887498949


def solid_findings(world: World, pieces: Pieces) -> list[Finding]:
    """Return degenerate triangles, closed pieces that are inside out, faces that disagree, and backs that show."""
    return [*_degenerate(world), *_inside_out(world, pieces), *_backs(world)]


def _degenerate(world: World) -> list[Finding]:
    found, seen = [], set()
    bad = np.flatnonzero(world.area < MIN_AREA_M2)
    for k in np.unique(world.part_of[bad]):
        part = world.parts[k]
        if part.source not in seen:
            seen.add(part.source)
            rows = bad[world.part_of[bad] == k]
            text = f"{len(rows)} of {len(part.faces)} triangles have no area"
            place = as_place(world.corners[rows[0], 0])
            found.append(Finding("warning", "degenerate", part.path, text, "delete them", place))
    return found


def _inside_out(world: World, pieces: Pieces) -> list[Finding]:
    if not pieces.count:
        return []
    corner = pieces.corner
    start, end = corner[:, [0, 1, 2]].ravel(), corner[:, [1, 2, 0]].ravel()
    real = start != end
    way = np.where(start < end, 1, -1)[real]
    key = np.minimum(start, end)[real] * (int(corner.max()) + 1) + np.maximum(start, end)[real]
    edge = np.unique(key, return_inverse=True)[1]
    owner = np.repeat(pieces.piece, 3)[real]
    balance, uses = np.bincount(edge, way), np.bincount(edge)
    is_open = np.bincount(owner, balance[edge] != 0, pieces.count) > 0
    disagrees = (uses == 2) & (balance != 0)
    bent = np.bincount(owner, disagrees[edge], pieces.count) / 2
    middle = (
        np.stack([np.bincount(pieces.piece, world.corners[pieces.face, 0, k], pieces.count) for k in range(3)], axis=1)
        / np.bincount(pieces.piece, minlength=pieces.count)[:, None]
    )
    a, b, c = np.moveaxis(world.corners[pieces.face] - middle[pieces.piece][:, None], 1, 0)
    volume = np.bincount(pieces.piece, np.einsum("fx,fx->f", a, np.cross(b, c)) / 6.0, pieces.count)
    found = []
    for k in np.flatnonzero((~is_open & (volume < -MIN_VOLUME_M3)) | (bent > 0)):
        path, place = world.parts[pieces.part[k]].path, as_place(middle[k])
        if bent[k]:
            text = f"neighbouring faces disagree about their front at {int(bent[k])} edges"
            found.append(Finding("warning", "winding", path, text, "let all faces look outward", place))
        else:
            text = f"a closed piece of {-volume[k]:.3f} m3 is inside out"
            found.append(Finding("error", "inside_out", path, text, "turn its faces over", place))
    return found


def _eyes(world: World) -> np.ndarray:
    """Return places in the streets from which people look around [m], shape [E, 3]."""
    if world.lanes is None:
        return np.zeros((0, 3))
    eyes = []
    for lane in world.lanes.lanes.values():
        station = np.arange(0.5 * min(EYE_STEP_M, lane.length), lane.length, EYE_STEP_M)
        eyes += [[np.interp(s, lane.station, lane.points[:, k]) for k in range(3)] for s in station]
    return np.array(eyes).reshape(-1, 3) + np.array((0.0, 0.0, EYE_HEIGHT_M))


def _backs(world: World) -> list[Finding]:
    eyes = _eyes(world)
    if not len(eyes) or not len(world.faces):
        return [does_not_apply("backs", "no lanes to look from")]
    count = np.arange(EYE_RAYS)
    z, turn = 1.0 - (2.0 * count + 1.0) / EYE_RAYS, 2.0 * np.pi * GOLDEN_RATIO_INVERSE * count
    way = np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], axis=1)
    way = np.tile(way, (len(eyes), 1))
    start = np.repeat(eyes, EYE_RAYS, axis=0)
    t, face = world.rays.cast(start, way, 500.0)
    hit = np.flatnonzero(face >= 0)
    part = world.part_of[face[hit]]
    is_back = np.einsum("rx,rx->r", world.normal[face[hit]], way[hit]) > 0.0
    hits = np.bincount(part, minlength=len(world.parts))
    share = np.bincount(part, is_back, len(world.parts)) / np.maximum(hits, 1)
    found = []
    for k in np.flatnonzero((hits >= MIN_HITS) & (share > OPEN_SHARE)):
        row = hit[np.flatnonzero((part == k) & is_back)[0]]
        severity = "error" if share[k] > BACK_SHARE and world.parts[k].label in ("building", "wall") else "warning"
        text = f"{100.0 * share[k]:.0f} % of {hits[k]} rays from the streets meet a back"
        cure = "turn its faces outward, or give it a thickness"
        place = as_place(start[row] + t[row] * way[row])
        found.append(Finding(severity, "backs", world.parts[k].path, text, cure, place))
    return found
