"""Switches that find nothing in a scene are told, and none that find something."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from mmw.channel.path_solver.surface_table import make_surface_table
from mmw.config import load_config
from mmw.generation.configuration_warnings import configuration_warnings, surface_warnings
from mmw.physics.materials.material import RadioMaterial
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData
from tests.fixtures.scenes import arrays_from_parts, ground_part, two_cars

ROUGH = RadioMaterial("itu", "itu_brick", scattering=0.3)
SLAB = RadioMaterial("itu", "itu_brick", thickness=0.2)
LEAVES = RadioMaterial("itu", itu="itu_brick", medium="foliage")
SMOOTH = RadioMaterial("itu", "itu_brick")


def scene_of(radio: RadioMaterial) -> SceneData:
    arrays = two_cars(10)
    materials = {w: tuple(replace(m, radio=radio) for m in by_id) for w, by_id in arrays.materials.items()}
    return replace(arrays, materials=materials)


def found(arrays: SceneData, *changes: str) -> list[str]:
    config = load_config("quickstart", ["sensors=[{type: imu}]", *changes])
    return list(configuration_warnings(arrays, config, config.scenarios[0]))


@pytest.mark.parametrize(
    ("radio", "change", "said"),
    [
        (
            SMOOTH,
            "channel.diffuse_reflection=true",
            "channel.diffuse_reflection finds nothing: no material of the ",
        ),
        (SLAB, "channel.diffuse_reflection=true", "channel.diffuse_reflection finds nothing"),
        (ROUGH, "channel.diffuse_reflection=true", ""),
        (
            SMOOTH,
            "channel.refraction=true",
            "channel.refraction finds nothing: no material of the scene has a thick",
        ),
        (SLAB, "channel.refraction=true", ""),
        (SMOOTH, "channel.foliage=true", "channel.foliage finds nothing: no material of the scene has the medium"),
        (LEAVES, "channel={foliage: true, diffuse_reflection: true}", ""),
        (LEAVES, "channel.diffuse_reflection=true", "channel.diffuse_reflection finds nothing"),
        (SMOOTH, "foliage=leaves", "foliage = leaves finds nothing: no material of the static world has the medium"),
        (LEAVES, "foliage=leaves", ""),
        (SMOOTH, "channel.links=[v2v]", "channel.links has v2v, but the scenario has 1 CAV, 1 RSU: no such link"),
        (ROUGH, "channel={max_depth: 0, diffuse_reflection: true}", "channel.max_depth = 0 leaves the line of sight"),
        (SMOOTH, "channel={los: false, specular_reflection: false}", "los and all interactions are switched off"),
        (SMOOTH, "channel.edge_diffraction=true", "channel.edge_diffraction finds nothing"),
        (SMOOTH, "channel={edge_diffraction: true, diffraction: true}", ""),
        (SMOOTH, "channel={enabled: false, diffuse_reflection: true}", ""),
        (SMOOTH, "channel.carriers_hz=[28e9, 4.9e9]", ""),
        (SMOOTH, "channel.carriers_hz=[60e9]", "(itu_brick) at 60 GHz: interpolated between 40 and 110 GHz"),
        (SMOOTH, "channel={enabled: false, carriers_hz: [60e9]}", ""),
    ],
)
def test_what_finds_nothing(radio: RadioMaterial, change: str, said: str) -> None:
    lines = found(scene_of(radio), "channel.links=[v2i]", change)
    assert [said in line for line in lines] == ([True] if said else [])


def test_notes_on_the_material_map_are_among_them() -> None:
    assert found(replace(two_cars(10), material_notes=("materials['x'] decides nothing",))) == [
        "materials['x'] decides nothing"
    ]


@pytest.mark.parametrize(
    ("arrays", "has_wedges"),
    [
        (lambda: arrays_from_parts([ground_part()], actors=[("rsu_1", "rsu", -1)]), False),
        (lambda: two_cars(2), True),
    ],
)
def test_diffraction_needs_an_edge(arrays: Callable[[], SceneData], has_wedges: bool) -> None:
    scene = DeviceScene(arrays(), "cpu", 1)
    lines = list(surface_warnings(make_surface_table(scene, wedges=True)))
    assert [line.split(":")[0] for line in lines] == ([] if has_wedges else ["channel.diffraction finds nothing"])
    assert list(surface_warnings(make_surface_table(scene))) == list(surface_warnings(None)) == []
