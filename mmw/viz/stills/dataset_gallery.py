"""One set of pictures of a dataset: the town from above, a street, every sensor, weathers side by side, a link."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from mmw.config.sensor_spec import SENSORS
from mmw.core.errors import InputError
from mmw.dataset import Dataset, open_dataset
from mmw.dataset.frame import Frame
from mmw.generation.provenance import stored_config
from mmw.scene.prepare import read_frame, stored_stage
from mmw.viz.plots import plot_link, plot_path_history, plot_sensor
from mmw.viz.plots.frame import sensors_of
from mmw.viz.plots.samples import has_sample, plot_view
from mmw.viz.stills.image_files import save_jpeg
from mmw.viz.stills.renderer import follow_view, load_renderer, map_frame, street_camera
from mmw.viz.stills.still import first_agent

RENDERED = ("above", "close", "street")
"""Names of the pictures by the RGB camera, as JPEG files."""

MAP_PX = 1200
"""Side of the maps [px]."""

STREET_PX = (1280, 720)
"""Width and height of the street view [px]."""

DPI = 100
"""Resolution of the plots."""

MAX_BYTES = 400_000
"""Size of one of them at most [bytes]. Design value."""


def make_gallery(
    root: Path,
    out: Path,
    *,
    scenario: str = "",
    agent: str = "",
    frame: int = -1,
    samples: int = 4,
    device: str = "auto",
) -> list[Path]:
    """Write pictures of one scenario of a dataset: the town, its sensors, a link.

    Args:
        root: Dataset folder.
        out: Folder for the files.
        scenario: Scenario name; the first one if empty.
        agent: Agent whose sensors and link are shown, and that the street view follows; the first CAV if empty. Of a
            sensor that it does not carry the first agent's is shown.
        frame: Frame to show; the first one if negative.
        samples: Rays in a pixel on an edge, for the rendered pictures: 1, 4 or 9.
        device: Warp device that renders: `auto`, `cpu` or `cuda:N`.

    Returns:
        The files written; none for a table that the dataset does not have.

    Raises:
        InputError: If the folder is no dataset, or it does not hold the scenario, agent or frame.
    """
    config = stored_config(root)
    found = config.scenario(scenario)
    scenario, weather, carriers = found.name, config.weathers[0], config.channel.carriers_hz
    frame = config.frames_of(found).start if frame < 0 else frame
    arrays = read_frame(config, found, stored_stage(root, found), frame, weather)
    names = [actor.name for actor in arrays.actors]
    agent = agent or first_agent(arrays)
    if agent not in names:
        raise InputError(f"{root}: scenario {scenario!r} has no agent {agent!r}; it has {', '.join(names[:8])}, ...")
    out.mkdir(parents=True, exist_ok=True)
    air = {weather: config.air[weather].weather(weather)}
    pictures = load_renderer(arrays, frame, air, seed=config.seed_of_scene, device=device)
    pose = arrays.poses[0, names.index(agent)]
    town = pictures.map_view(weather, *map_frame(pictures.scene), width=MAP_PX, samples=samples)
    close = pictures.map_view(weather, pose[:2], 120.0, width=MAP_PX, samples=samples)
    street = pictures.look(weather, *follow_view(pose), street_camera(*STREET_PX, samples))
    files = [out / f"{scenario}_{name}.jpg" for name in RENDERED]
    for path, image in zip(files, (town, close, street), strict=True):
        save_jpeg(image, path, MAX_BYTES)
    data = open_dataset(root)

    def save(name: str, figure: Any) -> None:
        files.append(out / f"{scenario}_{name}.png")
        figure.savefig(files[-1], dpi=DPI)

    for name, figure in sensor_figures(data, data.frame(scenario, weather, frame), config.weathers, agent):
        save(name, figure)
    if "links" in data.tables:
        found = data.numpy("links", columns=["peer", "path_count"], scenario=scenario, weather=weather, agent=agent)
        if len(found["peer"]):
            ends = (scenario, weather, str(found["peer"][0]), agent)
            save("link", plot_link(data, *ends, carrier_hz=carriers[0]))
            if found["path_count"].any():
                save("paths", plot_path_history(data, *ends, carrier_hz=carriers[0]))
    return files


def sensor_figures(data: Dataset, frame: Frame, weathers: Sequence[str], agent: str) -> Iterator[tuple[str, Any]]:
    """Yield name and figure of every type of sensor in a frame; of points in one weather and in all.

    Of a type that the agent does not carry the first agent's is shown.
    """
    agents = sorted(frame.agents.values(), key=lambda one: one.name != agent)
    for type_, spec in SENSORS.items():
        found = [(one, name) for one in agents for name in sensors_of(one, type_)]
        there = [(one, name) for one, name in found if has_sample(one, name)]
        if not there and spec.kind == "image" and "figure" not in spec.views and spec.tables[0].name in data.tables:
            there = found  # the figure shows images of other frames
        if not there or not (plot_view(spec) or spec.kind == "scalar"):
            continue
        owner, sensor = there[0]
        shown = {"": [frame.weather]} if spec.kind == "points" else {"": weathers}
        if spec.kind == "points" and len(weathers) > 1:
            shown["_weathers"] = weathers
        for ending, some in shown.items():
            yield f"{type_}{ending}", plot_sensor(data, frame.scenario, some, frame.frame, owner.name, sensor)
