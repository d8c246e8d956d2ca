"""Fill the land between imported roads: sidewalks, buildings and furniture by the builder of our own towns."""

from dataclasses import replace

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.worlds.importers.blocks.layout import GROUND_LABELS, find_layout
from mmw.worlds.importers.blocks.sidewalks import build_sidewalks, plan_sidewalks
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.importers.mesh_cleanup import free_name
from mmw.worlds.towns.block_description import BlockDescription
from mmw.worlds.towns.blocks import place_lots
from mmw.worlds.towns.buildings import build_building
from mmw.worlds.towns.ground_height import Ground
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.prop_placement import place_props

LANE_MARGIN = 0.5
"""Nothing is built closer than this to the edge of a lane, whatever the road's mesh covers [m]; design value."""
SWEPT = 2.6
"""Width that vehicles sweep on lanes that are narrower [m]; over the 2.55 m of Directive 96/53/EC, annex I, 1.2."""
COARSE = 0.05
"""Borders of carriageways are followed within this by rows of furniture [m]; design value."""
NICHE = 4.0
"""Niches of the corridor narrower than twice this are closed before fronts follow it [m]; design value."""
STEP = 0.3
"""Steps of the corridor below this do not turn a front [m]; design value."""


def fill_blocks(where: str, scene: ImportedScene, description: BlockDescription) -> ImportedScene:
    """Return a world with sidewalks along bare carriageways, and buildings and furniture along its streets.

    Fast roads and bridges, and the land ahead of open ends, stay free; so do lanes and objects of the source.

    Args:
        where: File, for errors.
        scene: A world with roads and, for zones of fast roads and open ends, lanes.
        description: Styles, districts and furniture.

    Raises:
        InputError: If the world has no road surface, or something placed by hand does not fit.
    """
    layout = find_layout(scene)
    if layout.carriageway.is_empty:
        raise InputError(
            f"{where}: --buildings: no mesh has the class road; label roads in a material map (--materials)"
        )
    strips = plan_sidewalks(layout)
    walks = build_sidewalks(scene, layout, strips)
    lanes = scene.lanes or LaneGraph()
    paths = [
        shapely.LineString(lane.points[:, :2]).buffer(0.5 * max(lane.width, SWEPT)) for lane in lanes.lanes.values()
    ]
    carriageway = shapely.union_all([layout.carriageway, *paths], grid_size=1e-3)
    corridor = shapely.union_all([layout.corridor, strips, shapely.buffer(carriageway, LANE_MARGIN)], grid_size=1e-3)
    corridor = shapely.buffer(shapely.buffer(corridor, NICHE, quad_segs=4), -NICHE + STEP, quad_segs=4)
    corridor, carriageway = (
        shapely.normalize(shapely.simplify(area, within)) for area, within in ((corridor, STEP), (carriageway, COARSE))
    )
    ground = Ground([part for part in (*scene.parts, *walks) if part.label in GROUND_LABELS])
    closed = [area for area in (layout.fast, layout.bridges, layout.ahead) if not area.is_empty]
    objects = list(layout.objects)
    try:
        lots, blocks = place_lots(description, corridor, layout.land, ground, [*closed, *objects])
        buildings: list[MeshPart] = []
        for number, lot in enumerate(lots):
            rng = np.random.default_rng([description.blocks.seed, 2, number])
            style = description.blocks.styles[lot.style]
            buildings += build_building(lot.name, style, lot.site, lot.storeys, rng, (), lot.is_joined)
        props = place_props(description, carriageway, lanes, lots, blocks, ground, objects, closed)
    except InputError as error:
        raise InputError(f"{where}: --buildings: {error}") from None
    made = [*walks, *buildings, *props]
    count = len({part.path.split("/")[1] for part in props})
    note = (
        f"not of the file but made for --buildings, seed {description.blocks.seed}: {len(lots)} buildings, {count} "
        f"trees and props, {strips.area:,.0f} m2 of sidewalk"
    )
    return replace(scene, parts=[*scene.parts, *_renamed(made, scene.parts)], notes=(*scene.notes, note))


def _renamed(parts: list[MeshPart], others: list[MeshPart]) -> list[MeshPart]:
    """Return parts whose objects have other names than those of the source."""
    used = {"/".join(part.path.split("/")[:2]) for part in others}
    names: dict[str, str] = {}
    result = []
    for part in parts:
        group, name, *rest = part.path.split("/")
        stem = f"{group}/{name}"
        if stem not in names:
            names[stem] = free_name(stem, used)
            used.add(names[stem])
        result.append(replace(part, path="/".join([names[stem], *rest])))
    return result
