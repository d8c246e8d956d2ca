"""Read the reference cases that were computed with Sionna RT."""

import json
from pathlib import Path

import numpy as np

from mmw.physics.materials.material import Material, RadioMaterial

FOLDER = Path(__file__).parents[1] / "reference" / "sionna"
MANIFEST = json.loads((FOLDER / "manifest.json").read_text())["cases"]
"""Inputs of every case by name."""


def read_case(name: str) -> dict[str, np.ndarray]:
    return dict(np.load(FOLDER / "cases" / f"{name}.npz"))


def used_material(name: str, values: dict, spec: dict) -> Material:
    """Return a material with the numbers that Sionna used at the case's frequency: float32, so not exactly ITU's."""
    radio = RadioMaterial(
        "constant",
        relative_permittivity=values["eps_r"],
        conductivity=values["sigma"],
        thickness=values["thickness"],
        scattering=values["S"],
        xpd=values["Kx"],
        scattering_pattern=spec.get("pattern", "lambertian"),
        **{{"lambda_": "lobe_share"}.get(k, k): v for k, v in spec.get("pattern_args", {}).items()},
    )
    return Material(name, radio, "none", 0.3, (0.5, 0.5, 0.5))
