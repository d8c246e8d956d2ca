"""Define exporters and run them: tasks that can be repeated alone, markers, progress.

An exporter is a module with one `FORMAT`. Its `tasks` plans the work from the small tables; each task writes its files,
with their final relative paths, into a folder of its own, and `export` moves them into place (`export_folder`).
"""

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from mmw.config.agent_keys import AGENT_ROLES
from mmw.core.errors import InputError
from mmw.core.extras import needed_by
from mmw.core.file_names import check_file_name, is_file_name
from mmw.core.progress_bar import Progress
from mmw.dataset import Dataset, open_dataset
from mmw.dataset.export.export_folder import is_done, mark_done, open_folder, run_task
from mmw.dataset.export.registry import load_format
from mmw.dataset.filesystem import read_text
from mmw.storage.atomic_files import write_bytes_atomically
from mmw.storage.dataset_card import LICENSE, NOTICE
from mmw.storage.finding import one_line
from mmw.storage.store import DATASET

MAX_TASK_BYTES = 200
"""Longest name of a task, which is a part of the name of its folder."""
FINISHED = "finish"
"""Marker of a format's last step, which no task may be called."""

VEHICLE_ROLES = ("cav", "rsu")
"""Roles of agents that formats of vehicles and roadside units have a place for."""

Options = Mapping[str, str]
"""Every option of a format, given or by default."""


@dataclass(frozen=True)
class Option:
    """One option of a format, given as `name=value`."""

    name: str
    default: str
    summary: str
    """Its effect in one line."""
    choices: tuple[str, ...] = ()
    """Values that it may have; any if empty."""


@dataclass(frozen=True)
class Selection:
    """Selection of a dataset. An empty tuple is all."""

    scenarios: tuple[str, ...] = ()
    weathers: tuple[str, ...] = ()
    agents: tuple[str, ...] = ()
    frames: range | None = None


@dataclass(frozen=True)
class Task:
    """One unit of an export that can be repeated alone."""

    name: str
    """Deterministic, unique in the export, a plain file name (`mmw.core.file_names`): that of its marker."""
    run: Callable[[Path], None]
    """Writes the files under the folder it is given, with their final paths relative to it."""


@dataclass(frozen=True)
class Format:
    """A format to export to."""

    name: str
    summary: str
    """One line."""
    losses: tuple[str, ...]
    """Losses of the format, one line each."""
    tasks: Callable[[Dataset, Selection, Options], list[Task]]
    """Plans the work; raises InputError if the dataset lacks something that the format needs."""
    finish: Callable[[Dataset, Selection, Path], None] | None = None
    """Last step in the finished folder, after every task; it must be possible to repeat it."""
    options: tuple[Option, ...] = ()
    packages: tuple[str, ...] = ()
    """Optional packages that it needs, by the names of their imports."""

    def check_packages(self) -> None:
        """Raise a MissingPackageError if one of `packages` is not installed."""
        with needed_by(f"mmw export {self.name}"):
            for package in self.packages:
                import_module(package)


@dataclass(frozen=True)
class Part:
    """Selection of one scenario in one weather."""

    scenario: str
    weather: str
    frames: tuple[int, ...]
    """Ascending."""
    agents: tuple[str, ...]
    """CAVs before the others, each in the order of their names."""


def export(
    root: str | Path,
    format_name: str,
    out: str | Path,
    selection: Selection = Selection(),
    options: Options | None = None,
    *,
    is_quiet: bool = False,
) -> None:
    """Write a dataset, or a part of it, in another format; finished tasks are skipped.

    Args:
        root: Dataset folder, or a URI such as s3://bucket/folder.
        format_name: A key of `mmw.dataset.export.registry.EXPORTERS`.
        out: Folder to write; made if it does not exist.
        selection: Part of the dataset to export.
        options: The format's options that differ from their defaults.
        is_quiet: Show no progress.

    Raises:
        InputError: If the format, the selection or an option is not known, the dataset lacks something that the format
            needs, or `out` holds something else: other files, or the export of another dataset, selection or options.
        MissingPackageError: If the format needs a package that is not installed.
        OutOfSpaceError: If the disk is full; the same call resumes.
    """
    dataset, out = open_dataset(root), Path(out).resolve()
    form = load_format(format_name)
    form.check_packages()
    values = checked_options(form, options or {})
    is_local = dataset.filesystem is None
    if is_local and (out == dataset.root or dataset.root in out.parents or out in dataset.root.parents):
        raise InputError(f"{out}: overlaps the dataset {dataset.root}; an export needs a folder of its own; give one")
    with _lookups(dataset, form.name):
        tasks = form.tasks(dataset, selection, values)
    _check_names(form, tasks)
    open_folder(out, _state(dataset, form, selection, values, tasks))
    pending = [task for task in tasks if not is_done(out, task.name)]
    with Progress(f"{form.name} -> {out}", len(tasks), len(tasks) - len(pending), is_quiet) as progress:
        for task in pending:
            with _lookups(dataset, f"{form.name}: {task.name}"):
                run_task(out, task.name, task.run)
            progress.advance(task.name)
        _copy_license(dataset, out)
        if form.finish is not None and (pending or not is_done(out, FINISHED)):
            with _lookups(dataset, form.name):
                form.finish(dataset, selection, out)
            mark_done(out, FINISHED, {})


def _copy_license(dataset: Dataset, out: Path) -> None:
    """Copy the license of the data, and what has to be named with them, where the dataset has them."""
    for name in (LICENSE, NOTICE):
        text = read_text(dataset.root, name, dataset.filesystem)
        if text and not (out / name).is_file():
            write_bytes_atomically(out / name, text.encode())


@contextmanager
def _lookups(dataset: Dataset, where: str) -> Iterator[None]:
    """Name the dataset where a row, or its configuration, names something that no other row has.

    Raises:
        InputError: If a lookup of the block fails; the log file has the trace.
    """
    try:
        yield
    except (LookupError, StopIteration) as error:
        name = one_line(error) or type(error).__name__
        raise InputError(
            f"{where}: {dataset.root}: {name} is named in a table or in {DATASET}, but is not where it belongs; "
            f"`mmw verify {dataset.root}` lists what is wrong; if that is nothing, report this"
        ) from error


def checked_options(form: Format, given: Options) -> Options:
    """Return every option of a format, those that are not given by default.

    Raises:
        InputError: If an option is not known or cannot have the value.
    """
    known = {option.name: option for option in form.options}
    for name, value in given.items():
        if name not in known:
            raise InputError(
                f"{form.name}: option {name!r} is not known; the options are {', '.join(known) or 'none'}; omit it"
            )
        choices = known[name].choices
        if choices and value not in choices:
            raise InputError(f"{form.name}: {name}={value}: is not known; give one of {', '.join(choices)}")
    return {option.name: given.get(option.name, option.default) for option in form.options}


def frame_steps(dataset: Dataset, form: str, name: str, options: Options) -> Callable[[str], int]:
    """Return what gives the step in frames of a rate option [Hz] in a scenario.

    It raises an InputError if the rate does not divide that of the scenario's frames.
    """

    def step(scenario: str) -> int:
        text, frame_rate = options[name], dataset.frame_rate_hz(scenario)
        if not text.isdecimal() or int(text) == 0 or frame_rate % int(text):
            rates = ", ".join(str(rate) for rate in range(1, frame_rate + 1) if frame_rate % rate == 0)
            raise InputError(
                f"{form}: {name}={text}: a rate that divides {frame_rate} Hz is needed; give one of {rates}"
            )
        return frame_rate // int(text)

    return step


def require(dataset: Dataset, form: str, *tables: str, hint: str = "record it, or choose another format") -> None:
    """Check that a dataset has tables.

    Raises:
        InputError: If one is missing.
    """
    for table in tables:
        if table not in dataset.tables:
            raise InputError(f"{dataset.root}: has no table {table!r}, which {form} needs; {hint}")


def parts(
    dataset: Dataset,
    selection: Selection,
    step_of: Callable[[str], int] = lambda scenario: 1,
    *,
    roles: Sequence[str] = AGENT_ROLES,
    carrying: Sequence[str] = (),
) -> list[Part]:
    """Return the parts of a selection, scenario by scenario and weather by weather, in the order of their names.

    Args:
        dataset: The dataset.
        selection: Scenarios, weathers, agents and frames.
        step_of: Scenario -> step; only frames that are multiples of it: a sensor of a lower rate samples multiples of
            its period too.
        roles: Roles of agents that the format has a place for; others are left out.
        carrying: Types of sensors that the format needs; agents beside CAVs and RSUs that lack one are left out, unless
            the selection names them.

    Raises:
        InputError: If the dataset has no such scenario, weather or agent, nothing is left, or a name of what is left
            cannot be that of a file.
    """
    require(dataset, "every export", "frames", "poses")
    picked: dict[tuple[str, str], list[int]] = {}
    rows = dataset.read("frames", columns=["scenario", "weather", "frame"])
    for scenario, weather, frame in zip(*(rows[name].to_pylist() for name in rows.column_names), strict=True):
        picked.setdefault((scenario, weather), []).append(frame)
    _check_known(dataset, "scenario", selection.scenarios, {scenario for scenario, _ in picked})
    _check_known(dataset, "weather", selection.weathers, {weather for _, weather in picked})
    agents = _agents(dataset, roles, carrying, selection.agents)
    _check_known(dataset, "agent", selection.agents, {name for names in agents.values() for name in names})
    result, step = [], 1
    for (scenario, weather), frames in sorted(picked.items()):
        is_wanted = scenario in (selection.scenarios or (scenario,)) and weather in (selection.weathers or (weather,))
        if not is_wanted:
            continue
        step = step_of(scenario)
        wanted = [
            frame
            for frame in sorted(frames)
            if frame % step == 0 and (selection.frames is None or frame in selection.frames)
        ]
        names = [name for name in agents.get(scenario, ()) if not selection.agents or name in selection.agents]
        if wanted and names:
            check_file_name(scenario, "scenario", dataset.root)
            check_file_name(weather, "weather", dataset.root)
            for name in names:
                check_file_name(name, "agent", dataset.root)
            result.append(Part(scenario, weather, tuple(wanted), tuple(names)))
    if not result:
        every = f", one frame in {step}" if step > 1 else ""
        raise InputError(
            f"{dataset.root}: nothing is left of {selection}{every}; pick more scenarios, agents or frames"
        )
    return result


def _agents(
    dataset: Dataset, roles: Sequence[str], carrying: Sequence[str], named: Sequence[str]
) -> dict[str, list[str]]:
    """Return the agents of each scenario that `parts` keeps, CAVs first; numbers in names count as numbers."""
    carriers = _carriers(dataset) if carrying else {}
    found: dict[str, set[tuple[bool, tuple[Any, ...], str]]] = {}
    table = dataset.read("poses", columns=["scenario", "agent", "role"]).group_by(["scenario", "agent", "role"])
    for row in table.aggregate([]).to_pylist():
        types = carriers.get((row["scenario"], row["agent"]), set())
        may_lack = row["role"] in VEHICLE_ROLES or row["agent"] in named
        if row["role"] not in roles or not (may_lack or types.issuperset(carrying)):
            continue
        pieces = tuple((not piece.isdigit(), int(piece) if piece.isdigit() else piece)
                       for piece in re.split(r"(\d+)", row["agent"]))  # fmt: skip
        found.setdefault(row["scenario"], set()).add((row["role"] != "cav", pieces, row["agent"]))
    return {scenario: [name for *_, name in sorted(names)] for scenario, names in found.items()}


def _carriers(dataset: Dataset) -> dict[tuple[str, str], set[str]]:
    """Return the types of the sensors of each agent of each scenario."""
    found: dict[tuple[str, str], set[str]] = {}
    for row in dataset.read("sensors", columns=["scenario", "agent", "type"]).to_pylist():
        found.setdefault((row["scenario"], row["agent"]), set()).add(row["type"])
    return found


def _check_known(dataset: Dataset, kind: str, given: tuple[str, ...], known: set[str]) -> None:
    for name in given:
        if name not in known:
            raise InputError(f"{kind}={name}: {dataset.root} has {', '.join(sorted(known))}; give one of them")


def _check_names(form: Format, tasks: list[Task]) -> None:
    names = [task.name for task in tasks]
    for name in names:
        if not is_file_name(name, MAX_TASK_BYTES) or name == FINISHED:
            raise InputError(f"{form.name}: task {name!r}: is no file name; letters, digits and _.=- are needed")
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"{form.name}: task {twice!r}: is there twice; every task needs its own name")


def _state(dataset: Dataset, form: Format, selection: Selection, options: Options, tasks: list[Task]) -> dict[str, Any]:
    picked = asdict(selection)
    frames = selection.frames
    picked["frames"] = [frames.start, frames.stop, frames.step] if frames is not None else None
    return {
        "format": form.name,
        "dataset": dataset.info["config_sha256"],
        "selection": json.loads(json.dumps(picked)),
        "options": dict(options),
        "tasks": sorted(task.name for task in tasks),
    }
