"""Triangles as solids: which side is out, and triangles that are none."""

import numpy as np

from mmw.worlds.checks.box_pairs import spiral
from mmw.worlds.checks.components import ConnectedComponents
from mmw.worlds.checks.findings import Finding, as_place, does_not_apply
from mmw.worlds.checks.stage_model import StageModel

MIN_AREA_M2 = 1.0e-10
"""Triangles with less are degenerate [m2]; design value: an equilateral one with sides of 15 um."""

MIN_VOLUME_M3 = 1.0e-6
"""Closed pieces with less than this are not asked which side is out [m3]."""

VIEW_HEIGHT_M = 1.6
"""Height of the viewpoints for backs of faces [m]; design value, a driver's or a pedestrian's."""

VIEW_STEP_M = 25.0
"""Distance between the viewpoints along a lane [m]."""

VIEW_RAYS = 400
"""Rays of a viewpoint."""

MIN_HITS = 12
"""A prim is judged by at least this many rays."""

BACK_SHARE = 0.5
"""Share of rays that hit a back from which on a prim counts as inside out [-]; below, as open."""

OPEN_SHARE = 0.05
"""Share of rays that hit a back which is tolerated [-]: a view past an edge."""


def solid_findings(model: StageModel, connected: ConnectedComponents) -> list[Finding]:
    """Return degenerate triangles, closed pieces that are inside out, faces that disagree, and backs that show."""
    return [*_degenerate(model), *_inside_out(model, connected), *_backs(model)]


def _degenerate(model: StageModel) -> list[Finding]:
    found, seen = [], set()
    bad = np.flatnonzero(model.mesh.areas < MIN_AREA_M2)
    for k in np.unique(model.part_of[bad]):
        part = model.parts[k]
        if part.source not in seen:
            seen.add(part.source)
            rows = bad[model.part_of[bad] == k]
            text = f"{len(rows)} of {len(part.faces)} triangles have no area"
            place = as_place(model.mesh.corners[rows[0], 0])
            found.append(Finding("warning", "degenerate", part.path, text, "delete them", place))
    return found


def _inside_out(model: StageModel, connected: ConnectedComponents) -> list[Finding]:
    if not connected.count:
        return []
    corner = connected.corner
    start, end = corner[:, [0, 1, 2]].ravel(), corner[:, [1, 2, 0]].ravel()
    real = start != end
    direction = np.where(start < end, 1, -1)[real]
    key = np.minimum(start, end)[real] * (int(corner.max()) + 1) + np.maximum(start, end)[real]
    edge = np.unique(key, return_inverse=True)[1]
    owner = np.repeat(connected.component, 3)[real]
    balance, uses = np.bincount(edge, direction), np.bincount(edge)
    is_open = np.bincount(owner, balance[edge] != 0, connected.count) > 0
    disagrees = (uses == 2) & (balance != 0)
    bent = np.bincount(owner, disagrees[edge], connected.count) / 2
    corners = model.mesh.corners[connected.face]
    middle = (
        np.stack([np.bincount(connected.component, corners[:, 0, k], connected.count) for k in range(3)], axis=1)
        / np.bincount(connected.component, minlength=connected.count)[:, None]
    )
    a, b, c = np.moveaxis(corners - middle[connected.component][:, None], 1, 0)
    volume = np.bincount(connected.component, np.einsum("fx,fx->f", a, np.cross(b, c)) / 6.0, connected.count)
    found = []
    for k in np.flatnonzero((~is_open & (volume < -MIN_VOLUME_M3)) | (bent > 0)):
        path, place = model.parts[connected.part[k]].path, as_place(middle[k])
        if bent[k]:
            text = f"neighboring faces disagree about their front at {int(bent[k])} edges"
            found.append(Finding("warning", "winding", path, text, "let all faces look outward", place))
        else:
            text = f"a closed piece of {-volume[k]:.3f} m3 is inside out"
            found.append(Finding("error", "inside_out", path, text, "turn its faces over", place))
    return found


def _viewpoints(model: StageModel) -> np.ndarray:
    """Return viewpoints in the streets [m], shape [E, 3]."""
    if model.lanes is None:
        return np.zeros((0, 3))
    viewpoints = []
    for lane in model.lanes.lanes.values():
        station = np.arange(0.5 * min(VIEW_STEP_M, lane.length), lane.length, VIEW_STEP_M)
        viewpoints += [[np.interp(s, lane.station, lane.points[:, k]) for k in range(3)] for s in station]
    return np.array(viewpoints).reshape(-1, 3) + np.array((0.0, 0.0, VIEW_HEIGHT_M))


def _backs(model: StageModel) -> list[Finding]:
    viewpoints = _viewpoints(model)
    if not len(viewpoints) or not len(model.mesh.faces):
        return [does_not_apply("backs", "no lanes to look from")]
    direction = spiral(1.0 - (2.0 * np.arange(VIEW_RAYS) + 1.0) / VIEW_RAYS)
    direction = np.tile(direction, (len(viewpoints), 1))
    start = np.repeat(viewpoints, VIEW_RAYS, axis=0)
    t, face = model.rays.cast(start, direction, 500.0)
    hit = np.flatnonzero(face >= 0)
    part = model.part_of[face[hit]]
    is_back = np.einsum("rx,rx->r", model.mesh.normals[face[hit]], direction[hit]) > 0.0
    hits = np.bincount(part, minlength=len(model.parts))
    share = np.bincount(part, is_back, len(model.parts)) / np.maximum(hits, 1)
    found = []
    for k in np.flatnonzero((hits >= MIN_HITS) & (share > OPEN_SHARE)):
        row = hit[np.flatnonzero((part == k) & is_back)[0]]
        severity = "error" if share[k] > BACK_SHARE and model.parts[k].label in ("building", "wall") else "warning"
        text = f"{100.0 * share[k]:.0f} % of {hits[k]} rays from the streets hit a back"
        cure = "turn its faces outward, or give it a thickness"
        place = as_place(start[row] + t[row] * direction[row])
        found.append(Finding(severity, "backs", model.parts[k].path, text, cure, place))
    return found
