"""Report missing optional packages with the extra of the distribution that installs them.

`mmw` on the package index is an unrelated program, so messages must not name it.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from mmw.core.errors import MissingPackageError

DISTRIBUTION = "multimodal-wireless"
"""Name of this project on the package index, `project.name` in pyproject.toml; the import name is `mmw`."""

EXTRA_OF = {
    "shapely": "author", "mapbox_earcut": "author", "scipy": "author",
    "duckdb": "query", "pandas": "query",
    "matplotlib": "plot",
    "torch": "torch", "transformers": "torch",
    "rerun": "viz", "rerun_notebook": "viz",
    "libsumo": "sumo",
    "osmium": "osm",
    "rasterio": "geo",
    "gymnasium": "gym", "pettingzoo": "gym",
    "stable_baselines3": "rl",
    "ray": "ray",
    "mcap": "mcap", "mcap_ros2": "mcap",
}  # fmt: skip
"""Import name of an optional package -> extra that installs it."""


def install(*extras: str) -> str:
    """Return the shell command that installs this project with optional packages."""
    return f"pip install '{DISTRIBUTION}[{','.join(extras)}]'" if extras else f"pip install {DISTRIBUTION}"


def missing_package(error: ModuleNotFoundError, what: str = "this command") -> MissingPackageError | None:
    """Return the error for an optional package that is not installed; None if another module is missing."""
    package = (error.name or "").partition(".")[0]
    if package not in EXTRA_OF:
        return None
    return MissingPackageError(
        f"{what} needs the package {package}, which is not installed; {install(EXTRA_OF[package])}"
    )


@contextmanager
def needed_by(what: str) -> Iterator[None]:
    """Import optional packages within the block.

    Raises:
        MissingPackageError: If one of `EXTRA_OF` is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        missing = missing_package(error, what)
        if missing is None:
            raise
        raise missing from error
