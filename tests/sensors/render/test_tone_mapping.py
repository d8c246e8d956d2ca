"""From radiance to pictures: closed forms of tone map and sRGB, exposure, noise statistics, blur, rain."""

import numpy as np
import pytest
import warp as wp

from mmw.config import ConfigError
from mmw.core.constants import FRAME_DT
from mmw.sensors.render.image_config import ExposureConfig, ImageConfig
from mmw.sensors.render.tone_mapping import exposure_of_ev100, make_exposure, tone_map

EXACT = ImageConfig(tone_map="none")


def light(values: np.ndarray, device: str = "cpu") -> wp.array:
    """Return radiance on a device of values [A, H, W] (gray) or [A, H, W, 3]."""
    values = np.asarray(values, dtype=np.float32)
    if values.ndim == 3:
        values = np.repeat(values[..., None], 3, axis=-1)
    return wp.array(np.ascontiguousarray(values), dtype=wp.vec3, device=device)


def picture(values: np.ndarray, config: ImageConfig, exposure: float = 1.0, device: str = "cpu", **rest) -> np.ndarray:
    radiance = light(values, device)
    factor = wp.full(radiance.shape[0], exposure, dtype=float, device=device)
    return tone_map(radiance, config, factor, **rest).numpy()


def keys(count: int, device: str = "cpu", first: int = 0) -> wp.array:
    words = np.arange(2 * first, 2 * (first + count), dtype=np.uint32).reshape(count, 2) * 7919 + 13
    return wp.array(words, dtype=wp.vec2ui, device=device)


def srgb(x: np.ndarray) -> np.ndarray:
    x = np.clip(np.asarray(x, dtype=np.float64), 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1.0 / 2.4) - 0.055)


def linear(code: np.ndarray) -> np.ndarray:
    s = np.asarray(code, dtype=np.float64) / 255.0
    return np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4)


def rounds_to(found: np.ndarray, shown: np.ndarray) -> bool:
    """Whether 8-bit values are `shown` (0 to 1) rounded, within 1e-3 of a step of single precision."""
    return bool(np.abs(found.astype(np.float64) - 255.0 * shown).max() <= 0.5 + 1e-3)


def test_tone_map_and_srgb_are_the_closed_forms(device: str) -> None:
    x = np.concatenate([[0.0], np.geomspace(1e-5, 1e4, 4095)])
    values = np.stack([x, 0.5 * x, 2.0 * x], axis=-1).reshape(1, 64, 64, 3)
    y = 0.8 * values
    toned = np.clip(y * (2.51 * y + 0.03) / (y * (2.43 * y + 0.59) + 0.14), 0.0, 1.0)
    assert rounds_to(picture(values, ImageConfig(), 0.8, device), srgb(toned))
    assert rounds_to(picture(values, EXACT, 0.8, device), srgb(y))


def test_white_black_and_more(device: str) -> None:
    values = np.array([[[0.0, 2.0, 1e30, np.inf, -1.0]]])
    assert picture(values, EXACT, 1.0, device)[0, 0, :, 0].tolist() == [0, 255, 255, 255, 0]
    assert picture(values, ImageConfig(), 1.0, device)[0, 0, :, 1].tolist() == [0, 245, 255, 255, 0]


def test_fixed_exposure(device: str) -> None:
    radiance = light(np.ones((3, 4, 4)), device)
    own = make_exposure(ExposureConfig(), radiance, 0.2).numpy()
    np.testing.assert_allclose(own, [0.2] * 3, rtol=1e-6)
    brighter = make_exposure(ExposureConfig(ev_compensation=1.5), radiance, 0.2).numpy()
    np.testing.assert_allclose(brighter, [0.2 * 2**1.5] * 3, rtol=1e-6)
    # EV100 15, the sunny 16 rule (f/16, 1/100 s, ISO 100): white is 1.2 x 2^15 = 39,322 cd/m2.
    given = make_exposure(ExposureConfig(ev100=15.0), radiance, 0.2).numpy()
    np.testing.assert_allclose(given, [1.0 / 39.3216] * 3, rtol=1e-6)
    assert exposure_of_ev100(0.0) == pytest.approx(1000.0 / 1.2)


def test_auto_exposure_brings_the_geometric_mean_to_middle_grey(device: str) -> None:
    rng = np.random.default_rng(0)
    values = np.exp(rng.normal(0.0, 1.5, (4, 30, 50, 3))) * np.array([0.01, 1.0, 20.0, 300.0]).reshape(4, 1, 1, 1)
    config = ExposureConfig(mode="auto", min_ev100=-10, max_ev100=24)
    found = make_exposure(config, light(values, device), 1.0).numpy()
    mean = np.exp(np.log(values @ [0.2126, 0.7152, 0.0722] + 1e-6).mean(axis=(1, 2)))
    np.testing.assert_allclose(found, 0.18 / mean, rtol=1e-5)


def test_auto_exposure_keeps_its_limits(device: str) -> None:
    config = ExposureConfig(mode="auto", min_ev100=2.0, max_ev100=14.0, ev_compensation=-1.0)
    values = np.stack([np.zeros((8, 8)), np.full((8, 8), 1e4)])
    found = make_exposure(config, light(values, device), 1.0).numpy()
    np.testing.assert_allclose(found, [0.5 * 1000 / (1.2 * 4), 0.5 * 1000 / (1.2 * 2**14)], rtol=1e-5)


def test_noise_has_the_mean_and_variance_of_the_sensor(device: str) -> None:
    """Linear values back from the code: steps of the 8 bits add 1/12 of a squared step."""
    config = ImageConfig(tone_map="none", noise={"enabled": True, "full_well": 2000.0, "read_noise": 6.0})
    for level in (0.05, 0.2, 0.5):
        found = linear(picture(np.full((2, 200, 200), level), config, 1.0, device, keys=keys(2, device)))
        step = np.gradient(linear(np.arange(256.0)))[int(255 * srgb(np.array(level)))]
        variance = (level * 2000.0 + 36.0) / 2000.0**2 + step**2 / 12.0
        count = found.size
        assert found.mean() == pytest.approx(level, abs=5.0 * np.sqrt(variance / count) + 0.02 * step)
        assert found.var() == pytest.approx(variance, rel=0.04)
        channels = found.reshape(-1, 3)
        assert np.abs(np.corrcoef(channels.T) - np.eye(3)).max() < 0.02
        assert abs(np.corrcoef(found[0].ravel(), found[1].ravel())[0, 1]) < 0.02


def test_pictures_do_not_depend_on_the_batch(device: str) -> None:
    rng = np.random.default_rng(1)
    values = rng.uniform(0.0, 2.0, (5, 24, 40, 3))
    config = ImageConfig(noise={"enabled": True}, exposure={"mode": "auto"})

    def make(rows: slice) -> np.ndarray:
        radiance = light(values[rows], device)
        own = wp.array(keys(5, device).numpy()[rows], dtype=wp.vec2ui, device=device)
        exposure = make_exposure(config.exposure, radiance, 1.0)
        return tone_map(radiance, config, exposure, keys=own).numpy()

    whole = make(slice(None))
    np.testing.assert_array_equal(whole, np.concatenate([make(slice(0, 2)), make(slice(2, 5))]))
    assert (whole[0] != make(slice(1, 2))[0]).any()


def test_blurred_step_is_a_ramp_as_long_as_the_motion(device: str) -> None:
    """16 px a frame and a shutter of 5 ms: 8 px, centered where the step is."""
    height, width, way = 10, 64, 16.0
    values = np.zeros((1, height, width))
    values[..., width // 2 :] = 1.0
    config = ImageConfig(tone_map="none", motion_blur=True, shutter_ms=5.0)
    motion = np.zeros((1, height, width, 2), dtype=np.float32)
    motion[..., 0] = way
    motion[:, :3] = 0.0
    found = picture(values, config, 1.0, device, motion=wp.array(motion, dtype=wp.vec2, device=device))
    length = way * 0.005 / FRAME_DT
    ramp = np.clip((np.arange(width) + 0.5 - width / 2) / length + 0.5, 0.0, 1.0)
    np.testing.assert_allclose(linear(found[0, 5, :, 0]), ramp, atol=0.006)
    assert (found[0, :3, :, 0] == np.where(np.arange(width) < width // 2, 0, 255)).all()


def test_streaks_mix_in_the_drops_light(device: str) -> None:
    cover = np.zeros((1, 2, 4), dtype=np.int32)
    cover[0, 0] = np.array([0.0, 0.25, 1.0, 3.0]) * 2**24
    found = picture(
        np.full((1, 2, 4), 0.2), EXACT, 1.0, device,
        cover=wp.array(cover, dtype=int, device=device), drop_light=wp.vec3(0.6, 0.4, 0.2),
    )  # fmt: skip
    np.testing.assert_allclose(linear(found[0, 0, :, 0]), [0.2, 0.3, 0.6, 0.6], atol=0.004)
    np.testing.assert_allclose(linear(found[0, 0, :, 2]), 0.2, atol=0.004)
    np.testing.assert_allclose(linear(found[0, 1]), 0.2, atol=0.004)


def test_missing_inputs_and_bad_sections_are_errors() -> None:
    values = np.ones((1, 4, 4))
    with pytest.raises(ValueError, match=r"noise.enabled is on and keys is None"):
        picture(values, ImageConfig(noise={"enabled": True}))
    with pytest.raises(ValueError, match=r"motion_blur is on and motion is None"):
        picture(values, ImageConfig(motion_blur=True))
    with pytest.raises(ConfigError, match="which finds its own"):
        ExposureConfig(mode="auto", ev100=3.0)
    with pytest.raises(ConfigError, match="swap them"):
        ExposureConfig(min_ev100=5.0, max_ev100=4.0)
    assert picture(np.ones((0, 4, 4)), ImageConfig()).shape == (0, 4, 4, 3)
