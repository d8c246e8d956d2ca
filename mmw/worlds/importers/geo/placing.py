"""Find the place of an imported world on the earth."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mmw.core.errors import MissingPackageError
from mmw.core.georeference import Georeference
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.importers.mesh_cleanup import bounds


def place_scene(scene: ImportedScene, origin: Sequence[float] | None) -> ImportedScene:
    """Return a world with its place on the earth, as far as it is known, and a note on it.

    Args:
        scene: The world.
        origin: Latitude and longitude of (0, 0) [deg], x east and y north there; None to take those of the source.

    Raises:
        InputError: If the origin is no place on the earth, or the projection of the source cannot be used.
    """
    if origin is not None:
        return replace(scene, georeference=Georeference(*origin), projection=None)
    if scene.georeference is not None or scene.projection is None:
        return scene
    low, high = bounds(scene)
    try:
        place = scene.projection.georeference(np.round(0.5 * (low + high)[:2], 3))
    except MissingPackageError as error:
        return replace(scene, notes=(*scene.notes, f"place on the earth not kept: {error}"))
    heading = np.degrees(place.heading)
    note = (
        f"origin: latitude {place.latitude:.6f}, longitude {place.longitude:.6f} deg; the y axis points {heading:.3f} "
        f"deg clockwise from north, {place.scale:.5f} m of the world are 1 m"
    )
    return replace(scene, georeference=place, notes=(*scene.notes, note))
