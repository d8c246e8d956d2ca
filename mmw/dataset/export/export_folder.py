"""Keep an export's folder: what it holds, which tasks are done, and files that appear when their task is.

    OUT/_export.json         format, dataset, selection and options; an export with others is refused
    OUT/_done/TASK.json      the files of a task that is done, written last
    .OUT.TASK.tmp/           files of the running task, beside OUT

A killed task leaves no marker, so the same command runs it again.
"""

import json
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mmw.core.errors import InputError
from mmw.storage.atomic_files import write_bytes_atomically

STATE = "_export.json"
"""File that names the dataset and options of an export."""
DONE = "_done"
"""Folder of the markers, one a task."""


def open_folder(out: Path, state: dict[str, Any]) -> None:
    """Make the folder, or check that it holds an unfinished export with the same state.

    Raises:
        InputError: If it holds something else.
    """
    path = out / STATE
    if not path.is_file():
        _check_free(out)
        write_bytes_atomically(path, (json.dumps(state, indent=1) + "\n").encode())
        return
    try:
        old = json.loads(path.read_text(encoding="utf-8"))
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: {error}; the file is damaged; remove the folder and export again") from error
    for name, value in state.items():
        if old.get(name) != value:
            raise InputError(
                f"{out}: holds an export with another {name}: {_short(old.get(name))}, not {_short(value)}; "
                "give another folder, or remove this one"
            )


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def _marker(out: Path, name: str) -> Path:
    return out / DONE / f"{name}.json"


def is_done(out: Path, name: str) -> bool:
    """Return whether a task has a marker and its files are there in the sizes that it says."""
    try:
        files = json.loads(_marker(out, name).read_text(encoding="utf-8"))["files"]
    except (FileNotFoundError, json.JSONDecodeError):
        return False
    return all((out / path).is_file() and (out / path).stat().st_size == size for path, size in files.items())


def mark_done(out: Path, name: str, sizes: Mapping[str, int]) -> None:
    """Mark a task as done, with the sizes of its files [B]."""
    write_bytes_atomically(_marker(out, name), (json.dumps({"files": sizes}, indent=0) + "\n").encode())


def run_task(out: Path, name: str, run: Callable[[Path], None]) -> None:
    """Run a task beside the folder, move its files in, and mark it as done."""
    folder = out.with_name(f".{out.name}.{name}.tmp")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    try:
        run(folder)
        files = {path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*")) if path.is_file()}
        sizes = {place: path.stat().st_size for place, path in files.items()}
        for place, path in files.items():
            (out / place).parent.mkdir(parents=True, exist_ok=True)
            path.replace(out / place)
        mark_done(out, name, sizes)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def check_new(out: Path, is_replaced: bool) -> None:
    """Check that a folder can take a new export.

    Raises:
        InputError: If it holds something else, or an export that is not to be replaced.
    """
    if not (out / STATE).is_file():
        _check_free(out)
    elif not is_replaced:
        raise InputError(f"{out}: holds an export; give another folder, or overwrite=True")


def remove_export(out: Path) -> None:
    """Remove a folder if it is that of an export."""
    if (out / STATE).is_file():
        shutil.rmtree(out)


def _check_free(out: Path) -> None:
    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: is a file; a folder is needed; give another one")
    if out.is_dir() and any(out.iterdir()):
        raise InputError(f"{out}: holds files that are no export; an empty or new folder is needed; give another one")
