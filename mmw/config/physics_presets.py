"""`channel.physics`: how much of the propagation is computed, as defaults of the other keys of `channel`."""

from typing import Any, Literal

Physics = Literal["paper", "standard", "full"]
"""`paper`: line of sight and mirror reflections of the first order, as in the Multimodal-Wireless paper. `standard`:
what a link budget in a street needs. `full`: one more reflection, and diffuse scattering."""

STANDARD: dict[str, Any] = {
    "max_depth": 2, "refraction": True, "diffraction": True, "finite_surfaces": True, "foliage": True,
    "dynamic_range_db": 40.0,
}  # fmt: skip

PHYSICS_PRESETS: dict[Physics, dict[str, Any]] = {
    "paper": {},
    "standard": STANDARD,
    "full": {**STANDARD, "max_depth": 3, "diffuse_reflection": True, "diffuse_error_db": 0.5},
}
"""Preset -> keys of `channel` that it changes; those of `paper` are the defaults of the keys. A key that is
given wins."""
