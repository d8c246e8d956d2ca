"""Write the page `docs/reference/channel-statistics.md` from what `bench.link_statistics` stored.

python -m bench.link_statistics_page
"""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from bench.link_statistics import (
    BELOW_DB,
    GRADUAL_DB,
    JUMP_DB,
    PERCENTILES,
    RANGE_DB,
    SAME_LENGTH_M_S,
    SAME_WAVE_RAD,
    STRONG_DB,
)
from mmw.channel.tr38901 import LogNormal, street_canyon
from mmw.config.physics_presets import PHYSICS_PRESETS

ROOT = Path(__file__).parents[1]
FILE = ROOT / "docs" / "reference" / "data" / "channel_statistics.json"
PAGE = ROOT / "docs" / "reference" / "channel-statistics.md"

DISTANCE_M = 30.0
"""Distance at which the zenith spread of departure of TR 38.901 is shown [m]; the other spreads have none."""

NO_VALUE = "-"

RATE_HZ = 100
"""Frames a second of the tables; other rates are in that of continuity."""

SPREADS = {
    "delay_spread_ns": "DS [ns]", "azimuth_departure_deg": "ASD [deg]", "azimuth_arrival_deg": "ASA [deg]",
    "zenith_departure_deg": "ZSD [deg]", "zenith_arrival_deg": "ZSA [deg]",
}  # fmt: skip
"""Key of a record -> heading."""

HEAD = f"""# Channel statistics

Measured over the links from the roadside unit to the CAVs, with one vertical dipole at both ends, in dry weather, by [preset of the physics](../concepts/channel.md#options). Numbers as data: [channel_statistics.json](data/channel_statistics.json), filled by

```bash
python -m bench.link_statistics --json docs/reference/data/channel_statistics.json --frames 40
python -m bench.link_statistics_page
```

The first command replaces only what it measures (`--scenarios`, `--physics`, `--rate-hz`); the second makes this page. Functions: `mmw.channel.statistics`, `mmw.channel.track_statistics` and `mmw.channel.tr38901` ([reference](api/channel.md)).

- Paths count as resolved: powers add. A link of one frame is a link-frame.
- Cells with three numbers are the median and, in parentheses, the {PERCENTILES[0]}th and {PERCENTILES[2]}th percentile.
"""  # noqa: E501

LIVES = f"""
## Lives of paths

Identifiers `path_id` over successive frames, without diffuse paths. Births and jumps count within {RANGE_DB:g} dB of the strongest path of the link. Lives are those of paths of which the preset leaves out the weakest: `standard` was traced to {RANGE_DB + BELOW_DB:g} dB for them, so a path that crosses {RANGE_DB:g} dB is not born.

- **births**: paths per link-frame that the link did not have in the frame before; **continue**: of these, share where a path of nearly the same length (within {SAME_LENGTH_M_S / RATE_HZ:g} m) ended there; **one wave**: and of the same directions (within {np.degrees(SAME_WAVE_RAD):.2g} deg)
- **life**: median lifetime after a birth by the estimator of Kaplan and Meier, which counts paths that outlast the recording; **one frame**: share of lives that end after their first frame
- **jumps**: steps of more than {JUMP_DB:g} dB from one frame to the next of one path
"""  # noqa: E501

CONTINUITY = f"""
## Continuity

A vehicle that passes at 10 m/s moves by nine wavelengths of 28 GHz in 1/100 s. Behind an edge 10 m away the level then changes by 3 dB from frame to frame, so a step between frames of 1/100 s need not be one of the channel. More frames a second tell. Columns as above, with lengths that change by {SAME_LENGTH_M_S:g} m/s at most, and:

- **births a second**: of each link
- **strong ends**: births and ends of paths within {STRONG_DB:g} dB of the strongest of their link, for each link and second. An obstacle in the way ends a path there too; its edge then carries on what is left.
"""  # noqa: E501

GRADUAL = f"""
The same recordings as every 1/{RATE_HZ} s shows them, from every first frame, and what the frames in between tell:

- **jumps**: steps of more than {JUMP_DB:g} dB in 1/{RATE_HZ} s
- **gradual**: share of the jumps without a change of more than {GRADUAL_DB:g} dB between two frames in between: the field fades that fast. **with a step**: share of those with one of more than {JUMP_DB:g} dB, or in which the path is away
- **steps**: jumps with a step, as a share of all changes
- **one wave**: births that continue an ended path, as above; **renamed**: births that do so from one frame to the next, too. The others are two paths: one ends and another begins within 1/{RATE_HZ} s, or they are there together.
"""  # noqa: E501

DISPERSION = f"""
- **K**: power of the strongest path over that of all others; in rows of TR 38.901 that of the line of sight over the rest
- **K, moments**: K-factor of the narrowband gain by the method of moments (Greenstein et al. 1999) for uniform phases
- **DS**, **ASD**, **ASA**, **ZSD**, **ZSA**: rms delay spread, and circular spreads of azimuth and zenith of departure (at the roadside unit) and arrival, 3GPP TR 38.901, Annex A.1
- **TR 38.901**: UMi street canyon, table 7.5-6, ZSD of table 7.5-8 at {DISTANCE_M:g} m; its base station is 10 m high, its spreads of azimuth end at 104 deg, those of zenith at 52 deg
- **median scenario**: median of the column over the scenarios of the preset
- `inf`: there is one path only
"""  # noqa: E501


def channel_statistics_page(records: list[dict[str, Any]]) -> str:
    """Return the page as Markdown.

    Args:
        records: Records of `bench.link_statistics`.
    """
    ranks = list(PHYSICS_PRESETS)
    records = sorted(records, key=lambda own: (own["scenario"], ranks.index(own["physics"]), own["carrier_hz"]))
    carriers = sorted({own["carrier_hz"] for own in records})
    finer = [own for own in records if own["rate_hz"] != RATE_HZ]
    records = [own for own in records if own["rate_hz"] == RATE_HZ]
    once = [own for own in records if own["carrier_hz"] == carriers[0]]
    lines = [HEAD, *_measured(once), *_sights(once), LIVES, *_lives(records)]
    if finer:
        lines += [CONTINUITY, *_continuity_of_all(finer), *_continuity(finer)]
        thinned = [own for own in finer if "thinned_jumps" in own]
        lines += [GRADUAL, *_gradual(thinned)] if thinned else []
    for is_los, title in ((True, "With line of sight"), (False, "Without line of sight")):
        lines += ["", f"## {title}", "", _state_text(is_los)]
        lines += [DISPERSION] if is_los else [""]
        for carrier in carriers:
            own = [each for each in records if each["carrier_hz"] == carrier]
            lines += [f"### {title}, {carrier / 1e9:g} GHz", "", *_dispersion(own, carrier, is_los), ""]
        lines.pop()
    return "\n".join(lines) + "\n"


def _state_text(is_los: bool) -> str:
    if is_los:
        return "Link-frames whose line of sight is clear or passes foliage."
    return "Link-frames whose line of sight is blocked and that have a path."


def _measured(records: list[dict[str, Any]]) -> list[str]:
    """Return which presets have which frames."""
    by_preset: dict[str, list[dict[str, Any]]] = {}
    for own in records:
        by_preset.setdefault(own["physics"], []).append(own)
    out = []
    for physics, group in by_preset.items():
        shapes = sorted({(own["bursts"], own["frames"]) for own in group})
        text = ", ".join(f"{bursts} x {frames}" for bursts, frames in shapes)
        out.append(f"- `{physics}`: scenarios {len(group)}; bursts x successive frames of 1/{RATE_HZ} s {text}")
    return out


def _sights(records: list[dict[str, Any]]) -> list[str]:
    head = "| scenario | preset | link-frames | distance [m] | clear | foliage | blocked | without path |"
    lines = ["", "## Line of sight and outage", "", "Shares of link-frames [%]; median horizontal distance.", "", head]
    lines.append("|---|---|---|---|---|---|---|---|")
    for own in records:
        shares = (_percent(own[name]) for name in ("clear", "foliage", "blocked", "without_path"))
        cells = (own["scenario"], own["physics"], str(own["links"]), f"{own['distance_m']:.0f}", *shares)
        lines.append(_row(cells))
    return lines


def _lives(records: list[dict[str, Any]]) -> list[str]:
    head = ("scenario", "preset", "GHz", "births", "continue [%]", "one wave [%]", "life [ms]", "one frame [%]")
    lines = [_row([*head, "jumps [%]"]), "|" + "---|" * (len(head) + 1)]
    for own in records:
        case = own["scenario"], own["physics"], f"{own['carrier_hz'] / 1e9:g}", f"{own['births_per_link_frame']:.2g}"
        births = _percent(own["births_that_continue"]), _percent(own["births_of_one_wave"])
        lines.append(_row([*case, *births, _life(own), _percent(own["lives_of_one_frame"]), _percent(own["jumps"])]))
    return lines


def _continuity_of_all(records: list[dict[str, Any]]) -> list[str]:
    """Return what all recordings of more frames a second tell together."""
    births, jumps, gradual = [], 0.0, []
    for carrier in sorted({own["carrier_hz"] for own in records}):
        some = [own for own in records if own["carrier_hz"] == carrier and own["births"]]
        count = sum(own["births"] for own in some)
        delay, wave = (
            100.0 * sum(own["births"] * own[name] for own in some) / count
            for name in ("births_that_continue", "births_of_one_wave")
        )
        births.append(f"{delay:.1f} % at {carrier / 1e9:g} GHz ({wave:.1f} % as one wave)")
        jumps = max(jumps, *(100.0 * own["jumps"] for own in some))
        share = [own["thinned_jumps_gradual"] for own in some if own.get("thinned_jumps_gradual") is not None]
        if share:
            gradual.append(f"{100.0 * np.mean(share):.0f} % at {carrier / 1e9:g} GHz")
    lines = [
        f"Of the births of all recordings with more frames a second, {' and '.join(births)} continue an ended delay; "
        f"none has more than {jumps:.2g} % of jumps. Points of reflection on one curved surface, and diffracted paths "
        "at edges that run side by side, are named by their rank.\n"
    ]
    if gradual:
        lines.append(
            f"The jumps that are left at {RATE_HZ} frames a second are of two kinds. Many ({', '.join(gradual)}, means "
            "of the scenarios) are gradual, as the field fades at cars: a Kirchhoff integral in float64 over the same "
            "smooth surface, in triangles of a sixth of a wavelength, falls at the roof of a car by 4.7 dB in 9 ms, "
            "where the path loses 3.2 dB (over 27 ms both differ by up to 4 dB about their mean); at a flank of paint "
            "and glass the path follows the integral over the paint within 0.9 dB. The others are points on one body "
            "that take over each other's rank, or that end where the outline of a panel does.\n"
        )
    return lines


def _continuity(records: list[dict[str, Any]]) -> list[str]:
    head = ["scenario", "preset", "GHz", "frames a second", "frames", "births a second", "continue [%]", "one wave [%]"]
    head += ["strong ends", "jumps [%]"]
    lines = [_row(head), "|" + "---|" * len(head)]
    for own in records:
        case = own["scenario"], own["physics"], f"{own['carrier_hz'] / 1e9:g}", str(own["rate_hz"]), str(own["frames"])
        births = f"{own['births_per_link_frame'] * own['rate_hz']:.0f}"
        jumps = NO_VALUE if own["jumps"] is None else f"{100 * own['jumps']:.3f}"
        old = _percent(own["births_that_continue"]), _percent(own["births_of_one_wave"])
        lines.append(_row([*case, births, *old, f"{own['strong_ends_per_s']:.1f}", jumps]))
    return lines


def _gradual(records: list[dict[str, Any]]) -> list[str]:
    head = ["scenario", "preset", "GHz", "link-frames", "jumps [%]", "gradual [%]", "with a step [%]", "steps [%]"]
    head += ["one wave [%]", "renamed [%]"]
    lines = [_row(head), "|" + "---|" * len(head)]
    for own in records:
        case = own["scenario"], own["physics"], f"{own['carrier_hz'] / 1e9:g}", str(own["links"])
        jumps, with_step = own["thinned_jumps"], own["thinned_jumps_with_step"]
        shares = _percent(jumps), _percent(own["thinned_jumps_gradual"]), _percent(with_step)
        steps = NO_VALUE if jumps is None else f"{100 * jumps * (with_step or 0.0):.3f}"
        births = _percent(own["thinned_births_of_one_wave"]), _percent(own["thinned_births_renamed"])
        lines.append(_row([*case, *shares, steps, *births]))
    return lines


def _life(own: dict[str, Any]) -> str:
    if own["median_life_s"] is None:
        return NO_VALUE
    if own["median_life_s"] == "inf":
        return "longer than the recording"
    return f"{1e3 * own['median_life_s']:.0f}"


def _dispersion(records: list[dict[str, Any]], carrier_hz: float, is_los: bool) -> list[str]:
    names = ["paths", "k_strongest_db", "k_moments_db", *SPREADS]
    lines = [_row(["scenario", "preset", "link-frames", "paths", "K [dB]", "K, moments [dB]", *SPREADS.values()])]
    lines.append("|" + "---|" * (len(names) + 3))
    lines.append(_row(["TR 38.901", "", "", "", *_canyon(carrier_hz, is_los)]))
    by_preset: dict[str, list[dict[str, Any]]] = {}
    rows = []
    for own in records:
        part = own["los" if is_los else "nlos"]
        if part["links"]:
            by_preset.setdefault(own["physics"], []).append(part)
            rows.append(_row([own["scenario"], own["physics"], str(part["links"]), *_cells(part, names)]))
    for physics, parts in by_preset.items():
        middle = _cells({n: np.median([_numbers(part[n]) for part in parts], axis=0) for n in names}, names)
        lines.append(_row(["median scenario", physics, str(sum(part["links"] for part in parts)), *middle]))
    return lines + rows


def _cells(part: dict[str, Any], names: list[str]) -> list[str]:
    return [_three(part[name], is_count=name == "paths") for name in names]


def _canyon(carrier_hz: float, is_los: bool) -> list[str]:
    """Return the cells of the street canyon of TR 38.901 from K on."""
    own = street_canyon(carrier_hz, is_los, DISTANCE_M)
    k_factor = NO_VALUE
    if own.k_factor_db is not None:
        decile = LogNormal(*own.k_factor_db)
        k_factor = _three([float(np.log10(value)) for value in decile.percentiles])
    delay = [1e9 * value for value in own.delay_spread_s.percentiles]
    angles = (
        own.azimuth_spread_departure_deg, own.azimuth_spread_arrival_deg, own.zenith_spread_departure_deg,
        own.zenith_spread_arrival_deg,
    )  # fmt: skip
    return [k_factor, NO_VALUE, _three(delay), *(_three(list(each.percentiles)) for each in angles)]


def _numbers(values: Iterable[Any]) -> list[float]:
    return [float(value) for value in values]


def _three(values: Iterable[Any], *, is_count: bool = False) -> str:
    low, middle, high = (f"{value:g}" if is_count else _short(value) for value in _numbers(values))
    return f"{middle} ({low}, {high})"


def _short(value: float) -> str:
    if not np.isfinite(value):
        return str(value)
    return f"{value:.0f}" if abs(value) >= 10 or value == 0 else f"{value:.1f}"


def _percent(share: float | None) -> str:
    return NO_VALUE if share is None else f"{100 * share:.1f}"


def _row(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Write the page."""
    PAGE.write_text(channel_statistics_page(json.loads(FILE.read_text())["records"]), encoding="utf-8")


if __name__ == "__main__":
    main()
