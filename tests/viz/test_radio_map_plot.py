"""Pictures of radio maps: the values of the cells, the axes that a surface needs, and one line for a mistake."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from mmw.channel import MeasurementSurface, RadioMap, mesh_surface, plane_grid
from mmw.channel.radio_map.radio_map import RadioMapConfig
from mmw.channel.radio_map.transmitters import Transmitters
from mmw.config import ChannelConfig
from mmw.core.errors import InputError
from mmw.scene.radio_devices import Transmitter
from tests.fixtures.map_scenes import map_scene
from tests.fixtures.scenes import arrays_from_parts, box_mesh, box_part
from tests.oracles.radio_map import CARRIER, UPRIGHT

CHANNEL = ChannelConfig(carriers_hz=(CARRIER,))


def make_map(surface: MeasurementSurface) -> RadioMap:
    gain = 10.0 ** np.random.default_rng(1).uniform(-12, -7, (2, len(surface)))
    gain[:, 3], gain[0, 4] = 0.0, 0.0
    tx = Transmitters(("bs", "far"), np.array([[0.0, 0, 9], [5, 5, 9]]), np.tile(np.eye(3), (2, 1, 1)), np.zeros(2))
    return RadioMap(tx, surface, RadioMapConfig(CHANNEL), gain)


def drawn(figure: Figure) -> list:
    """Return the collections of cells, which are those that have values."""
    found = figure.axes[0].collections
    return [one for one in found if isinstance(one, PolyCollection) and one.get_array() is not None]


@pytest.mark.parametrize(("metric", "label"), [("path_gain", "path gain [dB]"), ("rss", "RSS"), ("sinr", "SINR")])
def test_cells_have_the_values_of_the_metric(metric: str, label: str) -> None:
    result = make_map(plane_grid((0, 0, 1.5), (8, 6), 2.0))
    for tx in (None, "bs"):
        figure = result.plot(metric, tx)
        values = result.metric_db(metric, tx)
        (cells,) = drawn(figure)
        np.testing.assert_array_equal(cells.get_array(), values[np.isfinite(values)])
        corners = result.surface.corners[np.isfinite(values), :, :2]
        np.testing.assert_allclose([path.vertices[:4] for path in cells.get_paths()], corners)
        assert label in figure.axes[1].get_ylabel() and ("bs" in figure.axes[1].get_ylabel()) == (tx == "bs")
        assert {text.get_text() for text in figure.axes[0].texts} == {"bs", "far"}


def test_transmitters_at_one_place_share_a_label() -> None:
    result = make_map(plane_grid((0, 0, 1.5), (8, 6), 2.0))
    result.transmitters.position[1] = result.transmitters.position[0]
    assert {text.get_text() for text in result.plot("rss").axes[0].texts} == {"bs\nfar"}


def test_association_names_the_transmitters() -> None:
    result = make_map(plane_grid((0, 0, 1.5), (8, 6), 2.0))
    figure = result.plot("association")
    (cells,) = drawn(figure)
    np.testing.assert_array_equal(cells.get_array(), np.delete(result.tx_association, 3))
    assert [text.get_text() for text in figure.axes[1].get_yticklabels()] == ["bs", "far"]
    cells.update_scalarmappable()
    assert len(np.unique(cells.get_facecolors(), axis=0)) == 2


def test_buildings_of_the_scene_are_below_the_cells() -> None:
    houses = [
        box_part(f"Buildings/house_{x}", (4, 4, 8), (x, 0, 4), "concrete_facade", "building") for x in (0, 40)
    ]  # the second is out of the picture
    scene = map_scene(arrays_from_parts(houses), "cpu", Transmitter("bs", (0, 0, 9)))
    result = make_map(plane_grid((0, 0, 1.5), (8, 6), 2.0))
    own = Figure().subplots()
    assert result.plot("rss", ax=own, scene=scene) is own.figure
    plain = [one for one in own.collections if one.get_array() is None and isinstance(one, PolyCollection)]
    roofs = [one for one in plain if len(one.get_paths())]
    assert [len(one.get_paths()) for one in roofs] == [4]  # roof and floor, two triangles each
    assert roofs[0].get_zorder() < drawn(own.figure)[0].get_zorder()


@pytest.mark.parametrize(
    "surface",
    [plane_grid((0, 0, 5), (8, 6), 2.0, UPRIGHT), mesh_surface(*box_mesh((4, 3, 2)), offset_m=0.01)],
    ids=["wall", "box"],
)
def test_upright_surfaces_are_drawn_in_three_dimensions(surface: MeasurementSurface, tmp_path: Path) -> None:
    result = make_map(surface)
    figure = result.plot("path_gain")
    figure.savefig(tmp_path / "surface.png")
    (cells,) = [one for one in figure.axes[0].collections if isinstance(one, Poly3DCollection)]
    assert len(cells.get_array()) == len(surface) - 1
    with pytest.raises(InputError, match="these axes have 2 dimensions, the surface needs 3"):
        result.plot(ax=Figure().subplots())
    flat = make_map(plane_grid((0, 0, 1.5), (8, 6), 2.0))
    with pytest.raises(InputError, match="these axes have 3 dimensions, the surface needs 2"):
        flat.plot(ax=figure.axes[0])


def test_mistakes_are_named() -> None:
    result = make_map(plane_grid((0, 0, 1.5), (8, 6), 2.0))
    for call, part in (
        (lambda: result.plot("rssi"), "metric = 'rssi'; one of path_gain, rss, sinr, association is needed"),
        (lambda: result.plot("rss", "near"), "no transmitter 'near'"),
        (lambda: result.plot("association", "bs"), "leave tx out"),
    ):
        with pytest.raises(InputError, match=part):
            call()
