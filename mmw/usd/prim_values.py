"""Read attribute values of prims and of their ancestors."""

from collections.abc import Iterable, Iterator
from typing import Any

from pxr import Usd


def attribute_value(prim: Usd.Prim, name: str, default: Any = None, time: Usd.TimeCode | None = None) -> Any:
    """Return the value of an attribute, `default` where there is none."""
    attribute = prim.GetAttribute(name)
    value = attribute.Get(Usd.TimeCode.Default() if time is None else time) if attribute else None
    return default if value is None else value


def decimal(value: float) -> float:
    """Return the decimal number that was written as float32: seven digits give it back."""
    return float(f"{float(value):.7g}")


def decimals(values: Iterable[float]) -> tuple[float, float, float]:
    """Return three numbers that were written as float32."""
    a, b, c = map(decimal, values)
    return a, b, c


def ancestors(prim: Usd.Prim) -> Iterator[Usd.Prim]:
    """Yield a prim and its ancestors, without the pseudo-root."""
    while prim and not prim.IsPseudoRoot():
        yield prim
        prim = prim.GetParent()
