"""Name the folders of stages in a dataset, and read the hashes that are written beside a stage."""

import json
from collections.abc import Mapping
from typing import Any

STAGES = "stages"
"""Folder of the scenario stages in a dataset."""

ASSETS = "assets"
"""Folder of the copies that they refer to."""

Spans = Mapping[str, list[list[int]]]
"""Actor -> first frame and one past the last of stretches of frames."""


def parse_digests(data: bytes | None) -> dict[str, Any] | None:
    """Return the hashes that were written beside a stage; None if there are none, or they are damaged."""
    try:
        found = json.loads(data or b"")
    except (ValueError, RecursionError):
        return None
    is_complete = isinstance(found, dict) and isinstance(found.get("sha256"), str)
    return found if is_complete and isinstance(found.get("assets"), dict) else None
