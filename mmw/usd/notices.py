"""Name the sources of an asset in its layer, so that what must be said of them travels with everything made of it."""

from pxr import Sdf, Usd

NOTICE_KEY = "mmw_notice"
"""Key of a layer's `customLayerData`: what has to be named with the asset, as one text."""


def read_notices(stage: Usd.Stage) -> list[str]:
    """Return the notices of all layers that a stage uses, each once, by the names of their files."""
    layers = sorted(stage.GetUsedLayers(), key=lambda layer: layer.identifier)
    found = (str(layer.customLayerData.get(NOTICE_KEY, "")) for layer in layers)
    return [line for line in dict.fromkeys(found) if line]


def write_notice(layer: Sdf.Layer, notice: str) -> None:
    """Write a notice into a layer; an empty one changes nothing."""
    if notice:
        layer.customLayerData = {**layer.customLayerData, NOTICE_KEY: notice}
