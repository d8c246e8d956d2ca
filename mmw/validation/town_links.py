"""Trace links of shipped towns once, for all rows that compare their statistics."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from mmw.channel import statistics as st
from mmw.channel.links import make_links
from mmw.channel.path_solver.solver import solve_paths
from mmw.channel.path_solver.surface_table import make_surface_table
from mmw.channel.path_table import CarrierPaths, rows_from_paths
from mmw.channel.paths import LOS_STATES
from mmw.config import load_config
from mmw.scene.device_scene import DeviceScene
from mmw.scene.loading import load_scene

SHORT = ("town03_five_way", "town05_ring_road", "town10_crossroad")
"""One scenario of each town with streets between buildings. Their averages lie close to those of all scenarios, which
rows of `mmw validate --full` have: loss over P.1411 and delay spread within 0.2 dB and 10 %."""

CARRIERS_HZ = (28e9, 4.9e9)

CARS = 10
"""Connected cars of each scenario, those nearest to its spawn center."""

RAYS = 10_000
"""Rays of each transmitter. 20,000 and 100,000 move the mean loss of 24 links by less than 0.05 dB and the median delay
spread by less than 1 %."""

RESOLUTION_S = 2e-9
"""Delay within which a channel sounder of 500 MHz sees one path: the line of sight and the ground below it [s]."""

WEATHER = "sunny"


@dataclass(frozen=True)
class TownLinks:
    """Statistics of L links at one carrier; paths count as resolved, their powers add."""

    carrier_hz: float
    scenario: np.ndarray
    """Scenario of each, shape [L]."""
    distance_m: np.ndarray
    """Distance of both antennas, shape [L]."""
    state: np.ndarray
    """Line of sight: `clear`, `foliage` or `blocked`, shape [L]."""
    loss_db: np.ndarray
    """Basic transmission loss between isotropic antennas, NaN without a path, shape [L]."""
    delay_spread_s: np.ndarray
    k_factor_db: np.ndarray
    """Power within `RESOLUTION_S` of the line of sight over that of all later paths [dB], shape [L]."""
    azimuth_tx_deg: np.ndarray
    """Spread of the azimuths of departure, shape [L]."""
    azimuth_rx_deg: np.ndarray

    def take(self, chosen: np.ndarray) -> "TownLinks":
        """Return some of the links, by a mask of shape [L]."""
        columns = {name: value[chosen] for name, value in vars(self).items() if name != "carrier_hz"}
        return TownLinks(self.carrier_hz, **columns)

    def of_state(self, state: str) -> "TownLinks":
        """Return the links with a state of the line of sight."""
        return self.take(self.state == state)


@cache
def _solved(scenario: str, device: str) -> dict[str, list[TownLinks]]:
    """Return the links of one scenario at its first frame: kind of link -> one entry a carrier."""
    config = load_config(
        "full",
        [
            "channel.physics=standard",
            f"channel.carriers_hz=[{', '.join(f'{carrier:g}' for carrier in CARRIERS_HZ)}]",
            f"channel.samples_per_tx={RAYS}",
            "channel.antennas=[{pattern: iso}]",
            "channel.links=[v2i, {name: first_car, tx: [cav_1], rx: [cav]}]",
            "frames.start=0",
            "frames.count=1",
            f"scenarios.*.traffic.cav_ranks={list(range(CARS))}",
        ],
    )
    scene = load_scene(config, scenario=scenario, weather=[WEATHER], device=device)
    data, frames = scene.arrays, [scene.frames[0]]
    on_device = DeviceScene(data, scene.device, len(frames))
    on_device.load_batch(frames)
    links = make_links(data, frames, config.channel)
    table = make_surface_table(on_device, **config.channel.surface_options)
    paths = solve_paths(on_device, links, config.channel, data.materials, table, air=scene.weathers)
    state = np.array(LOS_STATES)[paths.los_state(WEATHER)]
    distance = np.linalg.norm(links.rx.position - links.tx.position, axis=1)
    found: dict[str, list[TownLinks]] = {}
    for kind, name in enumerate(config.channel.link_names):
        own = np.flatnonzero(links.kind == kind)
        found[name] = [
            _statistics(rows_from_paths(links, paths, WEATHER, carrier).take(own), scenario, distance[own], state[own])
            for carrier in CARRIERS_HZ
        ]
    return found


def _statistics(rows: CarrierPaths, scenario: str, distance: np.ndarray, state: np.ndarray) -> TownLinks:
    power = np.abs(rows.a) ** 2
    first = np.full(rows.link_count, np.inf)
    np.minimum.at(first, rows.link, rows.tau)
    is_first = rows.tau < first[rows.link] + RESOLUTION_S
    early, late = (np.bincount(rows.link, power * own, rows.link_count) for own in (is_first, ~is_first))
    with np.errstate(divide="ignore", invalid="ignore"):
        k_factor = 10.0 * np.log10(early / late)
    return TownLinks(
        carrier_hz=rows.carrier_hz,
        scenario=np.full(rows.link_count, scenario),
        distance_m=distance,
        state=state,
        loss_db=st.path_loss_db(rows),
        delay_spread_s=st.rms_delay_spread(rows),
        k_factor_db=k_factor,
        azimuth_tx_deg=np.degrees(st.azimuth_spread(rows, "tx")),
        azimuth_rx_deg=np.degrees(st.azimuth_spread(rows, "rx")),
    )


@cache
def town_links(kind: str, carrier_hz: float, device: str, scenarios: Sequence[str] = SHORT) -> TownLinks:
    """Return the links of one kind at a carrier, over scenarios.

    Args:
        kind: `v2i`, from the roadside unit to the cars, or `first_car`, from the first car to the others.
        carrier_hz: One of `CARRIERS_HZ`.
        device: Warp device.
        scenarios: Scenarios of `configs/full.yaml`, a tuple.
    """
    parts = [_solved(scenario, device)[kind][CARRIERS_HZ.index(carrier_hz)] for scenario in scenarios]
    columns = [name for name in vars(parts[0]) if name != "carrier_hz"]
    return TownLinks(carrier_hz, **{name: np.concatenate([getattr(part, name) for part in parts]) for name in columns})


def all_scenarios() -> tuple[str, ...]:
    """Return the names of the scenarios of `configs/full.yaml`."""
    return tuple(scenario.name for scenario in load_config("full").scenarios)
