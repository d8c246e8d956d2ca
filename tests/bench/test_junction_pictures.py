"""The side-by-side pictures of junctions: a made-up extract, features of osm2streets by hand."""

import json
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import shapely
from matplotlib.colors import to_rgb

from bench.junction_pictures import ASPHALT, GRASS, JUNCTION, PAINT, WALK, main, plan_streets
from mmw.core.errors import InputError
from mmw.worlds.importers.osm.feature import Extract
from tests.fixtures.osm_files import ORIGIN, needs_netconvert, quarter, to_degrees

COLORS = (ASPHALT, GRASS, JUNCTION, WALK)


def features(*items: tuple[dict[str, object], list[tuple[float, float]]]) -> str:
    """Return GeoJSON of polygons given in meters."""
    made = []
    for properties, corners in items:
        ring = [to_degrees(*corner)[::-1] for corner in [*corners, corners[0]]]
        made.append({"type": "Feature", "properties": properties,
                     "geometry": {"type": "Polygon", "coordinates": [ring]}})  # fmt: skip
    return json.dumps({"type": "FeatureCollection", "features": made})


def test_features_of_osm2streets_lie_in_the_frame_of_the_world(tmp_path: Path) -> None:
    path = tmp_path / "geometry.json"
    box = [(0.0, 0.0), (300.0, 0.0), (300.0, 7.0), (0.0, 7.0)]
    path.write_text(
        features(
            ({"type": "lane arrow"}, box),
            ({"type": "Sidewalk", "width": 1.5}, box),
            ({"type": "Driving", "width": 3.0}, box),
        )
    )
    plan = plan_streets([path], Extract(path, ORIGIN))
    assert [color for color, _ in plan.areas] == [ASPHALT, WALK, PAINT]
    for _, area in plan.areas:
        np.testing.assert_allclose(shapely.bounds(area), (0.0, 0.0, 300.0, 7.0), atol=1e-3)


@pytest.mark.parametrize("text", ["<osm/>", "{}", '{"features": [{"properties": {}, "geometry": null}]}'])
def test_another_file_is_an_error_that_names_it(tmp_path: Path, text: str) -> None:
    path = tmp_path / "other.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"other\.json: is no GeoJSON of osm2streets"):
        plan_streets([path], Extract(path, ORIGIN))


def test_picture_of_a_made_up_extract(tmp_path: Path) -> None:
    """Streets that cross, their sidewalks and the land around them are seen in both columns."""
    needs_netconvert()
    source, target = tmp_path / "quarter.osm", tmp_path / "quarter.png"
    source.write_text(quarter().text())
    place = ",".join(map(str, to_degrees(0.0, 0.0)))
    main([str(source), "--at", place, "--out", str(target), "--half", "30"])
    picture = matplotlib.image.imread(target)[..., :3]
    height, width, _ = picture.shape
    assert width == pytest.approx(2 * height, rel=0.15)
    for half in (picture[:, : width // 2], picture[:, width // 2 :]):
        share = {color: float((np.abs(half - to_rgb(color)) < 0.01).all(axis=-1).mean()) for color in COLORS}
        assert share[ASPHALT] + share[JUNCTION] > 0.08 and share[WALK] > 0.02 and share[GRASS] > 0.2
