"""A preset changes the defaults of the other keys of `channel`, and keys that are given win."""

from pathlib import Path

import pytest

from mmw.config import ChannelConfig, load_config
from mmw.config.differences import differences, differences_yaml
from mmw.config.physics_presets import PHYSICS_PRESETS
from mmw.core.errors import InputError


@pytest.mark.parametrize("physics", PHYSICS_PRESETS)
def test_a_preset_sets_what_is_not_given(physics: str) -> None:
    config = ChannelConfig(physics=physics)
    assert {key: getattr(config, key) for key in PHYSICS_PRESETS[physics]} == PHYSICS_PRESETS[physics]
    assert ChannelConfig(physics=physics, max_depth=5).max_depth == 5
    assert config.model_copy() == ChannelConfig(**config.model_dump())


def test_paper_is_the_default_of_every_key() -> None:
    assert ChannelConfig(physics="paper") == ChannelConfig()


def test_an_unknown_preset_is_told() -> None:
    with pytest.raises(InputError, match="physics"):
        ChannelConfig(physics="everything")
    with pytest.raises(InputError, match="physics"):
        ChannelConfig(physics=["full"])


def test_what_differs_is_told_against_the_preset(tmp_path: Path) -> None:
    """A key that has its usual value in `paper` is told where the preset would change it."""
    config = load_config("quickstart", ["channel={physics: standard, max_depth: 1}"])
    assert differences(config)["channel"] == {"physics": "standard", "max_depth": 1}
    (tmp_path / "short.yaml").write_text(differences_yaml(config))
    assert load_config(tmp_path / "short.yaml") == config
