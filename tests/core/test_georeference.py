"""Places of worlds on the earth, against map projections by their series and against PROJ."""

import numpy as np
import pytest

from mmw.core.errors import InputError
from mmw.core.geodesy import SEMI_MAJOR_AXIS, ecef_from_geodetic
from mmw.core.georeference import Georeference, locate
from mmw.worlds.importers.geo.projection import Projection

MUNICH = (48.137, 11.575)


def test_there_and_back() -> None:
    place = Georeference(*MUNICH, heading=0.3, scale=0.9996)
    xy = np.random.default_rng(1).uniform(-5000, 5000, (200, 2))
    np.testing.assert_allclose(place.world(place.degrees(xy)), xy, atol=1e-6)


def test_axes_scale_and_distances() -> None:
    place = Georeference(*MUNICH, heading=np.radians(90.0), scale=2.0 - 1e-9)
    # the y axis points east: a degree of longitude is cos(latitude) of the radius of curvature across the meridian
    e2 = 0.00669437999014
    across = SEMI_MAJOR_AXIS / np.sqrt(1 - e2 * np.sin(np.radians(MUNICH[0])) ** 2) * np.cos(np.radians(MUNICH[0]))
    step = 1e-3
    ((x, y),) = place.world([(MUNICH[0], MUNICH[1] + step)])
    assert y == pytest.approx(2 * across * np.radians(step), rel=1e-6)
    assert x == pytest.approx(0.0, abs=2 * 2e-3)
    plain = Georeference(*MUNICH)
    degrees = plain.degrees([[300.0, 400.0]])[0]
    chord = np.linalg.norm(np.subtract(*ecef_from_geodetic([[*degrees, 0.0], [*MUNICH, 0.0]])))
    assert chord == pytest.approx(500.0, rel=1e-7)


def test_a_grid_of_utm_within_centimeters() -> None:
    pytest.importorskip("rasterio")
    grid = Projection("EPSG:32632", (696848.56, 5347923.58), 0.1)
    xy = np.random.default_rng(2).uniform(-1000, 1000, (100, 2))
    degrees = grid.degrees(xy)
    np.testing.assert_allclose(grid.world(degrees), xy, atol=1e-5)
    place = grid.georeference(np.array([200.0, 100.0]))
    # the scale of the grid changes by x / R^2 = 5e-9 1/m, 200 km from its meridian: 5 mm at 1 km
    np.testing.assert_allclose(place.world(degrees), xy, atol=0.01)
    # Meridian convergence: (longitude - central meridian) sin(latitude); the axes were turned by 0.1 rad besides.
    latitude, longitude = np.radians([place.latitude, place.longitude - 9.0])
    assert place.heading == pytest.approx(longitude * np.sin(latitude) - 0.1, abs=2e-5)
    assert place.scale == pytest.approx(0.9996 * (1 + (696848.56 - 500e3) ** 2 / (2 * 6.384e6**2)), abs=2e-6)


def test_references_of_files_and_their_errors() -> None:
    pytest.importorskip("rasterio")
    carla = Projection("+lat_0=4.9e+1 +lon_0=8.0e+0").georeference(np.zeros(2))
    assert (carla.latitude, carla.longitude, carla.heading) == pytest.approx((49.0, 8.0, 0.0), abs=1e-9)
    geoid = Projection(
        "+proj=tmerc +lat_0=48 +lon_0=11 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +geoidgrids=a.gtx +vunits=m"
    )
    assert geoid.georeference(np.zeros(2)).scale == pytest.approx(1.0, abs=1e-6)
    for text, message in {"nonsense": "is no projection", "EPSG:4326": "has degrees instead of meters"}.items():
        with pytest.raises(InputError, match=message):
            Projection(text, where="town.xodr").degrees(np.zeros((1, 2)))


def test_places_that_are_refused() -> None:
    with pytest.raises(InputError, match="latitude -90 to 90"):
        Georeference(95.0, 0.0)
    with pytest.raises(InputError, match="the map's unit must be the meter"):
        Georeference(*MUNICH, scale=3.28)
    with pytest.raises(InputError, match=r"rsu_1: .*need a town with a geographic origin"):
        locate(None, [MUNICH], "rsu_1")
    with pytest.raises(InputError, match="is far from the town"):
        locate(Georeference(*MUNICH), [(-MUNICH[0], MUNICH[1] + 180 - 360)], "rsu_1")
