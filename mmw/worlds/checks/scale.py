"""Figures of a stage, and units or axes that were mistaken."""

import numpy as np

from mmw.worlds.checks.findings import Finding
from mmw.worlds.checks.stage_model import StageModel

MAX_EXTENT_M = 20_000.0
"""Extent in plan beyond which a stage is assumed to be in centimeters [m]; design value."""

MIN_EXTENT_M = 5.0
"""Extent in plan below which a stage is assumed to be in kilometers or scaled down [m]; design value."""

LANE_WIDTH_M = (2.0, 8.0)
"""Widths of lanes that exist [m]; design value."""

ACTOR_HEIGHT_M = (0.5, 6.0)
"""Heights of road users [m]; design value."""

FLAT = 0.98
"""Cosine of the angle to an axis within which a face is level [-]."""


def size_findings(model: StageModel) -> list[Finding]:
    """Return triangle count, bounds and opening time as information, and hints at mistaken units or axes."""
    opened = Finding("info", "open", "", f"opened in {model.open_s:.2f} s; a shipped town takes less than 1 s")
    if not len(model.mesh.faces):
        cure = "check purpose and visibility"
        return [Finding("error", "size", "", "no visible mesh with a triangle", cure), opened]
    low, high = model.mesh.bounds
    text = (
        f"{len(model.mesh.faces):,} triangles in {len(model.parts):,} meshes; x {low[0]:.1f} to {high[0]:.1f} m, "
        f"y {low[1]:.1f} to {high[1]:.1f} m, z {low[2]:.1f} to {high[2]:.1f} m"
    )
    return [Finding("info", "size", "", text), opened, *_units(model, high - low), *_axes(model, high - low)]


def _units(model: StageModel, extent: np.ndarray) -> list[Finding]:
    found = []
    wide = float(extent[:2].max())
    cure = "set metersPerUnit of the stage: 0.01 for centimeters"
    if wide > MAX_EXTENT_M:
        found.append(Finding("warning", "units", "", f"the stage is {wide / 1000.0:.0f} km wide", cure))
    elif wide < MIN_EXTENT_M:
        found.append(Finding("warning", "units", "", f"the stage is {wide:.2f} m wide", cure))
    if model.lanes is not None:
        width = np.array([lane.width for lane in model.lanes.lanes.values()])
        wrong = np.flatnonzero((width < LANE_WIDTH_M[0]) | (width > LANE_WIDTH_M[1]))
        if len(wrong):
            name = list(model.lanes.lanes)[wrong[0]]
            text = f"{len(wrong)} lanes have an unlikely width, this one {width[wrong[0]]:g} m"
            found.append(Finding("warning", "units", f"lane {name}", text, "mmw:lane:width is in meters"))
        step = max(float(np.diff(lane.station).max()) for lane in model.lanes.lanes.values())
        if step > 50.0:
            text = f"points of a lane are {step:.0f} m apart"
            found.append(Finding("warning", "units", "", text, "lanes have a point every 2 m; check metersPerUnit"))
    heights: dict[str, list[float]] = {}
    for part in model.parts:
        if part.is_actor:
            z = part.points[:, 2]
            heights[part.object_path] = [*heights.get(part.object_path, []), float(z.min()), float(z.max())]
    for path, z in heights.items():
        if not ACTOR_HEIGHT_M[0] <= max(z) - min(z) <= ACTOR_HEIGHT_M[1]:
            text = f"an actor that is {max(z) - min(z):.3g} m high"
            found.append(Finding("warning", "units", path, text, "check metersPerUnit, and the up axis"))
    return found


def _axes(model: StageModel, extent: np.ndarray) -> list[Finding]:
    """Look for a stage that lies on its side: most of its level area faces along y, and it is tall and thin."""
    level = [float(model.mesh.areas[np.abs(model.mesh.normals[:, k]) > FLAT].sum()) for k in range(3)]
    if level[1] > 2.0 * level[2] and extent[2] > 2.0 * extent[1]:
        text = f"{level[1]:.0f} m2 face along y and {level[2]:.0f} m2 along z: y seems to be up"
        return [Finding("warning", "up_axis", "", text, "set upAxis of the stage to Y")]
    return []
