"""Preview pictures of a scene: from above or from an eye, coloured by material. For people, not a sensor."""

from collections.abc import Sequence

import numpy as np
import warp as wp
from PIL import Image

from mmw.kernels import preview
from mmw.scene import Scene

SUN = (0.45, 0.35, 0.82)
"""Direction of the sun, roughly south-east at 55 deg; not normalised."""

HAZE_M = 2500.0
"""Distance over which the air takes 63 % of the contrast of a picture [m]: a clear day, a little thickened; design
value. Maps have none."""

MIRROR = {"clear_glass": 0.12, "one_way_mirror": 0.35, "mirror": 0.9}
"""Non-visual base -> reflectance at normal incidence in pictures [-]; design values, other materials are matt. A window
mirrors more than its first surface (4 %), because the room behind it is dark."""


def look(
    scene: Scene,
    weather: str,
    eye: Sequence[float],
    target: Sequence[float],
    *,
    fov_deg: float = 70.0,
    width: int = 1280,
    height: int = 720,
    samples: int = 2,
    slot: int = 0,
) -> Image.Image:
    """Return a pinhole picture of the scene.

    Args:
        scene: Scene with a batch loaded.
        weather: Weather whose colours are used.
        eye: Position in the world [m].
        target: Point that is in the middle of the picture [m]; not straight above or below the eye.
        fov_deg: Horizontal field of view [deg].
        width: Image width [px].
        height: Image height [px].
        samples: Rays a pixel in each direction.
        slot: Slot of the frame.
    """
    eye_w, forward = np.asarray(eye, float), np.asarray(target, float) - np.asarray(eye, float)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    pixel = 2.0 * np.tan(np.radians(fov_deg) / 2.0) / width
    lens = _lens(scene, eye_w, forward, right * pixel, np.cross(forward, right) * pixel, is_parallel=False)
    return _render(scene, weather, lens, width, height, samples, slot)


def map_view(
    scene: Scene,
    weather: str,
    center: Sequence[float],
    size_m: float,
    *,
    width: int = 1280,
    samples: int = 2,
    slot: int = 0,
) -> Image.Image:
    """Return a square map: the scene from straight above, north up.

    Args:
        scene: Scene with a batch loaded.
        weather: Weather whose colours are used.
        center: x and y of the middle, world frame [m].
        size_m: Side of the map [m].
        width: Side of the image [px].
        samples: Rays a pixel in each direction.
        slot: Slot of the frame.
    """
    eye = np.array([center[0], center[1], 300.0])
    pixel = size_m / width
    lens = _lens(scene, eye, (0, 0, -1), (pixel, 0, 0), (0, -pixel, 0), is_parallel=True)
    return _render(scene, weather, lens, width, width, samples, slot)


def _lens(
    scene: Scene,
    eye: np.ndarray,
    forward: Sequence[float],
    right: Sequence[float],
    down: Sequence[float],
    *,
    is_parallel: bool,
) -> preview.Lens:
    lens = preview.Lens()
    lens.eye = wp.vec3(*(eye - scene.origin))
    lens.forward, lens.right, lens.down = wp.vec3(*forward), wp.vec3(*right), wp.vec3(*down)
    lens.is_parallel = is_parallel
    lens.t_max = 5000.0
    return lens


def _render(
    scene: Scene, weather: str, lens: preview.Lens, width: int, height: int, samples: int, slot: int
) -> Image.Image:
    materials = scene.arrays.materials[weather]
    light = preview.Light()
    light.sun = wp.normalize(wp.vec3(*SUN))
    light.haze_m = HAZE_M if not lens.is_parallel else 1.0e9
    color = np.array([material.color for material in materials], dtype=np.float32)
    light.color = wp.array(color, dtype=wp.vec3, device=scene.device)
    mirror = np.array([MIRROR.get(material.nonvisual_base, 0.0) for material in materials], dtype=np.float32)
    light.mirror = wp.array(mirror, dtype=float, device=scene.device)
    image = wp.empty((height, width), dtype=wp.vec3, device=scene.device)
    wp.launch(
        preview.preview_kernel,
        dim=(height, width),
        inputs=[scene.struct, slot, lens, light, samples],
        outputs=[image],
        device=scene.device,
        block_dim=64,
    )
    return Image.fromarray(to_srgb(image.numpy()))


def to_srgb(linear: np.ndarray) -> np.ndarray:
    """Return linear colour as 8-bit sRGB, values above 1 clipped.

    Source: IEC 61966-2-1.
    """
    value = np.clip(linear, 0.0, 1.0)
    encoded = np.where(value <= 0.0031308, 12.92 * value, 1.055 * np.power(value, 1.0 / 2.4) - 0.055)
    return np.rint(encoded * 255.0).astype(np.uint8)
