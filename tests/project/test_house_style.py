"""The house style, executable: file length, import direction, kernel signatures, units of fields and columns."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pyarrow as pa

ROOT = Path(__file__).resolve().parents[2]
KERNELS_LINK = ROOT / "mmw" / "kernels"
"""Leads to `kernels/`, which is checked under its own name. Compared whole: a clone's own folder may be called mmw."""
SOURCES = sorted(
    p
    for folder in ("mmw", "kernels", "tests", "bench", "examples")
    for p in (ROOT / folder).rglob("*.py")
    if KERNELS_LINK not in p.parents
)
KERNELS = sorted((ROOT / "kernels").rglob("*.py"))


def imports_of(path: Path) -> list[str]:
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            found += [f"{node.module}.{alias.name}" for alias in node.names]
    return found


def test_files_are_short() -> None:
    assert [path for path in SOURCES if len(path.read_text().splitlines()) > 400] == []


def test_kernels_import_only_warp_and_kernels() -> None:
    for path in KERNELS:
        others = [name for name in imports_of(path) if not name.startswith(("warp", "mmw.kernels", "typing"))]
        assert others == [], path


def test_no_module_imports_a_test_module() -> None:
    for path in SOURCES:
        assert not any(re.match(r"tests\.(\w+\.)*test_", name) for name in imports_of(path)), path


def test_docstrings_do_not_open_with_a_question_word() -> None:
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text())):
            match node:
                case ast.Expr(value=ast.Constant(value=str(text))):
                    assert not re.match(r"\s*(What|Where|Which|Who)\b", text), f"{path}:{node.lineno}"


def test_only_trace_touches_a_tree() -> None:
    """Hulls of foliage have a tree of their own, of which every face on a ray counts."""
    own_trees = ("channel/edge_contacts.py", "channel/side_by_side.py")  # of boxes, without groups, which no ray meets
    allowed = ("core/trace.py", "core/bvh.py", "core/bvh_warp.py", *own_trees, "channel/foliage.py")
    for path in KERNELS:
        if path.relative_to(ROOT / "kernels").as_posix() not in allowed:
            assert not re.search(r"wp\.(mesh_query|bvh_query|bvh_get)|walk_(nearest|any)", path.read_text()), path


def test_only_the_tree_is_native_code() -> None:
    assert [path.name for path in KERNELS if "func_native" in path.read_text()] == ["bvh.py"]


def test_kernel_signatures() -> None:
    for path in KERNELS:
        for node in ast.walk(ast.parse(path.read_text())):
            decorators = [ast.unparse(decorator) for decorator in getattr(node, "decorator_list", ())]
            if not any(decorator.startswith(("wp.kernel", "wp.func")) for decorator in decorators):
                continue
            where, doc, arguments = f"{path.name}:{node.name}", ast.get_docstring(node), node.args.args
            assert not node.args.defaults, f"{where} has default values"
            assert doc, f"{where} has no docstring"
            assert all(argument.annotation is not None for argument in arguments), f"{where} has an untyped argument"
            if any(decorator.startswith("wp.kernel") for decorator in decorators):
                assert node.name.endswith("_kernel"), f"{where} must end in _kernel"
                assert "Launch:" in doc, f"{where} does not say how it is launched"
                outputs = [argument.arg.endswith("_out") for argument in arguments]
                assert outputs == sorted(outputs), f"{where}: outputs (`_out`) come last"
                assert any(outputs), f"{where} has no output"


UNIT_OF_SUFFIX = {
    "_per_m": "[1/m]", "_m_s": "[m/s]", "_m": "[m]", "_deg": "[deg]", "_hz": "[Hz]", "_s": "[s]", "_px": "[px]",
}  # fmt: skip
"""End of a field's name -> unit at the end of its description; the first that fits counts."""


def test_config_fields_say_their_unit() -> None:
    from mmw.config.load import json_schema

    schema = json_schema()
    sections = {"Config": schema, **schema["$defs"]}
    assert len(sections) >= 10
    for section, parts in sections.items():
        for name, field in parts.get("properties", {}).items():
            if name != "type":
                text = field.get("description", "")
                assert re.search(r"[\[(][^\])]+[\])]$", text), f"{section}.{name} must have a description with its unit"
                unit = next((unit for suffix, unit in UNIT_OF_SUFFIX.items() if name.endswith(suffix)), "")
                assert text.endswith(unit), f"{section}.{name} must end with {unit}"


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


def test_core_dependencies_are_enough() -> None:
    """Running shipped towns, checking towns and importing meshes needs no extra."""
    code = (
        "import sys\n"
        "extras = 'shapely scipy mapbox_earcut matplotlib libsumo osmium duckdb torch rerun ray'\n"
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
