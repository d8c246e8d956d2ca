"""The house style, executable: file length, import direction, kernel signatures, units of fields and columns."""

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pyarrow as pa
import pytest
from pydantic import BaseModel

ROOT = Path(__file__).resolve().parents[2]
KERNELS_LINK = ROOT / "mmw" / "kernels"
"""Leads to `kernels/`, which is checked under its own name. Compared whole: a clone's own folder may be called mmw."""
SOURCES = sorted(
    p
    for folder in ("mmw", "kernels", "tests", "bench", "examples")
    for p in (ROOT / folder).rglob("*.py")
    if KERNELS_LINK not in p.parents
)
KERNELS = sorted((ROOT / "kernels").glob("*.py"))

LAYERS = [
    {
        "mmw.core.errors",
        "mmw.core.extras",
        "mmw.core.resources",
        "mmw.core.log_files",
        "mmw.core.temp_files",
        "mmw.core.constants",
        "mmw.physics.materials.appearance",
    }
    | {
        "mmw.physics.materials.material",
        "mmw.core.transforms",
        "mmw.core.kinematics",
        "mmw.physics.weather.weather",
        "mmw.physics.weather.carla",
        "mmw.physics.weather.optics",
    }
    | {"mmw.sensors.lidar.optics", "mmw.core.camera_models", "mmw.core.random_keys"},
    {"mmw.config"},
    {"mmw.kernels"},
    {"mmw.core.bvh_kind", "mmw.core.bvh"},
    {"mmw.usd", "mmw.core.planar_surfaces"},
    {"mmw.worlds.vehicles"},
    {"mmw.worlds.towns"},
    {"mmw.worlds.importers"},
    {"mmw.traffic"},
    {"mmw.worlds.checks"},
    {"mmw.scene.stage"},
    {"mmw.scene.scene_data"},
    {"mmw.scene_actors", "mmw.scene.reader", "mmw.scene.device_scene"},
    {"mmw.sensors.lidar.scan_pattern", "mmw.scene.views"},
    {"mmw.channel", "mmw.sensors"},
    {"mmw.storage"},
    {"mmw.dataset"},
    {"mmw.dataset.windows", "mmw.viz.plots"},
    {"mmw.torch"},
    {"mmw.core", "mmw.generation.progress", "mmw.cli.command"},
    {
        "mmw.generation.estimate",
        "mmw.generation.provenance",
        "mmw.generation.configuration_warnings",
        "mmw.sensors.mount_checks",
        "mmw.generation.shards",
    },
    {"mmw.scene.prepare"},
    {"mmw.dataset.export"},
    {"mmw.viz.rerun", "mmw.viz.report"},
    {"mmw.viz.stills", "mmw.cli.radio_map", "mmw.cli.town", "mmw.cli.import_scene", "mmw.cli.view"}
    | {"mmw.cli.export", "mmw.cli.report"},
    {"mmw.generation.recorders"},
    {"mmw.generation.pipeline"},
    {"mmw.generation.worker"},
    {"mmw.generation.executors"},
    {"mmw.generation.generate"},
    {"mmw.generation.regenerate"},
    {"mmw.generation.verification"},
    {"mmw.run", "mmw.cli.row", "mmw.cli.status", "mmw.cli.finalize", "mmw.cli.verify", "mmw.__main__"},
]
"""Data flows down this list: a module imports only what stands in its own or an earlier row."""


def name_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(("mmw", *parts) if parts[0] == "kernels" else parts).removesuffix(".__init__")


def layer_of(module: str) -> int | None:
    for index, layer in enumerate(LAYERS):
        if any(module == name or module.startswith(name + ".") for name in layer):
            return index
    return None


def imports_of(path: Path) -> list[str]:
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            found += [f"{node.module}.{alias.name}" for alias in node.names]
    return found


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_file_is_short(path: Path) -> None:
    assert len(path.read_text().splitlines()) <= 400


@pytest.mark.parametrize(
    "path", [p for p in SOURCES if p.is_relative_to(ROOT / "mmw")], ids=lambda p: str(p.relative_to(ROOT))
)
def test_imports_point_one_way(path: Path) -> None:
    module = name_of(path)
    if module == "mmw":
        return
    own = layer_of(module)
    assert own is not None, f"{module} stands in no layer; add it to LAYERS"
    for name in imports_of(path):
        if name.startswith("mmw.") and name != "mmw.__version__":
            other = layer_of(name)
            assert other is not None, f"{module} imports {name}, which stands in no layer"
            assert other <= own, f"{module} imports {name}, which stands to its right"


@pytest.mark.parametrize("path", KERNELS, ids=lambda p: p.name)
def test_kernels_import_only_warp_and_kernels(path: Path) -> None:
    assert all(name.split(".")[0] == "warp" or name.startswith("mmw.kernels") for name in imports_of(path))


def test_kernels_is_no_package_of_its_own() -> None:
    assert not (ROOT / "kernels" / "__init__.py").exists()
    for path in SOURCES:
        assert not any(name == "kernels" or name.startswith("kernels.") for name in imports_of(path)), path


def test_only_trace_touches_a_tree() -> None:
    for path in KERNELS:
        if path.name not in ("trace.py", "tree.py", "tree_warp.py"):
            assert not re.search(r"wp\.(mesh_query|bvh_query|bvh_get)|walk_(nearest|any)", path.read_text()), path


def test_only_the_tree_is_native_code() -> None:
    assert [path.name for path in KERNELS if "func_native" in path.read_text()] == ["tree.py"]


@pytest.mark.parametrize("path", KERNELS, ids=lambda p: p.name)
def test_kernel_signatures(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.FunctionDef):
            continue
        decorators = [ast.unparse(d) for d in node.decorator_list]
        if not any(d.startswith(("wp.kernel", "wp.func")) for d in decorators):
            continue
        assert not node.args.defaults, f"{path.name}:{node.name} has default values"
        assert ast.get_docstring(node), f"{path.name}:{node.name} has no docstring"
        for argument in node.args.args:
            assert argument.annotation is not None, f"{path.name}:{node.name}: {argument.arg} has no type"
        if any(d.startswith("wp.kernel") for d in decorators):
            assert node.name.endswith("_kernel"), f"{path.name}:{node.name} must end in _kernel"
            assert "Launch:" in (ast.get_docstring(node) or ""), (
                f"{path.name}:{node.name} does not say how it is launched"
            )
            outputs = [argument.arg.endswith("_out") for argument in node.args.args]
            assert outputs == sorted(outputs), f"{path.name}:{node.name}: outputs (`_out`) come last"
            assert any(outputs), f"{path.name}:{node.name} has no output"


def config_models() -> list[type[BaseModel]]:
    from mmw.config import Config

    seen: list[type[BaseModel]] = []

    def walk(schema: type[BaseModel]) -> None:
        if schema in seen:
            return
        seen.append(schema)
        for info in schema.model_fields.values():
            for found in find(info.annotation):
                walk(found)

    def find(annotation: object) -> list[type[BaseModel]]:
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            return [annotation]
        return [model for argument in getattr(annotation, "__args__", ()) for model in find(argument)]

    walk(Config)
    return seen


UNIT_OF_SUFFIX = {
    "_per_m": "[1/m]", "_m_s": "[m/s]", "_m": "[m]", "_deg": "[deg]", "_hz": "[Hz]", "_s": "[s]", "_px": "[px]",
}  # fmt: skip
"""End of a field's name -> unit at the end of its description; the first that fits counts."""


def test_config_fields_say_their_unit() -> None:
    models = config_models()
    assert len(models) >= 10
    for model in models:
        for name, info in model.model_fields.items():
            if name == "type":
                continue
            assert info.description, f"{model.__name__}.{name} has no description"
            assert re.search(r"[\[(][^\])]+[\])]$", info.description), f"{model.__name__}.{name} must end with its unit"
            unit = next((unit for suffix, unit in UNIT_OF_SUFFIX.items() if name.endswith(suffix)), "")
            assert info.description.endswith(unit), f"{model.__name__}.{name} must end with {unit}"


def test_table_columns_have_unit_and_meaning() -> None:
    from mmw.storage.schemas import TABLES

    for table, spec in TABLES.items():
        for column in spec.columns:
            metadata = column.metadata or {}
            assert metadata.get(b"doc"), f"{table}.{column.name} has no meaning"
            value = column.type
            while pa.types.is_list(value):
                value = value.value_type
            if pa.types.is_floating(value):
                assert metadata.get(b"unit"), f"{table}.{column.name} has no unit"


def test_packages_list_every_folder_with_files() -> None:
    """setuptools discovers nothing here, so a folder that is not listed would be missing from the wheel."""
    listed = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"])
    needed = set()
    for folder, prefix in (
        ("mmw", "mmw"),
        ("kernels", "mmw.kernels"),
        ("configs", "mmw.configs"),
        ("assets", "mmw.assets"),
    ):
        for path in (ROOT / folder).rglob("*"):
            if (
                path.is_file()
                and path.suffix in (".py", ".yaml", ".json", ".usda", ".usdc", ".png")
                and KERNELS_LINK not in path.parents
            ):
                inner = path.parent.relative_to(ROOT / folder).parts
                needed.add(".".join((prefix, *inner)))
    assert listed == needed


def test_core_dependencies_are_enough() -> None:
    """Running shipped towns, checking towns and importing meshes needs no extra."""
    code = (
        "import sys\n"
        "extras = 'shapely scipy mapbox_earcut matplotlib libsumo duckdb torch rerun ray'\n"
        "for name in extras.split():\n"
        "    sys.modules[name] = None\n"
        "class NoPandas:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name == 'pandas':\n"
        "            raise ModuleNotFoundError(name)\n"
        "sys.meta_path.insert(0, NoPandas())  # pyarrow looks into sys.modules and would stumble over None\n"
        "import mmw.__main__, mmw.cli.export, mmw.cli.import_scene, mmw.worlds.checks.check, mmw.generation.pipeline\n"
        "import mmw.cli.radio_map, mmw.cli.report, mmw.run, mmw.cli.verify, mmw.dataset.windows\n"
        "import mmw.generation.executors.executor, mmw.cli.town, mmw.traffic.engine\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)
