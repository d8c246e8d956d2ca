"""Radio maps of scenes with absorbers: exactly the line of sight, at any incidence."""

from dataclasses import replace

import numpy as np

from mmw.channel.radio_map.measurement_surface import plane_grid
from mmw.channel.radio_map.radio_map import RadioMapConfig
from mmw.channel.radio_map.solver import solve_radio_map
from mmw.channel.radio_map.transmitters import actor_transmitters
from mmw.config import ChannelConfig
from mmw.physics.materials.material import RadioMaterial
from tests.fixtures.device_rays import loaded
from tests.fixtures.scenes import ground_part, wall_part
from tests.oracles.channel import link_scene, radio_materials


def test_an_absorber_adds_nothing_to_a_map(device: str) -> None:
    parts = [ground_part(60.0, material="own"), wall_part("wall", (-60.0, 20.0), (60.0, 20.0), 20.0, "own")]
    radio = {"own": RadioMaterial.absorber(), "stone": RadioMaterial("itu", itu="itu_concrete")}
    arrays = link_scene(parts, (0, 0, 5), (15, 2, 1.5), materials=radio_materials(radio))
    scene, transmitters = loaded(arrays, device, [0]), actor_transmitters(arrays, 0)
    surface = plane_grid((0.0, 0.0, 1.5), (80.0, 30.0), 4.0)

    def gain(name: str, depth: int) -> np.ndarray:
        materials = tuple(replace(material, radio=radio[name]) for material in arrays.materials["sunny"])
        config = RadioMapConfig(ChannelConfig(carriers_hz=(28e9,), samples_per_tx=50_000, max_depth=depth))
        return solve_radio_map(scene, 0, transmitters, surface, config, materials).path_gain

    np.testing.assert_array_equal(gain("own", 3), gain("own", 0))
    assert gain("stone", 3).sum() > 1.05 * gain("stone", 0).sum()
