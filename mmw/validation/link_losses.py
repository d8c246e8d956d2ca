"""Compare losses of links with models over distance."""

from collections.abc import Callable
from typing import Any

import numpy as np

from mmw.validation.town_links import TownLinks

Model = Callable[[np.ndarray], np.ndarray]
"""Loss [dB] over distance [m]."""

Average = Callable[[Any], Any]
"""`np.mean` or `np.median`."""


def over_scenarios(scenario: np.ndarray, values: np.ndarray, average: Average) -> float:
    """Return the average over scenarios, each of which counts once, of the averages over their links."""
    return float(average([average(values[scenario == name]) for name in dict.fromkeys(scenario)]))


def describe_difference(links: TownLinks, off: np.ndarray) -> str:
    """Return number, distances and spread of links whose loss differs by `off` from a model [dB], shape [L]."""
    return (
        f"{len(off)} links of {links.distance_m.min():.0f} to {links.distance_m.max():.0f} m, standard deviation "
        f"{off.std():.1f} dB"
    )


def draw_losses(
    scenario: np.ndarray, distance: np.ndarray, loss: np.ndarray, carrier_hz: float, curves: dict[str, Model]
) -> Callable[[Any], None]:
    """Return a function that draws losses over distance beside models.

    Args:
        scenario: Scenario of each link, shape [L].
        distance: Its length [m].
        loss: Its loss [dB].
        carrier_hz: Carrier frequency [Hz].
        curves: Name -> model.
    """

    def draw(axes: Any) -> None:
        grid = np.geomspace(distance.min() * 0.9, distance.max() * 1.1, 50)
        names = list(dict.fromkeys(scenario))
        for name in names if len(names) < 5 else ():
            axes.plot(distance[scenario == name], loss[scenario == name], "o", ms=4, label=str(name))
        if len(names) >= 5:
            axes.plot(distance, loss, "o", ms=3, label=f"links of {len(names)} scenarios")
        for (name, curve), style in zip(curves.items(), ("k-", "k--", "k:"), strict=False):
            axes.plot(grid, curve(grid), style, lw=1, label=name)
        axes.set_xlabel("distance [m]")
        axes.set_ylabel(f"loss at {carrier_hz / 1e9:g} GHz [dB]")
        axes.legend(fontsize=7)

    return draw
