"""Lights: test points of the regulation, inverse squares, a grid against all lights, and brakes of known motions."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from mmw.core.kinematics import differentiate
from mmw.kernels.core.structs import Scene as SceneStruct
from mmw.kernels.shading import lights as kernels
from mmw.kernels.shading.lights import Lights, beam_kcd, light_emission, reflected_lights
from mmw.kernels.shading.structs import Appearance, SurfacePoint
from mmw.kernels.shading.wet_surfaces import Wet, wetted
from mmw.physics.weather.weather import PRESETS, Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData
from mmw.sensors.render.lights import (
    batch_brakes,
    brake_levels,
    find_street_lights,
    make_lights,
    street_lights_on,
    vehicle_lights_on,
)
from tests.fixtures.kernels import launched
from tests.fixtures.scenes import arrays_from_parts, box_model, box_part, ground_part, material, pose

wp.set_module_options({"enable_backward": False, "fast_math": True})

NIGHT = Weather(sun_altitude_deg=-20.0)
DEGREE = np.pi / 180.0
NO_WATER = Wet()


@wp.kernel
def beam_kernel(away: wp.array[wp.vec3], value_out: wp.array[float]):
    """Intensities of a beam. Launch: dim=N."""
    k = wp.tid()
    value_out[k] = beam_kcd(away[k])


@wp.kernel
def light_kernel(
    lights: Lights, scene: SceneStruct, batch_index: int, appearance: Appearance, normal: wp.vec3, to_viewer: wp.vec3,
    point: wp.array[wp.vec3], wet: Wet, value_out: wp.array[wp.vec3],
):  # fmt: skip
    """Light of lights on a white plane. Launch: dim=N."""
    k = wp.tid()
    surface_point = SurfacePoint()
    surface_point.point = point[k]
    surface_point.normal = normal
    surface_point.shading_normal = normal
    surface_point.color = wp.vec3(1.0, 1.0, 1.0)
    surface_point.roughness = 1.0
    surface_point.opacity = 1.0
    value_out[k] = reflected_lights(
        lights, scene, batch_index, wetted(wet, appearance, surface_point, 0.0, 0.0), appearance, to_viewer
    )


@wp.kernel
def emission_kernel(
    lights: Lights, scene: SceneStruct, batch_index: int, instance: int, kind: int, to_viewer: wp.array[wp.vec3],
    value_out: wp.array[wp.vec3],
):  # fmt: skip
    """Emission of a lamp of luminance 1. Launch: dim=N."""
    k = wp.tid()
    appearance = Appearance()
    appearance.lamp = kind
    surface_point = SurfacePoint()
    surface_point.emission = wp.vec3(1.0, 0.5, 0.25)
    value_out[k] = light_emission(lights, scene, batch_index, instance, appearance, surface_point, to_viewer[k])


def away(up_deg: float, left_deg: float) -> np.ndarray:
    """Return the unit direction to a point of the measuring screen, x forward, y left, z up."""
    found = np.array([1.0, np.tan(left_deg * DEGREE), np.tan(up_deg * DEGREE)])
    return found / np.linalg.norm(found)


REGULATION_112 = {
    "B50L": (0.57, 3.43, 0.0, 0.35), "75R": (-0.57, -1.15, 10.1, None), "50R": (-0.86, -1.72, 10.1, None),
    "50L": (-0.86, 3.43, 3.55, 13.2), "50V": (-0.86, 0.0, 5.1, None), "25L": (-1.72, 9.0, 1.7, None),
    "25R": (-1.72, -9.0, 1.7, None), "zone III": (2.0, 4.0, 0.0, 0.625), "peak": (-0.8, -0.5, 0.0, 44.1),
}  # fmt: skip
"""Point -> degrees up, degrees left, minimum and maximum intensity [kcd]; UNECE Regulation 112, class B, right-hand
traffic (published in candela; the highest value allowed is 44.1 kcd)."""


@pytest.mark.parametrize("name", REGULATION_112)
def test_low_beam_meets_the_regulation(device: str, name: str) -> None:
    up, left, low, high = REGULATION_112[name]
    (found,) = launched(beam_kernel, 1, [[away(up, left)]], device)[0]
    assert found >= low
    assert high is None or found <= high


def test_when_lights_are_on() -> None:
    assert not vehicle_lights_on(PRESETS["sunny"]) and not street_lights_on(PRESETS["sunny"])
    assert (
        vehicle_lights_on(PRESETS["rainy"])
        and vehicle_lights_on(PRESETS["foggy"])
        and not street_lights_on(PRESETS["rainy"])
    )
    assert vehicle_lights_on(Weather(sun_altitude_deg=3.0)) and not street_lights_on(Weather(sun_altitude_deg=3.0))
    assert vehicle_lights_on(NIGHT) and street_lights_on(NIGHT)


def car_on_a_road(poses: np.ndarray, label: str = "car") -> SceneData:
    """Return a plane with one car, poses [F, 7]."""
    arrays = arrays_from_parts(
        [ground_part()], [box_model("sedan")], [("veh_001", "vehicle", 0)], poses[:, None],
        materials=["car_paint_red"],
    )  # fmt: skip
    return replace(arrays, actors=tuple(replace(actor, label=label) for actor in arrays.actors))


def drive(x: np.ndarray, yaw: float = 0.0) -> np.ndarray:
    return np.array([pose(np.cos(yaw) * d, np.sin(yaw) * d, yaw=yaw) for d in x])


def test_brakes_of_a_known_deceleration() -> None:
    """20 m/s, then slower at a rate that grows: no light to 0.5 m/s2, all of it from 1 m/s2."""
    time = np.arange(500) / 100.0
    for yaw in (0.0, 2.5):
        for rate, expected in ((-2.0, 0.0), (0.0, 0.0), (0.4, 0.0), (0.75, 0.5), (1.0, 1.0), (3.0, 1.0)):
            arrays = car_on_a_road(drive(20.0 * time - 0.5 * rate * time**2, yaw))
            assert brake_levels(arrays, range(500)) == pytest.approx(expected, abs=1e-3)
        reverse = car_on_a_road(drive(-5.0 * time + 0.5 * 0.75 * time**2, yaw))
        assert brake_levels(reverse, [100]) == pytest.approx(0.5, abs=1e-3)


def test_brakes_of_a_turn_and_of_a_stop() -> None:
    """Sideways acceleration lights nothing; who stands has a foot on the brake."""
    time = np.arange(300) / 100.0
    turn = np.array([pose(20 * np.sin(t), 20 - 20 * np.cos(t), yaw=t) for t in time])
    assert brake_levels(car_on_a_road(turn), range(300)) == pytest.approx(0.0, abs=1e-3)
    assert (brake_levels(car_on_a_road(drive(np.zeros(50))), range(50)) == 1.0).all()


def test_brakes_do_not_depend_on_the_batch() -> None:
    rng = np.random.default_rng(2)
    time = np.arange(200) / 100.0
    poses = drive(8.0 * time + np.cumsum(np.cumsum(rng.normal(0.0, 1e-4, 200))))
    poses[:20] = np.nan
    arrays = car_on_a_road(poses)
    every = brake_levels(arrays, range(200))
    assert (every[:20] == -1.0).all() and (every[20:] >= 0.0).all() and 0.0 < every[20:].mean() < 1.0
    for frames in ([150], [30, 20, 199], [19, 21]):
        assert (brake_levels(arrays, frames) == every[frames]).all()
        motion = differentiate(arrays.poses, arrays.pose_dt)
        np.testing.assert_array_equal(brake_levels(arrays, frames, motion), every[frames])
    walker = car_on_a_road(poses, "pedestrian")
    assert (brake_levels(walker, range(200)) == -1.0).all()
    with pytest.raises(ValueError, match="frame 200 is not in the scene"):
        brake_levels(arrays, [200])


def lit(
    lights: Lights,
    scene: DeviceScene,
    points: np.ndarray,
    normal: tuple,
    to_viewer: tuple,
    wet: Wet = NO_WATER,
    batch_index: int = 0,
) -> np.ndarray:
    appearance = Appearance()
    appearance.holds_puddles = True
    inputs = [lights, scene.struct, batch_index, appearance, wp.vec3(*normal), wp.vec3(*to_viewer), points, wet]
    return launched(light_kernel, len(points), inputs, scene.device)[0].astype(np.float64)


def night_car(device: str) -> tuple[Lights, DeviceScene]:
    scene = DeviceScene(car_on_a_road(drive(np.arange(40) * 0.1)), device, 2)
    scene.load_batch([0, 20])
    return make_lights(scene, "sunny", NIGHT), scene


def luminance(color: np.ndarray) -> np.ndarray:
    return color @ [0.2126, 0.7152, 0.0722]


def test_headlights_light_a_wall(device: str) -> None:
    """In the middle of the beam a wall gets 2 I / d^2, from the front of the car, whose pose moves with its frame."""
    lights, scene = night_car(device)
    for batch_index, start in ((0, 2.25), (1, 4.25)):
        for distance in (5.0, 10.0, 20.0):
            point = np.array([[start + distance, 0.0, 0.65 - 0.02 * distance]])
            found = luminance(lit(lights, scene, point, (-1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), batch_index=batch_index))[0]
            deep = (0.02 - 0.01) / 0.03
            candela = kernels.BEAM_PEAK_KCD / (1.0 + deep**2) + kernels.BEAM_STRAY_KCD
            candela *= (1.0 - (distance / kernels.BEAM_REACH_M) ** 4) ** 2
            slant = 1.0 / np.sqrt(1.0 + 0.02**2)
            assert found == pytest.approx(2.0 * candela * slant**3 / distance**2 / np.pi, rel=5e-3)
    above = luminance(lit(lights, scene, np.array([[12.25, 0.0, 1.5]]), (-1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)))[0]
    assert above == pytest.approx(0.5 / 100.0 / np.pi, rel=0.03)
    behind = lit(lights, scene, np.array([[-5.0, 0.0, 0.5], [200.0, 0.0, 0.0]]), (1.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    assert (behind == 0.0).all()


def test_headlights_glint_on_water(device: str) -> None:
    """Standing water between a viewer and a car reflects its lights; light that comes back from below gets less."""
    lights, scene = night_car(device)
    wet = Wet()
    wet.puddles = wet.wetness = 1.0
    middle = np.array([[12.25, 0.0, 0.0]])
    ahead = (0.995, 0.0, 0.0995)
    dry = luminance(lit(lights, scene, middle, (0.0, 0.0, 1.0), ahead))[0]
    soaked = luminance(lit(lights, scene, middle, (0.0, 0.0, 1.0), ahead, wet))[0]
    assert soaked > 3.0 * dry > 0.0
    back = luminance(lit(lights, scene, middle, (0.0, 0.0, 1.0), (-0.9, 0.0, 0.436), wet))[0]
    assert back < luminance(lit(lights, scene, middle, (0.0, 0.0, 1.0), (-0.9, 0.0, 0.436)))[0]


def test_lights_of_a_car_by_day_and_night(device: str) -> None:
    """Headlights glow in their beam, taillights when on, brake lights by day too; a third one while braking alone."""
    views = np.float32([away(-1.0, 0.0), away(2.0, 0.0), [-1.0, 0.0, 0.0]])
    for weather, moves in ((NIGHT, True), (PRESETS["sunny"], True), (PRESETS["sunny"], False)):
        scene = DeviceScene(car_on_a_road(drive(np.arange(20) * (0.1 if moves else 0.0))), device, 1)
        scene.load_batch([5])
        lights = make_lights(scene, "sunny", weather)
        glow, head, tail, brake = (
            launched(emission_kernel, 3, [lights, scene.struct, 0, 0, kind, views], device)[0][:, 0]
            for kind in (0, kernels.HEADLIGHT, kernels.TAILLIGHT, kernels.BRAKE)
        )
        assert (glow == 1.0).all()
        assert (brake == (0.0 if moves else kernels.BRAKE_GAIN)).all()
        if weather is NIGHT:
            assert head[0] > 20.0 and head[1] == pytest.approx(1.0, rel=0.01) and head[2] == 0.0
            assert (tail == 1.0).all()
        else:
            assert (head == 0.0).all() and (tail == (0.0 if moves else kernels.BRAKE_GAIN)).all()


def street(count: int) -> SceneData:
    """Return a plane with street lights at random places, each an object of its own."""
    rng = np.random.default_rng(5)
    parts = [ground_part(150.0)]
    for k, (x, y) in enumerate(rng.uniform(-120.0, 120.0, (count, 2))):
        parts.append(box_part(f"Props/lamp_{k:03d}", (0.7, 0.3, 0.1), (x, y, 8.3), "lens", "pole"))
    lens = material("lens")
    lens = replace(lens, appearance=replace(lens.appearance, lamp="street"))
    return arrays_from_parts(parts, materials={"asphalt": material("asphalt"), "lens": lens})


def test_street_lights_by_grid_and_by_all(device: str) -> None:
    """The grid holds every light: light on the ground is the float64 sum over all lights."""
    arrays = street(60)
    positions = find_street_lights(arrays, "sunny")
    assert len(positions) == 60 and positions[:, 2] == pytest.approx(8.3)
    scene = DeviceScene(arrays, device, 1)
    scene.load_batch([0])
    lights = make_lights(scene, "sunny", NIGHT)
    assert lights.street_count == 60 and lights.beam_count == 0
    points = np.zeros((4000, 3))
    points[:, :2] = np.random.default_rng(6).uniform(-150.0, 150.0, (4000, 2))
    found = luminance(lit(lights, scene, points, (0.0, 0.0, 1.0), (0.0, 0.6, 0.8)))
    offset = positions[None] - points[:, None]
    distance = np.linalg.norm(offset, axis=2)
    cosine = offset[..., 2] / distance
    window = np.clip(1.0 - (distance / kernels.STREET_REACH_M) ** 4, 0.0, 1.0) ** 2
    expected = (10.0 / np.pi * cosine**2 * window / distance**2).sum(axis=1) / np.pi
    assert found == pytest.approx(expected, rel=2e-3, abs=1e-7)
    assert (expected == 0.0).any() and (expected > 1e-3).any()
    assert max(np.diff(lights.grid_first.numpy())) < 30


def test_no_lights_by_day(device: str) -> None:
    scene = DeviceScene(street(3), device, 1)
    scene.load_batch([0])
    lights = make_lights(scene, "sunny", PRESETS["sunny"])
    assert lights.beam_count == lights.street_count == 0
    assert (lit(lights, scene, np.zeros((5, 3)), (0.0, 0.0, 1.0), (0.0, 0.0, 1.0)) == 0.0).all()
    assert batch_brakes(scene).shape == (1, 0)
