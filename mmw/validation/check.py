"""Describe one comparison with a published number."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

SEEN = ("document", "abstract", "other code", "citation")
"""How the number of a source was checked: in the document itself, in its abstract, in the code of another project that
implements it, or only as other documents cite it."""


@dataclass(frozen=True)
class Source:
    """A document that a reference value is from."""

    title: str
    """Authors or body, and title: `ITU-R P.1411-12`."""
    place: str
    """Section, table, equation or figure."""
    link: str
    """Address or DOI."""
    seen: str
    """How the number was checked, one of `SEEN`."""

    def __post_init__(self) -> None:
        """Check the words."""
        if self.seen not in SEEN:
            raise ValueError(f"source {self.title!r}: seen = {self.seen!r}; choose one of {', '.join(SEEN)}")


@dataclass(frozen=True)
class Reference:
    """A published value, and the range that agrees with it."""

    value: float
    """Published value, in the unit of the check."""
    low: float
    """Smallest value that agrees."""
    high: float
    """Largest value that agrees."""

    def __post_init__(self) -> None:
        """Check the order."""
        if not self.low <= self.value <= self.high:
            raise ValueError(f"reference {self.value:g} is not in {self.low:g} to {self.high:g}")

    def contains(self, value: float) -> bool:
        """Return whether a value agrees."""
        return self.low <= value <= self.high

    @classmethod
    def plus_minus(cls, value: float, spread: float) -> "Reference":
        """Return a range of `spread` to both sides, in the unit of the check."""
        return cls(value, value - spread, value + spread)

    @classmethod
    def within_share(cls, value: float, share: float) -> "Reference":
        """Return a range of `share` of the value to both sides."""
        return cls(value, (1.0 - share) * value, (1.0 + share) * value)

    @classmethod
    def within_factor(cls, value: float, factor: float) -> "Reference":
        """Return a range from the value divided by `factor` to the value times it."""
        return cls(value, value / factor, value * factor)


@dataclass(frozen=True)
class Measurement:
    """Result of the computation of a check."""

    value: float
    """The number that is compared, in the unit of the check."""
    detail: str = ""
    """More to know: number of samples, spread, other values."""
    draw: Callable[[Any], None] | None = None
    """Function that draws a figure on axes of Matplotlib, beside the published values."""


@dataclass(frozen=True)
class Check:
    """A number that the simulator computes, and the published one that it has to agree with."""

    name: str
    """Topic and row, such as `radio.foliage_28ghz`."""
    title: str
    """The comparison for people: `Loss through a crown of 5 m at 28 GHz`."""
    computed: str
    """How the simulator gets its number: scene, solver, preset, averages."""
    unit: str
    """Unit of all numbers, empty for a ratio."""
    reference: Reference
    """Published value, and the range that agrees with it."""
    tolerance: str
    """Reason of the range: spread of the measurements, accuracy of the model, limit of a standard."""
    sources: tuple[Source, ...]
    """Documents that the reference is from."""
    measure: Callable[[str], Measurement]
    """Function of a Warp device that computes the number."""
    known_red: str = ""
    """Why it does not agree and what would mend it; empty for a check that has to be green."""
    is_long: bool = False
    """Whether it needs minutes or a GPU, so that only `mmw validate --full` runs it."""

    def __post_init__(self) -> None:
        """Check that the row has a source and a topic."""
        if not self.sources:
            raise ValueError(f"check {self.name}: no source")
        if "." not in self.name:
            raise ValueError(f"check {self.name}: a name has a topic and a row, such as radio.foliage_28ghz")

    @property
    def topic(self) -> str:
        """The first part of the name."""
        return self.name.partition(".")[0]
