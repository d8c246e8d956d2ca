"""Progress of an export: a bar on a terminal, a line now and then elsewhere, all on standard error."""

import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar
from rich.table import Column

LINE_EVERY_S = 5.0
"""At most one line in so many seconds where there is no terminal [s]; design value."""


class Progress:
    """Counts tasks; `done` of `total` are there from an earlier export."""

    def __init__(self, title: str, total: int, done: int) -> None:
        self._console = Console(stderr=True, highlight=False, soft_wrap=True)
        self._total, self._done, self._fresh = total, done, 0
        self._start = self._said = time.perf_counter()
        if done:
            rest = "making the rest" if done < total else "nothing to make"
            self._say(f"{title}: {done} of {total} tasks are done already; {rest}")
        self._bar: Bar | None = None
        if self._console.is_terminal and done < total:
            self._bar = Bar(
                TextColumn("{task.description}", table_column=Column(overflow="ellipsis", min_width=8)),
                BarColumn(bar_width=10, table_column=Column(min_width=10)),
                TextColumn("{task.completed:,.0f}/{task.total:,.0f}", table_column=Column(no_wrap=True)),
                TimeRemainingColumn(compact=True, table_column=Column(no_wrap=True)),
                TextColumn("left", table_column=Column(no_wrap=True)),
                console=self._console,
            )
            self._row = self._bar.add_task(title, total=total, completed=done)
            self._bar.start()

    def __enter__(self) -> "Progress":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar:
            self._bar.stop()

    def advance(self, where: str) -> None:
        """Count one task that is done."""
        self._done, self._fresh = self._done + 1, self._fresh + 1
        if self._bar:
            self._bar.update(self._row, completed=self._done, description=where)
            return
        now = time.perf_counter()
        if now - self._said >= LINE_EVERY_S or self._done == self._total:
            self._said = now
            left = (self._total - self._done) * (now - self._start) / self._fresh
            self._say(f"{where}: {self._done}/{self._total} tasks, {left:.0f} s left")

    def _say(self, text: str) -> None:
        self._console.print(text, markup=False)
