"""Pictures of the shipped scenarios: for each, four cameras of a CAV and one of the roadside unit in three weathers.

Rows of a picture are sun, rain and fog; columns are the CAV's cameras to the front, left, right and back, and the
roadside unit's.
"""

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from mmw.config import Config, ScenarioConfig, load_config
from mmw.core.errors import InputError
from mmw.core.resources import configs_dir
from mmw.scene.prepare import prepare_scenario
from mmw.scene.reader import read_stage
from mmw.sensors.rgb.config import paper_cameras
from mmw.viz.stills.image_files import join_tiles, save_jpeg
from mmw.viz.stills.renderer import load_renderer
from mmw.viz.stills.still import camera_images, resized

WEATHERS = ("sunny", "rainy", "foggy")
"""Rows of a picture."""

COLUMNS = (("cav", "front"), ("cav", "left"), ("cav", "right"), ("cav", "back"), ("rsu", "front"))
"""Columns of a picture: role of the agent, camera."""

TILE_PX = (320, 240)
"""Width and height of a tile [px]."""

FRAME = 300
"""Frame that is shown unless another is asked for: 3 s."""

MAX_BYTES = 148_000
"""Size of a file at most [bytes]: 16 of them stay below 2.5 MB. Design value."""


def draw_scenarios(
    out: Path,
    names: Sequence[str] = (),
    *,
    frame: int = FRAME,
    agent: str = "cav_1",
    samples: int = 9,
    device: str = "auto",
) -> list[Path]:
    """Write the gallery, `<scenario>.jpg` for each shipped scenario.

    Args:
        out: Folder for the files.
        names: Scenarios; all shipped ones if empty.
        frame: Frame that is shown.
        agent: CAV whose cameras are shown.
        samples: Rays in a pixel on an edge: 1, 4 or 9.
        device: Warp device that renders: `auto`, `cpu` or `cuda:N`.

    Returns:
        The files written.

    Raises:
        InputError: If there is no such scenario, frame or CAV.
    """
    shipped = {path.stem: path for path in sorted((configs_dir() / "scenarios").glob("*.yaml"))}
    for name in names:
        if name not in shipped:
            raise InputError(f"scenario {name!r}: is not shipped; those are {', '.join(shipped)}; name one of them")
    out.mkdir(parents=True, exist_ok=True)
    files = []
    for name in names or shipped:
        start = time.perf_counter()
        patch = {"weathers": list(WEATHERS), "frames": {"start": frame, "count": 1}}
        config = load_config(shipped[name], patch=patch)
        picture = draw_scenario(config, config.scenarios[0], shipped[name].parent, agent, samples, device)
        files.append(out / f"{name}.jpg")
        save_jpeg(picture, files[-1], MAX_BYTES)
        print(f"{files[-1]}  {files[-1].stat().st_size / 1000:.0f} kB, {time.perf_counter() - start:.1f} s", flush=True)
    return files


def draw_scenario(
    config: Config, scenario: ScenarioConfig, base: Path, agent: str, samples: int, device: str
) -> Image.Image:
    """Return the picture of one scenario at its first frame: the configuration's weathers in rows, cameras in columns.

    Raises:
        InputError: If the CAV or a roadside unit is absent in the frame.
    """
    frame, (width, height) = config.frames_of(scenario).start, TILE_PX
    size = {"width_px": width, "height_px": height, "samples": samples}
    cameras = {camera.name: resized(camera, size) for camera in paper_cameras()}
    with tempfile.TemporaryDirectory() as folder:
        stage = prepare_scenario(config, scenario, base, Path(folder))
        arrays = read_stage(stage, range(frame, frame + 1), config.variants, margin=1, foliage=config.foliage)
        weathers = {name: config.air[name].weather(name) for name in config.weathers}
        pictures = load_renderer(arrays, frame, weathers, seed=config.seed_of_scene, device=device)
        rsu = next((actor.name for actor in arrays.actors if actor.role == "rsu"), "rsu")
        carriers, stream = {"cav": agent, "rsu": rsu}, (config.seed, scenario.name)
        columns = [
            camera_images(pictures, frame, config.weathers, cameras[name], carriers[role], stream)
            for role, name in COLUMNS
        ]
    return join_tiles([[images[weather] for images in columns] for weather in config.weathers])
