"""Compute the radar cross section of smooth bodies by shooting and bouncing rays and physical optics.

Tubes of rays of a plane wave bounce through the body as at mirrors. Where one hits, the field on the surface has the
currents that a plane wave and its reflection have, and all currents radiate to the receiver, with their phases:

    sigma = 4 pi |F|^2     F = -j k / 4 pi sum A (eta N + M x s) exp(-j k (L - s . r)) sinc(g_u h / 2) sinc(g_v h / 2)

with the path length L to the hit at r, the direction s to the receiver, the area A = h^2 / cos(i) that a tube of width
h lights, the currents eta N = n x (k_i x E_i + k_r x E_r) and M = -n x (E_i + E_r), and the gradients g of the phase
across the tube: exact on planes after any number of bounces, whatever the width of the tubes.

Source: H. Ling, R. Chou, S. Lee, "Shooting and bouncing rays: calculating the RCS of an arbitrarily shaped cavity",
IEEE Trans. Antennas Propag. 37(2), 1989; C. Balanis, Advanced Engineering Electromagnetics, 2nd ed., section 6.8
(radiation of surface currents).
"""

from dataclasses import dataclass, fields
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.errors import InputError
from mmw.physics.em.surface_response import SurfaceResponse
from mmw.physics.materials.permittivity import relative_permittivity
from mmw.scene.scene import Scene
from mmw.sensors.radar.cross_section import directions, middle_and_half

MAX_TUBES = 2**24
"""Tubes that one direction may have: some ten seconds on a CPU. Design value."""

PORTION = 2**19
"""Tubes that are traced at a time. Design value."""

LIFT_M = 1e-5
"""Distance from a surface at which a ray begins again [m]. Design value: more than the rounding of single precision in
bodies of 50 m, and 1/400 of the wavelength at 76.5 GHz."""

MIN_COSINE = 1e-3
"""Cosine of incidence that grazing rays are raised to. Design value."""


def smooth_cross_section(
    scene: Scene,
    azimuth_rad: ArrayLike,
    *,
    elevation_rad: float = 0.0,
    bistatic_rad: float = 0.0,
    carrier_hz: float = 76.5e9,
    polarization: Literal["V", "H"] = "V",
    max_bounces: int = 3,
    tubes_per_wavelength: float = 8.0,
) -> np.ndarray:
    """Return the cross section of the static world as if it were smooth [m2], shape [N].

    All echoes add up with their phases, so this is for calibration targets: spheres, plates, corner reflectors, and
    fine meshes. A facet is a plane: where a mesh stands for a curved body, its facets must be so small that they miss
    it by less than 1/16 of a wavelength. Waves through materials and around edges are left out, roughness, and the
    shadow, which is the strongest echo where the receiver stands behind the body: angles up to 120 degrees are sound.

    Args:
        scene: What is seen; actors of a recording are not.
        azimuth_rad: Directions from the body to the transmitter, counted from x toward y [rad], shape [N].
        elevation_rad: Angle of these directions and those to the receiver above the horizon [rad].
        bistatic_rad: Angle by which the azimuth of the receiver is larger [rad]; 0 for a radar, which is both.
        carrier_hz: Carrier [Hz].
        polarization: Of both ends.
        max_bounces: Hits of a ray that echo: 1 for convex bodies, 3 for corners of three planes.
        tubes_per_wavelength: Tubes along a wavelength of the plane across the rays; edges are rounded to a tube.

    Raises:
        InputError: If the scene has no static mesh, a material has no permittivity at the carrier, an argument is out
            of range, or a direction would need more than 2^24 tubes.

    Examples:
        >>> import mmw
        >>> from mmw.core.resources import assets_dir
        >>> drone = mmw.load_scene(assets_dir() / "drones/quadrotor/quadrotor.usda", device="cpu")
        >>> mmw.sensors.smooth_cross_section(drone, [0.0, 1.57], carrier_hz=10e9).shape
        (2,)
    """
    sent = directions("smooth_cross_section", azimuth_rad, elevation_rad)
    heard = directions("smooth_cross_section", np.add(azimuth_rad, bistatic_rad), elevation_rad)
    if polarization not in ("V", "H") or max_bounces < 1 or not tubes_per_wavelength > 0.0:
        raise InputError(
            f"smooth_cross_section: polarization = {polarization!r}, max_bounces = {max_bounces}, tubes_per_wavelength "
            f"= {tubes_per_wavelength:g}; V or H, at least 1, and more than 0 are needed; correct it"
        )
    middle, half = middle_and_half(scene)
    width, materials = SPEED_OF_LIGHT / carrier_hz / tubes_per_wavelength, scene.materials_by_id()
    radios = [material.seen_by_radar for material in materials]
    permittivity = [
        relative_permittivity(radio, carrier_hz, one.name) for radio, one in zip(radios, materials, strict=True)
    ]
    response = SurfaceResponse(radios, np.array(permittivity), carrier_hz)
    found = []
    for toward, toward_receiver in zip(sent, heard, strict=True):
        axes = _polarizations(toward)
        receiver = _Receiver(
            toward_receiver, _polarizations(toward_receiver)["HV".index(polarization)], bistatic_rad != 0.0
        )
        counts = np.ceil(2.0 * (np.abs(axes) @ half) / width).astype(np.int64) + 1
        total = int(counts.prod())
        if total > MAX_TUBES:
            raise InputError(
                f"smooth_cross_section: {counts[0]} x {counts[1]} tubes of {1e3 * width:.3g} mm; at most {MAX_TUBES} "
                "are possible; lower carrier_hz or tubes_per_wavelength, or load a smaller body"
            )
        start = middle + 1.1 * np.linalg.norm(half) * toward
        far = 0j
        for first in range(0, total, PORTION):
            cells = np.arange(first, min(first + PORTION, total))
            steps = np.stack([cells % counts[0], cells // counts[0]], axis=1) - (counts - 1) / 2.0
            tubes = _Tubes.of_plane_wave(start + width * steps @ axes, axes, polarization)
            far += _echo(scene, response, tubes, start, receiver, carrier_hz, width, max_bounces)
        found.append(4.0 * np.pi * abs(far) ** 2)
    return np.array(found)


def _polarizations(toward: np.ndarray) -> np.ndarray:
    """Return the unit vectors of H and V across a direction, shape [2, 3]."""
    across = np.cross([0.0, 0.0, 1.0], toward)
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(toward, across)])


@dataclass(frozen=True)
class _Receiver:
    """A receiver far away."""

    toward: np.ndarray
    """Unit vector from the body, shape [3]."""
    polarization: np.ndarray
    """Unit vector, shape [3]."""
    is_apart: bool
    """Whether it is elsewhere than the transmitter, so that it may not see what is lit."""


@dataclass
class _Tubes:
    """Tubes of rays on their way, N rows."""

    position: np.ndarray
    """Places that they have reached [m], shape [N, 3]."""
    direction: np.ndarray
    """Unit vectors, shape [N, 3]."""
    field: np.ndarray
    """Electric field of 1 V/m at the start, shape [N, 3], complex128."""
    sides: np.ndarray
    """Unit vectors along the sides of their square cross section, shape [N, 2, 3]."""
    length: np.ndarray
    """Path from the start [m], shape [N]."""

    @classmethod
    def of_plane_wave(cls, position: np.ndarray, axes: np.ndarray, polarization: str) -> "_Tubes":
        count = len(position)
        field = np.broadcast_to(axes["HV".index(polarization)], (count, 3)).astype(np.complex128)
        toward = np.cross(axes[0], axes[1])
        return cls(
            position, np.broadcast_to(-toward, (count, 3)), field, np.broadcast_to(axes, (count, 2, 3)), np.zeros(count)
        )

    def take(self, rows: np.ndarray) -> "_Tubes":
        return _Tubes(*(getattr(self, one.name)[rows] for one in fields(self)))


def _echo(
    scene: Scene, response: SurfaceResponse, tubes: _Tubes, start: np.ndarray, receiver: _Receiver, carrier_hz: float,
    width: float, max_bounces: int,
) -> complex:  # fmt: skip
    """Return the far field of all tubes at a receiver, over exp(-j k r) / r [m]."""
    toward, received = receiver.toward, receiver.polarization
    wave_number = 2.0 * np.pi * carrier_hz / SPEED_OF_LIGHT
    far = 0j
    for bounce in range(max_bounces):
        hits = scene.cast_rays(tubes.position, tubes.direction)
        rows = np.flatnonzero(hits.object_id >= 0)
        if not len(rows):
            break
        tubes, normal = tubes.take(rows), hits.normal[rows].astype(np.float64)
        distance = hits.distance[rows].astype(np.float64)
        point = tubes.position + distance[:, None] * tubes.direction
        cosine = np.maximum(-np.einsum("ij,ij->i", tubes.direction, normal), MIN_COSINE)
        mirrored = tubes.direction + 2.0 * cosine[:, None] * normal
        back = _reflected(response, hits.material_id[rows], tubes, normal, cosine, mirrored)
        # A wave of field E along k has eta H = k x E.
        electric = np.cross(normal, np.cross(tubes.direction, tubes.field) + np.cross(mirrored, back))
        magnetic = -np.cross(normal, tubes.field + back)
        seen = electric @ received + np.cross(magnetic, toward) @ received
        phase = wave_number * (tubes.length + distance - (point - start) @ toward)
        slopes = wave_number * _phase_slopes(tubes, normal, cosine, toward)
        shape = np.sinc(slopes * width / (2.0 * np.pi)).prod(axis=1)
        echo = seen * shape * np.exp(-1j * phase) * width**2 / cosine
        lifted = point + LIFT_M * normal
        if bounce or receiver.is_apart:
            faces = normal @ toward > 0.0
            faces[faces] = scene.cast_rays(lifted[faces], toward).object_id < 0
            echo *= faces
        far += -1j * wave_number / (4.0 * np.pi) * echo.sum()
        turn = tubes.sides + 2.0 * np.einsum("ijk,ik->ij", -tubes.sides, normal)[..., None] * normal[:, None]
        tubes = _Tubes(lifted, mirrored, back, turn, tubes.length + distance)
    return far


def _reflected(
    response: SurfaceResponse, material: np.ndarray, tubes: _Tubes, normal: np.ndarray, cosine: np.ndarray,
    mirrored: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Return the field that a surface reflects, shape [N, 3], complex128."""
    across = np.cross(tubes.direction, normal)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    # At normal incidence any axis across the ray is TE.
    te = np.where(length > 1e-9, across / np.maximum(length, 1e-9), tubes.sides[:, 0])
    r_te, r_tm = response.reflection(material.astype(np.int64), cosine)
    part_te = np.einsum("ij,ij->i", tubes.field, te)
    part_tm = np.einsum("ij,ij->i", tubes.field, np.cross(tubes.direction, te))
    return (r_te * part_te)[:, None] * te + (r_tm * part_tm)[:, None] * np.cross(mirrored, te)


def _phase_slopes(tubes: _Tubes, normal: np.ndarray, cosine: np.ndarray, toward: np.ndarray) -> np.ndarray:
    """Return the growth of path length to the surface and back along both sides of the tubes [-], shape [N, 2]."""
    lean = np.einsum("ijk,ik->ij", tubes.sides, normal) / cosine[:, None]
    slide = tubes.sides + lean[..., None] * tubes.direction[:, None]  # on the surface, for a step along a side
    return np.einsum("ijk,ik->ij", slide, tubes.direction - toward)
