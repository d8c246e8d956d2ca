"""A stage is loaded, solved and shown by the public names alone."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rerun")
pytest.importorskip("matplotlib")

import mmw
from tests.fixtures.rrd_files import read_recording


def test_a_stage_is_loaded_solved_and_shown(town: Path, tmp_path: Path) -> None:
    scene = mmw.load_scene(town, device="cpu")
    low, high = scene.bounds
    middle = 0.5 * (low + high)
    scene.add(mmw.Transmitter("mast", position=(middle[0] - 6.0, middle[1], high[2] + 5.0)))
    scene.add(mmw.Receiver("phone", position=(middle[0] + 6.0, middle[1], high[2] + 2.0)))
    paths = mmw.PathSolver(max_depth=1, samples_per_tx=10_000)(scene, carriers_hz=28e9)
    radio_map = mmw.RadioMapSolver(max_depth=1, samples_per_tx=10_000)(
        scene, cell_size_m=5.0, height_m=float(high[2]) + 1.0
    )
    assert len(paths) > 0 and (radio_map.path_gain > 0.0).any()
    file = scene.show(paths=paths, radio_map=radio_map, metric="rss", save=tmp_path / "town.rrd")
    found = read_recording(file)
    assert len(found.at("world/paths/28GHz/phone\\ from\\ mast", None, "LineStrips3D:strips")) == len(paths)
    assert {"/world/coverage", "/world/transmitters/mast", "/world/receivers/phone", "/legend"} <= set(found.rows)
    view = {"eye": middle + np.array([-20.0, -30.0, 40.0]), "look_at": middle, "width_px": 160, "height_px": 90}
    plain, drawn = scene.render(**view), scene.render(**view, paths=paths, radio_map=radio_map)
    assert drawn.size == (160, 90) and (np.asarray(plain) != np.asarray(drawn)).any()
    for name in ("top", "delay", "angles"):
        paths.plot(view=name, scene=scene).savefig(tmp_path / f"{name}.png")
        assert (tmp_path / f"{name}.png").read_bytes()[:4] == b"\x89PNG"
