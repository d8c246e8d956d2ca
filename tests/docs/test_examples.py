"""The small examples run as printed in their first lines, on the small dataset of the tests."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from examples import cooperative_perception, csi_prediction
from examples.csi_prediction import F_K, PILOTS, interpolate, lmmse, nmse_db, predictor, with_noise
from mmw.channel import subcarrier_frequencies
from mmw.dataset import open_dataset
from mmw.dataset.camera_geometry import to_world
from mmw.dataset.export.carla_frames import carla_point
from tests.fixtures.small_dataset import SCENARIO, small_dataset

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("[!_]*.py")), ids=lambda path: path.name)
def test_a_small_example_is_small(path: Path) -> None:
    text = path.read_text()
    assert len(text.splitlines()) < 150
    assert f"python -m examples.{path.stem} out/quickstart" in text


def test_csi_is_estimated_and_predicted(capsys: pytest.CaptureFixture[str]) -> None:
    root = small_dataset()
    capsys.readouterr()  # what making it printed
    csi_prediction.main([str(root)])
    told = capsys.readouterr().out
    lines, mmse = (float(text) for text in re.findall(r"lines (-?[\d.]+) dB, LMMSE (-?[\d.]+) dB", told)[0])
    assert mmse < lines < 0.0
    rows = [[float(number) for number in line.split()] for line in told.splitlines() if re.match(r" +\d", line)]
    assert [row[0] for row in rows] == [0.5, 1.0, 2.0, 4.0]
    for _, held, linear, paths in rows:
        assert paths < -20.0 and paths < linear and paths < held
    assert rows[0][2] < rows[0][1]  # half a millisecond ahead the learned predictor beats holding


def test_estimators_against_closed_forms() -> None:
    """A channel of one path with a random phase has a covariance of rank one: LMMSE averages all pilots coherently."""
    rng = np.random.default_rng(3)
    assert np.array_equal(F_K, subcarrier_frequencies(64, 30e3))
    path = np.exp(-2j * np.pi * F_K * 300e-9)
    phase = np.exp(2j * np.pi * rng.random((4000, 1, 1)))
    h = phase * path
    noisy = with_noise(h, 10.0, rng)
    assert nmse_db(noisy, h) == pytest.approx(-10.0, abs=0.1)
    error = nmse_db(lmmse(h, noisy[:, :, PILOTS], 10.0), h)
    assert error == pytest.approx(-10 * np.log10(1 + len(PILOTS) * 10), abs=0.2)
    assert nmse_db(interpolate(h[:, :, PILOTS]), h) < -20.0  # without noise, from bending between pilots alone


def test_a_turning_phase_is_predicted() -> None:
    turn = np.exp(2j * np.pi * 0.21 * np.arange(200))[:, None, None] * np.ones((1, 1, 64))
    weights = predictor(turn, 3)
    past = np.stack([turn[i : 100 + i] for i in range(4)], axis=-1)
    found = np.einsum("tlko,lo->tlk", past, weights)
    assert nmse_db(found, turn[6:106]) < -80.0


def test_cooperation_sees_more(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cooperative_perception.main([str(small_dataset()), "--out", str(tmp_path), "--frame", "2", "--extent", "60"])
    told = capsys.readouterr().out
    alone, together = (int(n) for n in re.findall(r"(\d+) by the ego alone, (\d+) by all 4 agents", told)[0])
    assert 0 < alone <= together
    picture = np.asarray(Image.open(tmp_path / "bev.png").convert("RGB"))
    assert picture.shape[0] > 1000 and picture.std() > 10
    assert yaml.safe_load((tmp_path / "train" / f"{SCENARIO}_rainy" / "-1" / "000002.yaml").read_text())["vehicles"]


def test_points_and_boxes_come_back_as_they_are_in_the_dataset(tmp_path: Path) -> None:
    cooperative_perception.main([str(small_dataset()), "--out", str(tmp_path), "--weather", "sunny"])
    frame = open_dataset(small_dataset()).frame(SCENARIO, "sunny", 0)
    folder = tmp_path / "train" / f"{SCENARIO}_sunny"
    for name, agent in frame.agents.items():
        number = "-1" if agent.role == "rsu" else str(agent.row["object_id"])
        (path,) = [one for one in folder.iterdir() if one.is_dir() and one.name.lstrip("0") == number.lstrip("0")]
        view = cooperative_perception.read_view(path, 0)
        np.testing.assert_allclose(view.points, agent.sweeps["lidar"].points, atol=1e-4, err_msg=name)
        np.testing.assert_allclose(view.pose[:3], agent.sensor_pose("lidar")[:3], atol=1e-4)
        beside = np.array([1.0, 2.0, 3.0])
        np.testing.assert_allclose(to_world(view.pose, beside), to_world(agent.sensor_pose("lidar"), beside), atol=1e-4)
        for object_id, vehicle in view.vehicles.items():
            (row,) = np.flatnonzero(frame.boxes["object_id"] == object_id)
            np.testing.assert_allclose(cooperative_perception.corners_of(vehicle), frame.boxes.corners[row], atol=1e-4)
    assert np.array_equal(carla_point([1.0, 2.0, 3.0]), [1.0, -2.0, 3.0])


def test_too_short_a_dataset_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(csi_prediction, "SLOT_S", 2.5e-3)
    with pytest.raises(SystemExit, match="3 links with paths all along, 12 slots; take a longer dataset"):
        csi_prediction.main([str(small_dataset())])
