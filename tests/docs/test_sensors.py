"""The pages of the sensors: fragments load, keys are listed with their defaults, and files they refer to exist."""

import re
from pathlib import Path

import pytest
import yaml
from pydantic import BaseModel

from mmw.config import MountConfig, SensorConfig, load_config
from mmw.config.lens import LensConfig
from mmw.sensors import DepthCamera, Gnss, Imu, Lidar, Radar, RgbCamera
from mmw.sensors.lidar.config_parts import CarlaLidarConfig, LidarOpticsConfig
from mmw.sensors.lidar.optics import PRESETS
from mmw.sensors.render.image_config import ExposureConfig, ImageConfig, NoiseConfig
from mmw.storage.schemas import table_spec
from tests.fixtures.pages import markdown_rows

ROOT = Path(__file__).parents[2]
PAGES = ROOT / "docs" / "sensors"
SECTIONS = {"lidar": Lidar, "radar": Radar, "rgb": RgbCamera, "depth": DepthCamera, "imu": Imu, "gnss": Gnss}
"""Page of a sensor -> section of the configuration."""

MAX_BYTES = 250_000
"""Size of a figure."""


def page(name: str) -> str:
    return (PAGES / f"{name}.md").read_text()


def all_pages() -> str:
    return "\n".join(path.read_text() for path in sorted(PAGES.glob("*.md")))


def number(text: str) -> float | None:
    """Return the number that a cell holds, such as `2e-4` or `0.1 / 50^2`; None if it holds none."""
    match = re.fullmatch(r"([-\d.e]+)(?: / (\d+)\^2)?", text.split(":")[0].strip())
    return float(match[1]) / float(match[2] or 1) ** 2 if match else None


def fields_of(cell: str) -> list[str]:
    return re.findall(r"`(\w+)`", cell)


def test_every_fragment_of_the_guide_loads(tmp_path: Path) -> None:
    blocks = re.findall(r"```yaml\n(.*?)```", all_pages(), re.DOTALL)
    assert len(blocks) >= 8
    types = set()
    for block in blocks:
        path = tmp_path / "c.yaml"
        path.write_text("scenarios: [{name: s, stage: s.usda}]\n" + block)
        config = load_config(path)
        assert len(config.sensors) == len(yaml.safe_load(block)["sensors"])
        types |= {(sensor.type, getattr(sensor, "mode", "")) for sensor in config.sensors}
    both = {(name, mode) for name in ("lidar", "radar", "imu", "gnss") for mode in ("carla", "physical")}
    assert types == both | {("depth", ""), ("rgb", ""), ("gnss", "ray_traced")}


@pytest.mark.parametrize("name", SECTIONS)
def test_the_page_names_every_key(name: str) -> None:
    text = page(name)
    keys = set(SECTIONS[name].model_fields) - set(SensorConfig.model_fields) - {"mode"}
    if name == "rgb":
        for section in (LensConfig, ImageConfig, ExposureConfig, NoiseConfig):
            keys |= set(section.model_fields)
    if name == "lidar":
        keys |= set(LidarOpticsConfig.model_fields) | set(CarlaLidarConfig.model_fields)
    assert {key for key in keys if not re.search(rf"`{key}[:`]", text)} == set()


def test_the_overview_names_the_keys_that_all_sensors_share() -> None:
    keys = {*SensorConfig.model_fields, *MountConfig.model_fields}
    assert {key for key in keys if f"`{key}`" not in page("index")} == set()


@pytest.mark.parametrize(
    ("sensor", "min_count"),
    [("lidar", 8), ("radar", 19), ("rgb", 15), ("depth", 4), ("imu", 14), ("gnss", 23)],
)
def test_the_defaults_of_the_guide_are_those_of_the_code(sensor: str, min_count: int) -> None:
    section: BaseModel = SECTIONS[sensor]()
    compared = 0
    for cells in markdown_rows(page(sensor), "key")[1:]:
        names = fields_of(cells[0])
        values = [part.strip() for part in cells[1].split(",")]
        if len(names) != len(values):
            continue
        for name, text in zip(names, values, strict=True):
            default = getattr(section, name)
            if isinstance(default, bool | str):
                assert text.strip("`") == str(default).lower(), name
                compared += 1
            elif number(text) is not None:
                assert number(text) == pytest.approx(default), name
                compared += 1
    assert compared >= min_count


def test_the_presets_of_the_guide_are_those_of_the_code() -> None:
    rows = markdown_rows(page("lidar"), "`optics`")[1:]
    compared = set()
    for cells in rows:
        names = fields_of(cells[0])
        for preset, cell in zip(PRESETS, cells[1:5], strict=True):
            for name, text in zip(names, cell.split(","), strict=True):
                optics = PRESETS[preset]
                value = optics.drop_efficiency if name == "drop_backscatter" else getattr(optics, name)
                assert number(text) == pytest.approx(value, rel=5e-3), (preset, name)
                compared.add(name)
    assert compared == set(LidarOpticsConfig.model_fields)


def test_carla_defaults_of_the_guide() -> None:
    given = re.search(r"\| `carla` \|(.*)\|", page("lidar"))
    assert given
    values = {name: float(value) for name, value in re.findall(r"`(\w+)` ([\d.]+)", given[1])}
    assert values == CarlaLidarConfig().model_dump()


def test_columns_that_the_guide_names_exist() -> None:
    columns = {sensor: {field.name for field in table_spec(sensor).columns} for sensor in ("lidar", "radar")}
    for sensor, known in columns.items():
        named = {name for cells in markdown_rows(page(sensor), "column") for name in fields_of(cells[0])}
        assert named <= known
        assert known - named <= {"scenario", "weather", "frame", "agent", "sensor", "point_count", "ring"}


def test_figures_of_the_guide_are_small() -> None:
    figures = re.findall(r"\]\((\.\./images/\w+\.png)\)", all_pages())
    assert len(figures) == 6
    assert all(20_000 < (PAGES / figure).stat().st_size <= MAX_BYTES for figure in figures)
