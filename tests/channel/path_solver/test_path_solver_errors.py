"""Refuse what a path solver cannot solve, with one clear error each."""

import numpy as np
import pytest

import mmw
from mmw.core.errors import InputError
from mmw.physics.weather.weather import PRESETS
from mmw.scene.scene import Scene
from tests.fixtures.scenes import arrays_from_parts, box_part, ground_part, two_cars

CARRIERS = (28e9, 4.9e9)


def street(frames: int = 4, frame: int = 1) -> Scene:
    return Scene(two_cars(frames), {"sunny": PRESETS["sunny"]}, device="cpu", frame=frame, name="street")


def lines_of_sight(scene: Scene, **options) -> mmw.Paths:
    return mmw.PathSolver(max_depth=0)(scene, **{"carriers_hz": 28e9, **options})


def walled() -> Scene:
    """Return a scene with a receiver inside a house."""
    parts = [ground_part(), box_part("Buildings/house", (4, 4, 6), (10, 0, 3), "concrete_facade", "building")]
    scene = Scene(arrays_from_parts(parts), {"sunny": PRESETS["sunny"]}, device="cpu", name="street")
    return with_devices(scene)


def with_devices(scene: Scene) -> Scene:
    scene.add(mmw.Transmitter("t", (0, 0, 2)))
    scene.add(mmw.Receiver("r", (10, 0, 3)))
    return scene


ERRORS = {
    "no transmitter": (lambda s: mmw.PathSolver()(s), "scene 'street': has no transmitter"),
    "inside": (lambda s: mmw.PathSolver()(walled()), r"receiver 'r': position = \(10.0, 0.0, 3.0\) is inside .*house"),
    "depth": (lambda s: mmw.PathSolver(max_depth=9), "PathSolver: max_depth = 9"),
    "mode": (lambda s: mmw.PathSolver(candidates="all"), 'PathSolver: candidates = "all"'),
    "carrier": (lambda s: mmw.PathSolver()(with_devices(s), carriers_hz=28.0), "28 Hz is outside 1e8 to 1e12 Hz"),
    "carrier of a material": (
        lambda s: (s.materials["asphalt"].set(model="itu", itu="itu_very_dry_ground"),
                   mmw.PathSolver()(with_devices(s), carriers_hz=900e9)),
        "asphalt",
    ),
    "no carrier": (lambda s: mmw.PathSolver()(with_devices(s), carriers_hz=[]), "give at least one carrier"),
    "weather": (lambda s: mmw.PathSolver()(with_devices(s), weathers=["foggy"]), "weather 'foggy'; it was loaded"),
    "select": (lambda s: lines_of_sight(with_devices(s)).select(rx="q"), "receiver 'q': the paths have r"),
    "twice": (lambda s: lines_of_sight(with_devices(s)).select(rx=["r", "r"]), "one is named twice"),
    "kind": (lambda s: lines_of_sight(with_devices(s)).select(kind="bent"), "kind = 'bent'; there are los"),
    "which carrier": (
        lambda s: lines_of_sight(with_devices(s), carriers_hz=CARRIERS).cfr([0.0]),
        "carrier_hz is missing; they have 2.8e",
    ),
    "frequencies": (lambda s: lines_of_sight(with_devices(s)).cfr([np.nan]), "frequencies_hz .* finite numbers"),
    "steps": (lambda s: lines_of_sight(with_devices(s)).cfr([0.0], num_time_steps=0), "num_time_steps = 0"),
    "taps": (lambda s: lines_of_sight(with_devices(s)).taps(1e6, l_max=-9), "l_min = -6, l_max = -9"),
    "spacing": (lambda s: lines_of_sight(with_devices(s)).ofdm(12, 0.0), "subcarrier_spacing_hz = 0"),
    "absent": (
        lambda s: (s.add(mmw.Receiver("r", actor="gone")), None),
        "actor 'gone': the scene has",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", ERRORS)
def test_bad_input_is_one_clear_error(case: str) -> None:
    act, message = ERRORS[case]
    with pytest.raises(InputError, match=message) as caught:
        act(street())
    assert "\n" not in str(caught.value)


def test_a_device_on_an_absent_actor() -> None:
    data = two_cars(3)
    data.poses[1, 0] = np.nan
    scene = Scene(data, {"sunny": PRESETS["sunny"]}, device="cpu", frame=1)
    scene.add(mmw.Transmitter("t", (0, 0, 2)))
    scene.add(mmw.Receiver("r", (0, 0, 2), actor="cav_1"))
    with pytest.raises(InputError, match="receiver 'r': actor 'cav_1' is absent in frame 1"):
        mmw.PathSolver()(scene)
    scene.frame = 2
    assert len(mmw.PathSolver(max_depth=0)(scene)) == 1
