"""Read a YAML file as a validated section; each problem is one line with file, key, value and remedy."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from mmw.config.validation_errors import problem_line
from mmw.config.yaml_loader import MAX_LENGTH, parse_yaml
from mmw.core.errors import InputError

Model = TypeVar("Model", bound=BaseModel)


class ConfigError(InputError):
    """Report a configuration that cannot be used; `problems` holds one line for each problem."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("\n".join(problems))
        self._problems = list(problems)

    def __reduce__(self) -> tuple[type["ConfigError"], tuple[list[str]]]:
        # It goes to another process by its problems, not by its text.
        return ConfigError, (self._problems,)

    @property
    def problems(self) -> list[str]:
        """Problems, one line each."""
        return self._problems


def read_yaml(path: Path, needed: str) -> dict[Any, Any]:
    """Return the map in a YAML file.

    Raises:
        ConfigError: If it cannot be read, is not YAML, or is no map.
    """
    try:
        with path.open(encoding="utf-8") as file:
            data = parse_yaml(file.read(MAX_LENGTH + 1))
    except FileNotFoundError:
        raise ConfigError([f"{path}: no such file; give an existing YAML file"]) from None
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise ConfigError([f"{path}: cannot be read ({reason}); give a readable YAML file"]) from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"{path}:{mark.line + 1}:{mark.column + 1}" if mark else str(path)
        raise ConfigError([f"{where}: not valid YAML: {reason_of(error)}; correct that line"]) from None
    if not isinstance(data, dict):
        kind = {"NoneType": "nothing", "str": "only text", "list": "a list"}.get(type(data).__name__, "no keys")
        raise ConfigError([f"{path}: holds {kind}; {needed} is needed"])
    return data


def reason_of(error: yaml.YAMLError) -> str:
    """Return what is wrong with a piece of YAML in one line."""
    return " ".join(str(getattr(error, "problem", None) or error).split())


def validated(model: type[Model], data: Any, place: Path | str, key: tuple[str, ...] = ()) -> Model:
    """Return the content of a file, or of its `key`, as a section; `place` is the file, or words for what is no file.

    Raises:
        ConfigError: With one line for each problem.
    """
    try:
        # As JSON, strictly: lists become tuples, but the text "42" is no number and 1 is not true.
        return model.model_validate_json(json.dumps(_whole(data), default=str), strict=True)
    except ValidationError as error:
        raise config_error(error, place, model, key) from None


def config_error(
    error: ValidationError, place: Path | str, model: type[BaseModel], key: tuple[str, ...] = ()
) -> ConfigError:
    """Return an error of pydantic as one line for each problem, see `validated`."""
    found: list[ErrorDetails] = [{**item, "loc": (*key, *item["loc"])} for item in error.errors()]
    return ConfigError([problem_line(place, item, model) for item in found])


def _whole(value: Any) -> Any:
    """Return a file's content with whole numbers as integers: `1e6` rays are a count too."""
    if isinstance(value, dict):
        return {key: _whole(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_whole(item) for item in value]
    return int(value) if isinstance(value, float) and value.is_integer() else value
