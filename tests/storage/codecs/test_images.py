"""Images of RGB cameras as files: colors, normals, flow, read back by ourselves and by Pillow."""

import io

import numpy as np
import pytest
from PIL import Image

from mmw.storage.codecs.images import (
    decode_depth,
    decode_flow,
    decode_instance,
    decode_normals,
    decode_rgb,
    decode_semantic,
    encode_depth,
    encode_flow,
    encode_instance,
    encode_normals,
    encode_rgb,
    encode_semantic,
    lossless_pixels,
)
from mmw.storage.codecs.png16 import decode_png16, encode_png16


def smooth(height: int = 48, width: int = 64) -> np.ndarray:
    v, u = np.mgrid[0:height, 0:width]
    return np.stack([4 * u, 5 * v, 255 - 2 * (u + v)], axis=2).astype(np.uint8)


def test_png_is_exact_and_jpeg_near() -> None:
    image = smooth()
    np.testing.assert_array_equal(decode_rgb(encode_rgb(image, "png", 95)), image)
    near = decode_rgb(encode_rgb(image, "jpeg", 95))
    assert near.dtype == np.uint8 and near.shape == image.shape
    assert np.abs(near.astype(int) - image).max() <= 6
    assert len(encode_rgb(image, "jpeg", 50)) < len(encode_rgb(image, "jpeg", 95))


def test_jpeg_can_keep_the_colour_of_single_pixels() -> None:
    """Red and blue columns in turn mix to violet where chroma is subsampled; their lightness stays."""
    image = np.zeros((16, 16, 3), dtype=np.uint8)
    image[:, ::2, 0] = 255
    image[:, 1::2, 2] = 255
    found = decode_rgb(encode_rgb(image, "jpeg", 95, "4:4:4")).astype(int)
    assert np.abs(found - image).max() < 30
    mixed = decode_rgb(encode_rgb(image, "jpeg", 95)).astype(int)
    assert np.abs(mixed - image).max() > 100
    lightness = np.array([0.299, 0.587, 0.114])
    assert np.abs((mixed - image)[2:-2, 2:-2] @ lightness).mean() < 30


@pytest.mark.parametrize("bad", [np.zeros((4, 4), np.uint8), np.zeros((4, 4, 4), np.uint8), np.zeros((4, 4, 3))])
def test_what_is_no_image_is_refused(bad: np.ndarray) -> None:
    with pytest.raises(ValueError, match=r"RGB image.*uint8 \[H, W, 3\]"):
        encode_rgb(bad, "png", 95)


def test_normals_keep_axes_exactly_and_others_within_half_a_degree() -> None:
    rng = np.random.default_rng(2)
    normals = rng.normal(size=(40, 50, 3))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    normals[0, :6] = axes
    normals[1] = 0.0
    found = decode_normals(encode_normals(normals.astype(np.float32)))
    np.testing.assert_array_equal(found[0, :6], axes)
    np.testing.assert_array_equal(found[1], 0.0)
    cosine = (found * normals).sum(axis=2)[2:]
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 0.5
    # What the table says of the file: (value - 128) / 127, red = x.
    file = Image.open(io.BytesIO(encode_normals(normals.astype(np.float32))))
    assert file.mode == "RGB" and file.getpixel((0, 0)) == (255, 128, 128) and file.getpixel((5, 0)) == (128, 128, 1)
    assert file.getpixel((3, 1)) == (0, 0, 0)


def test_flow_comes_back_within_half_a_step_of_kitti() -> None:
    flow = np.random.default_rng(3).uniform(-500, 500, (30, 40, 2)).astype(np.float32)
    flow[0, 0] = np.nan
    flow[0, 1] = (600.0, 0.0)
    flow[0, 2] = (0.0, -513.0)
    flow[0, 3] = (-511.5, 511.0)
    found = decode_flow(encode_flow(flow))
    assert np.isnan(found[0, :3]).all() and np.isfinite(found[0, 3:]).all()
    np.testing.assert_allclose(found[0, 3:], flow[0, 3:], atol=1 / 128)
    np.testing.assert_allclose(found[1:], flow[1:], atol=1 / 128)


def test_flow_is_kittis_file() -> None:
    """Zero flow is 2^15 in red and green; a pixel right and two down are 64 and 128 steps more; blue: valid."""
    flow = np.zeros((2, 3, 2), dtype=np.float32)
    flow[0, 1], flow[1, 2] = (1.0, 2.0), np.nan
    values = decode_png16(encode_flow(flow))
    assert values[0, 0].tolist() == [32768, 32768, 1] and values[0, 1].tolist() == [32832, 32896, 1]
    assert values[1, 2].tolist() == [0, 0, 0]


def test_16_bit_colours_are_a_png_that_pillow_opens() -> None:
    """Pillow keeps the upper eight bits of sixteen."""
    image = np.random.default_rng(4).integers(0, 65536, (17, 23, 3)).astype(np.uint16)
    data = encode_png16(image, 6)
    np.testing.assert_array_equal(decode_png16(data), image)
    file = Image.open(io.BytesIO(data))
    file.verify()  # checksums
    high = np.asarray(Image.open(io.BytesIO(data)))
    assert np.abs(high.astype(int) - (image >> 8)).max() <= 1


@pytest.mark.parametrize("data", [b"", b"no file", encode_rgb(smooth(), "png", 95), encode_rgb(smooth(), "jpeg", 95)])
def test_another_file_is_refused_as_flow(data: bytes) -> None:
    with pytest.raises(ValueError, match="three 16-bit channels"):
        decode_flow(data)


def test_pixels_of_a_file_without_loss_decode_as_the_file_does() -> None:
    rng = np.random.default_rng(4)
    objects = rng.integers(-1, 30, (6, 8), dtype=np.int32)
    normals = rng.normal(size=(6, 8, 3)).astype(np.float32)
    normals[0] = 0.0
    flow = rng.normal(scale=300.0, size=(6, 8, 2)).astype(np.float32)
    tags = rng.integers(0, 29, 31).astype(np.uint8)
    cases = [
        (encode_rgb, (smooth(), "png", 95, "4:2:0"), decode_rgb),
        (encode_depth, (rng.integers(0, 65_536, (6, 8)).astype(np.uint16),), decode_depth),
        (encode_instance, (objects,), decode_instance),
        (encode_semantic, (objects, tags), decode_semantic),
        (encode_normals, (normals,), decode_normals),
        (encode_flow, (flow,), decode_flow),
    ]
    for encode, args, decode in cases:
        pixels = lossless_pixels(encode, *args)
        assert pixels is not None
        found, stored = decode(pixels), decode(encode(*args))
        assert found.dtype == stored.dtype and not np.shares_memory(found, args[0])
        np.testing.assert_array_equal(found, stored)
    assert lossless_pixels(encode_rgb, smooth(), "jpeg", 95) is None
