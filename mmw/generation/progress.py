"""Show the progress of a run: a bar on a terminal, one line a batch elsewhere, a summary at the end; or only log it."""

import json
import logging
import shlex
import sys
from collections.abc import Sequence
from typing import Any, Protocol

from rich.console import Console as RichConsole
from rich.progress import Progress, TextColumn
from rich.table import Column

from mmw.config import Config
from mmw.core.progress_bar import make_bar
from mmw.core.timing import StageTimer

LOGGER = logging.getLogger(__name__)

SET_UP = ("traffic and stage", "scene", "kernels", "textures and skies")
"""Stages that run once a scenario, excluded from the speed and the time left."""


class Reporter(Protocol):
    """Receiver of a worker's progress: the terminal, or the process that owns it."""

    timer: StageTimer

    def warn_once(self, text: str) -> None:
        """Show a warning the first time it is given."""

    def advance(self, frames: int, where: str) -> None:
        """Count traced scenario-weather-frames of a scenario."""


class Console:
    """Progress and messages on standard error; standard output is for the summary. All of them are logged."""

    def __init__(self, *, is_quiet: bool = False) -> None:
        """Print nothing if `is_quiet`."""
        self._is_quiet = is_quiet
        # Rich shows a notebook each line as HTML of its own, a bar by ipywidgets, or else as a stream that keeps every
        # state of it: plain lines are better there, although its standard error says that it is a terminal.
        plain = {"force_jupyter": False, "force_terminal": False} if RichConsole().is_jupyter else {}
        self._rich = RichConsole(stderr=True, highlight=False, soft_wrap=True, quiet=is_quiet, **plain)
        self._progress: Progress | None = None
        self._task = None
        self._warned: set[str] = set()
        self.total = self.done = 0
        self.workers = 1
        self.timer = StageTimer()

    def __enter__(self) -> "Console":
        return self

    def __exit__(self, *_: object) -> None:
        if self._progress:
            self._progress.stop()

    def say(self, text: str) -> None:
        """Print one line above the bar, and log it."""
        LOGGER.info("%s", text)
        self._rich.print(text, markup=False)

    def warn_once(self, text: str) -> None:
        """Print a warning the first time it is given."""
        if text not in self._warned:
            self._warned.add(text)
            LOGGER.warning("%s", text)
            self._rich.print(f"note: {text}", markup=False)

    def begin(self, total: int, done: int, workers: int = 1) -> None:
        """Start counting scenario-weather-frames, of which an earlier run has done some, with the workers of a run."""
        self.total, self.done, self.workers = total, done, workers
        self.timer = StageTimer()
        self._fresh = 0
        if self._progress:  # of the dataset before, a part of which was made
            self._progress.stop()
            self._progress = None
        if self._rich.is_terminal and not self._is_quiet:
            speed = TextColumn("{task.fields[speed]}", table_column=Column(no_wrap=True))
            self._progress = make_bar(self._rich, speed)
            self._task = self._progress.add_task("setting up", total=total, completed=done, speed="")
            self._progress.start()

    def advance(self, frames: int, where: str) -> None:
        """Count traced frames and show the speed."""
        self.done += frames
        self._fresh += frames
        rays = sum(self.timer.rays.values())
        set_up = sum(self.timer.seconds.get(name, 0.0) for name in SET_UP) / self.workers
        elapsed = max(self.timer.elapsed - set_up, 1e-9)
        speed = f"{self._fresh / elapsed:.1f} frames/s, {si(rays / elapsed)}rays/s"
        if self._progress and self._task is not None:
            self._progress.update(self._task, completed=self.done, description=where, speed=speed)
            LOGGER.debug("%s: %d/%d frames, %s", where, self.done, self.total, speed)
        else:
            left = (self.total - self.done) * elapsed / max(self._fresh, 1)
            self.say(f"{where}: {self.done}/{self.total} frames, {speed}, {left:.0f} s left")

    def summary(self, text: str) -> None:
        """Print the closing summary on standard output."""
        if self._progress:
            self._progress.stop()
            self._progress = None
        LOGGER.info("%s", text)
        if not self._is_quiet:
            sys.stderr.flush()
            print(text, flush=True)


def si(value: float) -> str:
    """Return a number with an SI prefix: 2.31 G, 4.5 M, 12 k."""
    for limit, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(value) >= limit:
            return f"{value / limit:.2f} {letter}"
    return f"{value:.0f} "


def closing_summary(
    root: object, config: Config, device: str, workers: int, result: dict[str, Any], timer: StageTimer, frames: int
) -> str:
    """Return the closing text of a run: size of each table, time and rays of each stage, an example query."""
    tables = [("table", "rows", "bytes")]
    for name, entry in [*result["tables"].items(), ("all", result)]:
        tables.append((name, f"{entry['rows']:,}", f"{si(entry['bytes'])}B"))
    stages = [("stage", "seconds" if workers == 1 else f"seconds of {workers} workers", "rays/s")]
    for name, seconds in timer.seconds.items():
        rays = timer.rays[name]
        stages.append((name, f"{seconds:.2f}", f"{si(rays / seconds) if seconds > 0 else 0}rays/s" if rays else ""))
    made_by = device if workers == 1 else f"{workers} workers, {device}"
    return "\n".join(
        [
            f"{frames} frames in {timer.elapsed:.1f} s on {made_by} -> {root}",
            "",
            *_aligned(tables),
            "",
            *_aligned(stages),
            "",
            "query it (extra `query`):",
            example_query(root, config),
        ]
    )


def _aligned(rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Return lines of aligned columns, the first left-aligned, the others right-aligned."""
    first, *others = (max(map(len, column)) for column in zip(*rows, strict=True))
    lines = []
    for name, *texts in rows:
        numbers = [f"  {text:>{width}}" for text, width in zip(texts, others, strict=True)]
        lines.append(f"  {name:<{first}}{''.join(numbers)}".rstrip())
    return lines


def example_query(root: object, config: Config) -> str:
    """Return one DuckDB query over the dataset, as a line to paste into a shell."""
    if config.channel.enabled:
        query = (
            "SELECT frame, agent, peer, carrier_hz / 1e9 AS ghz, path_count, round(gain_db, 1) AS gain_db, "
            "round(x, 1) AS x, round(y, 1) AS y FROM links JOIN poses USING (scenario, weather, frame, agent) "
            "ORDER BY ALL LIMIT 8"
        )
    else:
        query = "SELECT frame, agent, x, y, z FROM poses ORDER BY ALL LIMIT 8"
    code = f"import mmw; print(mmw.connect({json.dumps(str(root))}).sql({json.dumps(query)}))"
    return f"{shlex.quote(sys.executable)} -c {shlex.quote(code)}"
