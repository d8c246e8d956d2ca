"""The cache: labels, sensor features and windows of a dataset, made once by streaming through it.

    CACHE/cache.json                             what it was made of and with
    CACHE/labels/SCENARIO.WEATHER.parquet        `part_labels`
    CACHE/rsu_lidar/SCENARIO.WEATHER.parquet     `part_features`, a folder a sensor
    CACHE/windows.parquet                        which windows train and which validate

Further datasets, of the same scenarios with other traffic, train alone; their scenarios are called SCENARIO+1, +2, ...

Training reads nothing else, so a cache can be taken to another machine without the dataset. Files that are there are
not made again.
"""

import json
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from examples.beam_prediction.config import INPUTS, Experiment
from examples.beam_prediction.features import part_features
from examples.beam_prediction.labels import part_labels
from examples.beam_prediction.windows import find_windows, split, window_table
from mmw.core.errors import InputError
from mmw.core.file_names import check_file_name
from mmw.dataset import Dataset, open_dataset
from mmw.storage.atomic_files import write_bytes_atomically

ABOUT = "cache.json"
WINDOWS = "windows.parquet"
LABELS = "labels"
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that keep the linear algebra of a process to one thread."""


def sources_of(experiment: Experiment) -> dict[str, str]:
    """Return each sensor of the experiment's input sets and its modality, `lidar` or `camera`."""
    modalities = dict.fromkeys(modality for name in experiment.inputs for modality in INPUTS[name])
    return {source: modality for modality in modalities for source in experiment.features.sources(modality)}


def folder_of(source: str) -> str:
    """Return the folder of a sensor's features in a cache."""
    return source.replace("/", "_")


def prepare(experiment: Experiment, data: Path | None, cache: Path, workers: int, more: Sequence[Path] = ()) -> None:
    """Make what is missing of a cache.

    Args:
        experiment: Radio, features, windows and inputs of it count.
        data: The dataset; None if the cache is complete.
        cache: Its folder.
        workers: Processes; each takes one scenario at a time.
        more: Further datasets, all windows of which train.

    Raises:
        InputError: If the cache is of something else, or the dataset is needed and not given.
    """
    about = about_text(experiment)
    if data is None:
        check_cache(cache, about)
        return
    datasets = [open_dataset(root) for root in (data, *more)]
    about["dataset"] = [{name: one.info[name] for name in ("config_sha256", "created_utc")} for one in datasets]
    if (cache / ABOUT).is_file():
        check_cache(cache, {key: value for key, value in about.items() if key != "windows"})  # these are found anew
    write_bytes_atomically(cache / ABOUT, json.dumps(about, indent=1).encode())
    write_bytes_atomically(cache / WINDOWS, parquet_bytes(_window_rows(experiment, datasets)))
    tasks = [task for number, one in enumerate(datasets) for task in _missing(experiment, one, cache, number)]
    with one_thread(), ProcessPoolExecutor(max(1, min(workers, len(tasks))), mp_context=get_context("spawn")) as pool:
        jobs = [pool.submit(make_file, *task) for task in tasks]
        for number, job in enumerate(as_completed(jobs), start=1):
            print(f"cache: {number}/{len(jobs)} {job.result()}", flush=True)


def about_text(experiment: Experiment) -> dict[str, Any]:
    """Return what decides the content of a cache besides the dataset, as JSON has it."""
    return {
        "radio": experiment.radio.model_dump(mode="json"),
        "features": experiment.features.model_dump(mode="json", exclude={"lidar", "camera"}),
        "windows": experiment.windows.model_dump(mode="json"),
    }


def check_cache(cache: Path, about: dict[str, Any]) -> None:
    """Raise ValueError if there is no cache, or it was made of or with something else."""
    if not (cache / ABOUT).is_file():
        raise InputError(f"{cache}: no cache is there; give the dataset as --data")
    found = json.loads((cache / ABOUT).read_text())
    wrong = [key for key, value in about.items() if found.get(key) != value]
    if wrong:
        raise InputError(
            f"{cache}: was made with another {wrong[0]}, {found.get(wrong[0])} instead of {about[wrong[0]]}; give "
            f"{'--data, and the step prepare finds them anew' if wrong[0] == 'windows' else 'another --cache'}"
        )


def read_parts(cache: Path, name: str) -> dict[tuple[str, str], pa.Table]:
    """Return the tables of one folder of a cache by scenario and weather.

    Raises:
        InputError: If it holds none.
    """
    files = sorted((cache / name).glob("*.parquet"))
    if not files:
        raise InputError(f"{cache / name}: nothing is there; make it with --data and an input set that uses it")
    found = {}
    for file in files:
        scenario, _, weather = file.stem.rpartition(".")
        found[scenario, weather] = pq.read_table(file)
    return found


def columns_of(experiment: Experiment) -> int:
    """Return the columns of a feature."""
    return experiment.features.columns_per_beam * experiment.radio.beams


def make_file(data: Path, file: Path, scenario: str, weather: str, source: str, experiment: Experiment) -> str:
    """Make one file of a cache and return its name; runs in a process of its own.

    Args:
        data: The dataset.
        file: What is made.
        scenario: Scenario.
        weather: Weather.
        source: Sensor; `LABELS` for labels.
        experiment: Radio and features of it count.
    """
    dataset = open_dataset(data)
    if source == LABELS:
        table = part_labels(dataset, scenario, weather, experiment.radio)
    else:
        modality = sources_of(experiment)[source]
        columns = columns_of(experiment)
        table = part_features(dataset, scenario, weather, source, modality, experiment.features, columns)
    write_bytes_atomically(file, parquet_bytes(table))
    return f"{file.parent.name} {file.stem}: {table.num_rows} rows, {file.stat().st_size / 1e6:.2f} MB"


def parquet_bytes(table: pa.Table) -> memoryview:
    """Return a table as a Parquet file."""
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd")
    return memoryview(sink.getvalue())


@contextmanager
def one_thread() -> Iterator[None]:
    """Let processes that start inside use one thread each for linear algebra."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _window_rows(experiment: Experiment, datasets: Sequence[Dataset]) -> pa.Table:
    tables = []
    for number, dataset in enumerate(datasets):
        windows = find_windows(dataset, experiment.radio, experiment.windows, experiment.features)
        parts = {"train": windows} if number else split(windows, experiment.windows)
        counts = ", ".join(f"{name} {len(part):,}" for name, part in parts.items())
        print(f"windows: {len(windows):,} of {len(windows.tracks)} tracks; {counts}", flush=True)
        tables.append(window_table(parts, _mark(number)))
    return pa.concat_tables(tables)


def _mark(number: int) -> str:
    """Return what the names of a dataset's scenarios end with; nothing for the first dataset."""
    return f"+{number}" if number else ""


def _missing(experiment: Experiment, dataset: Dataset, cache: Path, number: int) -> Iterator[tuple]:
    """Yield the arguments of `make_file` for every file of a dataset that is missing, the slow ones first."""
    rows = dataset.read("frames", columns=["scenario", "weather"]).group_by(["scenario", "weather"]).aggregate([])
    pairs = sorted((row["scenario"], row["weather"]) for row in rows.to_pylist())
    pairs = [pair for pair in pairs if pair[1] in experiment.windows.weathers]
    for scenario, weather in pairs:
        check_file_name(scenario, "scenario", dataset.root)
        check_file_name(weather, "weather", dataset.root)
    for source in (*sources_of(experiment), LABELS):
        for scenario, weather in pairs:
            file = cache / folder_of(source) / f"{scenario}{_mark(number)}.{weather}.parquet"
            if not file.is_file():
                yield dataset.root, file, scenario, weather, source, experiment
