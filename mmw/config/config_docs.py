"""Generate the page `docs/reference/configuration.md` from the models: every key with its default, unit and source."""

import json
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from mmw.config.file_content import file_content
from mmw.config.model import Config
from mmw.config.sensor_spec import SENSORS
from mmw.config.validation_errors import keys_of, models_in, tag_of

PAPER, CARLA, HDL64 = "paper", "CARLA 0.9.15", "HDL-64E"
"""Sources of defaults. `paper` is Multimodal-Wireless, tables of sensors and of Sionna's parameters."""

SOURCES = {
    **dict.fromkeys(
        (
            "channel.carriers_hz", "channel.samples_per_tx", "channel.max_depth", "channel.antennas.pattern",
            "scenarios.traffic.signals", "sensors.lidar.channels", "sensors.lidar.points_per_channel",
            "sensors.lidar.range_m", "sensors.lidar.upper_fov_deg", "sensors.lidar.lower_fov_deg",
            "sensors.lidar.rate_hz", "sensors.depth.rate_hz", "sensors.depth.width_px", "sensors.depth.height_px",
            "sensors.depth.fov_deg", "sensors.rgb.rate_hz", "sensors.rgb.width_px", "sensors.rgb.height_px",
            "sensors.rgb.fov_deg", "sensors.imu.rate_hz", "sensors.imu.gyro_bias", "sensors.imu.gyro_noise_std",
            "sensors.imu.accel_noise_std", "sensors.radar.rate_hz", "sensors.radar.points", "sensors.radar.range_m",
            "sensors.radar.horizontal_fov_deg", "sensors.radar.vertical_fov_deg",
        ),
        PAPER,
    ),
    "sensors.lidar.carla": CARLA,
    "sensors.lidar.preset": HDL64,
}  # fmt: skip
"""Dotted key, or the section above it -> source of its default; every other default is a choice of mmw."""

HEAD = """# Configuration keys

Every key, its default and the source of the default; generated from the models by `MMW_UPDATE_GOLDEN=1 pytest tests/config/test_config_docs.py`. The unit is in brackets at the end of each description. [What a configuration means](../guides/configure.md) has precedence and syntax.

Source of a default: `paper` is the Multimodal-Wireless paper, `CARLA 0.9.15` that simulator, `HDL-64E` that LiDAR's preset; without one it is a choice of mmw, whose reason is on the page of the sensor or model. A key without a default is needed; `none` means that there is no value unless one is given.
"""  # noqa: E501


def configuration_page() -> str:
    """Return the page as Markdown."""
    parts = [HEAD]
    for title, key, model in _sections():
        parts.append(
            f"\n## {title}\n\n{_summary(model)}\n\n| key | default | meaning [unit] | source |\n|---|---|---|---|\n"
        )
        for name, field in keys_of(model).items():
            if name == "type" and tag_of(model):
                continue
            full = f"{key}.{name}" if key else name
            parts.append(f"| `{name}` | {_default(field)} | {_cell(field.description or '')} | {_source(full)} |\n")
    return "".join(parts)


def _sections() -> Iterator[tuple[str, str, type[BaseModel]]]:
    """Yield title, key and model of every section, each model once."""
    seen: set[type[BaseModel]] = set()
    pending: list[tuple[str, str, type[BaseModel]]] = [("Top level", "", Config)]
    while pending:
        title, key, model = pending.pop(0)
        if model in seen:
            continue
        seen.add(model)
        yield title, key, model
        inner = []
        for name in keys_of(model):
            full = f"{key}.{name}" if key else name
            if full == "sensors":
                inner += [(f"`sensors`: `{type_}`", f"sensors.{type_}", spec.config) for type_, spec in SENSORS.items()]
                continue
            inner += [(f"`{full}`", full, found) for found in models_in(model, name)]
        pending = inner + pending


def _summary(model: type[BaseModel]) -> str:
    return " ".join((model.__doc__ or "").split("\n\n", 1)[0].split())


def _default(field: FieldInfo) -> str:
    value: Any = field.get_default(call_default_factory=True)
    if value is PydanticUndefined or field.is_required():
        return "needed"
    if value is None:
        return "none"
    if isinstance(value, BaseModel):
        return "its defaults"
    content = file_content(value)
    if isinstance(content, list) and any(isinstance(item, dict) for item in content):
        return f"{len(content)} entries"
    return f"`{_cell(json.dumps(content))}`"


def _source(key: str) -> str:
    above = key.rpartition(".")[0]
    return SOURCES.get(key) or SOURCES.get(above, "")


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
