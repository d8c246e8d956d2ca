"""Weather in pictures of the RGB camera: fog by Koschmieder's law, wet roads, puddles, rings of rain, night."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from mmw.core.constants import FRAME_DT
from mmw.physics.weather.optics import extinction
from mmw.physics.weather.weather import PRESETS, Weather
from mmw.scene.scene_data import SceneData
from mmw.sensors.render.sky.sky import bake
from tests.fixtures.rgb_scenes import SMALL, Rendering, at, even_sky, glowing, lambert, matter, render
from tests.fixtures.scenes import arrays_from_parts, box_model, box_part, ground_part, quad_part, wall_part

NARROW = SMALL.model_copy(update={"fov_deg": 2.0})
FOGS = {
    "heavy_fog": PRESETS["heavy_fog"],
    "foggy": PRESETS["foggy"],
    "light_fog": PRESETS["light_fog"],
    "haze": Weather(visibility_m=4000.0, sun_altitude_deg=30.0, sun_azimuth_deg=200.0),
    "rain": PRESETS["heavy_rain"],
}


def targets(distance: float, half: float) -> list:
    """Return a black target to the left and a white one to the right of the x axis, with free sky between them."""
    parts = []
    for name, low, high in (("black", half, 3.0 * half), ("white", -3.0 * half, -half)):
        corners = [(distance, high, -half), (distance, low, -half), (distance, low, half), (distance, high, half)]
        parts.append(quad_part(f"Buildings/{name}", corners, name, "building"))
    return parts


@pytest.mark.parametrize("name", FOGS)
def test_contrast_fades_by_koschmieders_law(device: str, name: str) -> None:
    """A black target against the horizon has the contrast exp(-extinction x distance), in green, that of 550 nm; a
    white one, whatever it is lit by, keeps as much of its difference to the black one. Far ones merge with the sky."""
    weather = FOGS[name]
    per_m = extinction(weather, 550)
    near = 0.0
    for depth in (0.02, 0.3, 1.0, 3.0, 12.0):
        distance = depth / per_m
        arrays = arrays_from_parts(
            targets(distance, distance * 0.004),
            materials={"black": lambert(0.0), "white": lambert(1.0)},
            weathers=(name,),
        )
        config = NARROW.model_copy(update={"range_m": 50_000.0})
        image = render(arrays, device, at((0.0, 0.0, 0.0)), config=config, weathers={name: weather}).one()[23, :, :]
        # Columns of one row, half a pixel above the horizon; all in nearly the same direction.
        black, sky, white = image[14:22], image[28:36], image[42:50]
        contrast = (black[:, 1].mean() - sky[:, 1].mean()) / sky[:, 1].mean()
        assert contrast == pytest.approx(-math.exp(-depth), rel=0.01, abs=0.01), depth
        difference = float((white.mean(axis=0) - black.mean(axis=0))[1])
        near = near or difference / math.exp(-depth)
        assert difference == pytest.approx(near * math.exp(-depth), rel=0.01, abs=2e-4 * near), depth
    np.testing.assert_allclose(black.mean(axis=0), sky.mean(axis=0), rtol=0.01)
    np.testing.assert_allclose(white.mean(axis=0), sky.mean(axis=0), rtol=0.01)


ASPHALT = matter("asphalt", "asphalt", color=(0.1, 0.1, 0.1), roughness=0.9)
DRY = Weather(cloudiness=1.0)
WET = replace(DRY, wetness=1.0)


def road(weathers: Sequence[str], parts: Sequence = ()) -> SceneData:
    """Return level asphalt and more."""
    materials = {"asphalt": ASPHALT, "wall": glowing((2.0, 0.4, 0.1), "wall")}
    return arrays_from_parts([ground_part(200.0), *parts], materials=materials, weathers=tuple(weathers))


def test_wet_road_is_darker_from_above_and_brighter_at_a_glance(device: str) -> None:
    """Under the same even sky the pores take light and the film reflects: which wins depends on the angle."""
    views = at((0.0, 0.0, 3.0, 0.0, 90.0, 0.0), (0.0, 0.0, 1.0, 0.0, 4.0, 0.0))
    config = SMALL.model_copy(update={"fov_deg": 4.0})
    weathers = {"dry": DRY, "wet": WET}
    light = render(road(weathers), device, views, config=config, weathers=weathers, sky=even_sky(device, 1.0)).light()
    (dry_down, dry_far), (wet_down, wet_far) = (light[name].mean(axis=(1, 2, 3)) for name in weathers)
    # Lekner and Dorf: 0.1 becomes 0.1 / (1.33^2 0.9 + 0.1) = 0.059; the dry dielectric reflects a little as well.
    assert 0.1 < dry_down < 0.15 and 0.55 < wet_down / dry_down < 0.95
    assert wet_far > 1.3 * dry_far
    assert light["wet"].max() < 1.0


def test_puddle_reflects_a_coloured_wall(device: str) -> None:
    """Black ground all under water before a red wall shows it by Schlick's term, within a fifth of Fresnel's law.

    Where less than 12 % is reflected, blurred sky is blended in, and takes over at 3 % (`reflections.MIN_WATER_SHARE`).
    """
    ground = matter("asphalt", "asphalt", color=(0.0, 0.0, 0.0), roughness=0.9, ior=1.0)
    wall = wall_part("wall", (-60.0, 12.0), (60.0, 12.0), 40.0, "wall")
    materials = {"asphalt": ground, "wall": glowing((2.0, 0.4, 0.1), "wall")}
    arrays = arrays_from_parts([ground_part(), wall], materials=materials, weathers=("flood",))
    config = SMALL.model_copy(update={"fov_deg": 3.0})
    weathers = {"flood": Weather(wetness=1.0, puddles=1.0)}
    for down in (9.0, 14.0, 20.0):
        place = (0.0, 0.0, 1.5, 90.0, down, 0.0)
        rendering = render(arrays, device, at(place), config=config, weathers=weathers, sky=even_sky(device, 0.0))
        cosine = -rendering.rays[..., 2]
        inside = np.sqrt(1.0 - (1.0 - cosine**2) / 1.33**2)
        s, p = (cosine - 1.33 * inside) / (cosine + 1.33 * inside), (1.33 * cosine - inside) / (1.33 * cosine + inside)
        share = 0.5 * (s**2 + p**2)
        color = rendering.one().mean(axis=(0, 1)) / (2.0, 0.4, 0.1)
        np.testing.assert_allclose(color, (0.02 + 0.98 * (1.0 - cosine) ** 5).mean(), rtol=0.03)
        np.testing.assert_allclose(color, share.mean(), rtol=0.2)  # Schlick's term is so far off Fresnel's for water
    dry = render(arrays, device, at(place), config=config, weathers={"flood": Weather()}, sky=even_sky(device, 0.0))
    assert dry.one().max() < 1e-6


@pytest.mark.parametrize("luminance", [0.05, 2.0])
def test_no_line_where_reflected_rays_end(device: str, luminance: float) -> None:
    """Down a flooded road before a wall, darker or brighter than the sky, light changes smoothly from row to row."""
    materials = {"asphalt": ASPHALT, "wall": glowing((luminance,) * 3, "wall")}
    wall = wall_part("wall", (-200.0, 60.0), (200.0, 60.0), 200.0, "wall")
    arrays = arrays_from_parts([ground_part(), wall], materials=materials, weathers=("flood",))
    config = SMALL.model_copy(update={"fov_deg": 52.0})
    weathers = {"flood": Weather(wetness=1.0, puddles=1.0)}
    views = at((0.0, 0.0, 1.5, 90.0, 32.0, 0.0))
    image = render(arrays, device, views, config=config, weathers=weathers, sky=even_sky(device, 1.0), glow=0.2).one()
    rows = image[..., 1].mean(axis=1)
    bend = np.abs(np.diff(rows, 2)) / rows[1:-1]
    assert bend.max() < 0.02, f"row {int(bend.argmax()) + 1}"


def test_some_of_the_road_lies_under_puddles(device: str) -> None:
    """With puddles on half of the road, as much reflects the wall, and the rest does not."""
    wall = wall_part("wall", (-200.0, 30.0), (200.0, 30.0), 150.0, "wall")
    config = SMALL.model_copy(update={"fov_deg": 30.0})
    weathers = {"half": Weather(puddles=0.5)}
    views = at((0.0, -25.0, 6.0, 90.0, 15.0, 0.0))
    rendering = render(
        road(weathers, [wall]), device, views, config=config, weathers=weathers, sky=even_sky(device, 0.0)
    )
    ground = (rendering.rays[..., 2] < -0.18) & (rendering.rays[..., 2] > -0.4)  # below the wall, and reflected sharply
    assert ground.mean() > 0.5 and (rendering.objects()[0][ground] == rendering.objects()[0, -1, 0]).all()
    schlick = 0.02 + 0.98 * (1.0 + rendering.rays[..., 2]) ** 5
    share = (rendering.one()[..., 0] / (2.0 * schlick))[ground]
    assert 0.35 < share.mean() < 0.65
    assert (share < 0.05).mean() > 0.15 and (np.abs(share - 1.0) < 0.1).mean() > 0.15


def clip(device: str, weather: Weather, frames: Sequence[int]) -> np.ndarray:
    """Return the light of one view of a road at some frames."""
    poses = np.zeros((40, 0, 7))
    arrays = arrays_from_parts([ground_part()], (), (), poses, materials={"asphalt": ASPHALT}, weathers=("w",))
    place = (0.0, 0.0, 1.2, 0.0, 25.0, 0.0)
    views = at(*[place] * len(frames), frame=frames)
    return render(arrays, device, views, config=SMALL, weathers={"w": weather}).light()["w"]


def test_rain_moves_and_a_sunny_road_does_not(device: str) -> None:
    """The rings of drops change from frame to frame, about the same picture; sunny frames are equal to the bit."""
    rain = clip(device, replace(PRESETS["rainy"], puddles=1.0), (0, 10, 20))
    off = np.abs(rain[1] - rain[0]).mean() / rain[0].mean()
    assert off > 0.001 and np.abs(rain[2] - rain[1]).max() > 0.03 * rain.mean()
    assert rain.mean(axis=(1, 2, 3)) == pytest.approx(rain.mean(), rel=0.03)
    sunny = clip(device, Weather(), (0, 10, 20))
    np.testing.assert_array_equal(sunny[1:], np.stack([sunny[0]] * 2))


NIGHT = Weather(sun_altitude_deg=-25.0, cloudiness=0.2)
LAMPS = {
    "paint": matter("paint", "steel", color=(0.3, 0.3, 0.35)),
    "tail": matter("tail", "plastic", color=(0.2, 0.0, 0.0), emission=(0.5, 0.01, 0.0), lamp="taillight"),
    "head": matter("head", "plastic", color=(0.5, 0.5, 0.5), emission=(1.0, 1.0, 0.9), lamp="headlight"),
    "asphalt": ASPHALT,
    "wall": lambert(0.5),
}


def car_at_night(device: str, views, *, speeds: Sequence[float], weathers: dict[str, Weather]) -> Rendering:
    """Return a car on a road before a house, which drives along x with these speeds [m/s], one a frame.

    Its back is taillights, its front headlights.
    """
    model = box_model("car")
    model.material[:] = 0
    model.material[0:2], model.material[2:4] = 1, 2
    x = np.concatenate([[0.0], np.cumsum(np.asarray(speeds[1:]) * FRAME_DT)])
    poses = np.array([[(place, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)] for place in x])
    house = box_part("Buildings/house", (8.0, 8.0, 6.0), (24.0, 10.0, 3.0), "wall", "building")
    arrays = arrays_from_parts(
        [ground_part(), house], [model], [("veh_001", "vehicle", 0)], poses, materials=LAMPS, weathers=tuple(weathers)
    )
    return render(arrays, device, views, weathers=weathers)


def test_brake_lights_are_seen(device: str) -> None:
    """By day the rear lights are off unless the car brakes; at night they are on, and ten times brighter in braking."""
    weathers = {"sunny": Weather(), "night": NIGHT}
    views = at((-8.0, 0.0, 1.0), frame=4)
    steady, braking = (
        car_at_night(device, views, speeds=speeds, weathers=weathers)
        for speeds in (np.full(10, 12.0), 12.0 - 0.05 * np.arange(10))
    )
    back = steady.objects()[0] == steady.scene.arrays.actors[0].object_id
    assert back.sum() > 60
    inside = back & np.roll(back, 1, 0) & np.roll(back, -1, 0) & np.roll(back, 1, 1) & np.roll(back, -1, 1)
    red = {
        (when, name): rendering.light()[name][0][inside].mean(axis=0)
        for when, rendering in (("steady", steady), ("braking", braking))
        for name in weathers
    }
    np.testing.assert_allclose(red["braking", "sunny"] - red["steady", "sunny"], [5.0, 0.1, 0.0], rtol=0.02, atol=0.01)
    assert red["steady", "night"][0] == pytest.approx(0.5, rel=0.02)
    assert red["braking", "night"][0] == pytest.approx(5.0, rel=0.02)


def test_headlights_light_the_road_at_night(device: str) -> None:
    """The road before the car is brighter than behind it, by day it makes no difference; an oncoming driver sees the
    lights shine."""
    weathers = {"sunny": Weather(), "night": NIGHT}
    views = at(
        (12.0, 0.0, 8.0, 0.0, 90.0, 0.0), (-12.0, 0.0, 8.0, 0.0, 90.0, 0.0), (25.0, 0.5, 1.3, 180.0, 0.0, 0.0), frame=4
    )
    rendering = car_at_night(device, views, speeds=np.full(10, 12.0), weathers=weathers)
    light = rendering.light()
    ahead, behind = light["night"][:2, 16:32, 24:40, 1].mean(axis=(1, 2))
    assert ahead > 3.0 * behind
    by_day = light["sunny"][:2, 16:32, 24:40, 1].mean(axis=(1, 2))
    assert by_day[0] == pytest.approx(by_day[1], rel=0.05)
    lights = light["night"][2].max(axis=(0, 1))
    assert lights[1] > 100.0 * np.median(light["night"][2][..., 1])


def lit_street(device: str, with_lights: bool) -> Rendering:
    """Return light ground with lights of 10 klm in two rows 24 m apart, 8 m up and 30 m from the next, or with none."""
    weathers = {
        "noon": Weather(),
        "dusk": Weather(sun_altitude_deg=-6.0),
        "night": Weather(sun_altitude_deg=-15.0),
        "night_rain": replace(PRESETS["rainy"], sun_altitude_deg=-15.0),
    }
    lights = [
        quad_part(f"Lights/{x}_{y}", [(x, y, 8), (x, y + 0.4, 8), (x + 0.4, y + 0.4, 8), (x + 0.4, y, 8)], "lamp")
        for x in range(-30, 91, 30)
        for y in (-12, 12)
    ]
    pavement = matter("asphalt", "asphalt", color=(0.25, 0.25, 0.25), roughness=0.9)
    street = matter("lamp", "plastic", emission=(20.0, 17.5, 13.5), lamp="street" if with_lights else "none")
    arrays = arrays_from_parts(
        [ground_part(200.0), *lights], materials={"asphalt": pavement, "lamp": street}, weathers=tuple(weathers)
    )
    return render(arrays, device, at((0.0, 0.0, 1.6, 0.0, 5.0, 0.0)), weathers=weathers)


def test_exposure_is_made_for_the_lights_of_a_lit_street(device: str) -> None:
    """Street lights that burn count as 10 lux (EN 13201-2, C4) beside sky and sun; no others, and none by day."""
    found = {}
    for with_lights in (True, False):
        rendering = lit_street(device, with_lights)
        keys = {name: np.zeros((1, 2), dtype=np.uint32) for name in rendering.weathers}
        images = rendering.camera.render(rendering.buffer, rendering.config, keys)
        found[with_lights] = {name: float(images[name].exposure.numpy()[0]) for name in images}
        if with_lights:
            pictures = {name: image.rgb.numpy()[0].astype(float).mean(axis=-1) for name, image in images.items()}
    for name in rendering.weathers:
        # pi key / E with the key (E / 100 klux)^0.17: E^-0.83 but for a factor.
        klux = bake(rendering.camera._weathers[name]).horizontal_klux
        share = 1.0 if name == "noon" else (1.0 + 0.010 / klux) ** -0.83
        assert found[True][name] / found[False][name] == pytest.approx(share, rel=1e-4), name
    assert found[True]["night"] < 0.05 * found[False]["night"]
    for name in ("dusk", "night", "night_rain"):
        ground, sky = pictures[name][rendering.rays[..., 2] < -0.05], pictures[name][rendering.rays[..., 2] > 0.05]
        assert (30.0 if name == "night_rain" else 40.0) < ground.mean() < 110.0, (name, ground.mean())
        assert (pictures[name] > 250.0).mean() < 0.01, name
        assert sky.mean() < (120.0 if name == "dusk" else 40.0), (name, sky.mean())


def test_night_is_readable(device: str) -> None:
    """A street at night is neither black nor flat: house, car and road differ, and little is at an end of the scale."""
    views = at((-14.0, -4.0, 2.0, 10.0, 2.0, 0.0), frame=4)
    rendering = car_at_night(device, views, speeds=np.full(10, 12.0), weathers={"night": NIGHT})
    image = rendering.rgb()["night"][0].astype(float).mean(axis=-1)
    objects = rendering.objects()[0]
    assert 15.0 < np.median(image) < 140.0
    assert ((image < 4.0) | (image > 251.0)).mean() < 0.1
    house, road_, car, sky = (
        image[objects == k].mean() for k in (0, 1, rendering.scene.arrays.actors[0].object_id, -1)
    )
    assert len(set(objects.ravel().tolist())) == 4
    for a, b in ((house, road_), (house, sky), (car, road_)):
        assert abs(a - b) > 4.0
