"""The shipped configurations by name, so that `--config quickstart` works in any folder, from a clone or a wheel."""

from difflib import get_close_matches
from pathlib import Path

from mmw.config.yaml_file import ConfigError
from mmw.core.resources import shipped_configs

CONFIG_HELP = "configuration file (YAML), or the name of a shipped configuration, such as quickstart"
"""Help of every command's `--config`."""


def config_path(given: str | Path) -> Path:
    """Return the configuration file that a user means.

    A file that exists is itself. A bare name, without folder and suffix, is looked up among the shipped configurations:
    `quickstart`, `full`, and the scenarios such as `town03_roundabout`. Relative paths in a configuration start from
    the folder of the file that is returned.

    Raises:
        ConfigError: If neither a file nor a shipped configuration is meant.

    Examples:
        >>> config_path("quickstart").name
        'quickstart.yaml'
    """
    path, shipped = Path(given), shipped_configs()
    if path.is_file():
        return path
    is_bare = path.name == str(given) and not path.suffix
    if is_bare and path.name in shipped:  # also where a folder has that name
        return shipped[path.name]
    if is_bare and not path.exists():
        near = get_close_matches(path.name, shipped, n=3, cutoff=0.6)
        listed = f"did you mean {' or '.join(near)}" if near else f"shipped ones are {', '.join(shipped)}"
        raise ConfigError(
            [f"{given}: no such file, and no shipped configuration; {listed}; name one of them, or give a YAML file"]
        )
    if not path.exists() and path.stem in shipped:
        raise ConfigError(
            [f"{given}: no such file; give an existing YAML file, or the shipped configuration by name: {path.stem}"]
        )
    return path
