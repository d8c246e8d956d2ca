"""Hostile files of every importer, and of recorded traffic."""

import io
import json
import random
import shutil
import struct
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import trimesh

from mmw.traffic.replay.trajectory_table import read_trajectories
from tests.fixtures.city_files import citygml, write_cityjson
from tests.fixtures.import_files import GROUND, HOUSE, write_glb, write_mitsuba, write_obj
from tests.fixtures.osm_files import quarter
from tests.fixtures.overture_files import HOUSES, write_overture
from tests.fixtures.recordings import COMMONROAD, FCD, lanelet_scenario, net_street, tracks_csv
from tests.fixtures.tile_files import batched, box_glb, write_tileset
from tests.fixtures.xodr_files import Plan, document, rise, road, street, t_town
from tests.fuzz.cases import Step, call, command
from tests.fuzz.map_excerpts import foreign_files
from tests.fuzz.mutations import NUMBERS, mutate_bytes, mutate_text, mutate_tree

MATERIALS = '"*": itu_concrete\n'


class Maps:
    """Small sound files, mutated as bytes, text and elements."""

    def prepare(self, folder: Path) -> None:
        self.folder = folder
        (folder / "town.xodr").write_text(t_town())
        plan = Plan(0.0, 0.0, 0.3).line(20.0).spiral(0.0, 0.02, 20.0).arc(0.02, 15.0)
        plan = plan.cubic_to(plan.pose[0] + 20.0, plan.pose[1] + 12.0, 1.2, 25.0)
        lateral = '<superelevation s="0" a="0.02" b="0" c="0" d="0"/>'
        offset = '<laneOffset s="0" a="0.1" b="0" c="0" d="0"/>'
        single = road(
            "7", plan, street(0.0) + street(30.0), elevation=rise(60.0, 0.0, 1.0), lateral=lateral, offset=offset
        )
        (folder / "road.xodr").write_text(document(single))
        (folder / "town.osm").write_text(quarter().text())
        write_mitsuba(folder / "mitsuba")
        write_glb(folder / "world.glb")
        write_obj(folder / "world.obj")
        house = trimesh.Trimesh(*HOUSE, process=False)
        for suffix in ("ply", "stl", "off"):
            house.export(folder / f"house.{suffix}")
        (folder / "house_text.ply").write_bytes(house.export(file_type="ply", encoding="ascii"))
        (folder / "ground_text.stl").write_text(trimesh.Trimesh(*GROUND).export(file_type="stl_ascii"))
        for name, data in trimesh.Scene(house).export(file_type="gltf").items():
            (folder / ("world.gltf" if name == "model.gltf" else name)).write_bytes(data)
        write_cityjson(folder / "model.city.json")
        write_cityjson(folder / "model.city.jsonl")
        (folder / "model.gml").write_text(citygml())
        write_tileset(folder / "tiles")
        (folder / "box.b3dm").write_bytes(batched(box_glb(), (10.0, 0.0, 0.0)))
        write_overture(folder / "buildings.parquet", HOUSES)
        for version, text in COMMONROAD.items():
            (folder / f"recorded_{version}.xml").write_text(text)
        (folder / "street.net.xml").write_text(net_street())
        (folder / "lanelets.xml").write_text(lanelet_scenario())
        (folder / "recorded_fcd.xml").write_text(FCD)
        (folder / "recorded.csv").write_text(tracks_csv())
        pyarrow.parquet.write_table(pyarrow.csv.read_csv(folder / "recorded.csv"), folder / "recorded.parquet")
        self.buffers = [path.name for path in folder.glob("*.bin")]
        self.foreign = foreign_files(folder)

    def make(self, rng: random.Random, folder: Path) -> list[Step]:
        foreign = bool(self.foreign) and rng.random() < 0.5
        name = rng.choice(self.foreign if foreign else list(_MUTATIONS))
        source = self.folder / name
        path = folder / source.name
        if source.parent != self.folder:
            shutil.copytree(source.parent, folder, dirs_exist_ok=True)
        for extra in (*self.buffers, "world.mtl"):
            shutil.copy(self.folder / extra, folder)
        path.write_bytes(rng.choice(_XML if foreign else _MUTATIONS[name])(rng, source.read_bytes()))
        if name == "mitsuba/scene.xml" and rng.random() < 0.3:
            mesh = folder / "meshes" / "house.ply"
            mesh.write_bytes(mutate_bytes(rng, mesh.read_bytes()))
        if name == "tiles/tileset.json" and rng.random() < 0.3:
            content = folder / rng.choice(("coarse.glb", "fine one.b3dm", "inner/fine.cmpt", "inner/tileset.json"))
            content.write_bytes(mutate_bytes(rng, content.read_bytes()))
        if name.startswith("recorded"):
            return [call(f"read_trajectories({name!r})", lambda: read_trajectories(path))]
        (folder / "materials.yaml").write_text(MATERIALS)
        placed = []
        if rng.random() < 0.2 and (
            name.startswith("mitsuba") or Path(name).suffix in (".glb", ".gltf", ".obj", ".ply", ".stl", ".off")
        ):
            placed = [
                "--unit",
                rng.choice(("mm", "km")),
                "--origin",
                *rng.choices(("0", "5", "nan", "1e300", "-inf"), k=3),
            ]
        given = ["--out", str(folder / "out"), "--materials", str(folder / "materials.yaml")]
        return [command("import", str(path), *given, *placed)]


def _text(rng: random.Random, data: bytes) -> bytes:
    return mutate_text(rng, data.decode()).encode(errors="surrogateescape")


def _elements(rng: random.Random, data: bytes) -> bytes:
    """Change attributes of elements, or remove, repeat and move elements."""
    root = ElementTree.fromstring(data)
    for _ in range(rng.choice((1, 1, 2, 3, 5))):
        every = list(root.iter())
        element = rng.choice(every)
        kind = rng.random()
        if kind < 0.6 and element.attrib:
            key = rng.choice(list(element.attrib))
            old = element.attrib[key]
            element.attrib[key] = rng.choice((*NUMBERS, *NUMBERS, f"-{old}", f"{old}000", "$x", "../x", "", "-1"))
        elif kind < 0.7 and element.attrib:
            del element.attrib[rng.choice(list(element.attrib))]
        elif len(element):
            child = rng.choice(list(element))
            if kind < 0.8:
                element.remove(child)
            elif kind < 0.9:
                element.extend([child] * rng.choice((1, 5, 50)))
            else:
                owner = rng.choice(every)
                if owner not in list(child.iter()):
                    owner.append(child)
    return ElementTree.tostring(root)


def _glb(rng: random.Random, data: bytes) -> bytes:
    """Change the JSON chunk, and keep the lengths right."""
    size = struct.unpack_from("<I", data, 12)[0]
    tree = json.loads(data[20 : 20 + size])
    text = json.dumps(mutate_tree(rng, tree)).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + size :]
    return data[:8] + struct.pack("<II", 20 + len(text) + len(rest), len(text)) + b"JSON" + text + rest


def _gltf(rng: random.Random, data: bytes) -> bytes:
    return json.dumps(mutate_tree(rng, json.loads(data))).encode()


def _json(rng: random.Random, data: bytes) -> bytes:
    """Change values of a JSON object, or of one line of several."""
    lines = data.splitlines()
    at = rng.randrange(len(lines))
    lines[at] = json.dumps(mutate_tree(rng, json.loads(lines[at]))).encode()
    return b"\n".join(lines)


def _header(rng: random.Random, data: bytes) -> bytes:
    """Change a length in the header of a tile."""
    at = rng.choice((4, 8, 12, 16, 20, 24))
    number = rng.choice((0, 1, 7, 28, len(data), len(data) + 1, 2**31 - 1, 2**32 - 1))
    return data[:at] + struct.pack("<I", number) + data[at + 4 :]


def _values(rng: random.Random, data: bytes) -> bytes:
    """Change values of a Parquet table; each keeps the type of its column, or the whole column gets another."""
    table = pyarrow.parquet.read_table(io.BytesIO(data))
    for _ in range(rng.choice((1, 1, 2, 4))):
        at = rng.randrange(table.num_columns)
        field, values = table.schema.field(at), table.column(at).to_pylist()
        row = rng.randrange(len(values))
        if isinstance(values[row], bytes):
            values[row] = mutate_bytes(rng, values[row])
        elif rng.random() < 0.1:
            field, values = pa.field(field.name, pa.string()), [str(value) for value in values]
        elif pa.types.is_floating(field.type):
            values[row] = rng.choice((None, float("nan"), float("inf"), -1.0, 0.0, 1e-300, 1e12, 1e300))
        elif pa.types.is_string(field.type):
            values[row] = rng.choice(("", "nan", "-1", "../x", "a" * 300, "#zz", "12 ft", "é"))
        else:
            values[row] = None
        table = table.set_column(at, field, pa.array(values, field.type))
    out = io.BytesIO()
    pyarrow.parquet.write_table(table, out)
    return out.getvalue()


Mutation = Callable[[random.Random, bytes], bytes]
_XML: tuple[Mutation, ...] = (_elements, _elements, _elements, _elements, _text, _text, mutate_bytes)
_MUTATIONS: dict[str, tuple[Mutation, ...]] = {
    "road.xodr": _XML, "town.xodr": _XML, "town.osm": _XML, "mitsuba/scene.xml": _XML,
    "world.glb": (_glb, _glb, mutate_bytes), "world.gltf": (_gltf, _gltf, _text), "world.obj": (_text, _text,
    mutate_bytes),
    "house.ply": (mutate_bytes,), "house_text.ply": (_text,), "house.stl": (mutate_bytes,), "ground_text.stl": (_text,),
    "house.off": (_text,),
    "model.city.json": (_json, _json, _json, _text, mutate_bytes), "model.city.jsonl": (_json, _json, _text),
    "model.gml": _XML, "tiles/tileset.json": (_json, _json, _json, _text), "box.b3dm": (_header, mutate_bytes),
    "buildings.parquet": (_values, _values, mutate_bytes), "lanelets.xml": _XML, "recorded_2020a.xml": _XML,
    "recorded_2018b.xml": _XML, "street.net.xml": _XML,
    "recorded_fcd.xml": _XML, "recorded.csv": (_text,), "recorded.parquet": (_values, mutate_bytes),
}  # fmt: skip
