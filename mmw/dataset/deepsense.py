"""Read a scenario of DeepSense 6G that a user has downloaded: positions, beam powers and pictures.

A scenario is a folder with one `scenarioN.csv`, a row a sample, whose cells are values or paths of files from the
folder on, `./unit1/mmWave_data/mmWave_power_7.txt`: 64 powers line by line, or latitude and longitude, or a picture.
Unit 1 is the base station that receives, unit 2 the vehicle that transmits. Scenarios in which vehicles talk to each
other (36 to 39) have other columns and are not read.

Source: A. Alkhateeb et al., "DeepSense 6G: A large-scale real-world multi-modal sensing and communication dataset",
IEEE Communications Magazine, 2023, and the pages of the scenarios on deepsense6g.net.
"""

import csv
from pathlib import Path

import numpy as np

from mmw.core.errors import InputError
from mmw.dataset.beam_samples import BeamSamples

__all__ = ["PUBLISHED", "read_deepsense"]

POWER, BASE, SEQUENCE, PICTURE = "unit1_pwr_60ghz", "unit1_loc", "seq_index", "unit1_rgb"
USER = ("unit2_loc_cal", "unit2_loc")
"""Columns of the user's position, the better first: scenarios 3, 4, 8 and 9 have corrected positions as well."""

PUBLISHED: dict[int, tuple[float, float, float]] = {
    1: (55.59, 81.01, 90.70),
    2: (49.04, 70.91, 84.82),
    3: (32.45, 47.45, 59.13),
    4: (28.37, 43.69, 56.36),
    5: (41.17, 64.00, 77.91),
    6: (41.64, 67.27, 82.08),
    7: (27.33, 46.92, 58.37),
    8: (21.77, 32.84, 40.28),
    9: (38.82, 54.22, 64.82),
}
"""Scenario -> top-1, top-2 and top-3 accuracy by position [%]. Source: leaderboard of the task "position-aided beam
prediction", deepsense6g.net/position-aided-beam-prediction, entry of the Wireless Intelligence Lab of 15 January 2021;
method after J. Morais et al., "Position-aided beam prediction in the real world", arXiv 2205.09054."""


def read_deepsense(folder: str | Path, *, table: str | None = None) -> BeamSamples:
    """Return the samples of a scenario; `img = PIL.Image.open(samples.images[n])` reads a picture.

    Rows without a power of any beam are left out.

    Args:
        folder: The scenario's folder.
        table: Name of its CSV file, such as `scenario33_dev.csv`; None for the only `scenario*.csv` in it.

    Raises:
        InputError: If a file or a column is missing, or a file does not hold what it should.

    Examples:
        >>> samples = read_deepsense("Scenario1")  # doctest: +SKIP
        >>> samples.position_deg.shape, samples.power.shape  # doctest: +SKIP
        ((2411, 2), (2411, 64))
    """
    root = Path(folder)
    path = _table(root, table)
    with path.open(newline="", encoding="utf-8-sig") as file:
        reader = csv.DictReader(file)
        columns = {name.strip(): name for name in reader.fieldnames or ()}
        rows = list(reader)
    user = next((name for name in USER if name in columns), USER[-1])
    if missing := [name for name in (POWER, user) if name not in columns]:
        raise InputError(
            f"{path}: no column {' and '.join(missing)}, but {', '.join(columns) or 'none'}; a scenario with a base "
            "station is needed, such as 1 to 9 and 31 to 35"
        )
    if not rows:
        raise InputError(f"{path}: has no row; download the scenario again")

    def cells(name: str) -> list[str]:
        return [(row[columns[name]] or "").strip() for row in rows]

    kept: dict[str, np.ndarray] = {}
    power = [_numbers(root, path, cell, kept) for cell in cells(POWER)]
    sizes = {len(one) for one in power}
    if len(sizes) != 1:
        raise InputError(f"{path}: files of {POWER} have {sorted(sizes)} numbers; each needs one a beam")
    position = [_numbers(root, path, cell, kept, 2) for cell in cells(user)]
    base = _numbers(root, path, cells(BASE)[0], kept, 2) if BASE in columns else None
    sequence = [_whole(path, SEQUENCE, cell) for cell in cells(SEQUENCE)] if SEQUENCE in columns else [0] * len(rows)
    images = tuple(root / cell for cell in cells(PICTURE)) if PICTURE in columns else ()
    powers = np.array(power)
    is_there = np.flatnonzero(np.isfinite(powers).any(axis=1))
    return BeamSamples(
        path.stem, np.array(position)[is_there], powers[is_there], np.array(sequence, dtype=np.int64)[is_there], base,
        tuple(images[row] for row in is_there) if images else (),
    )  # fmt: skip


def _table(root: Path, name: str | None) -> Path:
    """Return the table of a scenario."""
    found = sorted(root.glob("scenario*.csv")) if name is None else [root / name]
    if len(found) == 1 and found[0].is_file():
        return found[0]
    if name is None and len(found) > 1:
        raise InputError(f"{root}: tables {', '.join(one.name for one in found)}; name one by table=")
    raise InputError(
        f"{root}: no {name or 'scenario*.csv'}; the unpacked folder of a scenario of deepsense6g.net is needed"
    )


def _numbers(root: Path, table: Path, cell: str, kept: dict[str, np.ndarray], count: int | None = None) -> np.ndarray:
    """Return the numbers of a file, which is read once."""
    if cell not in kept:
        path = root / cell
        if not cell or not path.is_file():
            raise InputError(
                f"{table}: names {cell or 'no file'!r}, which is not in {root}; unpack all of the scenario"
            )
        try:
            kept[cell] = np.array(path.read_text().replace(",", " ").split(), dtype=np.float64)
        except ValueError as error:
            raise InputError(f"{path}: {error}; numbers are needed, one a line; download it again") from error
    values = kept[cell]
    if count is not None:
        # Some scenarios have the altitude as a third number.
        if len(values) < count or not np.isfinite(values[:count]).all():
            raise InputError(f"{root / cell}: {values.tolist()}; latitude and longitude are needed; download it again")
        return values[:count]
    return values


def _whole(table: Path, column: str, cell: str) -> int:
    try:
        return int(float(cell))
    except ValueError as error:
        raise InputError(f"{table}: {column} = {cell!r}; a whole number is needed; download it again") from error
