"""Show the progress of an export on standard error: a bar on a terminal, lines elsewhere."""

import time

from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar
from rich.table import Column

LINE_INTERVAL_S = 5.0
"""Minimum time between lines without a terminal [s]; design value."""


def make_bar(console: Console, *columns: TextColumn) -> Bar:
    """Return a bar of description, bar, count, further columns and time left, readable on 80 columns."""
    fixed = Column(no_wrap=True)
    return Bar(
        TextColumn("{task.description}", table_column=Column(overflow="ellipsis", min_width=8)),
        BarColumn(bar_width=10, table_column=Column(min_width=10)),
        TextColumn("{task.completed:,.0f}/{task.total:,.0f}", table_column=fixed),
        *columns,
        TimeRemainingColumn(compact=True, table_column=fixed),
        TextColumn("left", table_column=fixed),
        console=console,
    )


class Progress:
    """Counter of tasks, of which `done` of `total` are finished by an earlier export."""

    def __init__(self, title: str, total: int, done: int, is_quiet: bool = False) -> None:
        self._console = Console(stderr=True, highlight=False, soft_wrap=True, quiet=is_quiet)
        self._total, self._done, self._fresh = total, done, 0
        self._start = self._said = time.perf_counter()
        if done:
            rest = "making the rest" if done < total else "nothing to make"
            self._say(f"{title}: {done} of {total} tasks are done already; {rest}")
        self._bar: Bar | None = None
        if self._console.is_terminal and done < total:
            self._bar = make_bar(self._console)
            self._row = self._bar.add_task(title, total=total, completed=done)
            self._bar.start()

    def __enter__(self) -> "Progress":
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar:
            self._bar.stop()

    def advance(self, where: str) -> None:
        """Count one finished task."""
        self._done, self._fresh = self._done + 1, self._fresh + 1
        if self._bar:
            self._bar.update(self._row, completed=self._done, description=where)
            return
        now = time.perf_counter()
        if now - self._said >= LINE_INTERVAL_S or self._done == self._total:
            self._said = now
            left = (self._total - self._done) * (now - self._start) / self._fresh
            self._say(f"{where}: {self._done}/{self._total} tasks, {left:.0f} s left")

    def _say(self, text: str) -> None:
        self._console.print(text, markup=False)
