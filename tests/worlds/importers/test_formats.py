"""Importers are chosen from the registry, and a package of its own adds one without a change in mmw."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from mmw.core.errors import InputError
from mmw.core.registry import load_reference
from mmw.worlds.importers.formats import IMPORTERS, Importer, find_importer, read_scene

ROOT = Path(__file__).resolve().parents[3]
MODULE = '''
import numpy as np
from mmw.core.mesh import TriangleMesh
from mmw.physics.materials.material import RadioMaterial
from mmw.worlds.importers.imported_scene import ImportedMaterial, ImportedScene
from mmw.worlds.importers.formats import Importer
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.primitives import box

def read_boxes(path, *, height="3"):
    """Read a text file with the width of a box a line."""
    brick = ImportedMaterial("brick", "brick", radio=RadioMaterial("itu", itu="itu_brick"))
    widths = [float(line) for line in path.read_text().split()]
    parts = [
        MeshPart.of(f"Boxes/box_{k}", box((width, width, float(height)), (20.0 * k, 0.0, 0.0)), "brick", "building")
        for k, width in enumerate(widths)
    ]
    return ImportedScene(parts, {"brick": brick})

BOXES = Importer((".boxes",), "mmw_boxes:read_boxes", "boxes of brick", {"height": "height of the boxes [m]"})
RIVAL = Importer((".xodr",), "mmw_boxes:read_boxes", "roads of another reader", {})
'''


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Lay out a package as pip does, and return the environment of a process that sees it and its entry points."""
    folder = tmp_path_factory.mktemp("boxes")
    (folder / "mmw_boxes.py").write_text(MODULE)
    info = folder / "mmw_boxes-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mmw-boxes\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[mmw.importers]\nboxes = mmw_boxes:BOXES\nrival = mmw_boxes:RIVAL\n")
    return os.environ | {"PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])}


def run(environment: dict[str, str], *arguments: str, code: int = 0) -> str:
    result = subprocess.run(
        [sys.executable, "-m", "mmw", "import", *arguments], env=environment, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert result.returncode == code, result.stdout + result.stderr
    return result.stdout + result.stderr


def test_another_package_adds_a_format(installed: dict[str, str], tmp_path: Path) -> None:
    listed = run(installed, "--list")
    assert "boxes: .boxes: boxes of brick (from mmw-boxes)\n  height: height of the boxes [m]" in listed
    assert "opendrive: .xodr: OpenDRIVE" in listed and "mitsuba: .xml: " in listed
    (tmp_path / "some.boxes").write_text("4\n6\n")
    text = run(installed, str(tmp_path / "some.boxes"), "height=5", "--out", str(tmp_path / "out"))
    assert "24 triangles in 2 meshes" in text and "26.00 x 6.00 x 5.00 m" not in text and "x 6.00 x 5.00 m" in text
    assert (tmp_path / "out" / "some.usda").is_file()
    text = run(installed, str(tmp_path / "some.boxes"), "depth=5", "--out", str(tmp_path / "no"), code=2)
    assert "depth: no option of .boxes files; options are: height; remove depth" in text


def test_two_importers_of_one_suffix_are_named(installed: dict[str, str], tmp_path: Path) -> None:
    (tmp_path / "a.xodr").write_text("7\n")
    text = run(installed, str(tmp_path / "a.xodr"), "--out", str(tmp_path / "out"), code=2)
    assert ".xodr is read by opendrive of mmw and rival of mmw-boxes; choose one with --importer" in text
    run(installed, str(tmp_path / "a.xodr"), "--importer", "rival", "--out", str(tmp_path / "out"))
    assert (tmp_path / "out" / "a.usda").is_file()


@pytest.mark.parametrize("name", IMPORTERS)
def test_references_exist_and_suffixes_find_their_importer(name: str, tmp_path: Path) -> None:
    assert isinstance(IMPORTERS[name], Importer) and callable(load_reference(IMPORTERS[name].read))
    for suffix in IMPORTERS[name].suffixes:
        path = tmp_path / f"Some.File{suffix.upper()}"
        if IMPORTERS[name].root:  # several read such files
            path.write_text(f"<{IMPORTERS[name].root}/>")
        assert find_importer(path) == name


@pytest.mark.parametrize(
    ("path", "name", "message"),
    [
        ("a.blend", "", r"\.blend is not read; give one of \.xml, "),
        ("plain", "", "a file without a suffix is not read"),
        ("a.xml", "blender", "importer 'blender': is not known; give one of mitsuba"),
    ],
)
def test_no_importer_is_an_error(path: str, name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_scene(Path(path), name)
