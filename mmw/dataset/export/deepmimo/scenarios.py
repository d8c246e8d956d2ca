"""DeepMIMO v4 scenarios, written without DeepMIMO: `deepmimo.load(NAME)` of DeepMIMO 4.0.5 opens them.

Run Python in OUT: DeepMIMO looks for `deepmimo_scenarios/NAME` in the working directory. There is one scenario for each
scenario, weather and carrier, in lower case, such as `town03_roundabout_sunny_28ghz`.

packed   one static scenario: transmitters are the roadside units, receiver r is one CAV in one frame, frame by frame.
         Exact, because roadside units do not move. V2V links are omitted.
dynamic  one folder a frame (`deepmimo.DynamicDataset`); V2V links too. Set 0: roadside units; set 1: CAVs that receive;
         set 2: CAVs that send. A set that sends and receives would be skipped by `deepmimo.load`'s defaults.

Matrices are float64 (DeepMIMO's converters write float32, whose delays turn a path of 1 us by up to 4e-5 rad at the
edge of 123 MHz). `power` is 20 log10 |a| [dB] and `phase` [deg] is that of a exp(-j 2 pi f_c tau), because DeepMIMO
adds no carrier phase. Angles [deg] are azimuths from +x and polar angles from +z, world frame; arrival points from the
receiver back along the path.

DeepMIMO does not read these additional files:

    receivers_r001.npz            frame, time_s, agent, rotation_deg, velocity, of each row of the matrices
    transmitters_t000.npz         agent, rotation_deg, velocity, of each transmitter
    extra_t000_tx000_r001.npz     doppler [Hz] for `set_doppler`, path_id and inter_object (our object ids), -1 for none

`rotation_deg` is DeepMIMO's `rotation` of an antenna (about x, y, z). H of DeepMIMO is ours at the baseband
frequencies k B / N, k = 0 ... N - 1, over sqrt(N); its first element is at the center of our array.

Losses: those of `FORMAT` below.

Source: DeepMIMO 4.0.5, `consts.py`, `datasets/load.py`, `generator/channel.py`, `generator/geometry.py`.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from mmw.channel import LINK_COLUMNS, CarrierPaths, PlanarArray, apply_arrays
from mmw.channel.response import complex_gain
from mmw.config.sampling import UNSET, Sampling
from mmw.core.errors import InputError
from mmw.core.transforms import quaternion_to_matrix, quaternion_to_ypr
from mmw.dataset import Dataset
from mmw.dataset.export.deepmimo.scene import material_list, no_scene, write_actors, write_town
from mmw.dataset.export.exporter import VEHICLE_ROLES, Format, Option, Options, Part, Selection, Task, parts, require
from mmw.dataset.export.read_radio import Antennas, read_antennas
from mmw.dataset.export.read_sensors import Block
from mmw.dataset.table_reader import path_columns
from mmw.storage.manifest import DATASET

FOLDER = "deepmimo_scenarios"
"""Folder of DeepMIMO's scenarios, below the working directory."""
VERSION = "4.0.5"
"""DeepMIMO version whose files these are."""
RSUS, RECEIVERS, SENDERS = 0, 1, 2
"""Sets of antennas: roadside units, CAVs that receive, CAVs that send."""
DIGITS = {1: 1, 2: 3, 4: 4, 8: 2}
"""Interaction of the dataset (specular, diffuse, transmission, diffraction) -> DeepMIMO's digit."""


@dataclass(frozen=True)
class Radio:
    """Links and paths of one scenario, weather and carrier."""

    paths: CarrierPaths
    """`row` counts the paths, so that it names the rows of the other two."""
    coefficient: np.ndarray
    """Coefficient of each path without the carrier phase, shape [P], complex128."""
    lists: pa.Table
    """`path_id`, `interactions`, `vertices` and `objects` of each path, P rows."""

    def at(self, frames: Sequence[int]) -> "Radio":
        """Return links and paths of some frames."""
        paths = self.paths.take(np.isin(self.paths.keys["frame"], frames))
        rows = paths.row
        return Radio(replace(paths, row=np.arange(len(rows))), self.coefficient[rows], self.lists.take(pa.array(rows)))


def read_radio(dataset: Dataset, part: Part, carrier_hz: float, antennas: Antennas, options: Options) -> Radio:
    """Return links and paths at one carrier, with the coefficients of the antenna that the options name."""
    lists = ["path_id", "interactions", "vertices", "objects"]
    block = Block(dataset, part.scenario, part.weather, part.frames)
    names = list(dict.fromkeys([*path_columns(dataset), *lists]))
    rows, links = block.table("paths", names), block.table("links", LINK_COLUMNS)
    paths = CarrierPaths.from_table(rows, carrier_hz, links)
    coefficient = paths.a
    if options["pattern"] != "stored":
        antenna = PlanarArray(pattern=options["pattern"], polarization=options["polarization"])
        turns = []
        for end in ("peer", "agent"):
            keys = [(int(frame), str(agent)) for frame, agent in zip(paths.keys["frame"], paths.keys[end], strict=True)]
            turns.append(quaternion_to_matrix(antennas.at(keys)[0][:, 3:]))
        coefficient = apply_arrays(paths, antenna, antenna, carrier_hz, *turns)[:, 0, 0]
    table = rows.select(lists).take(pa.array(paths.row))
    return Radio(replace(paths, row=np.arange(len(paths))), coefficient, table)


def path_matrices(radio: Radio, peer: str, receivers: list[tuple[int, str]], max_paths: int) -> dict[str, np.ndarray]:
    """Return DeepMIMO's matrices of a transmitter, a row for each (frame, receiver), NaN without a path, and ours."""
    paths = radio.paths
    place = {key: row for row, key in enumerate(receivers)}
    keys = zip(paths.keys["frame"], paths.keys["agent"], paths.keys["peer"], strict=True)
    target = np.array([place.get((int(f), str(a)), -1) if p == peer else -1 for f, a, p in keys], dtype=np.int64)
    power = 20.0 * np.log10(np.maximum(np.abs(radio.coefficient), 1e-30))
    order = np.lexsort((-power, paths.link))
    first = np.cumsum(paths.path_count) - paths.path_count
    column = np.arange(len(order)) - first[paths.link[order]]
    row = target[paths.link[order]]
    is_written = (column < max_paths) & (row >= 0)
    order, column, row = order[is_written], column[is_written], row[is_written]
    phase = np.degrees(np.angle(complex_gain(radio.coefficient, paths, paths.carrier_hz)))
    code, points, objects = _interactions(radio.lists.take(pa.array(order)))
    shape = (len(receivers), int(column.max(initial=0)) + 1)
    values = {
        "power": power[order],
        "phase": phase[order],
        "delay": paths.tau[order],
        "aoa_az": np.degrees(paths.phi_r[order]),
        "aoa_el": np.degrees(paths.theta_r[order]),
        "aod_az": np.degrees(paths.phi_t[order]),
        "aod_el": np.degrees(paths.theta_t[order]),
        "inter": code,
        "inter_pos": points,
        "doppler": paths.doppler_hz[order],
        "path_id": radio.lists["path_id"].to_numpy()[order],
        "inter_object": objects,
    }
    result = {}
    for name, value in values.items():
        is_id = value.dtype.kind == "i"
        full = np.full((*shape, *value.shape[1:]), -1 if is_id else np.nan, dtype=value.dtype)
        full[row, column] = value
        result[name] = full
    return result


def _interactions(lists: pa.Table) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return codes [P], points [P, I, 3] and object ids [P, I] of each path's interactions, at least one column."""
    kinds = lists["interactions"].combine_chunks()
    count = pc.list_value_length(kinds).to_numpy(zero_copy_only=False).astype(np.int64)
    width = max(int(count.max(initial=0)), 1)
    where = np.arange(width) < count[:, None]
    digits = np.zeros((len(count), width))
    digits[where] = [DIGITS[kind] for kind in kinds.flatten().to_pylist()]
    weight = np.where(where, 10.0 ** np.maximum(count[:, None] - 1 - np.arange(width), 0), 0.0)
    points = np.full((len(count), width, 3), np.nan)
    points[where] = lists["vertices"].combine_chunks().flatten().to_numpy().reshape(-1, 3)
    objects = np.full((len(count), width), -1, dtype=np.int32)
    objects[where] = lists["objects"].combine_chunks().flatten().to_numpy()
    return (digits * weight).sum(axis=1), points, objects


def tasks(dataset: Dataset, selection: Selection, options: Options) -> list[Task]:
    """Return one task for each scenario, weather and carrier.

    Raises:
        InputError: If the dataset has no radio tables, there is no link for the mode, or an option is wrong.
    """
    require(
        dataset,
        "deepmimo",
        "links",
        "path_gains",
        "path_geometry",
        "sensors",
        hint="record it with channel.enabled: true",
    )
    if not isinstance(dataset.info["config"].get("channel"), dict):
        raise InputError(f"{dataset.root / DATASET}: its configuration has no channel, which deepmimo writes down; the "
                         "file was changed; put the old one back")  # fmt: skip
    if not options["max_paths"].isdecimal() or int(options["max_paths"]) < 1:
        raise InputError(f"deepmimo: max_paths={options['max_paths']}: is no number of paths; give 1 or more")
    if dataset.filesystem is not None and options["mode"] == "packed" and options["scene"] != "off":
        raise InputError(f"deepmimo: {dataset.root} is no local folder, its stages cannot be read; give scene=off")
    planned = []
    channel = dataset.info["config"]["channel"]
    sampling = Sampling(**{key: channel[key] for key in UNSET if key in channel})
    for part in parts(dataset, selection, roles=VEHICLE_ROLES):
        due = sampling.is_due(part.frames, dataset.frame_rate_hz(part.scenario))
        part = replace(part, frames=tuple(np.array(part.frames)[due].tolist()))
        if not part.frames:
            raise InputError(f"deepmimo: scenario {part.scenario}: no frame of the channel is selected; pick more")
        block = Block(dataset, part.scenario, part.weather, part.frames)
        rows = block.table("links", ["frame", "carrier_hz", "link", "agent"])
        kinds = set(rows.filter(pc.is_in(rows["agent"].cast(pa.string()), value_set=pa.array(part.agents)))["link"]
                    .to_pylist())  # fmt: skip
        if not kinds or (options["mode"] == "packed" and "v2i" not in kinds):
            raise InputError(
                f"deepmimo: scenario {part.scenario}, weather {part.weather} has {' and '.join(sorted(kinds)) or 'no'} "
                f"links to {', '.join(part.agents)}; mode packed needs v2i; give mode=dynamic or other agents"
            )
        for carrier in sorted(pc.unique(rows["carrier_hz"]).to_pylist()):
            name = scenario_name(part, carrier)
            planned.append(Task(name, partial(write_scenario, dataset, part, carrier, dict(options))))
    return planned


def scenario_name(part: Part, carrier_hz: float) -> str:
    """Return the name for `deepmimo.load`, which turns names to lower case."""
    return f"{part.scenario}_{part.weather}_{carrier_hz / 1e9:.9g}ghz".replace(".", "p").lower()


def write_scenario(dataset: Dataset, part: Part, carrier_hz: float, options: Options, out: Path) -> None:
    """Write one DeepMIMO scenario below `out`."""
    folder, rate_hz = out / FOLDER / scenario_name(part, carrier_hz), dataset.frame_rate_hz(part.scenario)
    antennas = read_antennas(dataset, part)
    radio = read_radio(dataset, part, carrier_hz, antennas, options)
    roles = {agent: role for (_, agent), role in zip(antennas.row, antennas.role, strict=True)}
    peers = sorted({str(peer) for peer in radio.paths.keys["peer"]})
    cavs = [agent for agent in part.agents if roles[agent] == "cav"]
    senders = {RSUS: [p for p in peers if roles[p] == "rsu"], SENDERS: [p for p in peers if roles[p] == "cav"]}
    is_packed = options["mode"] == "packed"
    if is_packed:
        senders[SENDERS] = []
    steps = [part.frames] if is_packed else [(frame,) for frame in part.frames]
    reached = np.zeros(len(cavs) * (len(part.frames) if is_packed else 1), dtype=bool)
    # With one step DeepMIMO treats the scenario as static, and looks for its files in the scenario's own folder.
    places = [folder] if len(steps) == 1 else [folder / f"frame_{frames[0]:06d}" for frames in steps]
    for frames, place in zip(steps, places, strict=True):
        place.mkdir(parents=True)
        now = radio.at(frames)
        receivers = [(frame, cav) for frame in frames for cav in cavs]
        _write_ends(place / f"receivers_r{RECEIVERS:03}.npz", antennas, receivers, rate_hz)
        for tx_set, names in senders.items():
            if names:
                ends = [(frames[0], name) for name in names]
                _write_ends(place / f"transmitters_t{tx_set:03}.npz", antennas, ends, rate_hz)
            for index, peer in enumerate(names):
                matrices = path_matrices(now, peer, receivers, int(options["max_paths"]))
                reached |= ~np.isnan(matrices["power"][:, 0])
                matrices["rx_pos"] = antennas.at(receivers)[0][:, :3]
                matrices["tx_pos"] = antennas.at([(frames[0], peer)])[0][:, :3]
                _write_pair(place, f"t{tx_set:03}_tx{index:03}_r{RECEIVERS:03}", matrices)
    if options["scene"] == "off":
        scene = no_scene()
    elif is_packed:
        scene = write_town(dataset, part, folder, options["scene"])
    else:
        scene = write_actors(dataset, part, places)
    sets = {f"txrx_set_{tx}": _set(f"{'rsu' if tx == RSUS else 'cav'} tx", tx, names, True)
            for tx, names in senders.items() if names}  # fmt: skip
    sets[f"txrx_set_{RECEIVERS}"] = _set("cav rx", RECEIVERS, reached, False) | {
        "num_active_points": int(reached.sum())
    }
    params = {
        "version": VERSION,
        "rt_params": _rt_params(dataset, part, carrier_hz, options),
        "txrx_sets": sets,
        "materials": material_list(dataset, part, carrier_hz),
        "scene": {"num_scenes": len(steps), **scene},
    }
    (folder / "params.json").write_text(json.dumps(params, indent=1) + "\n", encoding="utf-8")


def _write_ends(path: Path, antennas: Antennas, keys: list[tuple[int, str]], rate_hz: int) -> None:
    pose, velocity = antennas.at(keys)
    frame = np.array([frame for frame, _ in keys], dtype=np.int32)
    np.savez_compressed(
        path,
        frame=frame,
        time_s=frame / rate_hz,
        agent=np.array([agent for _, agent in keys], dtype=np.str_),
        rotation_deg=np.degrees(quaternion_to_ypr(pose[:, 3:])[:, ::-1]),
        velocity=velocity,
    )


def _write_pair(folder: Path, pair: str, matrices: dict[str, np.ndarray]) -> None:
    """Write one file a matrix, as DeepMIMO reads them, and one additional file."""
    own = {name: matrices.pop(name) for name in ("doppler", "path_id", "inter_object")}
    for name, matrix in matrices.items():
        np.savez_compressed(folder / f"{name}_{pair}.npz", **{name: matrix})
    np.savez_compressed(folder / f"extra_{pair}.npz", **own)


def _set(name: str, index: int, points: Any, is_tx: bool) -> dict[str, Any]:
    return {
        "name": name,
        "id_orig": index,
        "id": index,
        "is_tx": is_tx,
        "is_rx": not is_tx,
        "num_points": len(points),
        "num_active_points": len(points),
        "num_ant": 1,
        "dual_pol": False,
        "ant_rel_positions": [[0, 0, 0]],
        "array_orientation": [0, 0, 0],
        "grid_spacing": None,
    }


def _rt_params(dataset: Dataset, part: Part, carrier_hz: float, options: Options) -> dict[str, Any]:
    """Return the ray tracing parameters by DeepMIMO's names, all of its `RayTracingParameters` but `gps_bbox`.

    Terrain reflects, diffracts and scatters as everything else does. Rays are the points of a Fibonacci lattice on the
    sphere. A path with a diffuse reflection may have mirrors and slabs, but no edge.
    """
    channel, info = dataset.info["config"]["channel"], dataset.info
    depth = int(channel["max_depth"])
    is_diffuse = bool(channel["diffuse_reflection"])
    return {
        "raytracer_name": "mmw",
        "raytracer_version": info["versions"].get("mmw", ""),
        "frequency": carrier_hz,
        "max_path_depth": depth,
        "max_reflections": depth if channel["specular_reflection"] else 0,
        "max_diffractions": int(channel["diffraction"]),
        "max_scattering": int(channel["diffuse_reflection"]) * channel.get("diffuse_order", 1),
        "max_transmissions": depth if channel["refraction"] else 0,
        "diffuse_reflections": max(depth - 1, 0) if is_diffuse and channel["specular_reflection"] else 0,
        "diffuse_diffractions": 0,
        "diffuse_transmissions": depth if is_diffuse and channel["refraction"] else 0,
        "diffuse_final_interaction_only": False,
        "diffuse_random_phases": False,
        "terrain_reflection": bool(channel["specular_reflection"]),
        "terrain_diffraction": bool(channel["diffraction"]),
        "terrain_scattering": is_diffuse,
        "num_rays": int(channel["samples_per_tx"]),
        "ray_casting_method": "uniform",
        "ray_casting_range_az": 360.0,
        "ray_casting_range_el": 180.0,
        "synthetic_array": True,
        "raw_params": {
            "config_sha256": info["config_sha256"],
            "scenario": part.scenario,
            "weather": part.weather,
            "pattern": options["pattern"],
            "polarization": options["polarization"],
        },
    }


FORMAT = Format(
    name="deepmimo",
    summary="DeepMIMO v4 scenarios: paths, angles, delays, interactions and positions; `deepmimo.load` opens them",
    losses=(
        "one polarization and one antenna pattern, of the options; the polarimetric transfers are omitted",
        "DeepMIMO has no Doppler, path id, object or velocity matrix: they are in files beside, see doppler below",
        "at most max_paths paths of a receiver, the strongest",
        "mode packed omits V2V links; mode dynamic has everything",
        "weather is in the gains; the losses by rain, fog and gas that they hold are not separate",
        "no sensor but the radio",
        "DeepMIMO computes in complex64; the first element of its arrays is at the antenna, ours are centered on it",
    ),
    tasks=tasks,
    options=(
        Option("mode", "packed", "packed: one static scenario; dynamic: one scene a frame", ("packed", "dynamic")),
        Option(
            "pattern",
            "iso",
            "antenna of `power` and `phase`; iso: DeepMIMO applies its own pattern; stored: the dataset's",
            ("iso", "dipole", "hw_dipole", "tr38901", "stored"),
        ),
        Option("polarization", "V", "polarization of both ends, unless pattern=stored", ("V", "H")),
        Option("max_paths", "25", "largest number of paths of a receiver; DeepMIMO loads 25 by default"),
        Option(
            "scene",
            "hull",
            "geometry; packed: the static town, an upright convex prism an object, or its meshes; dynamic: boxes of "
            "vehicles and people",
            ("hull", "mesh", "off"),
        ),
    ),
)
