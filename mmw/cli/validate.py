"""Hold the simulator against measurements, standards and closed forms: `mmw validate`."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from mmw.cli.command import run_command


def main(argv: Sequence[str], prog: str = "mmw validate") -> int:
    """Run `mmw validate` and return its exit code."""
    parser = argparse.ArgumentParser(
        prog=prog,
        description="Compute what measurements, standards and closed forms give, and say where the simulator agrees.",
        epilog="docs/reference/validation.md is its page. Exit codes: 0 all rows are as expected, 1 a row that has to "
        "be green is red, or one that is known to be red is green, 2 an unknown row.",
    )
    parser.add_argument("rows", nargs="*", metavar="ROW", help="rows or topics, such as materials; all by default")
    parser.add_argument("--full", action="store_true", help="also rows that need minutes or a GPU")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N")
    parser.add_argument("--page", type=Path, metavar="FILE.md", help="write the page and its figures (extra plot)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers")
    return run_command(parser, _validate, argv)


def _validate(options: argparse.Namespace) -> int:
    from mmw.core.device import choose_device
    from mmw.core.errors import InputError
    from mmw.validation import Result, all_checks, run_checks
    from mmw.validation.page import write_page

    checks = all_checks()
    known = {check.name for check in checks} | {check.topic for check in checks}
    if unknown := [name for name in options.rows if name not in known]:
        raise InputError(f"mmw validate: unknown row {unknown[0]!r}; choose among {', '.join(sorted(known))}")
    if options.rows:
        checks = [check for check in checks if {check.name, check.topic} & set(options.rows)]
    if not options.full:
        checks = [check for check in checks if not check.is_long]

    def tell(result: Result) -> None:
        color = "green" if result.is_green else "red"
        check, value, published = result.check, result.measurement.value, result.check.reference
        agrees = f"{published.low:.4g} to {published.high:.4g} {check.unit}".rstrip()
        print(f"{color:5}  {check.name:32} {value:9.4g}  ({agrees})  {result.seconds:.1f} s", flush=True)

    results = run_checks(checks, choose_device(options.device), tell)
    if options.json is not None:
        options.json.write_text(json.dumps([result.record for result in results], indent=1) + "\n")
    if options.page is not None:
        write_page(results, options.page)
    problems = [result for result in results if result.problem]
    for result in problems:
        print(f"mmw: {result.check.name}: {result.problem}")
    print(f"{sum(result.is_green for result in results)} of {len(results)} rows are green")
    return 1 if problems else 0
