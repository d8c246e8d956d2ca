"""Presets of the physics in Python are those of a configuration."""

from typing import cast

import pytest

import mmw
from mmw.config import ChannelConfig
from mmw.config.physics_presets import Physics
from mmw.core.errors import InputError


@pytest.mark.parametrize("physics", ["paper", "standard", "full"])
def test_a_preset_has_the_settings_of_a_configuration(physics: Physics) -> None:
    """Every key of the channel but antennas and carriers; arguments win, and an unknown preset is an error."""
    one, other = mmw.PathSolver.preset(physics)._config, ChannelConfig(physics=physics)
    kept = set(ChannelConfig.model_fields) - {"physics", "carriers_hz", "antennas", "links"}
    assert {name: getattr(one, name) for name in kept} == {name: getattr(other, name) for name in kept}
    assert mmw.PathSolver.preset(physics, max_depth=0)._config.max_depth == 0
    with pytest.raises(InputError, match=r"PathSolver\.preset = 'best'; one of paper, standard, full is needed"):
        mmw.PathSolver.preset(cast(Physics, "best"))
