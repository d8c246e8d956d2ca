"""Lines of paths: their points, gains and order; paths of another scene are refused."""

import numpy as np
import pytest

from mmw.channel import Paths
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.errors import InputError
from mmw.physics.weather.weather import PRESETS
from mmw.scene import Receiver, Scene
from mmw.viz.scene_view.path_lines import choose_paths
from tests.fixtures.scenes import two_cars
from tests.fixtures.street_scene import CARRIERS_HZ, street_scene


def test_lines_lead_from_transmitter_to_receiver(street: Scene, street_paths: Paths) -> None:
    found = choose_paths(street_paths, scene=street)
    assert len(found) == found.total == len(street_paths) > 8
    places = {"car": (-20.0, -3.0, 1.8), "ue": (40.0, -6.0, 1.5)}
    for line, rx, tau, kinds in zip(found.lines, found.rx, found.tau_s, found.interactions, strict=True):
        np.testing.assert_allclose(line[0], (-30.0, 6.0, 8.0))
        np.testing.assert_allclose(line[-1], places[rx])
        assert np.linalg.norm(np.diff(line, axis=0), axis=1).sum() == pytest.approx(SPEED_OF_LIGHT * tau)
        assert len(line) == len(kinds) + 2 and set(kinds) <= {1}  # reflections only
    first = np.array([line[1] - line[0] for line in found.lines])
    last = np.array([line[-2] - line[-1] for line in found.lines])
    np.testing.assert_allclose(found.departure, np.arctan2(first[:, 1], first[:, 0]), atol=1e-9)
    np.testing.assert_allclose(found.arrival, np.arctan2(last[:, 1], last[:, 0]), atol=1e-9)


def test_the_strongest_are_chosen_at_a_carrier(street_paths: Paths) -> None:
    found = choose_paths(street_paths, carrier_hz=3.5e9, max_paths=3)
    gains = 20.0 * np.log10(np.abs(street_paths.a[:, CARRIERS_HZ.index(3.5e9)]))
    np.testing.assert_allclose(found.gain_db, np.sort(gains)[-3:])
    assert found.kind[-1] == "los" and found.labels[-1] == f"los, {gains.max():.1f} dB"
    assert (found.carrier_hz, found.total) == (3.5e9, len(gains))
    np.testing.assert_allclose(found.share[[0, -1]], [0.0, 1.0])
    assert choose_paths(street_paths).carrier_hz == CARRIERS_HZ[0]
    assert len(choose_paths(street_paths, max_paths=0)) == 0


def test_the_color_scale_spans_60_db_at_most(street_paths: Paths) -> None:
    found = choose_paths(street_paths)
    low, top = found.limits_db
    assert top == found.gain_db.max() and low == max(found.gain_db.min(), top - 60.0)
    assert choose_paths(street_paths, max_paths=1).limits_db == (top - 1.0, top)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"carrier_hz": 6e10}, r"carrier_hz = 6e\+10; they have 2.8e\+10, 3.5e\+09 Hz"),
        ({"max_paths": -1}, "max_paths = -1"),
        ({"max_paths": 2.5}, "max_paths = 2.5; a whole number"),
    ],
)
def test_what_the_paths_do_not_have_is_named(street_paths: Paths, arguments: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        choose_paths(street_paths, **arguments)


def test_paths_of_another_scene_are_refused(street_paths: Paths) -> None:
    scene = street_scene()
    choose_paths(street_paths, scene=scene)
    scene.frame = 1
    with pytest.raises(InputError, match="of scene 'street', frame 0; the scene is 'street', frame 1"):
        choose_paths(street_paths, scene=scene)
    scene.frame = 0
    scene.receivers["ue"].position = (41.0, -6.0, 1.5)
    with pytest.raises(InputError, match=r"receiver 'ue' was at \(40.0, -6.0, 1.5\) m .* is at \(41.0, -6.0, 1.5\)"):
        choose_paths(street_paths, scene=scene)
    choose_paths(street_paths.select(rx="car"), scene=scene)
    scene.remove("ue")
    with pytest.raises(InputError, match="receiver 'ue' is not in scene 'street', which has car"):
        choose_paths(street_paths, scene=scene)
    other = Scene(two_cars(1), {"sunny": PRESETS["sunny"]}, device="cpu", name="elsewhere")
    other.add(Receiver("ue", position=(40.0, -6.0, 1.5)))
    with pytest.raises(InputError, match="the scene is 'elsewhere'"):
        choose_paths(street_paths, scene=other)
