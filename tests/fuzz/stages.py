"""Hostile USD stages: text, crates, and attribute values that no tool should write."""

import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from tests.fixtures.import_files import write_stage
from tests.fixtures.own_world import DATA, write_own_world
from tests.fixtures.stages import write_scenario
from tests.fuzz.cases import Step, command
from tests.fuzz.mutations import mutate_bytes, mutate_text

OWN = "mine.usda"


class Stages:
    """Small stages, each checked, imported and, with a moving vehicle, run."""

    def prepare(self, folder: Path) -> None:
        self.folder = folder
        write_own_world(folder)
        write_stage(folder / "house.usda", up="Y", metres_per_unit=0.01).Save()
        self.drive = folder / "drive"
        shutil.copytree(DATA / "drive", self.drive)
        (folder / "scenario").mkdir()
        write_scenario(folder / "scenario")
        self.write_instances(folder / "instances.usda")
        self.texts = {path.relative_to(folder): path.read_text() for path in sorted(folder.rglob("*.usda"))}

    def write_instances(self, path: Path) -> None:
        """Write a stage with a point instancer, instances, face sets and a reference to one of its own prims."""
        stage = Usd.Stage.CreateNew(str(path))
        UsdGeom.SetStageUpAxis(stage, "Z")
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        stage.DefinePrim("/World", "Xform")
        stage.SetDefaultPrim(stage.GetPrimAtPath("/World"))
        mesh = UsdGeom.Mesh.Define(stage, "/World/Protos/tile")
        mesh.CreatePointsAttr([(0, 0, 0), (2, 0, 0), (2, 2, 0), (1, 0.5, 0), (0, 2, 0)])
        mesh.CreateFaceVertexCountsAttr([5])
        mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3, 4])
        mesh.CreateHoleIndicesAttr([])
        UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex").Set([(0, 0)] * 5)
        UsdGeom.Subset.CreateGeomSubset(mesh, "part", "face", Vt.IntArray([0]), "materialBind")
        scatter = UsdGeom.PointInstancer.Define(stage, "/World/scatter")
        scatter.CreatePrototypesRel().SetTargets([mesh.GetPath()])
        scatter.CreateProtoIndicesAttr([0, 0, 0])
        scatter.CreatePositionsAttr([(0, 0, 0), (5, 0, 0), (0, 5, 1)])
        scatter.CreateOrientationsAttr([Gf.Quath(1, 0, 0, 0)] * 3)
        scatter.CreateScalesAttr([(1, 1, 1)] * 3)
        for name in ("a", "b"):
            prim = stage.DefinePrim(f"/World/{name}", "Xform")
            prim.GetReferences().AddInternalReference("/World/Protos")
            prim.SetInstanceable(name == "b")
            UsdGeom.Xformable(prim).AddTranslateOp().Set((3.0, 7.0, 0.0))
        for kind in ("Sphere", "Cylinder", "Cone", "Capsule", "Plane"):
            stage.DefinePrim(f"/World/{kind}", kind)
        stage.Save()

    def make(self, rng: random.Random, folder: Path) -> list[Step]:
        name = rng.choice(list(self.texts))
        source = self.folder / name
        for path in source.parent.iterdir():
            if path.is_file():
                shutil.copy(path, folder)
        path = folder / name.name
        kind = rng.random()
        if kind < 0.4:
            path.write_bytes(mutate_text(rng, self.texts[name]).encode(errors="surrogateescape"))
        elif kind < 0.6:
            _write_values(rng, path)
        elif kind < 0.65:
            path.write_text(rng.choice(_STAGES)(rng))
        else:  # a crate that says .usda is read by its content, as all files are
            layer = Sdf.Layer.OpenAsAnonymous(str(path))
            crate = folder / "crate.usdc"
            layer.Export(str(crate))
            data = crate.read_bytes()
            path.write_bytes(mutate_bytes(rng, data) if rng.random() < 0.8 else _tail_bytes(rng, data))
            crate.unlink()
        steps = [
            command("town", "check", str(path)),
            command("import", str(path), "--out", str(folder / "out")),
        ]
        if path.name == OWN:
            shutil.copy(self.folder / "mine.yaml", folder)
            given = ("frames.count=2", "--device", "cpu", "--workers", "1")
            steps.append(command("run", "--config", str(folder / "mine.yaml"), "--out", str(folder / "d"), *given))
        return steps


def _tail_bytes(rng: random.Random, data: bytes) -> bytes:
    """Change bytes of the sections at the end of a crate, where counts and offsets are."""
    start = int(len(data) * 0.7)
    return data[:start] + mutate_bytes(rng, data[start:])


def _write_values(rng: random.Random, path: Path) -> None:
    """Set attributes to values of their own type that make no sense."""
    stage = Usd.Stage.Open(str(path))
    attributes = [a for prim in stage.Traverse() for a in prim.GetAttributes() if a.HasAuthoredValue()]
    for attribute in rng.sample(attributes, min(len(attributes), rng.choice((1, 1, 2, 4)))):
        value = attribute.Get() if attribute.Get() is not None else attribute.Get(0)
        new = _hostile(rng, value)
        if new is not None:
            times = attribute.GetTimeSamples()
            attribute.Set(new, rng.choice(times)) if times and rng.random() < 0.7 else attribute.Set(new)
    if rng.random() < 0.3:
        prim = rng.choice(list(stage.Traverse()))
        prim.SetTypeName(
            rng.choice(("Mesh", "PointInstancer", "Material", "Xform", "Shader", "NoSuchType", "GeomSubset", ""))
        )
    if rng.random() < 0.2:
        prim, target = rng.choices(list(stage.Traverse()), k=2)
        rng.choice((prim.GetReferences().AddInternalReference, prim.GetInherits().AddInherit))(target.GetPath())
    if rng.random() < 0.2:
        UsdGeom.SetStageMetersPerUnit(stage, rng.choice((0.0, -1.0, 1e-30, 1e30, float("nan"), float("inf"))))
    if rng.random() < 0.1:
        stage.SetStartTimeCode(rng.choice((float("nan"), -1e300, 1e300)))
    stage.GetRootLayer().Save()


def _hostile(rng: random.Random, value: Any) -> Any:
    number = rng.choice((float("nan"), float("inf"), -float("inf"), 1e38, 1e300, -1.0, 0.0, 1e-30))
    integer = rng.choice((-1, 0, 1, 2, 10**6, 2**31 - 1, -(2**31)))
    if isinstance(value, bool | str):
        return rng.choice(("", "x", "../x", "leftHanded", "invisible")) if isinstance(value, str) else not value
    if isinstance(value, float):
        return number
    if isinstance(value, int):
        return integer
    if type(value).__name__.endswith("Array"):
        items = list(value)
        kind = rng.random()
        if kind < 0.2:
            return type(value)([])
        if kind < 0.35:
            return type(value)(items * rng.choice((2, 100, 2_000)))
        if kind < 0.5 and items:
            return type(value)(items[:-1])
        if items:
            new = _hostile(rng, items[0])
            items[rng.randrange(len(items))] = items[0] if new is None else new
            return type(value)(items)
        return None
    if type(value).__name__.startswith("Vec"):
        return type(value)(*([number if "i" not in type(value).__name__ else integer] * len(value)))
    if type(value).__name__.startswith("Quat"):
        return type(value)(number, number, 0, 0)
    if type(value).__name__.startswith("Matrix"):
        return type(value)(number)
    return None


def _tree(rng: random.Random, instanceable: bool) -> str:
    """Return a stage whose prims grow tenfold with each level of references."""
    levels, flag = rng.choice((3, 7, 9)), "instanceable = true" if instanceable else ""
    parts = ['#usda 1.0\n(\n upAxis = "Z"\n metersPerUnit = 1\n)\ndef Mesh "L0" {\n'
             ' int[] faceVertexCounts = [3]\n int[] faceVertexIndices = [0, 1, 2]\n'
             " point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]\n}\n"]  # fmt: skip
    for level in range(1, levels + 1):
        inner = "".join(f' def "c{k}" ({flag} references = </L{level - 1}>) {{}}\n' for k in range(10))
        parts.append(f'def Xform "L{level}" {{\n{inner}}}\n')
    return "".join(parts)


def _deep(rng: random.Random) -> str:
    depth = rng.choice((50, 500, 5_000))
    return "#usda 1.0\n" + 'def Xform "a" {\n' * depth + "}\n" * depth


def _cycle(rng: random.Random) -> str:
    return rng.choice(
        (
            '#usda 1.0\ndef "A" (references = </B>) {}\ndef "B" (references = </A>) {}\n',
            '#usda 1.0\ndef "A" (references = </A/B>) { def "B" (references = </A>) {} }\n',
            "#usda 1.0\n(subLayers = [@./mine.usda@, @./house.usda@, @./instances.usda@])\n",
            '#usda 1.0\ndef "A" (inherits = </B>) {}\nclass "B" (inherits = </A>) {}\n',
        )
    )


def _many(rng: random.Random) -> str:
    count = rng.choice((1_000, 300_000))
    return (
        '#usda 1.0\n(upAxis = "Z"\n metersPerUnit = 1)\ndef Mesh "M" {\n int[] faceVertexCounts = [3]\n'
        " int[] faceVertexIndices = [0, 1, 2]\n point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]\n}\n"
        f'def PointInstancer "P" {{\n rel prototypes = </M>\n int[] protoIndices = {[0] * count}\n'
        f" point3f[] positions = [{'(1, 2, 3), ' * (count - 1)}(0, 0, 0)]\n}}\n"
    )


_STAGES: tuple[Callable[[random.Random], str], ...] = (
    lambda rng: _tree(rng, True), lambda rng: _tree(rng, False), _deep, _cycle, _many,
)  # fmt: skip
