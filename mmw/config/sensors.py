"""`sensors`: what every agent carries. Defaults are the values of the paper's sensor table."""

import json
from typing import Annotated, Any, get_args

from pydantic import BeforeValidator, GetJsonSchemaHandler, SerializeAsAny, ValidationError, ValidationInfo
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError
from pydantic_core.core_schema import ErrorType

from mmw.config.sensor import SensorConfig
from mmw.config.sensor_spec import SENSORS

_PYDANTIC_ERRORS = frozenset(get_args(ErrorType))
"""Types of errors that pydantic has messages for."""


def _by_type(value: Any, info: ValidationInfo) -> Any:
    """Return the section of the registered kind that `type` names; a section that Python code gives, if it is one."""
    if not isinstance(value, dict | SensorConfig):
        return value
    kind = value.get("type") if isinstance(value, dict) else value.type
    if kind is None:
        raise PydanticCustomError("union_tag_not_found", "type is missing")
    if not isinstance(kind, str) or kind not in SENSORS:
        names = ", ".join(repr(name) for name in SENSORS)
        raise PydanticCustomError(
            "union_tag_invalid", "{tag} is unknown; {expected_tags}", {"tag": str(kind), "expected_tags": names}
        )
    section = SENSORS[kind].config
    if isinstance(value, section):
        return value
    if not isinstance(value, dict):
        raise PydanticCustomError(
            "sensor_class",
            "a {found} is no sensor of type {kind}; give a {needed}",
            {"found": type(value).__name__, "kind": repr(kind), "needed": section.__name__},
        )
    try:
        # As `mmw.config.yaml_file.validated`: of a file, lists become tuples, but the text "42" is no number.
        if info.mode == "json":
            return section.model_validate_json(json.dumps(value), strict=True)
        return section.model_validate(value)
    except ValidationError as error:
        details = []
        for item in error.errors():
            name: Any = item["type"]
            if name not in _PYDANTIC_ERRORS:
                name = PydanticCustomError(name, item["msg"].replace("{", "{{").replace("}", "}}"))
            location = (kind, *item["loc"])
            details.append(InitErrorDetails(type=name, loc=location, input=item["input"], ctx=item.get("ctx", {})))
        raise ValidationError.from_exception_data(error.title, details) from None


class _Schema:
    """JSON schema of a sensor: nothing yet; see `add_sensor_schemas`."""

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {}


def add_sensor_schemas(schema: dict[str, Any]) -> None:
    """Fill the schemas of all registered kinds into the JSON schema of a configuration."""
    definitions, mapping = dict(schema["$defs"]), {}
    for name, spec in SENSORS.items():
        own = spec.config.model_json_schema()
        definitions |= own.pop("$defs", {})
        definitions[spec.config.__name__] = own
        mapping[name] = f"#/$defs/{spec.config.__name__}"
    schema["$defs"] = dict(sorted(definitions.items()))
    schema["properties"]["sensors"]["items"] = {
        "discriminator": {"mapping": mapping, "propertyName": "type"},
        "oneOf": [{"$ref": reference} for reference in mapping.values()],
    }


AnySensor = Annotated[SerializeAsAny[SensorConfig], BeforeValidator(_by_type), _Schema()]
"""A sensor of any registered kind."""


def default_sensors() -> tuple[SensorConfig, ...]:
    """Return the paper's suite."""
    return tuple(sensor for spec in SENSORS.values() for sensor in spec.defaults())
