"""Write a dataset, or a part of it, in the format of another tool: `mmw export`."""

import argparse
import re
from collections.abc import Sequence
from pathlib import Path

from mmw.cli.command import run_command
from mmw.core.errors import InputError

FILTERS = {"scenario": "scenarios", "weather": "weathers", "agent": "agents"}
"""Filter of the command -> field of `Selection`."""


def main(argv: Sequence[str], prog: str = "mmw export") -> int:
    """Run `mmw export` and return its exit code."""
    parser = argparse.ArgumentParser(
        prog=prog,
        description="Write a dataset, or a part of it, in another format. Run the same command again to resume.",
        epilog="docs/guides/export.md describes every format. Exit codes: 0 done, 2 a format, folder, filter or option "
        "that cannot be used, 1 failure while running.",
    )
    parser.add_argument("format", nargs="?", default="", help="format; --list prints them")
    parser.add_argument("root", nargs="?", help="dataset folder, or a URI such as s3://bucket/folder")
    parser.add_argument("out", nargs="?", type=Path, help="folder for the files; a new one, or one to resume")
    parser.add_argument(
        "values", nargs="*", metavar="name=value",
        help="filters: scenario=A,B weather=A,B agent=A,B frames=START:STOP:STEP; others are options of the format",
    )  # fmt: skip
    parser.add_argument("--list", action="store_true", help="print the formats, their options and what they lose")
    return run_command(parser, _export, argv, intermixed=True)


def _list() -> None:
    from mmw.dataset.export.registry import EXPORTERS, load_format

    for name in sorted(EXPORTERS):
        form = load_format(name)
        print(f"{name}: {form.summary}")
        for option in form.options:
            values = f" ({', '.join(option.choices)})" if option.choices else ""
            print(f"  {option.name}={option.default}: {option.summary}{values}")
        print("  cannot hold:")
        for line in form.losses:
            print(f"    - {line}")


def _export(arguments: argparse.Namespace) -> None:
    if arguments.list:
        _list()
        return
    from mmw.dataset.export.exporter import Selection, export

    if arguments.out is None:
        raise InputError("export: FORMAT, ROOT and OUT are needed; give all three, or --list")
    picked: dict[str, tuple[str, ...]] = {}
    frames, options = None, {}
    for text in arguments.values:
        name, equals, value = text.partition("=")
        if not equals or not value:
            raise InputError(f"export: {text!r}: name=value is needed; write scenario=NAME or option=VALUE")
        if name == "frames":
            frames = frames_of(value)
        elif name in FILTERS:
            picked[FILTERS[name]] = (*picked.get(FILTERS[name], ()), *value.split(","))
        else:
            options[name] = value
    export(arguments.root, arguments.format, arguments.out, Selection(**picked, frames=frames), options)
    print(arguments.out)


def frames_of(text: str) -> range:
    """Return the frames of `START:STOP` or `START:STOP:STEP`; STOP is not among them.

    Raises:
        InputError: If the text is no range or the range is empty.
    """
    if not re.fullmatch(r"\d+:\d+(:\d+)?", text):
        raise InputError(f"frames={text}: START:STOP or START:STOP:STEP is needed, such as 0:100:10; write it so")
    frames = range(*(int(number) for number in text.split(":"))) if not text.endswith(":0") else range(0)
    if not frames:
        raise InputError(f"frames={text}: holds no frame; START must be below STOP and STEP above 0; change it")
    return frames
