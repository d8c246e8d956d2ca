"""Keep the place of a town on the earth in its layer, so that it travels with the asset."""

from pxr import Sdf, Usd

from mmw.core.georeference import Georeference

KEY = "mmw_georeference"
"""Key of a layer's `customLayerData`: a dictionary of latitude, longitude [deg], heading [rad] and scale."""
FIELDS = ("latitude", "longitude", "heading", "scale")


def write_georeference(layer: Sdf.Layer, reference: Georeference | None) -> None:
    """Write a place into a layer; None changes nothing."""
    if reference is not None:
        data = {name: float(getattr(reference, name)) for name in FIELDS}
        layer.customLayerData = {**layer.customLayerData, KEY: data}


def read_georeference(stage: Usd.Stage) -> Georeference | None:
    """Return the place that the strongest layer of a stage with one gives; None if there is none.

    Raises:
        InputError: If it is no place on the earth.
    """
    for layer in [stage.GetRootLayer(), *stage.GetUsedLayers()]:
        data = layer.customLayerData.get(KEY)
        if data:
            return Georeference(*(float(data[name]) for name in FIELDS))
    return None
