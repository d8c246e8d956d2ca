"""Trace radio channels and sensors in 3-D scenes, and generate and read multimodal wireless datasets.

`__all__` lists the public names, which are loaded at their first use. Classes and functions for sensors are in
`mmw.sensors`. `mmw.open` is the short name of `open_dataset`.
"""

import logging as _logging
from importlib import import_module as _import_module
from pathlib import Path as _Path
from typing import TYPE_CHECKING
from typing import Any as _Any

if TYPE_CHECKING:
    from mmw import channel as channel
    from mmw import config as config
    from mmw import dataset as dataset
    from mmw import gym as gym
    from mmw import scene as scene
    from mmw import sensors as sensors
    from mmw import torch as torch
    from mmw import viz as viz
    from mmw.channel import Paths, PathSolver, PlanarArray, RadioMap, RadioMapSolver
    from mmw.config import Config, load_config
    from mmw.core.errors import Error, InputError
    from mmw.dataset import Dataset, Frame, connect, open_dataset
    from mmw.generation.batched_simulation import BatchedSimulation
    from mmw.generation.run_config import generate
    from mmw.generation.simulation import Simulation
    from mmw.physics.materials.material import RadioMaterial
    from mmw.physics.weather.weather import Weather
    from mmw.scene import Receiver, Scene, Transmitter, load_scene
    from mmw.sensors import register_sensor
    from mmw.traffic.live.control import Control

    open = open_dataset

__all__ = [
    "BatchedSimulation", "Config", "Control", "Dataset", "Error", "Frame", "InputError", "PathSolver", "Paths",
    "PlanarArray", "RadioMap", "RadioMapSolver", "RadioMaterial", "Receiver", "Scene", "Simulation", "Transmitter",
    "Weather", "connect", "generate", "load_config", "load_scene", "open_dataset", "register_sensor",
]  # fmt: skip

__version__ = "0.2.0"

_logging.getLogger(__name__).addHandler(_logging.NullHandler())  # whoever imports mmw decides where records go

_root = _Path(__file__).resolve().parent.parent
if (_root / "pyproject.toml").is_file():
    # Source checkout: kernels/, assets/ and configs/ sit beside this package; in a wheel they sit inside it.
    __path__.append(str(_root))


_HOME = {
    **dict.fromkeys(("PathSolver", "Paths", "PlanarArray", "RadioMap", "RadioMapSolver"), "mmw.channel"),
    **dict.fromkeys(("Config", "load_config"), "mmw.config"),
    **dict.fromkeys(("Error", "InputError"), "mmw.core.errors"),
    **dict.fromkeys(("Dataset", "Frame", "connect", "open_dataset"), "mmw.dataset"),
    "BatchedSimulation": "mmw.generation.batched_simulation",
    "Simulation": "mmw.generation.simulation",
    "generate": "mmw.generation.run_config",
    "RadioMaterial": "mmw.physics.materials.material",
    "Weather": "mmw.physics.weather.weather",
    **dict.fromkeys(("Receiver", "Scene", "Transmitter", "load_scene"), "mmw.scene"),
    "register_sensor": "mmw.sensors",
    "Control": "mmw.traffic.live.control",
}
"""Name -> module that defines it, so that `import mmw` stays light."""

_SUBMODULES = ("channel", "config", "dataset", "gym", "scene", "sensors", "torch", "viz")
"""Public modules; `mmw.gym` and `mmw.torch` need the extras of their names."""

_SHORT = {"open": "open_dataset"}
"""Short name -> name; not in `__all__`, so that `from mmw import *` replaces no built-in function."""


if not TYPE_CHECKING:  # checkers of types would take any name as there

    def __getattr__(name: str) -> _Any:
        name = _SHORT.get(name, name)
        if name in _SUBMODULES:
            return _import_module(f"{__name__}.{name}")
        if name not in _HOME:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(_import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    loaded = {name for name in globals() if name[0] != "_"} - {"TYPE_CHECKING"}
    return sorted({*__all__, *_SUBMODULES, *_SHORT, "__version__", *loaded})
