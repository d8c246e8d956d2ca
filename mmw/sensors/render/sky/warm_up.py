"""Make skies before they are needed."""

from mmw.config import Config
from mmw.sensors.render.sky.sky import bake


def bake_skies(config: Config) -> None:
    """Make the sky of each weather, which `bake` caches, while the first scene is made and read."""
    for name in config.weathers:
        bake(config.air[name].weather(name), config.seed_of_scene)
