"""Radio links of a frame: paths as lines through the town, and gain, best beams and line of sight over time."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import rerun as rr

from mmw.channel.antennas.array_response import rotations_from_poses
from mmw.channel.path_table import CarrierPaths
from mmw.dataset import BeamSearch
from mmw.dataset.frame import Frame
from mmw.dataset.link import Link
from mmw.viz.plots.paths import gains_db, path_lines
from mmw.viz.plots.style import GAIN_DB, carrier_name, scale_colors
from mmw.viz.rerun.entities import SERIES, paths_entity, series_entity
from mmw.viz.rerun.selection import Scope

STATES = {"los": (90, 210, 120), "nlos": (240, 160, 50), "no path": (200, 60, 60)}
"""State of a link in the series `los` -> color."""

LINE_POINTS = 2.0
"""Width of a path's line on the screen, in Rerun's points. Design value."""

LinkName = tuple[float, str, str]
"""Carrier [Hz], receiver and transmitter."""


@dataclass
class RadioLogger:
    """Logs the links of frames one after the other; the caller sets the stream's time."""

    stream: rr.RecordingStream
    scope: Scope
    search: BeamSearch | None
    """Search for best beams; None leaves them out."""
    links: dict[LinkName, None] = field(default_factory=dict)
    """Links that were logged so far."""
    _shown: set[str] = field(default_factory=set)
    _there: set[LinkName] = field(default_factory=set)

    def log(self, frame: Frame) -> None:
        """Log one frame; paths that are gone are cleared, and series of links that are gone have a gap."""
        own = [link for link in reversed(frame.links) if link.agent in self.scope.agents]
        found = list({(link.carrier_hz, link.agent, link.peer): link for link in own}.values())  # of first antennas
        beams = best_beams(frame, found, self.search) if self.search and "paths" in self.scope.data.views else {}
        shown, there = set(), set()
        for link in found:
            name = (link.carrier_hz, link.agent, link.peer)
            there.add(name)
            if name not in self.links:
                self.links[name] = None
                self._describe(name)
            shape = path_strips(frame, link)
            if shape is not None:
                shown.add(paths_entity(*name))
                self.stream.log(paths_entity(*name), shape)
            gain = np.nan if link.gain_db is None or not np.isfinite(link.gain_db) else float(link.gain_db)
            self._log_scalars(name, {"gain": gain, **beams.get(name, {})})
            state = "los" if link.is_los else "nlos" if np.isfinite(gain) else "no path"
            self.stream.log(series_entity("los", *name), rr.StateChange(state=state))
        for entity in self._shown - shown:
            self.stream.log(entity, rr.Clear(recursive=False))
        for name in self._there - there:
            self._log_scalars(name, dict.fromkeys(set(SERIES) - {"los"} if self.search else {"gain"}, np.nan))
            self.stream.log(series_entity("los", *name), rr.Clear(recursive=False))
        self._shown, self._there = shown, there

    def _log_scalars(self, name: LinkName, values: Mapping[str, float]) -> None:
        for series, value in values.items():
            self.stream.log(series_entity(series, *name), rr.Scalars(value))

    def _describe(self, name: LinkName) -> None:
        """Log names of a link's series, and colors of its states."""
        text = f"{name[1]} from {name[2]}, {carrier_name(name[0])}"
        for series in SERIES:
            if series == "los":
                states = rr.StateConfiguration(values=list(STATES), colors=list(STATES.values()))
                self.stream.log(series_entity(series, *name), states, static=True)
            elif series == "gain" or self.search:
                self.stream.log(series_entity(series, *name), rr.SeriesLines(names=text), static=True)


def path_strips(frame: Frame, link: Link) -> rr.LineStrips3D | None:
    """Return the paths of a link as lines from transmitter to receiver; None without any, or without an end's place."""
    for name, antenna in ((link.peer, link.peer_antenna), (link.agent, link.antenna)):
        if name not in frame.agents or antenna not in frame.agents[name].sensors:
            return None
    if not len(link.a):
        return None
    gain_db = gains_db(link.a)
    return rr.LineStrips3D(
        path_lines(frame, link),
        colors=scale_colors(gain_db, *GAIN_DB),
        radii=rr.Radius.ui_points(LINE_POINTS),
        labels=[f"{kind}, {gain:.1f} dB" for kind, gain in zip(link.paths["kind"], gain_db, strict=True)],
        show_labels=False,
    )


def best_beams(frame: Frame, links: list[Link], search: BeamSearch) -> dict[LinkName, dict[str, float]]:
    """Return gain [dB] and numbers of the best pair of beams of each link, NaN for a link without path."""
    found = {}
    wanted = {(link.carrier_hz, link.agent, link.peer) for link in links}
    for carrier in sorted({link.carrier_hz for link in links}):
        paths = CarrierPaths.from_table(frame.table("paths"), carrier, frame.table("links"))
        keys = [(carrier, str(key["agent"]), str(key["peer"])) for key in paths.keys]
        own = np.array([index for index, key in enumerate(keys) if key in wanted], dtype=np.int64)
        paths = paths.take(own)
        pairs = search.best(paths, *(rotations_from_poses(frame.table("poses"), paths, end) for end in ("tx", "rx")))
        with np.errstate(divide="ignore"):
            numbers = np.stack([10.0 * np.log10(pairs.gain), pairs.tx_beam, pairs.rx_beam], axis=1)
        numbers[pairs.tx_beam < 0] = np.nan
        for index, row in zip(own, numbers.tolist(), strict=True):
            found.setdefault(keys[index], dict(zip(("beam_gain", "tx_beam", "rx_beam"), row, strict=True)))
    return found
