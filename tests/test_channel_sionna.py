"""Line of sight and first-order reflection against the reference cases of Sionna RT, path by path."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mmw.channel.antennas import SLANTS, antenna_field
from mmw.channel.field import combine
from mmw.channel.links import Ends, Links
from mmw.channel.materials import relative_permittivity
from mmw.channel.paths import Paths
from mmw.channel.solver import solve_paths
from mmw.config import ChannelConfig
from mmw.constants import SPEED_OF_LIGHT, VACUUM_PERMITTIVITY
from mmw.materials import Material, RadioMaterial
from mmw.poses import compose, invert, pose_from_ypr, quaternion_from_ypr, quaternion_to_matrix, transform_points
from mmw.scene import Scene
from mmw.scene_arrays import Model
from mmw.surfaces import find_surfaces
from mmw.town.parts import MeshPart
from tests.scenes import arrays_from_parts

FOLDER = Path(__file__).parent / "reference" / "sionna"
MANIFEST = json.loads((FOLDER / "manifest.json").read_text())
CASES = sorted(MANIFEST["cases"])
BODY = pose_from_ypr([3.0, -2.0, 0.5], 0.4, 0.1, -0.2)
"""Frame that moving objects get, so that nothing about an instance is the identity."""


def used_material(name: str, values: dict) -> Material:
    """Return a material with the numbers that Sionna used at the case's frequency: float32, so not exactly ITU's."""
    radio = RadioMaterial(
        "constant",
        relative_permittivity=values["eps_r"],
        conductivity=values["sigma"],
        thickness=values["thickness"],
        scattering=values["S"],
    )
    return Material(name, radio, "none", 0.3, (0.5, 0.5, 0.5))


def load_ply(name: str) -> tuple[np.ndarray, np.ndarray]:
    mesh = trimesh.load_mesh(FOLDER / name, process=False)
    return np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int32)


def reference_scene(case: dict, device: str) -> Scene:
    """Return the scene of a case at its middle frame; objects with a velocity are instances that move."""
    spec, velocity = case["config"]["scene"], case["config"].get("object_velocity") or {}
    materials = {name: used_material(name, values) for name, values in case["materials"].items()}
    names, steps = list(materials), np.arange(-1, 2)[:, None] * 0.01
    parts, models, actors, poses = [], [], [], []
    for item in spec.get("objects", []):
        name, (points, faces) = item["name"], load_ply(item["ply"])
        if name in velocity:
            ids = np.full(len(faces), names.index(item["material"]), dtype=np.int32)
            surface = find_surfaces(points, faces, np.zeros_like(ids), ids)
            actors.append((name, "vehicle", len(models)))
            models.append(Model(name, transform_points(invert(BODY), points), faces, ids, surface))
            poses.append([compose([*step, 0, 0, 0, 1], BODY) for step in steps * np.array(velocity[name])])
        else:
            parts.append(MeshPart(f"Buildings/{name}", points, faces, item["material"], "building"))
    frames = np.array(poses).transpose(1, 0, 2) if poses else np.zeros((3, 0, 7))
    arrays = arrays_from_parts(parts, models, actors, frames, first_frame=6, materials=materials)
    scene = Scene(arrays, device, 1)
    scene.load_batch([7])
    return scene


def reference_links(config: dict) -> Links:
    """Return every transmitter to every receiver, receivers first as the columns of a case are sorted."""
    tx, rx = (np.array(k).ravel() for k in np.meshgrid(range(len(config["tx"])), range(len(config["rx"]))))

    def ends(devices: list[dict], index: np.ndarray) -> Ends:
        value = [[np.array(d.get(key, [0, 0, 0]), dtype=float) for d in devices] for key in ("pos", "ori", "vel")]
        position, turn, velocity = (np.array(v)[index] for v in value)
        return Ends(position, quaternion_to_matrix(quaternion_from_ypr(*turn.T)), velocity)

    count = len(tx)
    return Links(
        frame=np.full(count, 7, dtype=np.int32),
        slot=np.zeros(count, dtype=np.int32),
        kind=np.zeros(count, dtype=np.int8),
        tx_actor=tx.astype(np.int32),
        rx_actor=rx.astype(np.int32),
        tx=ends(config["tx"], tx),
        rx=ends(config["rx"], rx),
    )


def element_gains(paths: Paths, links: Links, config: dict) -> np.ndarray:
    """Return the coefficient between all elements of a case, shape [P, rx elements, tx elements]."""
    fields = []
    for ends, theta, phi, array in (
        (links.rx, paths.theta_r, paths.phi_r, config["rx_array"]),
        (links.tx, paths.theta_t, paths.phi_t, config["tx_array"]),
    ):
        direction = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
        model = array.get("pol_model", "tr38901_2")
        fields.append(antenna_field(direction, ends.rotation[paths.link], array["pattern"], array["pol"], model))
        assert fields[-1].shape[1] == len(SLANTS[array["pol"]])
    return combine(fields[0], paths.transfer["sunny"][:, 0], fields[1])


def compare(name: str, device: str) -> dict[str, float]:
    """Compare a case path by path and return the worst errors."""
    case, reference = MANIFEST["cases"][name], dict(np.load(FOLDER / "cases" / f"{name}.npz"))
    config = case["config"]
    order = (reference["itype"] != 0).sum(axis=1)
    reference = {key: value[order <= 1] for key, value in reference.items()}
    order = order[order <= 1]
    scene, links = reference_scene(case, device), reference_links(config)
    channel = ChannelConfig(
        carriers_hz=(config["frequency"],),
        candidates="exhaustive",
        max_depth=min(1, config["solver"].get("max_depth", 1)),
        pattern="iso",
    )
    paths = solve_paths(scene, links, channel, scene.arrays.materials)
    gains = element_gains(paths, links, config)
    # A null of the pattern removes a path from Sionna's list; ours keeps it with gain 0.
    spread = SPEED_OF_LIGHT / config["frequency"] / (4 * np.pi * paths.tau * SPEED_OF_LIGHT)
    is_heard = np.abs(gains).max(axis=(1, 2)) > 1e-9 * spread
    unmatched = set(np.nonzero(is_heard)[0])
    worst = dict.fromkeys(("a64", "tau64", "vert64", "a", "tau_m", "angle", "doppler"), 0.0)
    for i in range(len(order)):
        same = (links.tx_actor[paths.link] == reference["tx"][i]) & (links.rx_actor[paths.link] == reference["rx"][i])
        same &= paths.kind == order[i]
        same &= np.abs(paths.tau - reference["tau64"][i]) * SPEED_OF_LIGHT < 5e-3
        if order[i]:
            same &= np.linalg.norm(paths.vertex - reference["vert64"][i, 0], axis=1) < 0.05
        rows = np.nonzero(same)[0]
        if len(rows) == 0:
            assert not reference.get("robust", np.ones(len(order), bool))[i], f"{name}: path {i} is missing"
            continue
        assert len(rows) == 1, f"{name}: path {i} was found {len(rows)} times"
        p = rows[0]
        unmatched.discard(p)
        a64, scale = reference["a64"][i], np.abs(reference["a64"][i]).max()
        length = reference["tau64"][i] * SPEED_OF_LIGHT
        worst["a64"] = max(worst["a64"], np.abs(gains[p] - a64).max() / scale)
        worst["tau64"] = max(worst["tau64"], abs(paths.tau[p] / reference["tau64"][i] - 1))
        worst["a"] = max(worst["a"], np.abs(gains[p] - reference["a"][i]).max() / scale)
        worst["tau_m"] = max(worst["tau_m"], abs(paths.tau[p] - reference["tau"][i]) * SPEED_OF_LIGHT)
        worst["doppler"] = max(worst["doppler"], abs(paths.doppler_hz[p, 0] - reference["doppler"][i]))
        if order[i]:
            worst["vert64"] = max(worst["vert64"], np.linalg.norm(paths.vertex[p] - reference["vert64"][i, 0]) / length)
        for zenith, azimuth in (("theta_t", "phi_t"), ("theta_r", "phi_r")):
            own = getattr(paths, zenith)[p], getattr(paths, azimuth)[p]
            turn = np.angle(np.exp(1j * (own[1] - reference[azimuth][i]))) * np.sin(own[0])
            worst["angle"] = max(worst["angle"], abs(own[0] - reference[zenith][i]), abs(turn))
    assert not unmatched, f"{name}: paths {sorted(unmatched)} are not in the reference"
    return worst


@pytest.mark.parametrize("name", CASES)
def test_sionna_case(name: str, device: str) -> None:
    worst = compare(name, device)
    assert worst["a64"] < 1e-6
    assert worst["tau64"] < 1e-9
    assert worst["vert64"] < 1e-6
    assert worst["a"] < (1.5e-3 if "hw_dipole" in name else 6e-4)  # float32 columns; the former near its axis
    assert worst["tau_m"] < 1e-4
    assert worst["angle"] < 2e-5
    assert worst["doppler"] < 5e-3


@pytest.mark.parametrize("name", [name for name in CASES if MANIFEST["cases"][name]["objects"]])
def test_sionna_materials(name: str) -> None:
    """The table gives what Sionna uses, to its float32."""
    case = MANIFEST["cases"][name]
    for key, spec in case["config"]["scene"]["materials"].items():
        if spec["type"] == "itu":
            frequency, used = case["config"]["frequency"], case["materials"][key]
            value = relative_permittivity(RadioMaterial("itu", itu="itu_" + spec["itu"]), frequency)
            sigma = -value.imag * 2 * np.pi * frequency * VACUUM_PERMITTIVITY
            assert value.real == pytest.approx(used["eps_r"], rel=1e-6)
            assert sigma == pytest.approx(used["sigma"], rel=1e-6)
