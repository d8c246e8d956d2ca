"""A folder in the layout of DeepSense 6G gives its positions, powers, drives and pictures, or says what is wrong."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mmw.core.errors import InputError
from mmw.dataset.deepsense import PUBLISHED, read_deepsense
from tests.fixtures.deepsense import BASE, drive_past, write_scenario

COUNT = 12


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_scenario(tmp_path, *drive_past(COUNT))


def test_everything_is_read(folder: Path) -> None:
    position, power = drive_past(COUNT)
    samples = read_deepsense(folder)
    assert samples.name == "scenario1" and len(samples) == COUNT
    np.testing.assert_allclose(samples.position_deg, position, atol=1e-9)
    np.testing.assert_allclose(samples.power, power, atol=1e-6)
    np.testing.assert_array_equal(samples.base_deg, BASE)
    np.testing.assert_array_equal(samples.beams, power.argmax(axis=1))
    np.testing.assert_array_equal(samples.sequence, np.repeat([1, 2, 3, 4], 3))
    with Image.open(samples.images[5]) as picture:
        assert picture.size == (8, 6) and abs(picture.getpixel((0, 0))[0] - 5) <= 2  # JPEG


def test_corrected_positions_come_first(tmp_path: Path) -> None:
    """Scenarios 3, 4, 8 and 9 have both."""
    position, power = drive_past(COUNT)
    names = [f"./unit2/GPS_data/corrected_{n}.txt" for n in range(COUNT)]
    folder = write_scenario(tmp_path, position, power, number=8, columns={"unit2_loc_cal": names})
    for name, place in zip(names, position + 1e-4, strict=True):
        (folder / name).write_text(f"{place[0]:.9f}\n{place[1]:.9f}\n301.5\n")  # an altitude is left out
    np.testing.assert_allclose(read_deepsense(folder).position_deg, position + 1e-4, atol=1e-9)


def test_powers_that_were_not_measured_do_not_count(folder: Path) -> None:
    """Beams are NaN here and there; a row of them alone is left out, and its picture."""
    power = drive_past(COUNT)[1]
    file = folder / "unit1/mmWave_data/mmWave_power_{}.txt"
    best = int(power[0].argmax())
    Path(str(file).format(0)).write_text("\n".join("nan" if n == best else f"{v:.6f}" for n, v in enumerate(power[0])))
    Path(str(file).format(1)).write_text("\n".join(["nan"] * 64))
    samples = read_deepsense(folder)
    assert len(samples) == len(samples.images) == COUNT - 1
    assert samples.beams[0] in (best - 1, best + 1) and samples.images[1].name == "image_2.jpg"


def test_parts_and_windows(folder: Path) -> None:
    samples = read_deepsense(folder)
    some = samples.select(samples.sequence == 2)
    assert len(some) == 3 and some.images == samples.images[3:6] and some.base_deg is samples.base_deg
    windows = samples.windows(past=2, future=1)
    np.testing.assert_array_equal(windows, np.arange(0, COUNT, 3)[:, None] + np.arange(3))
    assert (np.diff(samples.sequence[windows], axis=1) == 0).all()
    with pytest.raises(InputError, match="no drive has 4 samples in a row"):
        samples.windows(past=3, future=1)
    with pytest.raises(InputError, match="at least 1 and 0"):
        samples.windows(past=0, future=1)


def test_a_scenario_may_have_several_tables(folder: Path) -> None:
    (folder / "scenario1_dev.csv").write_bytes((folder / "scenario1.csv").read_bytes())
    with pytest.raises(InputError, match=r"name one by table="):
        read_deepsense(folder)
    assert read_deepsense(folder, table="scenario1_dev.csv").name == "scenario1_dev"


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("unit1/mmWave_data/mmWave_power_3.txt", "0.1\n0.2\n", "each needs one a beam"),
        ("unit1/mmWave_data/mmWave_power_3.txt", "<html>", "numbers are needed, one a line"),
        ("unit2/GPS_data/gps_location_3.txt", "33.42\n", "latitude and longitude are needed"),
        ("unit2/GPS_data/gps_location_3.txt", None, "unpack all of the scenario"),
        ("scenario1.csv", "index,unit1_pwr1\n1,a\n", "no column unit1_pwr_60ghz and unit2_loc"),
        ("scenario1.csv", "unit1_pwr_60ghz,unit2_loc\n", "has no row"),
        ("scenario1.csv", None, "unpacked folder of a scenario"),
    ],
)
def test_damage_is_named(folder: Path, file: str, content: str | None, message: str) -> None:
    if content is None:
        (folder / file).unlink()
    else:
        (folder / file).write_text(content)
    with pytest.raises(InputError, match=message):
        read_deepsense(folder)


def test_drives_are_numbers(folder: Path) -> None:
    table = folder / "scenario1.csv"
    table.write_text(table.read_text().replace(",12-00-00-0", ",12-00-00-0").replace(",1,12-00-01", ",one,12-00-01"))
    with pytest.raises(InputError, match="seq_index = 'one'"):
        read_deepsense(folder)


def test_published_accuracies_grow_with_k() -> None:
    assert set(PUBLISHED) == set(range(1, 10))
    assert all(0 < one < two < three < 100 for one, two, three in PUBLISHED.values())
