"""Run checks and say which agree."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mmw.validation.check import Check, Measurement


@dataclass(frozen=True)
class Result:
    """A check and what it measured."""

    check: Check
    measurement: Measurement
    seconds: float
    """Time that it took [s]."""

    @property
    def is_green(self) -> bool:
        """Whether the value lies in the range that agrees."""
        value = float(self.measurement.value)
        return math.isfinite(value) and self.check.reference.contains(value)

    @property
    def problem(self) -> str:
        """Why the result is not the expected one; empty if it is."""
        if not self.is_green and not self.check.known_red:
            return "red: it should agree"
        if self.is_green and self.check.known_red:
            return "green, but listed as known to disagree: remove known_red"
        return ""

    @property
    def record(self) -> dict[str, str | float | bool]:
        """The result as JSON has it."""
        check = self.check
        return {
            "name": check.name, "title": check.title, "unit": check.unit, "value": float(self.measurement.value),
            "reference": check.reference.value, "low": check.reference.low, "high": check.reference.high,
            "is_green": self.is_green, "known_red": check.known_red, "detail": self.measurement.detail,
            "seconds": round(self.seconds, 2),
        }  # fmt: skip


def run_checks(checks: Sequence[Check], device: str, tell: Callable[[Result], None] = lambda _: None) -> list[Result]:
    """Return the results of checks.

    Args:
        checks: The checks.
        device: Warp device that they compute on.
        tell: Function that is called with each result.
    """
    results = []
    for check in checks:
        began = time.perf_counter()
        measurement = check.measure(device)
        results.append(Result(check, measurement, time.perf_counter() - began))
        tell(results[-1])
    return results
