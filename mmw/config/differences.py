"""Say what a configuration changes: the shortest file content that means the same."""

from typing import Any

import yaml
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from mmw.config.air import AirConfig, resolve_air
from mmw.config.channel import ChannelConfig
from mmw.config.model import Config
from mmw.config.validation_errors import tag_of
from mmw.physics.weather.weather import PRESETS


def differences(config: Config) -> dict[str, Any]:
    """Return the keys of a configuration whose values are not the defaults, and those without a default.

    It is the content of a file that means the same configuration. Of lists of sections, such as `sensors`, either
    nothing or all entries are there, each with its own differences.
    """
    rates = {config.frame_rate_of(scenario) for scenario in config.scenarios}
    plain = tuple(
        # written out by `Config` where all scenarios have one rate
        sensor.model_copy(update={"rate_hz": None}) if {sensor.rate_hz} == rates else sensor
        for sensor in config.sensors
    )
    changed = _section(config.model_copy(update={"sensors": plain}))
    changed.pop("air", None)
    air = {name: found for name, one in config.air.items() if (found := _air(name, one)) is not None}
    return changed | ({"air": air} if air else {})


def differences_yaml(config: Config) -> str:
    """Return `differences` as YAML."""
    return yaml.safe_dump(differences(config), sort_keys=False, allow_unicode=True, width=120)


def _air(name: str, values: AirConfig) -> dict[str, Any] | None:
    """Return what a weather changes of the preset of its name, else of clear air; None for a preset as it is."""
    usual = resolve_air({} if name in PRESETS else {name: AirConfig()}, (name,))[name]
    given, base = values.model_dump(mode="json"), usual.model_dump(mode="json")
    changed = {key: value for key, value in given.items() if value != base[key]}
    return None if not changed and name in PRESETS else changed


def _section(section: BaseModel) -> dict[str, Any]:
    tag = tag_of(type(section))
    content: dict[str, Any] = {"type": tag} if tag else {}
    for name, field in type(section).model_fields.items():
        value = getattr(section, name)
        if name == "type" and tag:
            continue
        if field.is_required() or value != _default(field):
            content[field.alias or name] = _content(value, None if field.is_required() else _default(field))
    return content


def _default(field: FieldInfo) -> Any:
    return field.get_default(call_default_factory=True)


def _changed(value: BaseModel, default: BaseModel) -> dict[str, Any]:
    """Return the keys of a section whose values are not those of another one, and those without a default."""
    return {
        field.alias or name: _content(getattr(value, name), getattr(default, name))
        for name, field in type(value).model_fields.items()
        if getattr(value, name) != getattr(default, name) or field.is_required()
    }


def _content(value: Any, default: Any) -> Any:
    """Return a value as file content; of a section what differs from its default in this place."""
    if isinstance(value, ChannelConfig):  # its preset says what is usual
        preset = {} if value.physics == "paper" else {"physics": value.physics}
        return preset | _changed(value, ChannelConfig(physics=value.physics))
    if isinstance(value, BaseModel):
        return _changed(value, default) if type(default) is type(value) else _section(value)
    if isinstance(value, list | tuple):
        return [_content(item, None) for item in value]
    if isinstance(value, dict):
        return {key: _content(item, None) for key, item in value.items()}
    return value
