"""Beams from positions alone: top-k of measured scenarios and of a dataset, beside what is published.

    python -m examples.position_beams out/quickstart --carrier 28e9
    python -m examples.position_beams out/positions --deepsense Scenario1 Scenario5

The dataset has GNSS and links from a roadside unit; `--deepsense` takes scenarios that you have downloaded. A score
needs hundreds of samples; the quickstart has 30. Protocol and predictors: `mmw.dataset.position_beams`.
"""

import argparse
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from mmw.core.errors import InputError
from mmw.dataset import open_dataset
from mmw.dataset.beam_samples import BeamSamples, link_samples
from mmw.dataset.deepsense import PUBLISHED, read_deepsense
from mmw.dataset.position_beams import look_up_table, nearest_neighbors, score_positions


def main(argv: Sequence[str] | None = None) -> None:
    """Score what is given, and print one table."""
    parser = argparse.ArgumentParser(prog="python -m examples.position_beams")
    parser.add_argument("root", type=Path, nargs="?", help="dataset of mmw")
    parser.add_argument("--deepsense", type=Path, nargs="*", default=[], help="folders of scenarios of DeepSense 6G")
    parser.add_argument("--carrier", type=float, help="carrier of the dataset [Hz]; left out, the only one")
    parser.add_argument("--weather", default="sunny", help="weather of the dataset")
    given = parser.parse_args(argv)
    rows, left = [], dict(PUBLISHED)
    for samples in [*map(read_deepsense, given.deepsense), *_of_dataset(given.root, given.carrier, given.weather)]:
        nearest, table = (score_positions(samples, method).top for method in (nearest_neighbors, look_up_table))
        number = re.fullmatch(r"scenario(\d+)(_\w+)?", samples.name)
        rows.append((samples.name, len(samples), nearest, table, left.pop(int(number[1]), ()) if number else ()))
    rows += [(f"scenario{number}", "", (), (), top) for number, top in left.items()]
    print(f"{'top-1, 2, 3 [%]':28} {'samples':>8} {'neighbors':>18} {'look-up table':>18} {'published':>18}")
    for name, count, *accuracies in rows:
        print(f"{name:28} {count:8} " + " ".join(f"{_percent(top):>18}" for top in accuracies))


def _of_dataset(root: Path | None, carrier_hz: float | None, weather: str) -> Iterator[BeamSamples]:
    """Yield the samples of every scenario of a dataset."""
    if root is None:
        return
    data = open_dataset(root)
    carriers = data.info["config"]["channel"]["carriers_hz"]
    if carrier_hz is None and len(carriers) != 1:
        raise InputError(f"{root}: carriers {', '.join(f'{one:g}' for one in carriers)} Hz; name one by --carrier")
    for scenario in data.info["config"]["scenarios"]:
        yield link_samples(data, scenario=scenario["name"], carrier_hz=carrier_hz or carriers[0], weather=weather)


def _percent(top: Sequence[float]) -> str:
    return "  ".join(f"{value:4.1f}" for value in top)


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except InputError as error:
        sys.exit(str(error))
