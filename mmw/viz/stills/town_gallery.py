"""Pictures of a town alone: from above, three streets, and the map of its lanes."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mmw.core.errors import InputError
from mmw.physics.weather.weather import PRESETS, Weather
from mmw.scene.reader import WEATHER, read_stage
from mmw.usd.open_stage import open_stage, reads_usd
from mmw.viz.plots.lane_map import plot_lanes
from mmw.viz.stills.image_files import save_jpeg
from mmw.viz.stills.renderer import load_renderer, map_frame, street_camera
from mmw.viz.stills.street_views import FOV_DEG, HEIGHT_PX, STREETS, WIDTH_PX, View, choose_views, view_direction
from mmw.worlds.checks.stage_model import open_stage_model

MAX_BYTES = 190_000
"""Size of a JPEG file at most [bytes], so that documents stay small. Design value."""


def draw_town(
    path: Path, out: Path, *, views: Sequence[View] = (), samples: int = 4, device: str = "auto"
) -> list[Path]:
    """Write the pictures of a town, or of any other stage at its start, as the RGB camera sees it.

    The files are `<name>_above.jpg`, `<name>_street1.jpg` to `3`, and, for a stage with lanes, `<name>_lanes.png`.
    Equal stages give equal pictures. Without given views, those that see most distinct objects are chosen. The stage's
    selected weather is drawn, with the values of the preset of its name.

    Args:
        path: USD file.
        out: Folder for the files.
        views: Street views instead of the chosen ones, at most three.
        samples: Rays in a pixel on an edge: 1, 4 or 9.
        device: Warp device that renders: `auto`, `cpu` or `cuda:N`.

    Returns:
        The files written.

    Raises:
        InputError: If the stage cannot be read, a mesh has no radio material, or there are more than three views.
    """
    if len(views) > STREETS:
        raise InputError(f"{len(views)} views are given; a town has {STREETS}; leave some out")
    weather = selected_weather(path)
    arrays = read_stage(path, range(1), [weather])
    pictures = load_renderer(arrays, 0, {weather: PRESETS.get(weather, Weather())}, device=device)
    lanes = open_stage_model(path).lanes
    out.mkdir(parents=True, exist_ok=True)
    files = [out / f"{path.stem}_above.jpg"]
    above = pictures.map_view(weather, *map_frame(pictures.scene), width=WIDTH_PX, samples=samples)
    save_jpeg(above, files[0], MAX_BYTES)
    camera = street_camera(WIDTH_PX, HEIGHT_PX, samples, FOV_DEG)
    for number, view in enumerate(views or choose_views(pictures.scene, lanes), start=1):
        eye, direction = np.array(view[:3]), view_direction(view[3])
        files.append(out / f"{path.stem}_street{number}.jpg")
        save_jpeg(pictures.look(weather, eye, eye + direction, camera), files[-1], MAX_BYTES)
    if lanes is not None:
        files.append(out / f"{path.stem}_lanes.png")
        plot_lanes(lanes, arrays, path.stem, files[-1])
    return files


@reads_usd
def selected_weather(path: Path) -> str:
    """Return the weather that a stage has selected, `sunny` for a stage without weathers.

    Raises:
        InputError: If USD cannot read the file.
    """
    stage = open_stage(path)
    for prim in stage.Traverse():
        if prim.HasVariantSets() and prim.GetVariantSets().HasVariantSet(WEATHER):
            return prim.GetVariantSet(WEATHER).GetVariantSelection() or prim.GetVariantSet(WEATHER).GetVariantNames()[0]
    return "sunny"
