"""List all checks."""

import importlib

from mmw.validation.check import Check

TOPICS = (
    "materials", "street", "vehicles", "blockage", "atmosphere", "traffic", "camera",
    "radar", "beams", "lidar", "gnss", "near_field",
)  # fmt: skip
"""Modules of `mmw.validation.checks`, in the order of the page."""


def all_checks() -> list[Check]:
    """Return the checks of all topics, in the order of the page.

    Raises:
        ValueError: If two checks have one name.
    """
    checks: list[Check] = []
    for topic in TOPICS:
        checks += importlib.import_module(f"mmw.validation.checks.{topic}").CHECKS
    names = [check.name for check in checks]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"checks with one name: {', '.join(twice)}")
    return checks
