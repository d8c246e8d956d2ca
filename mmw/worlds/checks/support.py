"""Check the support of objects: parts that float, and objects under the ground."""

import numpy as np

from mmw.core.bvh import RayMesh
from mmw.core.planar_surfaces import components
from mmw.worlds.checks.box_pairs import box_pairs
from mmw.worlds.checks.components import ConnectedComponents
from mmw.worlds.checks.findings import Finding, as_place, does_not_apply
from mmw.worlds.checks.stage_model import GROUND_LABELS, StageModel

FLOAT_M = 0.05
"""Height over the ground from which on a part floats [m]; design value."""

TOUCH_M = 0.01
"""Parts closer than this hold each other [m]; design value."""

BELOW_M = 0.003
"""Rays start this far below a lowest point [m], so that they miss the part itself and find ground that it touches."""

SLACK_M = 0.001
"""Vertices this close to the lowest one are lowest too [m]."""

UP = np.array([0.0, 0.0, 1.0])


def support_findings(model: StageModel, connected: ConnectedComponents) -> list[Finding]:
    """Return parts that float, and objects that lie wholly under the ground."""
    if not len(model.ground):
        reason = f"no mesh has a class that supports objects ({', '.join(GROUND_LABELS)})"
        return [does_not_apply(rule, reason) for rule in ("floating", "sunken")]
    if not connected.count:
        return []
    ground = RayMesh(model.mesh.points, model.mesh.faces[model.ground])
    return [*_floating(model, connected, ground), *_sunken(model, connected, ground)]


def _is_below(model: StageModel, ground: RayMesh, points: np.ndarray) -> np.ndarray:
    """Return whether each point [P, 3] is under the ground: the first ground above it shows its back, shape [P]."""
    _, face = ground.cast(points, UP, 1000.0)
    return (face >= 0) & (model.mesh.normals[model.ground][face, 2] > 0.0)


def _floating(model: StageModel, connected: ConnectedComponents, ground: RayMesh) -> list[Finding]:
    moving = np.array([part.is_moving for part in model.parts], dtype=bool)[connected.part]
    z = model.mesh.corners[connected.face, :, 2]
    row, column = np.nonzero(z <= connected.lowest[connected.component][:, None] + SLACK_M)
    point = model.mesh.corners[connected.face[row], column] - BELOW_M * UP
    component = connected.component[row]
    is_supported = _is_below(model, ground, point)
    fall, _ = model.rays.cast(point, -UP, 1000.0)
    gap = np.full(connected.count, np.inf)
    np.minimum.at(gap, component, np.where(is_supported, 0.0, fall + BELOW_M))
    floats = (gap > FLOAT_M) & ~moving
    suspects = np.flatnonzero(floats)
    if not len(suspects):
        return []
    first, second = _contacts(model, connected, floats)
    is_free = np.append(floats, False)
    linked = components(connected.count + 1, first, np.where(is_free[second], second, connected.count))
    findings = []
    for label in np.unique(linked[suspects]):
        if label == linked[connected.count]:
            continue
        group = suspects[linked[suspects] == label]
        lowest = group[np.argmin(gap[group])]
        rows = np.flatnonzero(component == lowest)
        part = model.parts[connected.part[lowest]]
        below = f"{gap[lowest]:.2f} m above what is below" if np.isfinite(gap[lowest]) else "with nothing below"
        more = f", with {len(group) - 1} more that hang on it" if len(group) > 1 else ""
        text = f"a piece of {part.object_path} touches nothing and is {below} it{more}"
        path = part.object_path if part.is_actor else part.path
        cure = "put it on the ground, or let it touch what holds it"
        findings.append(Finding("error", "floating", path, text, cure, as_place(point[rows[0]] + BELOW_M * UP)))
    return findings


def _contacts(model: StageModel, connected: ConnectedComponents, floats: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs of pieces (a floating one, any other one or the ground) that touch; the ground is piece K."""
    every = np.arange(len(model.mesh.faces))
    piece_of = np.full(len(model.mesh.faces), connected.count)
    piece_of[connected.face] = connected.component
    is_free = np.append(floats, False)
    mine = every[is_free[piece_of]]
    low, high = model.mesh.corners.min(axis=1), model.mesh.corners.max(axis=1)
    found = [np.zeros((0, 2), dtype=int)]
    for i, j in box_pairs(low[mine] - TOUCH_M, high[mine] + TOUCH_M, low, high):
        i = mine[i]
        keep = piece_of[i] != piece_of[j]
        i, j = i[keep], j[keep]
        keep = _reaches_plane(model, i, j) & _reaches_plane(model, j, i)
        found.append(np.unique(np.stack([piece_of[i[keep]], piece_of[j[keep]]], axis=1), axis=0))
    first, second = np.unique(np.concatenate(found), axis=0).T
    return first, second


def _reaches_plane(model: StageModel, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Return whether triangles i reach the planes of triangles j, within `TOUCH_M`, shape [P]."""
    height = np.einsum("pcx,px->pc", model.mesh.corners[i] - model.mesh.corners[j, :1], model.mesh.normals[j])
    return (height.min(axis=1) < TOUCH_M) & (height.max(axis=1) > -TOUCH_M)


def _sunken(model: StageModel, connected: ConnectedComponents, ground: RayMesh) -> list[Finding]:
    path_of_face = np.array([part.object_path for part in model.parts], dtype=object)
    names, object_path = np.unique(path_of_face[model.part_of[connected.face]], return_inverse=True)
    z = model.mesh.corners[connected.face, :, 2]
    top = np.full(len(names), -np.inf)
    np.maximum.at(top, object_path, z.max(axis=1))
    row, column = np.nonzero(z >= top[object_path][:, None] - SLACK_M)
    point = model.mesh.corners[connected.face[row], column]
    is_above = np.zeros(len(names), dtype=bool)
    np.logical_or.at(is_above, object_path[row], ~_is_below(model, ground, point))
    return [
        Finding(
            "error", "sunken", str(names[k]), "lies wholly under the ground", "raise it",
            as_place(point[np.flatnonzero(object_path[row] == k)[0]]),
        )
        for k in np.flatnonzero(~is_above)
    ]  # fmt: skip
