"""Kinds of hostile input by name."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tests.fuzz.cases import Kind

KINDS = {
    "configurations": "Configurations",
    "maps": "Maps",
    "stages": "Stages",
    "datasets": "Datasets",
    "command_lines": "CommandLines",
}
"""Module of a kind -> its class; imported when it is made."""


def make_kind(name: str) -> "Kind":
    """Return a new kind; `broken`, beside those of `KINDS`, tests the fuzzer itself."""
    return getattr(import_module(f"tests.fuzz.{name}"), {**KINDS, "broken": "Broken"}[name])()
