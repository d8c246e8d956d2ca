"""Measure spherical waves over arrays, their time and their phases: `python -m bench.near_field`.

Times are those of `apply_arrays` for 200 lines of sight of 5 to 300 m with any attitude of both arrays, the least of
`--repeats` runs. Phases are compared with a trace of every element in town03, for receivers up to 300 m away.
"""

import argparse
import time

import numpy as np

import mmw
from bench.rays import cpu_name
from mmw.channel import PlanarArray, apply_arrays, ula
from mmw.channel.antennas.wavefronts import Wavefront
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.transforms import quaternion_from_ypr, quaternion_to_matrix
from mmw.dataset.beams import plain_paths
from mmw.validation.checks.near_field import BASE, CARRIER_HZ, phase_errors

PATHS = 200
SIZES = ((64, 16), (256, 1), (256, 16), (256, 64), (256, 256))
"""Elements of the transmitter and of the receiver."""
RECEIVERS = ((9.5, -29.5, 7.0), (5.0, -25.0, 5.0), (-2.0, -5.0, 1.5), (-2.0, 60.0, 1.5), (-2.0, 160.0, 1.5))


def times(repeats: int) -> None:
    """Print the time of plane and spherical waves for arrays of several sizes."""
    rng = np.random.default_rng(0)
    count = 20 * PATHS
    theta, phi = np.arccos(rng.uniform(-1.0, 1.0, (2, count))), rng.uniform(-np.pi, np.pi, (2, count))
    angles = np.column_stack([phi[0], theta[0], phi[1], theta[1]])
    tau = rng.uniform(5.0, 300.0, count) / SPEED_OF_LIGHT
    paths = plain_paths(CARRIER_HZ, count, np.arange(count), tau, rng.normal(size=(count, 8)), angles)
    turns = quaternion_to_matrix(quaternion_from_ypr(*rng.uniform(-1.5, 1.5, (3, 2, count))))
    print("| arrays | plane [us a path] | spherical [us a path] | ratio |\n|---|---|---|---|")
    for sent, heard in SIZES:
        links = np.arange(PATHS if sent * heard < 40_000 else PATHS // 10)
        some, ends = paths.take(links), (ula(sent), ula(heard), CARRIER_HZ, turns[0][links], turns[1][links])
        least: dict[Wavefront, float] = {"plane": np.inf, "spherical": np.inf}
        for _ in range(repeats):
            for wavefront in least:
                began = time.perf_counter()
                apply_arrays(some, *ends, wavefront=wavefront)
                least[wavefront] = min(least[wavefront], time.perf_counter() - began)
        plane, spherical = (1e6 * least[name] / len(links) for name in ("plane", "spherical"))
        print(f"| 1 x {sent} to 1 x {heard} | {plane:.1f} | {spherical:.1f} | {spherical / plane:.1f} |")


def phases(elements: int, device: str) -> None:
    """Print the phase errors of paths over an array as wide as 1 x 256 against a trace of its elements."""
    wide, single = PlanarArray(1, elements, horizontal_spacing=127.5 / (elements - 1), pattern="iso"), ula(1)
    scene = mmw.load_scene("town03", device=device)
    scene.add(mmw.Transmitter("base", position=BASE, array=wide))
    for number, place in enumerate(RECEIVERS):
        scene.add(mmw.Receiver(f"user_{number}", position=place, array=single))
    found, seconds = {}, {}
    for is_synthetic in (True, False):
        solver = mmw.PathSolver(max_depth=3, samples_per_tx=100_000, synthetic_array=is_synthetic)
        began = time.perf_counter()
        found[is_synthetic] = solver(scene, carriers_hz=[CARRIER_HZ])
        seconds[is_synthetic] = time.perf_counter() - began
    center, traced = found[True], found[False]
    print(f"\ntrace of the phase centers {seconds[True]:.1f} s, of {elements} elements {seconds[False]:.1f} s\n")
    print(
        "| order | paths | length [m] | plane [rad] | spherical [rad] | the same, any triangle [rad] |\n"
        + 6 * "|---"
        + "|"
    )
    errors = [
        phase_errors(center, traced, wide, single, wavefront, same_planes=same)
        for wavefront, same in (("plane", True), ("spherical", True), ("spherical", False))
    ]
    length = SPEED_OF_LIGHT * center.tau
    for order in range(4):
        own = (center.depth == order) & np.isfinite(errors[0])
        if own.any():
            worst = " | ".join(f"{error[own].max():.1g}" for error in errors)
            print(f"| {order} | {own.sum()} | {length[own].min():.0f} to {length[own].max():.0f} | {worst} |")


def kinds(device: str) -> None:
    """Print the phase errors by kind of path, with edges and curved surfaces, for 9 and 3 elements in the apertures."""
    arrays = (
        PlanarArray(1, 9, horizontal_spacing=127.5 / 8, pattern="iso"),
        PlanarArray(1, 3, horizontal_spacing=3.75, pattern="iso"),
    )
    scene = mmw.load_scene("town03", device=device)
    scene.add(mmw.Transmitter("base", position=BASE, array=arrays[0]))
    for number, place in enumerate(RECEIVERS[2:4]):
        scene.add(mmw.Receiver(f"user_{number}", position=place, array=arrays[1]))
    center, traced = (
        mmw.PathSolver(
            max_depth=2, samples_per_tx=50_000, finite_surfaces=True, diffraction=True, synthetic_array=is_synthetic
        )(scene, carriers_hz=[CARRIER_HZ])
        for is_synthetic in (True, False)
    )
    is_curved = np.isfinite(center.curvatures).all(axis=1)
    named = {
        "mirrors": (center.kind == "specular") & ~is_curved,
        "curved surface": is_curved,
        "edge": (center.kind == "diffraction") & (center.depth == 1),
        "edge and mirror": (center.kind == "diffraction") & (center.depth == 2),
    }
    print("\n| path | paths | plane: median, 90 % [rad] | spherical: median, 90 % [rad] |\n|---|---|---|---|")
    errors = [phase_errors(center, traced, *arrays, kind, same_planes=False) for kind in ("plane", "spherical")]
    for name, own in named.items():
        own = own & np.isfinite(errors[0])
        cells = [f"{np.median(error[own]):.1g}, {np.quantile(error[own], 0.9):.1g}" for error in errors]
        print(f"| {name} | {own.sum()} | {cells[0]} | {cells[1]} |")


def main() -> None:
    """Run the measurements."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=15)
    parser.add_argument("--elements", type=int, default=256, help="elements in the aperture of 1 x 256 [256]")
    parser.add_argument("--device", default="cpu")
    arguments = parser.parse_args()
    print(f"{cpu_name()}, NumPy {np.__version__}\n")
    times(arguments.repeats)
    phases(arguments.elements, arguments.device)
    kinds(arguments.device)


if __name__ == "__main__":
    main()
