"""Describe traffic engines, and find them by name without importing what they need."""

from dataclasses import dataclass
from importlib.util import find_spec

from mmw.core.errors import InputError
from mmw.core.extras import EXTRA_OF, install
from mmw.core.registry import Registry

ENGINE_KEYS = (
    "cav_pool", "cav_models", "warmup_s", "lane_changes", "signals", "driving_weather", "trajectories", "cav_ids",
    "options",
)  # fmt: skip
"""Keys of `traffic` that some engines use; every engine uses the others."""


@dataclass(frozen=True)
class TrafficEngineSpec:
    """A traffic engine: the function that runs it, the keys that it uses, and what it needs."""

    title: str
    """Its name in messages and tables."""
    simulate: str
    """`module:function` of a `mmw.traffic.engine.TrafficEngine`: `TrafficDemand` -> `TrafficResult`."""
    keys: tuple[str, ...] = ()
    """Keys among `ENGINE_KEYS` that it uses; others are refused."""
    required: tuple[str, ...] = ()
    """Keys among `keys` that the configuration must give."""
    needs_lanes: bool = True
    """Whether the town needs lanes, one of them near `spawn_center_m`."""
    package: str = ""
    """Optional package that it imports."""
    live: str = ""
    """`module:class` of `mmw.traffic.live.live_vehicles.LiveVehicles`, made from a `TrafficDemand`: vehicles that are
    advanced row by row and obey controls; empty if the engine cannot."""

    def __post_init__(self) -> None:
        """Check the names of keys.

        Raises:
            InputError: If a key is not one of `ENGINE_KEYS`, or is required and not used.
        """
        unknown = [key for key in self.keys if key not in ENGINE_KEYS]
        unknown += [key for key in self.required if key not in self.keys]
        if unknown:
            raise InputError(f"traffic engine {self.title!r}: key {unknown[0]!r} is none of {', '.join(ENGINE_KEYS)}")


ENGINES: Registry[TrafficEngineSpec] = Registry(
    "mmw.traffic_engines",
    "traffic engine",
    "mmw.config.traffic_engine:TrafficEngineSpec",
    {name: f"mmw.traffic.builtin_engines:{name.upper()}" for name in ("idm", "sumo", "replay")},
)
"""Engines by `traffic.engine`. Other packages add theirs by the entry point group `mmw.traffic_engines`."""


def engine_spec(name: str) -> TrafficEngineSpec:
    """Return an engine by its name.

    Raises:
        InputError: If there is no such engine.
    """
    if name not in ENGINES:
        raise InputError(f"engine = {name!r}: is not known; give one of {', '.join(ENGINES)}")
    return ENGINES[name]


def check_package(name: str) -> None:
    """Check that the optional package of an engine is installed.

    Raises:
        InputError: If it is not.
    """
    package = engine_spec(name).package
    if package and find_spec(package) is None:
        command = install(EXTRA_OF[package]) if package in EXTRA_OF else f"pip install {package}"
        raise InputError(f"engine = {name!r}: the package {package} is not installed; run: {command}")
