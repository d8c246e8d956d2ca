"""Compare radar cross sections and ranges of detection with 3GPP TR 38.901, measurements, data sheets and theory."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from mmw.core.constants import SPEED_OF_LIGHT
from mmw.scene import Scene
from mmw.sensors import Radar, radar_cross_section, smooth_cross_section
from mmw.validation.check import Check, Measurement, Reference, Source
from mmw.validation.targets import Mesh, ball, dihedral, load_asset, load_target, plate, trihedral

TR38901 = Source(
    "3GPP TR 38.901 V19", "tables 7.9.2.1-1 and 7.9.2.1-4, as Sionna RT 2.2 has them (rt/rcs/tr38901/parameters.py)",
    "https://www.3gpp.org/dynareport/38901.htm", "other code",
)  # fmt: skip
TR38901_BISTATIC = Source(
    "3GPP TR 38.901 V19", "equation 7.9.2-2: -3 sin(beta / 2) dB, as Sionna RT 2.2 has it",
    "https://www.3gpp.org/dynareport/38901.htm", "other code",
)  # fmt: skip
JRC = Source(
    "Fortuny-Guasch and Chareau, Radar cross section measurements of pedestrian dummies and humans in the 24/77 GHz "
    "frequency bands, EUR 25762, 2013; Yamada, 2004", "mean over azimuth, as MATLAB's BackscatterHumanTarget has it",
    "https://doi.org/10.2788/80844", "other code",
)  # fmt: skip
RUCK = Source(
    "Ruck et al., Radar Cross Section Handbook, 1970", "chapter 8; physical optics, as RadarBook and others have it",
    "https://doi.org/10.1007/978-1-4899-5324-7", "other code",
)  # fmt: skip
TI_IMAGING = Source(
    "Texas Instruments TIDUEN5A, Imaging radar using cascaded mmWave sensor reference design", "key system "
    "specifications, MIMO", "https://www.ti.com/lit/ug/tiduen5a/tiduen5a.pdf", "document",
)  # fmt: skip
TI_SHORT = Source(
    "Texas Instruments TIDUD36B, Short range radar reference design using AWR1642", "features: cars and trucks up to "
    "80 m", "https://www.ti.com/lit/ug/tidud36b/tidud36b.pdf", "document",
)  # fmt: skip
TI_PEOPLE = Source(
    "Texas Instruments, answer on maximum range with the evaluation board of AWR1642", "moving people up to 30 m",
    "https://e2e.ti.com/support/sensors-group/sensors/f/sensors-forum/625168/awr1243-maximum-possible-range-with-"
    "awr1243-sensors", "document",
)  # fmt: skip

CARS = ("sedan", "hatchback", "suv")
AROUND = np.radians(np.arange(0.0, 360.0, 5.0))
LOBES = (
    (90.0, 26.90, 79.70, 44.42, 20.75, 13.68), (180.0, 36.32, 79.65, 36.73, 14.56, 7.50),
    (270.0, 26.90, 79.70, 44.42, 20.75, 13.68), (0.0, 40.54, 71.75, 29.13, 15.52, 8.45),
)  # fmt: skip
"""Left, back, right and front of a vehicle: azimuth and 3-dB width, zenith angle and 3-dB width [deg], peak [dBsm] and
range below it [dB]; TR 38.901, table 7.9.2.1-4."""

TARGET_M = 0.15
"""Edge of corner reflectors and plates, and radius of the ball [m]. Design value."""

BISTATIC_DB = -3.0
"""Growth of the mean bistatic cross section with sin(beta / 2) [dB]; TR 38.901, equation 7.9.2-2."""

SIDEWAYS_DB = BISTATIC_DB * float(np.sqrt(0.5))
"""That growth at 90 degrees [dB]."""

STEEL = {"radio": "itu_pec", "base": "steel"}
"""Material of targets that the radar's rough surfaces are of."""

DRAWS = 60
"""Detections tried at a distance: they place the range of 50 % within some percent. Design value."""


def decibels(values: Any) -> Any:
    """Return 10 log10."""
    return 10.0 * np.log10(values)


@cache
def _around(kind: str, name: str, carrier_hz: float, device: str) -> np.ndarray:
    """Return the cross section of a shipped body in the directions `AROUND` [m2], shape [N]."""
    return radar_cross_section(load_asset(kind, name, device), AROUND, carrier_hz=carrier_hz)


def _mean(kind: str, names: tuple[str, ...], carrier_hz: float, device: str) -> Measurement:
    """Return the mean over azimuth and bodies."""
    each = {name: _around(kind, name, carrier_hz, device) for name in names}
    means = [f"{name} {decibels(values.mean()):.1f}" for name, values in each.items()]
    front, left, rear = (decibels(np.mean([values[at] for values in each.values()])) for at in (0, 18, 36))
    detail = f"means {', '.join(means)} dBsm; front {front:.1f}, left {left:.1f}, rear {rear:.1f} dBsm"
    return Measurement(float(decibels(np.mean(list(each.values())))), detail)


def vehicle_pattern(azimuth_deg: np.ndarray) -> np.ndarray:
    """Return 10 lg(sigma_M sigma_D) of 3GPP's vehicle seen level [dBsm], shape of `azimuth_deg`.

    Source: TR 38.901, 7.9.2.1: G_max - min(min(12 (dphi / w)^2, s) + min(12 (dtheta / v)^2, s), s) of the lobe around.
    """
    side = (np.floor((azimuth_deg + 45.0) / 90.0).astype(int) - 1) % 4  # front is the last row
    center, width, zenith, height, peak, depth = np.array(LOBES)[side].T
    off = (azimuth_deg - center + 180.0) % 360.0 - 180.0
    level, upward = (
        np.minimum(12.0 * (off / width) ** 2, depth),
        np.minimum(12.0 * ((90.0 - zenith) / height) ** 2, depth),
    )
    return peak - np.minimum(level + upward, depth)


def _vehicles(device: str) -> Measurement:
    def draw(axes: Any) -> None:
        degrees = np.degrees(AROUND)
        for name in CARS:
            axes.plot(degrees, decibels(_around("vehicles", name, 28e9, device)), lw=1.0, label=name)
        axes.plot(degrees, vehicle_pattern(degrees), color="k", lw=1.2, ls="--", label="TR 38.901")
        axes.set(xlabel="azimuth, 0 in front [deg]", ylabel="RCS at 28 GHz [dBsm]", xticks=range(0, 361, 90))
        axes.legend(ncols=2, fontsize=8)

    return replace(_mean("vehicles", CARS, 28e9, device), draw=draw)


def _broadside(device: str) -> Measurement:
    each = {name: _around("vehicles", name, 28e9, device) for name in CARS}
    values = {name: float(decibels(own[18] / own[0])) for name, own in each.items()}
    return Measurement(float(np.mean(list(values.values()))), ", ".join(f"{n} {v:.1f} dB" for n, v in values.items()))


def _peak(device: str) -> Measurement:
    peaks = {name: float(decibels(_around("vehicles", name, 28e9, device).max())) for name in CARS}
    return Measurement(float(np.mean(list(peaks.values()))), ", ".join(f"{n} {v:.1f} dBsm" for n, v in peaks.items()))


def _person(carrier_hz: float) -> Callable[[str], Measurement]:
    return lambda device: _mean("pedestrians", ("man", "woman"), carrier_hz, device)


def _people(device: str) -> Measurement:
    """Return the mean at 28 GHz, and draw all bands."""
    ghz = np.array([10.0, 24.0, 28.0, 76.5])

    def draw(axes: Any) -> None:
        for name in ("man", "woman", "child"):
            own = [decibels(_around("pedestrians", name, 1e9 * f, device).mean()) for f in ghz]
            axes.plot(ghz, own, "o-", ms=3.0, lw=1.0, label=name)
        axes.errorbar([28.0], [-1.37], yerr=3.94, fmt="ks", ms=4.0, capsize=3.0, label="TR 38.901, all bands")
        axes.plot([24.0, 77.0], [-11.5, -8.1], "k^", ms=5.0, label="EUR 25762 and Yamada, as MATLAB has them")
        axes.set(xlabel="carrier [GHz]", ylabel="mean RCS over azimuth [dBsm]")
        axes.legend(fontsize=8)

    return replace(_mean("pedestrians", ("man", "woman"), 28e9, device), draw=draw)


def _smooth_people(device: str) -> Measurement:
    man, around = load_asset("pedestrians", "man", device), np.radians(np.arange(0.37, 360.0, 6.0))
    own = smooth_cross_section(man, around, carrier_hz=10e9, max_bounces=2, tubes_per_wavelength=4.0)
    return Measurement(
        float(decibels(own.mean())), f"median of {len(own)} aspects {decibels(np.median(own)):.1f} dBsm; the rough "
        f"surfaces of the radar give {decibels(_around('pedestrians', 'man', 10e9, device).mean()):.1f} dBsm",
    )  # fmt: skip


def _bistatic(device: str) -> Measurement:
    """Return how much less a man scatters to the side than back, and draw all angles."""
    man, around = load_asset("pedestrians", "man", device), np.radians(np.arange(0.37, 360.0, 15.0))
    angles = np.array([0.0, 45.0, 90.0, 120.0])
    means = [
        smooth_cross_section(
            man, around, bistatic_rad=float(np.radians(beta)), carrier_hz=4.9e9, max_bounces=1, tubes_per_wavelength=4.0
        ).mean()
        for beta in angles
    ]
    own = decibels(np.array(means) / means[0])

    def draw(axes: Any) -> None:
        beta = np.linspace(0.0, 180.0, 91)
        axes.plot(angles, own, "o-", ms=4.0, label="man at 4.9 GHz")
        axes.plot(beta, BISTATIC_DB * np.sin(np.radians(beta) / 2.0), "k--", label="TR 38.901")
        axes.set(xlabel="angle between transmitter and receiver [deg]", ylabel="mean RCS over the monostatic [dB]")
        axes.legend(fontsize=8)

    text = ", ".join(f"{value:+.1f} dB at {beta:g}" for beta, value in zip(angles[1:], own[1:], strict=True))
    return Measurement(float(own[2]), f"{text} degrees", draw)


def _smooth(mesh: Mesh, azimuth: float, elevation: float, bounces: int, factor: float) -> Callable[[str], Measurement]:
    """Return a function that gives found over expected, in decibels: factor a^4 / lambda^2."""

    def measure(device: str) -> Measurement:
        scene, found = load_target(mesh, device), []
        for carrier_hz in (10e9, 28e9, 76.5e9):
            own = smooth_cross_section(
                scene, [azimuth], elevation_rad=elevation, carrier_hz=carrier_hz, max_bounces=bounces
            )[0]
            found.append(float(decibels(own / (factor * TARGET_M**4 * (carrier_hz / SPEED_OF_LIGHT) ** 2))))
        return Measurement(max(found, key=abs), f"10, 28, 76.5 GHz: {', '.join(f'{one:+.2f}' for one in found)} dB")

    return measure


def _ball(device: str) -> Measurement:
    scene = load_target(ball(TARGET_M, 6), device, STEEL)
    own = radar_cross_section(scene, np.radians([0.0, 50.0, 200.0]))
    return Measurement(float(decibels(own.mean() / (np.pi * TARGET_M**2))), f"{decibels(own.mean()):.2f} dBsm")


def _single_bounces(device: str) -> Measurement:
    scene = load_target(trihedral(TARGET_M), device, STEEL)
    own = radar_cross_section(scene, [np.pi / 4.0], elevation_rad=float(np.arctan(np.sqrt(0.5))))[0]
    expected = 4.0 * np.pi * TARGET_M**4 / 3.0 * (76.5e9 / SPEED_OF_LIGHT) ** 2
    return Measurement(float(decibels(own / expected)), f"{decibels(own):.1f} instead of {decibels(expected):.1f} dBsm")


@cache
def _detection_range(device: str) -> tuple[float, np.ndarray, np.ndarray]:
    """Return the range at which half of the samples detect a ball of 10 dBsm [m], the ranges tried and the shares."""
    radius = np.sqrt(10.0 / np.pi)
    scene: Scene = load_target(ball(radius, 5), device, STEEL)
    radar = Radar(
        range_m=250.0, horizontal_fov_deg=1.0, vertical_fov_deg=1.0, azimuth_rays=48, elevation_rays=48,
        horizontal_beam_deg=110.0, vertical_beam_deg=30.0,
    )  # fmt: skip
    ranges = np.arange(40.0, 181.0, 10.0)
    # Free poses a millimeter apart have other random numbers.
    poses = [[-away - radius - 1e-3 * n, 0, 0, 0, 0, 0, 1] for away in ranges for n in range(DRAWS)]
    seen = [(np.abs(one.range - away) < 3.0).any() for one, away in _with_ranges(scene, radar, poses, ranges)]
    shares = np.reshape(seen, (len(ranges), DRAWS)).mean(axis=1)
    below = int(np.flatnonzero(shares < 0.5)[0])
    low, high = below - 1, below
    part = (shares[low] - 0.5) / (shares[low] - shares[high])
    return float(ranges[low] + part * (ranges[high] - ranges[low])), ranges, shares


def _with_ranges(scene: Scene, radar: Radar, poses: list[list[float]], ranges: np.ndarray) -> Any:
    return zip(scene.capture(radar, pose=np.array(poses)), np.repeat(ranges, DRAWS), strict=True)


def _car_range(device: str) -> Measurement:
    middle, ranges, shares = _detection_range(device)
    config = Radar()

    def draw(axes: Any) -> None:
        snr = 10.0 ** (config.reference_snr_db / 10.0) * (100.0 / ranges) ** 4
        axes.plot(ranges, shares, "o", ms=4.0, label="detected")
        axes.plot(ranges, config.false_alarm_probability ** (1.0 / (1.0 + snr)), lw=1.0, label="Swerling 1")
        axes.axvline(150.0, color="k", ls="--", lw=1.0, label="data sheet")
        axes.set(xlabel="range of 10 dBsm [m]", ylabel="share of samples")
        axes.legend(fontsize=8)

    near, far = (ranges[np.flatnonzero(shares >= share)[-1]] for share in (0.8, 0.2))
    return Measurement(middle, f"80 % are detected at {near:.0f} m, 20 % at {far:.0f} m, in one sample of 10 ms", draw)


def _range_ratio(device: str) -> Measurement:
    car, man = (_around(*body, 76.5e9, device).mean() for body in (("vehicles", "sedan"), ("pedestrians", "man")))
    middle = _detection_range(device)[0]
    own = [middle * (rcs / 10.0) ** 0.25 for rcs in (car, man)]
    return Measurement(float(own[0] / own[1]), f"50 % at {own[0]:.0f} m and {own[1]:.0f} m by the default `Radar`")


def _reflector(
    name: str, title: str, mesh: Mesh, azimuth: float, elevation: float, bounces: int, factor: float
) -> Check:
    return Check(
        name=f"radar.{name}", title=f"{title}, worst of 10, 28 and 76.5 GHz, over its closed form",
        computed=f"`smooth_cross_section` of a target of {TARGET_M:g} m with {bounces} bounces, along its axis",
        unit="dB", reference=Reference.plus_minus(0.0, 1.0), sources=(RUCK,),
        tolerance="targets of 5 wavelengths and more; single echoes of the same target interfere with 0.7 dB at 5 "
        "wavelengths, and edges are rounded to 1/8 wavelength",
        measure=_smooth(mesh, azimuth, elevation, bounces, factor),
    )  # fmt: skip


CHECKS = (
    Check(
        name="radar.vehicle_mean", title="RCS of cars at 28 GHz, mean over azimuth",
        computed="`radar_cross_section` of sedan, hatchback and SUV, every 5 degrees, seen level", unit="dBsm",
        reference=Reference.plus_minus(11.25, 3.41), tolerance="sigma_S of the standard, 3.41 dB",
        sources=(TR38901,), measure=_vehicles,
    ),
    Check(
        name="radar.vehicle_broadside", title="RCS of cars at 28 GHz, broadside over front",
        computed="`radar_cross_section` of sedan, hatchback and SUV, mean of their differences", unit="dB",
        reference=Reference(20.75 - 15.52, 3.0, 20.75 - 15.52 + 3.41),
        tolerance="at least 3 dB, so that sides are brighter; at most sigma_S more than the peaks of the standard",
        sources=(TR38901,), measure=_broadside,
    ),
    Check(
        name="radar.vehicle_peak", title="RCS of cars at 28 GHz, peak",
        computed="largest of 72 aspects of sedan, hatchback and SUV, mean in decibels", unit="dBsm",
        reference=Reference.plus_minus(20.75, 3.41), tolerance="sigma_S of the standard, 3.41 dB",
        sources=(TR38901,), measure=_peak,
        known_red="painted metal has a slope of 0.25, which stands for seams, handles and cavities that the meshes "
        "leave out, and spreads the flash of flat sides over 14 degrees; a smaller slope beside corners in the meshes, "
        "or several bounces, would mend it",
    ),
    Check(
        name="radar.person_28ghz", title="RCS of people at 28 GHz, mean over azimuth",
        computed="`radar_cross_section` of man and woman, every 5 degrees, seen level", unit="dBsm",
        reference=Reference.plus_minus(-1.37, 3.94), tolerance="sigma_S of the standard, 3.94 dB",
        sources=(TR38901,), measure=_people,
    ),
    Check(
        name="radar.person_smooth_10ghz", title="RCS of a man at 10 GHz as smooth skin, mean over azimuth",
        computed="`smooth_cross_section`, shooting and bouncing rays with phases, 60 aspects", unit="dBsm",
        reference=Reference.plus_minus(-1.37, 3.94), tolerance="sigma_S of the standard, 3.94 dB",
        sources=(TR38901,), measure=_smooth_people,
    ),
    Check(
        name="radar.person_77ghz", title="RCS of people at 77 GHz, mean over azimuth",
        computed="`radar_cross_section` of man and woman at 76.5 GHz, every 5 degrees, seen level", unit="dBsm",
        reference=Reference.plus_minus(-8.1, 3.94),
        tolerance="the spread of people and poses in TR 38.901, sigma_S = 3.94 dB", sources=(JRC, TR38901),
        measure=_person(76.5e9),
    ),
    Check(
        name="radar.person_24ghz", title="RCS of people at 24 GHz, mean over azimuth",
        computed="`radar_cross_section` of man and woman, every 5 degrees, seen level", unit="dBsm",
        reference=Reference.plus_minus(-11.5, 3.94),
        tolerance="the spread of people and poses in TR 38.901, sigma_S = 3.94 dB", sources=(JRC, TR38901),
        measure=_person(24e9),
        known_red="the sources disagree by 10 dB: 3GPP has -1.37 dBsm for all bands, and the abstract of EUR 25762 "
        "says that 24 and 77 GHz are very close. The model follows the reflection of skin, which falls with the "
        "carrier; layers of cloth over skin, with measured permittivities, could lower it",
    ),
    Check(
        name="radar.person_bistatic", title="RCS of a man at a right angle of both ends, over monostatic",
        computed="`smooth_cross_section` at 4.9 GHz, mean over 24 aspects, first hits", unit="dB",
        reference=Reference.plus_minus(SIDEWAYS_DB, 3.94),
        tolerance="sigma_S of the standard, 3.94 dB", sources=(TR38901_BISTATIC,), measure=_bistatic,
    ),
    Check(
        name="radar.drone", title="RCS of a small drone at 28 GHz, mean over azimuth",
        computed="`radar_cross_section` of the shipped quadrotor, every 5 degrees, seen level", unit="dBsm",
        reference=Reference.plus_minus(-12.81, 3.74), tolerance="sigma_S of the standard, 3.74 dB",
        sources=(TR38901,), measure=lambda device: _mean("drones", ("quadrotor",), 28e9, device),
    ),
    _reflector("plate", "RCS of a plate", plate(TARGET_M), 0.0, 0.0, 1, 4.0 * np.pi),
    _reflector("dihedral", "RCS of a corner of two planes", dihedral(TARGET_M), np.pi / 4.0, 0.0, 2, 8.0 * np.pi),
    _reflector(
        "trihedral", "RCS of a corner reflector of three triangles", trihedral(TARGET_M), np.pi / 4.0,
        float(np.arctan(np.sqrt(0.5))), 3, 4.0 * np.pi / 3.0,
    ),
    Check(
        name="radar.ball", title="RCS of a metal ball by the radar's rays, over pi r^2",
        computed=f"`radar_cross_section` of a steel ball of {TARGET_M:g} m at 76.5 GHz from three sides", unit="dB",
        reference=Reference.plus_minus(0.0, 0.5), sources=(RUCK,), measure=_ball,
        tolerance="the roughness of steel adds 0.17 dB, and 100 radii of distance take 0.09 dB",
    ),
    Check(
        name="radar.trihedral_by_radar", title="RCS of a corner reflector by the radar's rays, over its closed form",
        computed=f"`radar_cross_section` of a steel corner of {TARGET_M:g} m at 76.5 GHz along its axis", unit="dB",
        reference=Reference.plus_minus(0.0, 1.0), tolerance="as for the other corner reflectors", sources=(RUCK,),
        measure=_single_bounces,
        known_red="echoes of the radar bounce once, and by `multipath: full` once more in a mirror. Tubes of three "
        "bounces on smooth metal, as `smooth_cross_section` has them, would mend it",
    ),
    Check(
        name="radar.range_10dbsm", title="Range at which half of the samples detect 10 dBsm",
        computed=f"detections of `Radar()` of a ball of 10 dBsm, {DRAWS} samples at each of 15 distances", unit="m",
        reference=Reference.within_share(150.0, 0.2),
        tolerance="20 %, which is 3.2 dB of the link budget: boards, temperatures and patterns differ by as much",
        sources=(TI_IMAGING,), measure=_car_range,
        known_red="`reference_snr_db` of 15 dB at 100 m is a design value, for samples of 10 ms that no tracker adds "
        "up; 21 dB gives 150 m. The data sheet says how far a target of 10 m2 can be detected, not with which "
        "probability",
    ),
    Check(
        name="radar.range_ratio", title="Range of cars over range of people",
        computed="fourth root of the ratio of mean cross sections of sedan and man at 76.5 GHz", unit="",
        reference=Reference.within_share(80.0 / 30.0, 0.25),
        tolerance="25 %, which is 3.9 dB between the two cross sections: sigma_S of people in TR 38.901",
        sources=(TI_SHORT, TI_PEOPLE), measure=_range_ratio,
    ),
)  # fmt: skip
"""Rows of this topic."""
