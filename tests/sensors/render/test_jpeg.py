"""JPEG files that Warp kernels make: byte for byte those that the CPU's encoder writes."""

import io
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from PIL import Image

from mmw.core.recorded_work import DirectWork, NewArrays
from mmw.core.transfer import to_host
from mmw.sensors.render.jpeg import code_images, fast_divisors, file_bytes, jpeg_files, read_files, zigzag
from mmw.sensors.render.row_lists import ListShares, RowLists
from mmw.storage.codecs.images import encode_rgb

SUBSAMPLING = {"4:4:4": 0, "4:2:0": 2}
"""Pillow's numbers for them."""


def pictures(height: int, width: int) -> np.ndarray:
    """Return smooth colors, noise, black and white pixels, and one color, shape [4, H, W, 3], uint8."""
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


def hard_patterns() -> np.ndarray:
    """Return black-and-white blocks whose coefficients are the largest there can be, shape [72, 16, 24, 3], uint8.

    A block has the signs of one wave of the transform along each axis; then, stripes and chessboards of several widths.
    """
    v, u = np.mgrid[0:16, 0:24]
    waves = [np.cos((2 * v + 1) * k * np.pi / 16) * np.cos((2 * u + 1) * j * np.pi / 16) for k, j in np.ndindex(8, 8)]
    blocks = [v // n + u // n for n in (1, 2, 3, 4)] + [u // n for n in (1, 3)] + [v // n for n in (1, 3)]
    is_white = np.stack([wave >= 0.0 for wave in waves] + [block % 2 == 0 for block in blocks])
    return np.repeat(255 * is_white[..., None].astype(np.uint8), 3, axis=3)


def assert_files_are_those_of_the_cpu(images: np.ndarray, quality: int, subsampling: str, device: str) -> None:
    (files,) = jpeg_files([wp.array(images, dtype=wp.uint8, device=device)], quality, subsampling)
    assert files == [encode_rgb(image, "jpeg", quality, subsampling) for image in images], quality


@pytest.mark.parametrize("subsampling", ["4:2:0", "4:4:4"])
@pytest.mark.parametrize(("height", "width"), [(48, 64), (33, 47), (24, 40), (9, 17), (1, 1), (17, 100)])
def test_files_are_those_of_the_cpu(device: str, height: int, width: int, subsampling: str) -> None:
    images = pictures(height, width)
    for quality in (1, 50, 95, 96, 100):
        assert_files_are_those_of_the_cpu(images, quality, subsampling, device)


@pytest.mark.parametrize("subsampling", ["4:2:0", "4:4:4"])
def test_files_of_every_quality_are_those_of_the_cpu(device: str, subsampling: str) -> None:
    images = pictures(17, 25)
    for quality in range(1, 101):
        assert_files_are_those_of_the_cpu(images, quality, subsampling, device)


def test_hardest_patterns_overflow_as_on_the_cpu(device: str) -> None:
    for quality in (1, 60, 95, 96):
        assert_files_are_those_of_the_cpu(hard_patterns(), quality, "4:4:4", device)


@pytest.mark.parametrize("subsampling", ["4:2:0", "4:4:4"])
def test_accurate_files_are_those_of_pillow(device: str, subsampling: str) -> None:
    images = pictures(33, 47)
    for quality in (96, 100):
        (files,) = jpeg_files([wp.array(images, dtype=wp.uint8, device=device)], quality, subsampling)
        assert files == [by_pillow(image, quality, subsampling) for image in images], quality


def test_bytes_do_not_depend_on_the_vector_instructions_of_the_cpu(tmp_path: Path) -> None:
    """libjpeg-turbo has code for each kind, and plain C; only the hardest patterns overflow otherwise in C."""
    code = (
        "import hashlib, sys, numpy; from mmw.storage.codecs.images import encode_rgb\n"
        "files = [encode_rgb(image, 'jpeg', q) for image in numpy.load(sys.argv[1]) for q in (1, 50, 95, 96)]\n"
        "print(hashlib.sha256(b''.join(files)).hexdigest())"
    )
    np.save(tmp_path / "images.npy", pictures(33, 47))
    digests = set()
    for switch in ("none", "JSIMD_FORCESSE2", "JSIMD_FORCENONE"):
        result = subprocess.run(
            [sys.executable, "-c", code, str(tmp_path / "images.npy")],
            env={**os.environ, switch: "1"}, capture_output=True, text=True, check=True,
        )  # fmt: skip
        digests.add(result.stdout.splitlines()[-1])
    assert len(digests) == 1


def test_fast_divisors_are_the_squares_of_the_papers_factors() -> None:
    divisors = fast_divisors(np.full(64, 1000, dtype=np.int32)).reshape(8, 8) / 8000.0
    axis = np.array([1.0, 1.387040, 1.306563, 1.175876, 1.0, 0.785695, 0.541196, 0.275899])
    np.testing.assert_allclose(divisors, np.outer(axis, axis), atol=1e-4)


def test_several_arrays_are_the_files_of_each(device: str) -> None:
    first = wp.array(pictures(48, 64), dtype=wp.uint8, device=device)
    second = wp.array(pictures(48, 64)[::-1].copy(), dtype=wp.uint8, device=device)
    files, turned = jpeg_files([first, second], 95, "4:2:0")
    assert files == turned[::-1] and len(set(files)) == 4
    assert jpeg_files([first[:0], second[:0]], 95, "4:2:0") == [[], []] and jpeg_files([], 95, "4:2:0") == []


@pytest.mark.parametrize("missing", [-100, 0, 1])
def test_bytes_that_were_copied_ahead_are_not_copied_again(device: str, missing: int) -> None:
    """If one is missing, all are."""
    images = [wp.array(pictures(16, 24) + np.uint8(k), dtype=wp.uint8, device=device) for k in range(2)]
    work, shares, copied = DirectWork(device), ListShares(), []
    lists = RowLists(NewArrays(device), shares, 4 * 16 * 24)
    coded = [code_images(one, 95, "4:2:0", lists) for one in images]
    spans = work.to_host([some.spans for some in coded])
    ahead = work.to_host([some.body[: file_bytes(span) - missing] for some, span in zip(coded, spans, strict=True)])
    work.to_host = lambda arrays: copied.append(len(arrays)) or to_host(arrays)
    found = [one.files() for one in read_files(coded, spans, work, ahead)]
    assert found == jpeg_files(images, 95, "4:2:0") and copied == ([2] if missing > 0 else [])


def test_zigzag_starts_as_in_the_standard() -> None:
    assert zigzag().reshape(8, 8)[:3, :4].tolist() == [[0, 1, 5, 6], [2, 4, 7, 13], [3, 8, 12, 17]]
    assert sorted(zigzag()) == list(range(64))
