"""Filtering of textures on the device: texel places, wraps, mip levels, long footprints, color spaces."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp
from PIL import Image

from mmw.kernels.shading.structs import AppearanceTable
from mmw.kernels.shading.texture import MAX_TAPS, sample_texture
from mmw.physics.materials.appearance import Appearance, TextureUse
from mmw.physics.materials.material import Material, RadioMaterial
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData
from mmw.sensors.render.appearance_buffers import AppearanceArrays
from mmw.usd.textures import area_shrink, decode_image, mip_levels
from tests.fixtures.kernels import launched

RADIO = RadioMaterial("constant")


@wp.kernel
def sample_kernel(
    appearance: AppearanceTable,
    use: int,
    st: wp.array[wp.vec2],
    ds: wp.array[wp.vec2],
    dt: wp.array[wp.vec2],
    value_out: wp.array[wp.vec4],
):
    """Sample a texture. Launch: dim=N."""
    i = wp.tid()
    value_out[i] = sample_texture(appearance, use, st[i], ds[i], dt[i], MAX_TAPS)


def arrays_with(*appearances: Appearance) -> SceneData:
    """One triangle, and a material for each appearance."""
    points, faces = np.eye(3), np.array([[0, 1, 2]], dtype=np.int32)
    zero = np.zeros(1, dtype=np.int32)
    materials = tuple(
        Material(f"m{k}", RADIO, "none", 0.3, entry.color, appearance=entry) for k, entry in enumerate(appearances)
    )
    return SceneData(points, faces, zero, zero, zero, (), (), range(1), np.zeros((1, 0, 7)), {"sunny": materials})


def sample(device: str, use: TextureUse, st, ds=(0.0, 0.0), dt=(0.0, 0.0)) -> np.ndarray:
    """Values of a texture at coordinates [N, 2] for a footprint, [N, 4]."""
    appearance = AppearanceArrays(
        DeviceScene(arrays_with(Appearance(color_texture=use)), device, 1), debug=False
    ).for_weather("sunny")
    st = np.asarray(st, dtype=np.float32).reshape(-1, 2)
    spread = [np.broadcast_to(np.asarray(v, dtype=np.float32), st.shape) for v in (ds, dt)]
    return launched(sample_kernel, len(st), [appearance, 0, st, *spread], device)[0]


def write(path: Path, codes: np.ndarray) -> str:
    Image.fromarray(np.asarray(codes, dtype=np.uint8)).save(path)
    return str(path)


def noise_image(path: Path, height: int, width: int) -> tuple[str, np.ndarray]:
    """Write a random image; return its path and its values, rows upward, [H, W, 3]."""
    codes = np.random.default_rng(7).integers(0, 256, (height, width, 3))
    return write(path, codes), codes[::-1] / 255.0


def test_texel_centres_and_rows_upward(device: str, tmp_path: Path) -> None:
    file, values = noise_image(tmp_path / "a.png", 5, 7)
    u, v = np.meshgrid((np.arange(7) + 0.5) / 7, (np.arange(5) + 0.5) / 5)
    found = sample(device, TextureUse(file), np.stack([u.ravel(), v.ravel()], axis=1))
    np.testing.assert_allclose(found[:, :3], values.reshape(-1, 3), atol=1e-3)
    np.testing.assert_array_equal(found[:, 3], 1.0)


def test_between_texels_is_linear(device: str, tmp_path: Path) -> None:
    file, values = noise_image(tmp_path / "a.png", 4, 4)
    found = sample(device, TextureUse(file), [(0.25, 0.125), (0.25, 0.25)])
    np.testing.assert_allclose(found[0, :3], values[0, :2].mean(axis=0), atol=1e-3)
    np.testing.assert_allclose(found[1, :3], values[:2, :2].mean(axis=(0, 1)), atol=1e-3)


@pytest.mark.parametrize(
    ("wrap", "inside"),
    [
        ("repeat", lambda k: k % 4),
        ("mirror", lambda k: np.where(k % 8 < 4, k % 8, 7 - k % 8)),
        ("clamp", lambda k: np.clip(k, 0, 3)),
        ("black", lambda k: np.where((k >= 0) & (k < 4), k, -1)),
    ],
)
def test_wraps(device: str, tmp_path: Path, wrap, inside) -> None:
    file, values = noise_image(tmp_path / "a.png", 4, 4)
    k = np.arange(-11, 15)
    at = (k + 0.5) / 4
    along_u = sample(device, TextureUse(file, wrap=(wrap, "clamp")), np.stack([at, np.full_like(at, 0.125)], axis=1))
    along_v = sample(device, TextureUse(file, wrap=("clamp", wrap)), np.stack([np.full_like(at, 0.125), at], axis=1))
    row = inside(k)
    seen = row >= 0
    np.testing.assert_allclose(along_u[:, :3], np.where(seen[:, None], values[0, row], 0.0), atol=1e-3)
    np.testing.assert_allclose(along_v[:, :3], np.where(seen[:, None], values[row, 0], 0.0), atol=1e-3)


def test_repeat_blends_over_the_seam(device: str, tmp_path: Path) -> None:
    file, values = noise_image(tmp_path / "a.png", 4, 4)
    found = sample(device, TextureUse(file), [(0.0, 0.125), (1.0, 0.125), (-250.0, 0.125)])
    np.testing.assert_allclose(found[:, :3], np.tile(0.5 * (values[0, 0] + values[0, 3]), (3, 1)), atol=1e-3)


def test_srgb_of_iec_61966(device: str, tmp_path: Path) -> None:
    """Against values of the standard's transfer function, computed with 50 digits."""
    codes = [0, 1, 10, 11, 128, 188, 255]
    linear = [0.0, 3.035269835488375e-4, 3.035269835488375e-3, 3.346535763899161e-3, 0.21586050011389926,
              0.5028864580325687, 1.0]  # fmt: skip
    file = write(tmp_path / "a.png", np.repeat(np.array(codes)[None, :, None], 3, axis=2))
    st = [((k + 0.5) / len(codes), 0.5) for k in range(len(codes))]
    found = sample(device, TextureUse(file, is_srgb=True), st)
    np.testing.assert_allclose(found[:, 0], linear, rtol=5e-4, atol=1e-7)
    np.testing.assert_allclose(decode_image(file, True, "").values[0, :, 1], linear, rtol=1e-6)
    raw = sample(device, TextureUse(file, is_srgb=False), st)
    np.testing.assert_allclose(raw[:, 0], np.array(codes) / 255.0, rtol=5e-4, atol=1e-7)


def test_auto_is_srgb_for_colours_of_8_bits(tmp_path: Path) -> None:
    grey = np.full((2, 2), 128)
    assert decode_image(write(tmp_path / "rgb.png", np.dstack([grey] * 3)), None, "").values[0, 0, 0] == pytest.approx(
        0.2159, abs=1e-4
    )
    assert decode_image(write(tmp_path / "l.png", grey), None, "").values[0, 0, 0] == pytest.approx(128 / 255)
    Image.fromarray(np.full((2, 2), 0x8000, dtype=np.uint16)).save(tmp_path / "l16.png")
    for is_srgb in (None, True):
        assert decode_image(str(tmp_path / "l16.png"), is_srgb, "").values[0, 0, 0] == pytest.approx(0x8000 / 65535)


@pytest.mark.parametrize("largest", [2048, 20])
def test_palettes_are_their_colours(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, largest: int) -> None:
    monkeypatch.setattr("mmw.usd.textures.LARGEST_PX", largest)
    codes = np.random.default_rng(5).integers(0, 9, (21, 35), dtype=np.uint8)
    image = Image.fromarray(codes, mode="P")
    image.putpalette(np.random.default_rng(6).integers(0, 256, (9, 3), dtype=np.uint8).tobytes())
    image.save(tmp_path / "opaque.png")
    image.save(tmp_path / "clear.png", transparency=bytes([0, 40, 80]))
    for name, mode in (("opaque", "RGB"), ("clear", "RGBA")):
        Image.open(tmp_path / f"{name}.png").convert(mode).save(tmp_path / f"{name}_plain.png")
        found, plain = (decode_image(str(tmp_path / f"{name}{end}.png"), None, "") for end in ("", "_plain"))
        np.testing.assert_array_equal(found.values, plain.values)
        np.testing.assert_array_equal(found.halves, plain.values.astype(np.float16))
        np.testing.assert_array_equal(plain.halves, found.halves)


def test_alpha_is_never_srgb(tmp_path: Path) -> None:
    file = write(tmp_path / "a.png", np.full((2, 2, 4), 128))
    np.testing.assert_allclose(decode_image(file, True, "").values[0, 0], [0.21586] * 3 + [128 / 255], atol=1e-5)


@pytest.mark.parametrize(("height", "width"), [(64, 64), (37, 50), (1, 9), (13, 1)])
def test_levels_keep_the_mean(height: int, width: int) -> None:
    values = np.random.default_rng(3).random((height, width, 4)).astype(np.float32)
    levels = mip_levels(values)
    assert levels[-1].shape == (1, 1, 4)
    for k, level in enumerate(levels):
        assert level.shape == (max(height >> k, 1), max(width >> k, 1), 4)
        np.testing.assert_allclose(level.mean(axis=(0, 1)), values.mean(axis=(0, 1)), rtol=1e-5)


def test_area_shrink_against_brute_force() -> None:
    values = np.random.default_rng(4).random(35)
    np.testing.assert_allclose(area_shrink(values, 14), np.repeat(values, 14).reshape(14, 35).mean(axis=1), rtol=1e-12)


def test_wide_footprint_reads_the_mean(device: str, tmp_path: Path) -> None:
    file, values = noise_image(tmp_path / "a.png", 37, 50)
    found = sample(device, TextureUse(file), [(0.3, 0.4), (7.9, -3.1)], (2.0, 0.0), (0.0, 2.0))
    np.testing.assert_allclose(found[:, :3], np.tile(values.mean(axis=(0, 1)), (2, 1)), atol=1e-3)


def test_footprint_of_a_level_reads_its_texels(device: str, tmp_path: Path) -> None:
    """A footprint of 4 x 4 texels at the middle of such a block is the block's mean, wherever the axes point."""
    file, values = noise_image(tmp_path / "a.png", 32, 32)
    blocks = values.reshape(8, 4, 8, 4, 3).mean(axis=(1, 3))
    at = (np.arange(8) + 0.5) / 8
    st = np.stack([g.ravel() for g in np.meshgrid(at, at)], axis=1)
    for angle in (0.0, 0.4, 2.0):
        side = np.array([np.cos(angle), np.sin(angle)]) * 4 / 32
        found = sample(device, TextureUse(file), st, side, (-side[1], side[0]))
        np.testing.assert_allclose(found[:, :3], blocks.reshape(-1, 3), atol=2e-3)


def test_long_footprint_keeps_lines_along_it(device: str, tmp_path: Path) -> None:
    """Stripes of 2 texels along u, seen with a footprint 4 texels long along u: sharp; across them: the mean."""
    rows = np.where(np.arange(64) % 4 < 2, 255, 0)
    file = write(tmp_path / "a.png", np.repeat(np.repeat(rows[:, None], 64, axis=1)[..., None], 3, axis=2))
    st = [(0.4, (k + 0.5) / 64) for k in range(64)]
    along = sample(device, TextureUse(file), st, (4 / 64, 0.0), (0.0, 1 / 64))
    across = sample(device, TextureUse(file), st, (0.0, 4 / 64), (1 / 64, 0.0))
    np.testing.assert_allclose(along[:, 0], rows[::-1] / 255.0, atol=1e-3)
    np.testing.assert_allclose(across[:, 0], 0.5, atol=0.01)


def test_grazing_view_neither_shimmers_nor_smears(device: str, tmp_path: Path) -> None:
    """Footprints 1:4 on noise: as contrasty as their exact area means (no smear), and close to them (no shimmer)."""
    file, values = noise_image(tmp_path / "a.png", 128, 128)
    rng = np.random.default_rng(5)
    st = rng.random((400, 2))
    found = sample(device, TextureUse(file), st, (2 / 128, 0.0), (0.0, 8 / 128))[:, 0]
    fine = np.repeat(np.repeat(values[..., 0], 4, axis=0), 4, axis=1)
    corner = np.rint(st * 512).astype(int) - (4, 16)
    exact = np.array([fine[np.ix_((y + np.arange(32)) % 512, (x + np.arange(8)) % 512)].mean() for x, y in corner])
    assert np.corrcoef(found, exact)[0, 1] > 0.8
    assert 0.7 < found.std() / exact.std() < 1.3


def test_huge_and_degenerate_footprints_are_finite(device: str, tmp_path: Path) -> None:
    file, values = noise_image(tmp_path / "a.png", 16, 16)
    for ds, dt in [((1e30, 1e30), (1e30, -1e30)), ((0.0, 0.0), (1e20, 0.0)), ((1e-30, 0.0), (0.0, 1e-30))]:
        found = sample(device, TextureUse(file), [(0.2, 0.7)], ds, dt)
        assert np.isfinite(found).all()
        assert (found >= -1e-6).all() and (found <= 1.0 + 1e-6).all()
    np.testing.assert_allclose(
        sample(device, TextureUse(file), [(0.2, 0.7)], (1e30, 0), (0, 1e30))[0, :3], values.mean(axis=(0, 1)), atol=1e-3
    )


def test_scale_bias_and_coordinates(device: str, tmp_path: Path) -> None:
    file, values = noise_image(tmp_path / "a.png", 8, 8)
    use = TextureUse(
        file, scale=(2.0, 1.0, 0.5, 1.0), bias=(-1.0, 0.25, 0.0, 0.0), row_u=(0.0, -1.0, 1.0), row_v=(0.5, 0.0, 0.0)
    )
    st = np.random.default_rng(1).integers(0, 8, (20, 2))
    u, v = 7 - st[:, 1], st[:, 0]  # u = 1 - t, v = s / 2 at texel centers
    found = sample(device, use, np.stack([(st[:, 0] + 0.5) / 4, (st[:, 1] + 0.5) / 8], axis=1))
    np.testing.assert_allclose(found[:, :3], values[v, u] * [2.0, 1.0, 0.5] + [-1.0, 0.25, 0.0], atol=2e-3)


def test_textures_are_stored_once(device: str, tmp_path: Path) -> None:
    file, _ = noise_image(tmp_path / "a.png", 16, 16)
    copy = tmp_path / "copy.png"
    copy.write_bytes(Path(file).read_bytes())
    uses = [TextureUse(file), TextureUse(file, wrap=("clamp", "clamp")), TextureUse(str(copy))]
    scene = DeviceScene(arrays_with(*(Appearance(color_texture=use) for use in uses)), device, 1)
    appearance = AppearanceArrays(scene).for_weather("sunny")
    assert len(appearance.textures) == 1
    assert len(appearance.uses) == 3
    assert len(appearance.texels) == 16 * 16 + 8 * 8 + 4 * 4 + 2 * 2 + 1


def test_missing_texture(device: str, tmp_path: Path) -> None:
    use = TextureUse(str(tmp_path / "none.png"))
    appearances = [
        Appearance(color=(0.1, 0.2, 0.3), color_texture=use, prim_path="/M/a"),
        Appearance(color_texture=use, prim_path="/M/b"),
    ]
    scene = DeviceScene(arrays_with(*appearances), device, 1)
    plain = AppearanceArrays(scene)
    (note,) = plain.notes
    assert "/M/a" in note and "none.png" in note and "not there" in note
    appearances_of = plain.for_weather("sunny").appearances.numpy()
    assert appearances_of[0]["color_texture"] == -1
    np.testing.assert_allclose(appearances_of[0]["color"], [0.1, 0.2, 0.3], rtol=1e-6)
    debug = AppearanceArrays(scene, debug=True).for_weather("sunny")
    assert debug.appearances.numpy()["color_texture"].tolist() == [0, 0]
    np.testing.assert_array_equal(debug.texels.numpy().view(np.float16)[:4], [1.0, 0.0, 1.0, 1.0])


@pytest.mark.parametrize("suffix", ["exr", "hdr"])
def test_formats_that_are_not_read_are_named(device: str, tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"sky.{suffix}").write_bytes(b"v/1\x01")
    appearance = Appearance(color_texture=TextureUse(str(tmp_path / f"sky.{suffix}")), prim_path="/M/a")
    (note,) = AppearanceArrays(DeviceScene(arrays_with(appearance), device, 1)).notes
    assert suffix.upper() in note and "/M/a" in note


@pytest.mark.parametrize("content", [b"", b"no image", b"\x89PNG\r\n\x1a\n", None])
def test_corrupt_file_is_one_error(device: str, tmp_path: Path, content: bytes | None) -> None:
    file = tmp_path / "bad.png"
    write(file, np.random.default_rng(0).integers(0, 256, (64, 64, 3)))
    file.write_bytes(file.read_bytes()[:2000] if content is None else content)
    scene = DeviceScene(arrays_with(Appearance(color_texture=TextureUse(str(file)), prim_path="/M/a")), device, 1)
    with pytest.raises(ValueError, match=r"^/M/a: texture .*bad\.png cannot be decoded \(.*\); ") as caught:
        AppearanceArrays(scene)
    assert "\n" not in str(caught.value)


def test_huge_texture_is_made_smaller_in_linear_light(tmp_path: Path) -> None:
    codes = np.zeros((6, 4999, 3), dtype=np.uint8)
    codes[:, ::2] = 255  # half of the light; sRGB codes would average to 0.2
    image = decode_image(write(tmp_path / "wide.png", codes), True, "material /M/a")
    assert image.values.shape == (2, 2048, 4)
    assert image.values[..., :3].mean() == pytest.approx(0.5, abs=2e-3)
    assert "4999 x 6" in image.note and "2048 x 2" in image.note and "/M/a" in image.note


def test_weather_that_was_not_read(device: str) -> None:
    with pytest.raises(ValueError, match="weather 'foggy'"):
        AppearanceArrays(DeviceScene(arrays_with(Appearance()), device, 1)).for_weather("foggy")
