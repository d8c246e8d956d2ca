"""List the shipped configurations, and copy one to edit: `mmw configs`."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from mmw.cli.command import run_command
from mmw.config import config_path
from mmw.config.yaml_file import read_yaml
from mmw.core.errors import InputError
from mmw.core.resources import shipped_configs
from mmw.storage.atomic_files import write_bytes_atomically


def main(argv: Sequence[str], prog: str = "mmw configs") -> int:
    """Run `mmw configs` and return its exit code: 0 done, 2 no such configuration, or a file is in the way."""
    parser = argparse.ArgumentParser(
        prog=prog, description="List the configurations that come with mmw, or copy one to edit."
    )
    commands = parser.add_subparsers(dest="action", metavar="{list,copy}")
    commands.add_parser("list", help="print names and what they generate (also without an action)")
    copy = commands.add_parser("copy", help="copy a configuration, and the files that it includes")
    copy.add_argument("name", metavar="NAME", help="one of the listed names")
    copy.add_argument("target", nargs="?", type=Path, metavar="FILE", help="file to write; by default NAME.yaml")
    copy.add_argument("--overwrite", action="store_true", help="replace files that exist")
    return run_command(parser, _configs, argv)


def _configs(arguments: argparse.Namespace) -> None:
    if arguments.action == "copy":
        target = arguments.target or Path(f"{arguments.name}.yaml")
        for path in copy_config(arguments.name, target, overwrite=arguments.overwrite):
            print(path)
        return
    shipped = shipped_configs()
    width = max(map(len, shipped))
    for name, path in shipped.items():
        print(f"{name:{width}}  {description(path)}")
    print("\nRun one: mmw run NAME. Edit one: mmw configs copy NAME.")


def description(path: Path) -> str:
    """Return the first comment of a shipped configuration that is for people."""
    comments = (line[1:].strip() for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("#"))
    return next(line for line in comments if not _is_modeline(line)).rstrip(".")


def copy_config(name: str, target: Path, *, overwrite: bool = False) -> list[Path]:
    """Copy a shipped configuration and the files that it includes, which keep their places relative to it.

    Args:
        name: Name of the configuration.
        target: File to write.
        overwrite: Whether files that exist are replaced.

    Returns:
        Files that were written.

    Raises:
        InputError: If no configuration has the name, a file exists (none is written then), or one cannot be written.
    """
    shipped = shipped_configs()
    if name not in shipped:
        config_path(name)  # names the nearest ones
        raise InputError(f"{name}: is a file of yours, no shipped configuration; those are {', '.join(shipped)}")
    source = shipped[name]
    included = [entry for entry in read_yaml(source, "a configuration")["scenarios"] if isinstance(entry, str)]
    files = {target: source} | {target.parent / entry: source.parent / entry for entry in included}
    existing = [path for path in files if path.exists()]
    if existing and not overwrite:
        raise InputError(f"{existing[0]}: exists; give another FILE, or --overwrite to replace it")
    for path, origin in files.items():
        lines = origin.read_text(encoding="utf-8").splitlines(keepends=True)
        text = "".join(line for line in lines if not _is_modeline(line.lstrip("# ")))  # its schema is not copied
        try:
            write_bytes_atomically(path, text.encode())
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({error.strerror}); give another FILE") from error
    return list(files)


def _is_modeline(line: str) -> bool:
    """Return whether a comment names a schema for editors, by a path relative to the file."""
    return line.startswith("yaml-language-server:")
