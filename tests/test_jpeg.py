"""JPEG files that Warp kernels make: byte for byte those of libjpeg."""

import io

import numpy as np
import pytest
import warp as wp
from PIL import Image

from mmw.sensors.jpeg import jpeg_files, zigzag
from mmw.tables.encode import decode_rgb, encode_rgb

SUBSAMPLING = {"4:4:4": 0, "4:2:0": 2}
"""Pillow's numbers for them."""


def pictures(height: int, width: int) -> np.ndarray:
    """Return smooth colours, noise, black and white pixels, and one colour, shape [4, H, W, 3], uint8."""
    rng = np.random.default_rng(height * width)
    v, u = np.mgrid[0:height, 0:width] / max(height, width)
    smooth = np.stack([255 * u, 255 * v, 128 + 127 * np.sin(9.0 * u * v)], axis=2)
    noise = rng.integers(0, 256, (height, width, 3))
    edges = 255 * rng.integers(0, 2, (height, width, 1)) * np.ones(3)
    return np.stack([smooth, noise, edges, np.full((height, width, 3), (10, 200, 90))]).astype(np.uint8)


def by_pillow(image: np.ndarray, quality: int, subsampling: str) -> bytes:
    file = io.BytesIO()
    Image.fromarray(image).save(file, "jpeg", quality=quality, subsampling=SUBSAMPLING[subsampling])
    return file.getvalue()


@pytest.mark.parametrize("subsampling", ["4:2:0", "4:4:4"])
@pytest.mark.parametrize(("height", "width"), [(48, 64), (33, 47), (24, 40), (9, 17), (1, 1), (17, 100)])
def test_files_are_those_of_libjpeg(device: str, height: int, width: int, subsampling: str) -> None:
    images = pictures(height, width)
    for quality in (1, 50, 95, 100):
        (files,) = jpeg_files([wp.array(images, dtype=wp.uint8, device=device)], quality, subsampling)
        assert files == [by_pillow(image, quality, subsampling) for image in images], quality


def test_several_arrays_are_the_files_of_each(device: str) -> None:
    first = wp.array(pictures(48, 64), dtype=wp.uint8, device=device)
    second = wp.array(pictures(48, 64)[::-1].copy(), dtype=wp.uint8, device=device)
    files, turned = jpeg_files([first, second], 95, "4:2:0")
    assert files == turned[::-1] and len(set(files)) == 4
    assert jpeg_files([first[:0], second[:0]], 95, "4:2:0") == [[], []] and jpeg_files([], 95, "4:2:0") == []


def test_files_are_as_near_as_those_of_the_cpu(device: str) -> None:
    image = pictures(48, 64)[0]
    ((file,),) = jpeg_files([wp.array(image[None], dtype=wp.uint8, device=device)], 95, "4:2:0")
    own, other = (np.abs(decode_rgb(data) - image.astype(int)).mean() for data in (file, encode_rgb(image, "jpeg", 95)))
    assert own <= 1.02 * other < 3.0
    ((fine,),) = jpeg_files([wp.array(image[None], dtype=wp.uint8, device=device)], 96, "4:4:4")
    assert fine == encode_rgb(image, "jpeg", 96, "4:4:4")


def test_zigzag_starts_as_in_the_standard() -> None:
    assert zigzag().reshape(8, 8)[:3, :4].tolist() == [[0, 1, 5, 6], [2, 4, 7, 13], [3, 8, 12, 17]]
    assert sorted(zigzag()) == list(range(64))
