"""Compare links between cars, and links past cars, with 3GPP TR 37.885."""

from collections.abc import Callable
from functools import cache
from itertools import product
from typing import Any

import numpy as np

from mmw.channel import PathSolver
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.physics.materials.material import RadioMaterial
from mmw.validation.check import Check, Measurement, Reference, Source
from mmw.validation.link_levels import add_ends
from mmw.validation.link_losses import describe_difference, draw_losses, over_scenarios
from mmw.validation.targets import load_asset
from mmw.validation.town_links import CARS, RAYS, SHORT, town_links

TR37885_LOSS = Source("3GPP TR 37.885", "table 6.2.1-1", "https://www.3gpp.org/dynareport/37885.htm", "other code")
TR37885_BLOCKAGE = Source(
    "3GPP TR 37.885", "section 6.2.1: vehicle blockage loss", "https://www.3gpp.org/dynareport/37885.htm", "other code"
)

LOS_SIGMA_DB = 3.0
"""Standard deviation of the loss with line of sight [dB]."""

BLOCKED_DB, BLOCKED_SIGMA_DB = 9.0, 4.5
"""Mean and standard deviation of the loss by a vehicle that is higher than both antennas, up to 540 m [dB]."""

ANTENNA_M = 1.6
"""Height of the antennas of a car, TR 37.885 [m]."""

BESIDE_M = (-0.6, -0.2, 0.2, 0.6)
"""How far the link is from the middle of the vehicle that it passes [m]."""

AWAY_M = (12.0, 18.0, 25.0)
"""Distances of the ends from the vehicle, ahead and behind [m]."""


def urban_loss_db(distance_m: np.ndarray, carrier_hz: float) -> np.ndarray:
    """Return the loss of an urban link between vehicles with line of sight [dB], TR 37.885, table 6.2.1-1."""
    return 38.77 + 16.7 * np.log10(distance_m) + 18.2 * np.log10(carrier_hz / 1e9)


def _los(carrier_hz: float) -> Callable[[str], Measurement]:
    def measure(device: str) -> Measurement:
        links = town_links("first_car", carrier_hz, device, SHORT).of_state("clear")
        off = links.loss_db - urban_loss_db(links.distance_m, carrier_hz)
        model = {"TR 37.885": lambda distance: urban_loss_db(distance, carrier_hz)}
        draw = draw_losses(links.scenario, links.distance_m, links.loss_db, carrier_hz, model)
        return Measurement(over_scenarios(links.scenario, off, np.mean), describe_difference(links, off), draw)

    return measure


def _los_row(ghz: float) -> Check:
    return Check(
        name=f"vehicles.los_loss_{ghz:g}ghz",
        title=f"Loss between cars at {ghz:g} GHz with line of sight, over TR 37.885 urban",
        computed=f"the first of {CARS} cars to the others in each of {', '.join(SHORT)}, first frame, antennas at "
        f"2.5 m, isotropic, preset `standard`, {RAYS:,} rays, each scenario counts once; mean difference",
        unit="dB",
        reference=Reference.plus_minus(0.0, LOS_SIGMA_DB),
        tolerance="the standard deviation of the model, 3 dB",
        sources=(TR37885_LOSS,),
        measure=_los(1e9 * ghz),
    )


@cache
def _past_vehicle_db(model: str, device: str) -> np.ndarray:
    """Return the loss over free space of links past a vehicle on a concrete road at 28 GHz [dB], infinite without path.

    Powers of paths add.
    """
    scene = load_asset("vehicles", model, device, physics="standard")
    scene.add_material("road", RadioMaterial("itu", itu="itu_concrete"))
    corners = [(-80.0, -80.0, 0.0), (80.0, -80.0, 0.0), (80.0, 80.0, 0.0), (-80.0, 80.0, 0.0)]
    scene.add_object("ground", corners, [(0, 1, 2), (0, 2, 3)], material="road", label="road")
    solver = PathSolver.preset("standard", samples_per_tx=5000)
    tx, rx = add_ends(scene)
    losses = []
    for behind, ahead, beside in product(AWAY_M, AWAY_M, BESIDE_M):
        tx.position, rx.position = (-behind, beside, ANTENNA_M), (ahead, beside, ANTENNA_M)
        power = float((np.abs(solver(scene, carriers_hz=28e9).a) ** 2).sum())
        free = (SPEED_OF_LIGHT / (4.0 * np.pi * 28e9 * (behind + ahead))) ** 2
        with np.errstate(divide="ignore"):
            losses.append(-10.0 * np.log10(power / free))
    return np.array(losses)


def _past_vehicle(model: str) -> Callable[[str], Measurement]:
    def measure(device: str) -> Measurement:
        loss = _past_vehicle_db(model, device)
        heard = np.sort(loss[np.isfinite(loss)])

        def draw(axes: Any) -> None:
            share = (np.arange(len(heard)) + 0.5) / len(loss)
            axes.step(heard, share, where="mid", label=f"simulated, {model}")
            if model != "sedan":
                exponent = np.linspace(-2.5, 2.5, 101)
                density = np.exp(-0.5 * exponent**2)
                curve = np.cumsum(density) / density.sum()
                axes.plot(BLOCKED_DB + BLOCKED_SIGMA_DB * exponent, curve, "k--", lw=1, label="TR 37.885")
            axes.set_ylim(0.0, 1.0)
            axes.set_xlabel("loss over free space [dB]")
            axes.set_ylabel("share of links")
            axes.legend(fontsize=8)

        quartile, middle = np.percentile(loss, (25, 50), method="inverted_cdf")
        text = f"{len(loss)} links, {len(loss) - len(heard)} without any path; lower quartile {quartile:.1f} dB"
        return Measurement(float(middle), text, draw)

    return measure


def _past_row(model: str, what: str, known_red: str = "") -> Check:
    is_below = model == "sedan"
    return Check(
        name=f"vehicles.past_{model}_28ghz",
        title=f"Loss of a link {what} at 28 GHz, median",
        computed=f"shipped `{model}` on a concrete road, antennas at {ANTENNA_M:g} m, 12 to 25 m ahead of it and "
        "behind; preset `standard`, powers add",
        unit="dB",
        reference=Reference.plus_minus(0.0, 3.0) if is_below else Reference.plus_minus(BLOCKED_DB, BLOCKED_SIGMA_DB),
        tolerance="the ground's reflection, at most 3 dB"
        if is_below
        else "the standard deviation of the model, 4.5 dB",
        sources=(TR37885_BLOCKAGE,),
        measure=_past_vehicle(model),
        known_red=known_red,
    )


CHECKS = (
    _los_row(28.0),
    _los_row(4.9),
    _past_row("sedan", "above a sedan of 1.45 m"),
    _past_row(
        "suv", "past an SUV of 1.69 m",
        known_red="a path bends around one edge, and the roof has two, at the windscreen and at the tailgate: what is "
        "left are waves that pass one of them and are reflected at the roof, and those below the body. Diffraction at "
        "two edges would mend it",
    ),
    _past_row(
        "box_truck", "past a box truck of 3.2 m",
        known_red="as for the SUV: over the box and around its sides lie two edges, so that half of the links have no "
        "path at all, and the others one below the chassis or at a rounded edge. In a street walls reflect past it. "
        "Diffraction at two edges would mend it",
    ),
)  # fmt: skip
"""Rows of this topic."""
