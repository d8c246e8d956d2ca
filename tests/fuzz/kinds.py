"""Kinds of hostile input by name."""

from collections.abc import Callable

from tests.fuzz.cases import Kind
from tests.fuzz.command_lines import CommandLines
from tests.fuzz.configurations import Configurations
from tests.fuzz.datasets import Datasets
from tests.fuzz.maps import Maps
from tests.fuzz.stages import Stages

KINDS: dict[str, Callable[[], Kind]] = {
    "configurations": Configurations,
    "maps": Maps,
    "stages": Stages,
    "datasets": Datasets,
    "command_lines": CommandLines,
}
