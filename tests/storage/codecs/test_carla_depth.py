"""CARLA's encodings of depth: known values, round trips, and the resolution that each of them has."""

import io

import numpy as np
import pytest
from PIL import Image

from mmw.storage.codecs.carla_depth import (
    decode_bgra,
    decode_grey,
    decode_log_grey,
    encode_bgra,
    encode_grey,
    encode_log_grey,
)


@pytest.mark.parametrize(
    ("depth_m", "bgra"),
    [
        (0.0, (0, 0, 0, 255)),
        (1000.0 / (2**24 - 1), (0, 0, 1, 255)),  # one step: the low byte is red
        (256 * 1000.0 / (2**24 - 1), (0, 1, 0, 255)),
        (65536 * 1000.0 / (2**24 - 1), (1, 0, 0, 255)),
        (500.0, (128, 0, 0, 255)),  # 8388607.5 rounds to even
        (10.0, (0x02, 0x8F, 0x5C, 255)),  # 167772.15
        (1000.0, (255, 255, 255, 255)),
        (1234.5, (255, 255, 255, 255)),
        (np.inf, (255, 255, 255, 255)),
    ],
)
def test_24_bits_of_known_depths(depth_m: float, bgra: tuple[int, ...]) -> None:
    found = encode_bgra(np.array(depth_m))
    assert found.dtype == np.uint8
    np.testing.assert_array_equal(found, bgra)


def test_24_bits_keep_a_sixteenth_of_a_millimetre() -> None:
    depth = np.random.default_rng(0).uniform(0.0, 1000.0, (60, 80))
    image = encode_bgra(depth)
    step = 1000.0 / (2**24 - 1)
    assert image.shape == (60, 80, 4) and step == pytest.approx(0.06e-3, rel=0.01)
    assert np.abs(decode_bgra(image) - depth).max() <= 0.5 * step * (1 + 1e-9)
    # The documented formula, written out for one pixel.
    blue, green, red = (int(image[7, 9, channel]) for channel in range(3))
    assert decode_bgra(image)[7, 9] == 1000.0 * (red + 256 * green + 65536 * blue) / (256**3 - 1)
    np.testing.assert_array_equal(encode_bgra(decode_bgra(image)), image)
    np.testing.assert_array_equal(decode_bgra(image[..., :3]), decode_bgra(image))


def test_rgb_file_of_24_bits_has_the_low_byte_in_red() -> None:
    buffer = io.BytesIO()
    Image.fromarray(encode_bgra(np.array([[10.0]]))[..., 2::-1]).save(buffer, format="PNG")
    assert Image.open(buffer).getpixel((0, 0)) == (0x5C, 0x8F, 0x02)


def test_grey_is_linear_to_a_kilometre() -> None:
    depth = np.array([0.0, 1.0, 2.0, 500.0, 1000.0, np.inf])
    np.testing.assert_array_equal(encode_grey(depth), [0, 0, 1, 128, 255, 255])
    every = np.arange(256, dtype=np.uint8)
    np.testing.assert_array_equal(encode_grey(decode_grey(every)), every)
    np.testing.assert_allclose(np.diff(decode_grey(every)), 1000.0 / 255.0)


def test_log_grey_of_known_depths() -> None:
    # 100 m: 1 + ln(0.1) / 5.70378 = 0.596306; 10 m: 0.192613; each times 255.
    depth = np.array([0.0, 0.5, 3.3, 3.37, 10.0, 100.0, 999.0, 1000.0, np.inf])
    np.testing.assert_array_equal(encode_log_grey(depth), [0, 0, 0, 0, 49, 152, 255, 255, 255])
    assert decode_log_grey(np.uint8(255)) == pytest.approx(1000.0)
    assert decode_log_grey(np.uint8(0)) == pytest.approx(3.333, abs=0.002)
    # Everything nearer than 3.33 m is black, half a step more too; then gray begins.
    assert encode_log_grey(np.array([3.335, 3.37, 3.38])).tolist() == [0, 0, 1]


def test_log_grey_has_even_ratios() -> None:
    every = np.arange(256, dtype=np.uint8)
    depth = decode_log_grey(every)
    np.testing.assert_allclose(depth[1:] / depth[:-1], 1.0226, atol=1e-4)
    np.testing.assert_allclose(np.diff(np.log(depth)), 5.70378 / 255.0)  # 2.24 % of a depth, as a logarithm
    np.testing.assert_array_equal(encode_log_grey(depth), every)
    wanted = np.random.default_rng(1).uniform(3.4, 1000.0, 5000)
    assert np.abs(decode_log_grey(encode_log_grey(wanted)) / wanted - 1.0).max() < 0.0113


@pytest.mark.parametrize("encode", [encode_bgra, encode_grey, encode_log_grey])
@pytest.mark.parametrize("bad", [-0.5, np.nan])
def test_impossible_depths_are_refused(encode, bad: float) -> None:
    with pytest.raises(ValueError, match=f"holds {bad} m"):
        encode(np.array([1.0, bad]))


def test_images_of_another_kind_are_refused() -> None:
    for image in (np.zeros((2, 2, 2), dtype=np.uint8), np.zeros((2, 2, 4))):
        with pytest.raises(ValueError, match="blue, green, red"):
            decode_bgra(image)
    for decode in (decode_grey, decode_log_grey):
        with pytest.raises(ValueError, match="float64"):
            decode(np.zeros((2, 2)))
