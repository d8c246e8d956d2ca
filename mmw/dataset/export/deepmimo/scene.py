"""Scenes and materials of DeepMIMO scenarios: triangles of the static town, or boxes of vehicles and people.

A scene is `vertices.npz` (V x 3) and `objects.json`. One of hulls has the polygons of each object in the latter, those
of an upright prism, see `hulls.py`; one of meshes has `faces.npz` and `materials.npz`, triangles and their materials of
each object. DeepMIMO allows one object of label `terrain`, so all ground is one object.

Source: DeepMIMO 4.0.5, `core/scene.py`, `core/materials.py`.
"""

import json
from collections import defaultdict
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from mmw.core.constants import VACUUM_PERMITTIVITY
from mmw.core.errors import InputError
from mmw.core.transforms import transform_points
from mmw.dataset import Dataset
from mmw.dataset.export.deepmimo.hulls import main_material, prism
from mmw.dataset.export.exporter import Part
from mmw.dataset.export.read_sensors import Block, box_corners, box_pose, by_frame
from mmw.physics.materials.material import RadioMaterial
from mmw.physics.materials.permittivity import relative_permittivity
from mmw.storage.dataset_card import CONFIG

GROUND = ("road", "road_line", "sidewalk", "terrain", "ground", "water", "rail_track")
"""Our classes that are DeepMIMO's one terrain object."""
LABELS = {"building": "buildings", "wall": "buildings", "bridge": "buildings", "vegetation": "vegetation"}
"""Our class -> DeepMIMO's label; every other class is `objects`."""
BOX_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
     [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]], dtype=np.int32,
)  # fmt: skip
"""Outward triangles of a box with the corners of `mmw.dataset.export.read_sensors.box_corners`."""
MARGIN = 50.0
"""Width of the ground beyond the boxes [m]; design value."""
PERFECT_CONDUCTOR = 1e7
"""Conductivity of a perfect conductor, as in ITU-R P.2040's metal [S/m]."""
Mesh = tuple[str, str, np.ndarray, np.ndarray]
"""An object of a scene: label, name, triangles [T, 3] and their materials [T]."""
SCATTERING = {"lambertian": "lambertian", "directive": "directive", "backscattering": "directive"}
"""Our scattering pattern -> DeepMIMO's model."""


def material_list(dataset: Dataset, part: Part, carrier_hz: float) -> dict[str, dict[str, Any]]:
    """Return DeepMIMO's materials of a scenario in one weather, permittivity and conductivity at the carrier.

    Raises:
        InputError: If a permittivity is a function, or a scattering pattern none of mmw: the dataset has their names.
    """
    result = {}
    for row in dataset.read("materials", scenario=part.scenario, weather=part.weather).to_pylist():
        if row["model"] == "function" or (row["scattering"] and row["scattering_pattern"] not in SCATTERING):
            raise InputError(
                f"material {row['name']!r}: model {row['model']}, scattering pattern {row['scattering_pattern']}; "
                "DeepMIMO needs numbers, and a dataset holds no functions; export scenarios without such materials"
            )
        radio = RadioMaterial(
            model=row["model"],
            itu=row["itu"] or "",
            relative_permittivity=row["relative_permittivity"],
            conductivity=row["conductivity"],
        )
        eps = relative_permittivity(radio, carrier_hz, row["name"])
        conductivity = -eps.imag * 2.0 * np.pi * carrier_hz * VACUUM_PERMITTIVITY
        result[f"material_{row['material_id']}"] = {
            "id": row["material_id"],
            "name": row["name"],
            "permittivity": eps.real,
            "conductivity": conductivity if np.isfinite(conductivity) else PERFECT_CONDUCTOR,
            "scattering_model": SCATTERING[row["scattering_pattern"]] if row["scattering"] else "none",
            "scattering_coefficient": row["scattering"],
            "cross_polarization_coefficient": row["xpd"],
            "alpha_r": float(row["alpha_r"]),
            "alpha_i": float(row["alpha_i"]),
            "lambda_param": row["lobe_share"],
            "thickness": row["thickness"],
        }
    return result


def write_town(dataset: Dataset, part: Part, folder: Path, shape: str) -> dict[str, Any]:
    """Write the static town of a scenario, one object a prim and one for all the ground.

    Args:
        dataset: The dataset.
        part: Scenario and frames.
        folder: Folder of the scenario.
        shape: `hull` or `mesh`.

    Returns:
        What `params.json` says of the scene.
    """
    points, objects = _town(dataset.root, part.scenario)
    return _write_hulls(folder, points, objects) if shape == "hull" else _write(folder, points, objects)


def write_actors(dataset: Dataset, part: Part, folders: Sequence[Path]) -> dict[str, Any]:
    """Write boxes of vehicles and people in each frame into its folder, and a plane of ground below them.

    Objects are in the order of their ids, so that DeepMIMO can follow them from frame to frame while all are present.

    Returns:
        What `params.json` says of the scene in the first frame.
    """
    names = ["object_id", "x", "y", "z", "yaw", "pitch", "roll", "length", "width", "height"]
    rows = by_frame(Block(dataset, part.scenario, part.weather, part.frames).rows("boxes", names))
    corners = {
        frame: np.array([transform_points(box_pose(row), box_corners(row)) for row in found])
        for frame, found in rows.items()
    }
    every = np.concatenate([*corners.values()] or [np.zeros((1, 8, 3))]).reshape(-1, 3)
    low, high = every.min(axis=0), every.max(axis=0)
    ground = [[x, y, low[2]] for x in (low[0] - MARGIN, high[0] + MARGIN) for y in (low[1] - MARGIN, high[1] + MARGIN)]
    plane = ("terrain", "ground", np.array([[0, 2, 3], [0, 3, 1]], dtype=np.int32), np.zeros(2, dtype=np.int32))
    written = []
    for frame, folder in zip(part.frames, folders, strict=True):
        boxes = sorted(
            zip(rows.get(frame, []), corners.get(frame, ()), strict=True), key=lambda box: box[0]["object_id"]
        )
        objects = [
            ("objects", f"object_{row['object_id']}", BOX_FACES + 4 + 8 * index, np.zeros(12, dtype=np.int32))
            for index, (row, _) in enumerate(boxes)
        ]
        points = np.concatenate([np.array(ground), *(found for _, found in boxes)])
        written.append(_write(folder, points, [plane, *objects]))
    return written[0]


@lru_cache(maxsize=1)
def _town(root: Path, name: str) -> tuple[np.ndarray, list[Mesh]]:
    """Return vertices and objects of a scenario's static town; tasks of one scenario follow each other."""
    from mmw.config import load_config  # USD and Warp load for seconds, and no other format needs them
    from mmw.scene.prepare import stored_stage
    from mmw.scene.reader import read_stage

    config = load_config(root / CONFIG)
    scenario = next(found for found in config.scenarios if found.name == name)
    frames, weather = config.frames_of(scenario), config.weathers[0]
    arrays = read_stage(
        stored_stage(root, scenario),
        range(frames.start, frames.start + 1),
        {weather: config.variants[weather]},
        rate_hz=config.frame_rate_of(scenario),
        roles=scenario.actor_roles,
        material_map=config.materials_of(scenario),
        physics=config.channel.physics,
    )
    objects = {one.object_id: one for one in arrays.objects}
    faces: dict[tuple[str, str], list[np.ndarray]] = defaultdict(list)
    order = np.argsort(arrays.object_id, kind="stable")
    starts = np.flatnonzero(np.diff(arrays.object_id[order])) + 1
    for rows in np.split(order, starts):
        one = objects[int(arrays.object_id[rows[0]])]
        is_ground = one.label in GROUND
        key = ("terrain", "ground") if is_ground else (LABELS.get(one.label, "objects"), one.prim_path)
        faces[key].append(rows)
    joined = {key: np.concatenate(rows) for key, rows in faces.items()}
    meshes = [(label, path, arrays.faces[rows], arrays.material[rows]) for (label, path), rows in joined.items()]
    return arrays.points, meshes


def no_scene() -> dict[str, Any]:
    """Return what `params.json` says where no scene is written."""
    return _described("hull", 0, 0, 0, 0)


def _described(shape: str, objects: int, vertices: int, faces: int, triangles: int) -> dict[str, Any]:
    return {
        "representation": shape, "n_objects": objects, "n_vertices": vertices, "n_faces": faces,
        "n_triangular_faces": triangles,
    }  # fmt: skip


def _write_hulls(folder: Path, points: np.ndarray, objects: list[Mesh]) -> dict[str, Any]:
    """Write a scene of one upright prism an object, of the material that most of its area has."""
    vertices, entries, first = [], [], 0
    polygons = []
    for key, (label, name, faces, material) in enumerate(objects):
        corners, sides = prism(points[np.unique(faces)])
        use = main_material(points, faces, material)
        entries.append({"name": name, "label": label, "id": key, "face_material_idxs": [use] * len(sides),
                        "face_vertex_idxs": [[first + corner for corner in side] for side in sides]})  # fmt: skip
        vertices.append(corners)
        polygons += sides
        first += len(corners)
    np.savez_compressed(folder / "vertices.npz", vertices=np.concatenate(vertices))
    _write_objects(folder, entries)
    return _described("hull", len(objects), first, len(polygons), sum(len(side) - 2 for side in polygons))


def _write(folder: Path, points: np.ndarray, objects: list[Mesh]) -> dict[str, Any]:
    """Write a mesh scene."""
    np.savez_compressed(folder / "vertices.npz", vertices=points)
    np.savez_compressed(folder / "faces.npz", **{str(key): faces for key, (_, _, faces, _) in enumerate(objects)})
    np.savez_compressed(folder / "materials.npz", **{str(key): use for key, (_, _, _, use) in enumerate(objects)})
    entries = [{"name": name, "label": label, "id": key, "mesh_key": str(key)}
               for key, (label, name, _, _) in enumerate(objects)]  # fmt: skip
    _write_objects(folder, entries)
    triangles = sum(len(faces) for _, _, faces, _ in objects)
    return _described("mesh", len(objects), len(points), triangles, triangles)


def _write_objects(folder: Path, entries: list[dict[str, Any]]) -> None:
    text = ",\n".join(json.dumps(entry) for entry in entries)
    (folder / "objects.json").write_text(f"[\n{text}\n]\n", encoding="utf-8")
