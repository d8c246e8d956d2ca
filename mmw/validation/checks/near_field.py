"""Compare waves over wide arrays with the far-field limit of the books and with a trace of every pair of elements."""

from typing import Any

import numpy as np

import mmw
from mmw.channel import PlanarArray, apply_arrays, ula
from mmw.channel.path_table import CarrierPaths
from mmw.channel.scene_paths import Paths
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.dataset.beams import plain_paths
from mmw.validation.check import Check, Measurement, Reference, Source

FS1037 = Source(
    "Federal Standard 1037C, Glossary of telecommunication terms", "far-field region, note 1",
    "https://www.its.bldrdoc.gov/fs-1037/dir-015/_2167.htm", "document",
)  # fmt: skip
KNOTT = Source(
    "Fraunhofer distance, after Knott, Radar Cross Section, 2nd edition", "first paragraph: 22.5 degrees",
    "https://en.wikipedia.org/wiki/Fraunhofer_distance", "citation",
)  # fmt: skip
BALANIS = Source(
    "Balanis, Antenna Theory", "section 4.7, images: a flat surface reflects as its image radiates",
    "https://en.wikipedia.org/wiki/Method_of_image_charges", "citation",
)  # fmt: skip

CARRIER_HZ = 28e9
APERTURE = 127.5
"""Aperture of 1 x 256 elements [wavelengths]."""
BASE = (13.5, -29.5, 10.0)
"""Place of the wide array in town03 [m]."""
RECEIVERS = ((9.5, -29.5, 7.0), (-2.0, -17.0, 1.5), (-2.0, 45.0, 1.5))
"""Places of the receivers, 5, 22 and 77 m away [m]."""


def _sight(distance: np.ndarray) -> CarrierPaths:
    """Return lines of sight along x, without transmit power."""
    count, zeros = len(distance), np.zeros(len(distance))
    transfer = np.tile([1.0, 0, 0, 0, 0, 0, 1.0, 0], (count, 1))
    angles = np.column_stack([zeros, zeros + np.pi / 2, zeros + np.pi, zeros + np.pi / 2])
    return plain_paths(CARRIER_HZ, count, np.arange(count), distance / SPEED_OF_LIGHT, transfer, angles)


def _fraunhofer(device: str) -> Measurement:
    array, single = ula(256, pattern="iso"), PlanarArray(pattern="iso")
    limit = 2.0 * array.aperture_m(CARRIER_HZ) ** 2 * CARRIER_HZ / SPEED_OF_LIGHT
    paths = _sight(np.array([limit]))
    plane, spherical = (
        apply_arrays(paths, array, single, CARRIER_HZ, wavefront=kind)[0, 0] for kind in ("plane", "spherical")
    )
    error = float(np.degrees(np.abs(np.angle(spherical / plane)).max()))
    return Measurement(error, f"2 D^2 / lambda = {limit:.0f} m for 1 x 256 at 28 GHz")


def _traced(device: str) -> Measurement:
    wide = PlanarArray(1, 9, horizontal_spacing=APERTURE / 8, pattern="iso")
    narrow = PlanarArray(1, 3, horizontal_spacing=3.75, pattern="iso")
    scene = mmw.load_scene("town03", device=device)
    scene.add(mmw.Transmitter("base", position=BASE, array=wide))
    for number, place in enumerate(RECEIVERS):
        scene.add(mmw.Receiver(f"user_{number}", position=place, array=narrow))
    center, traced = (
        mmw.PathSolver(max_depth=3, samples_per_tx=100_000, synthetic_array=kind)(scene, carriers_hz=[CARRIER_HZ])
        for kind in (True, False)
    )
    errors = {kind: phase_errors(center, traced, wide, narrow, kind) for kind in ("spherical", "plane")}
    everywhere = np.nanmax(phase_errors(center, traced, wide, narrow, "spherical", same_planes=False))
    found = np.isfinite(errors["spherical"])
    length = SPEED_OF_LIGHT * center.tau[found]
    depth = center.depth[found]

    def draw(axes: Any) -> None:
        for kind, marker in (("plane", "x"), ("spherical", "o")):
            axes.semilogy(length, np.maximum(errors[kind][found], 1e-8), marker, label=kind)
        axes.axhline(1e-6, color="gray", linestyle="--")
        axes.set_xlabel("length of the path [m]")
        axes.set_ylabel("largest phase error [rad]")
        axes.legend()

    text = (
        f"{found.sum()} paths of {depth.min()} to {depth.max()} reflections, {length.min():.0f} to {length.max():.0f} "
        f"m; plane waves: {errors['plane'][found].max():.1f} rad; where elements meet other triangles of a wall, which "
        f"vertices of float32 tilt by 2e-6 rad: {everywhere:.1g} rad"
    )
    return Measurement(float(errors["spherical"][found].max()), text, draw)


def phase_errors(
    center: Paths, traced: Paths, tx: PlanarArray, rx: PlanarArray, wavefront: Any, *, same_planes: bool = True
) -> np.ndarray:
    """Return the largest phase error of each path between phase centers against traces of elements [rad], shape [P].

    Phases are relative to that of the phase centers. NaN where no pair of elements has the path.

    Args:
        center: Paths between the phase centers of level devices, at one carrier.
        traced: Paths between all elements.
        tx: Array of the transmitters.
        rx: Array of the receivers.
        wavefront: Waves, see `mmw.channel.apply_arrays`.
        same_planes: Only pairs of elements whose path meets triangles of the same planes.
    """
    at, single = center.at_carrier(), PlanarArray(pattern="iso")
    response = apply_arrays(at, tx, rx, at.carrier_hz, wavefront=wavefront)
    response = response / apply_arrays(at, single, single, at.carrier_hz)
    out = np.full(len(center), np.nan)
    for row, path in enumerate(at.row):
        own = np.flatnonzero((traced.path_ids == center.path_ids[path]) & (traced.rx == center.rx[path]))
        if same_planes:
            normal = center.normals[path, : center.depth[path]]
            off = ((traced.vertices[own] - center.vertices[path])[:, : len(normal)] * normal).sum(axis=2)
            turned = traced.normals[own][:, : len(normal)] - normal
            own = own[(np.abs(off) < 1e-10).all(axis=1) & (np.abs(turned) < 1e-12).all(axis=(1, 2))]
        if len(own):
            turn = np.exp(2j * np.pi * at.carrier_hz * (traced.tau[own] - center.tau[path]))
            phase = np.angle(response[row, traced.rx_element[own], traced.tx_element[own]] * turn)
            out[path] = np.abs(phase).max()
    return out


CHECKS = (
    Check(
        name="near_field.fraunhofer",
        title="Phase error of a plane wave over 1 x 256 at the far-field distance",
        computed="largest phase between plane and spherical waves of `apply_arrays` ahead of the array, 2 D^2 / lambda "
        "away",
        unit="deg",
        reference=Reference.plus_minus(22.5, 0.1),
        tolerance="the definition is exact but for terms of higher order, 1e-5 here",
        sources=(FS1037, KNOTT),
        measure=_fraunhofer,
    ),
    Check(
        name="near_field.reflections",
        title="Phase of spherical waves over 1 x 256 after up to three reflections",
        computed="`apply_arrays` of paths between phase centers in town03 against a trace of every pair of elements, 9 "
        "in the aperture of 1 x 256 and 3 in that of 1 x 16, at 28 GHz; largest difference where both meet one plane",
        unit="rad",
        reference=Reference(0.0, 0.0, 1e-6),
        tolerance="cosines are float32, right to 3e-7",
        sources=(BALANIS,),
        measure=_traced,
    ),
)  # fmt: skip
"""Rows of this topic."""
