"""`mmw town`: build, check and draw towns."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path


def main(argv: Sequence[str], prog: str = "mmw town") -> int:
    """Run a subcommand of `mmw town` and return its exit code."""
    parser = argparse.ArgumentParser(prog=prog, description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    build = commands.add_parser("build", help="build a town from its YAML description (needs mmw[author])")
    build.add_argument("description", help="the town's YAML file, or the name of a shipped town")
    build.add_argument("--out", type=Path, help="folder for the built asset; the description's own by default")
    arguments = parser.parse_args(argv)
    try:
        return {"build": _build}[arguments.command](arguments)
    except ValueError as error:
        print(f"mmw: {error}", file=sys.stderr)
        return 2
    except ImportError as error:
        print(f"mmw: {error}; install the extra that `mmw --help` names for this command", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"mmw: {error.filename}: {error.strerror}", file=sys.stderr)
        return 1


def _build(arguments: argparse.Namespace) -> int:
    from mmw.town.build import build_shipped_town, build_town

    path = Path(arguments.description)
    if path.suffix in (".yaml", ".yml"):
        print(build_town(path, arguments.out or path.parent))
    else:
        print(build_shipped_town(arguments.description, arguments.out))
    return 0
