"""3D Tiles: the finest tiles at their places on the earth, and faults with element and cure."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from mmw.__main__ import main
from mmw.worlds.importers.formats import read_scene
from tests.fixtures.tile_files import REFERENCE, batched, box_glb, write_tileset


def test_the_finest_tiles_lie_where_the_tileset_says(tmp_path: Path):
    scene = read_scene(write_tileset(tmp_path))
    boxes = {part.path: part.mesh.bounds for part in scene.parts}
    assert len(boxes) == 3
    size = np.array([high - low for low, high in boxes.values()])
    assert size == pytest.approx(np.tile([4.0, 4.0, 3.0], (3, 1)), abs=1e-3)
    centers = {path: 0.5 * (low + high) for path, (low, high) in boxes.items()}
    fine, inner, added = (next(c for path, c in centers.items() if name in path) for name in ("one", "/fine/", "added"))
    # the plane of latitude and longitude keeps heights over the ellipsoid: 20 m aside they differ by 0.03 mm
    assert fine - added == pytest.approx([10.0, 0.0, -10.0], abs=2e-3)
    assert inner - added == pytest.approx([-5.0, 20.0, -10.0], abs=2e-3)
    assert min(low[2] for low, _ in boxes.values()) == pytest.approx(0.0, abs=0.01)
    latitude, longitude, height = REFERENCE
    (origin,) = (note for note in scene.notes if note.startswith("origin: "))
    assert f"height {height:.2f} m" in origin
    found = [float(number) for number in re.findall(r"itude ([\d.]+)", origin)]
    middle = [latitude + 10.0 / 111_200, longitude + 2.5 / 74_600]  # meters of a degree at 48 deg
    assert found == pytest.approx(middle, abs=2e-6)
    assert scene.georeference is not None
    assert [scene.georeference.latitude, scene.georeference.longitude] == pytest.approx(found, abs=1e-6)
    assert "left out: 1 pnts" in scene.notes


def test_a_batched_model_alone(tmp_path: Path):
    (tmp_path / "b.b3dm").write_bytes(batched(box_glb((1.0, 2.0, 1.5)), (100.0, 0.0, 0.0)))
    (part,) = read_scene(tmp_path / "b.b3dm").parts
    assert part.mesh.bounds == pytest.approx(np.array([[99.0, 0.0, 0.0], [103.0, 4.0, 3.0]]), abs=1e-5)
    a, b, c = np.moveaxis(part.mesh.corners, 1, 0)
    assert np.einsum("fk,fk->f", a - 100.0, np.cross(b - 100.0, c - 100.0)).sum() / 6.0 == pytest.approx(48.0, rel=1e-4)


def test_the_town_is_sound(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = write_tileset(tmp_path / "t")
    (tmp_path / "map.yaml").write_text('"*": {radio: itu_concrete, label: building}\n')
    given = ["--out", str(tmp_path / "out"), "--materials", str(tmp_path / "map.yaml")]
    assert main(["import", str(path), *given]) == 0
    assert main(["town", "check", str(tmp_path / "out" / "tileset.usda")]) == 0, capsys.readouterr().out


def test_faults_name_tile_and_cure(tmp_path: Path):
    path = write_tileset(tmp_path)
    sound = path.read_text()

    def refused(match: str, text: str = sound) -> None:
        path.write_text(text)
        with pytest.raises(ValueError, match=match) as caught:
            read_scene(path)
        assert str(caught.value).startswith(str(tmp_path))

    refused(r"tileset.json: is no tileset \(no 'root'\)", "{}")
    refused(
        r"root.children\[1\]: https://x.org/a.glb is not a local file; download",
        sound.replace("added.glb", "https://x.org/a.glb"),
    )
    refused(
        r"gone.glb: cannot be read \(No such file or directory\); download all", sound.replace("added.glb", "gone.glb")
    )
    refused(r"the tileset contains itself", sound.replace("added.glb", "tileset.json"))
    tree = json.loads(sound)
    tree["root"]["transform"] = [1.0]
    refused(r"tileset.json: root.transform: 16 numbers are needed", json.dumps(tree))
    tree["root"] = {"implicitTiling": {}}
    refused(r"root: implicit tiling is not read; give a tileset that lists", json.dumps(tree))
    (tmp_path / "added.glb").write_bytes(b"PK\x03\x04")
    refused(r"added.glb: begins with b'PK.*a glb, b3dm or cmpt is needed; convert")
    (tmp_path / "added.glb").write_bytes(b"b3dm" + b"\xff" * 24)
    refused(r"added.glb: ends after 28 bytes")
