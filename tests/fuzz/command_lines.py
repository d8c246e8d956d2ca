"""Hostile command lines: random options and values for every subcommand, as its parser knows them."""

import argparse
import random
import shutil
from pathlib import Path
from unittest import mock

import yaml

from mmw.__main__ import COMMANDS
from mmw.cli.run import main as run_main
from mmw.cli.run import parser as run_parser
from tests.fixtures.own_world import write_own_world
from tests.fuzz.cases import Step, command

Parsers = dict[tuple[str, ...], argparse.ArgumentParser]

WORDS = (
    "", " ", "0", "-1", "1", "2", "1e999", "nan", "inf", "-inf", "-1e308", "9" * 30, "9" * 5000, "0x10", "1_0",
    "٣", "²", "a" * 300,
    "a" * 5000, "\udcff", "é", "../x", "./x", "*", "%s", "{}", "a=b", "a:b", "0:0:0", "1:", ":", "::", "5:1",
    "0:9:0", "0:2:1",
    "0/0", "1/0", "-1/2", "0/1", "1/3", "x/y", "0/99999999999999999999", "-", "--", "-x", "--x", "s3:", "s3://", "s3:///x",
    "s3://a?b=c", "file:///x", "http://x", "a,b", ",", "sunny", "rainy", "mine", "Ego", "Mast", "lidar",
    "front", "cpu", "cuda:0",
    "cuda:99", "cuda:x", "tpu", "auto", "local", "all", "null", "[", "town03", "quickstart", "kitti", "opv2v",
    "nuscenes", "v1",
    "deepmimo", "huggingface", "rate=0", "rate=nan", "frame=0", "frame=x", "frames=0:2:1", "frames=0:", "scenario=mine",
    "agent=Ego", "images=none", "lidar=x", "arrays=0x0", "arrays=1x1-2x2", "delays=x", "weather=sunny",
    "frames.count=1",
    "frames.count=-1", "sensors=[]", "weathers=[]", "seed=-1", "out.png", "out.html", "out.rrd", "out.jsonl",
    "out.parquet",
)  # fmt: skip
"""Values; those that are names of files lie in the folder of the case."""

NEVER = {"--web", "--port", "--engine", "--debug"}
"""Options that open a port or wait for one, and the one that shows traces."""


class CommandLines:
    """Arguments drawn from each command's own parser; paths lead to a dataset, a stage and a configuration."""

    def prepare(self, folder: Path) -> None:
        self.folder = folder
        write_own_world(folder)
        small = ("frames.count=2", "sensors=[{type: imu}, {type: lidar, channels: 2, points_per_channel: 8}]")
        out = ("--out", str(folder / "d"), "--device", "cpu", "--workers", "1")
        assert run_main(["--config", str(folder / "mine.yaml"), *small, *out]) == 0
        self.parsers = _parsers()

    def make(self, rng: random.Random, folder: Path) -> list[Step]:
        shutil.copytree(self.folder / "d", folder / "d")
        shutil.copy(self.folder / "mine.usda", folder)
        tree = yaml.safe_load((self.folder / "mine.yaml").read_text())
        tree["frames"]["count"] = 1
        (folder / "mine.yaml").write_text(yaml.safe_dump(tree))
        names, parser = rng.choice(list(self.parsers.items()))
        argv = list(names)
        groups = []
        for action in parser._actions:
            chance = 0.15 if action.option_strings else 0.85
            if rng.random() < chance and not NEVER & set(action.option_strings):
                groups.append(_arguments(rng, action))
        rng.shuffle(groups)
        for group in groups:
            argv += group
        if rng.random() < 0.1:
            argv.insert(rng.randrange(len(argv) + 1), rng.choice(WORDS))
        return [command(*_safe(rng, argv, folder))]


def _safe(rng: random.Random, argv: list[str], folder: Path) -> list[str]:
    """Keep a command line from opening viewers, computing all checks, and making large datasets and towns."""
    name = argv[0] if argv else ""
    if name == "view" and not any(each.startswith(("--st", "--sa")) for each in argv):
        argv += rng.choice((["--save", "x.rrd"], ["--still", "x.png"]))
    if name == "run":
        argv += rng.choice((["--dry-run", "--quick"], ["--print-config"]))
    if name == "validate":  # without a row it computes all of them, which takes minutes
        argv.append("materials")
    if argv[:2] == ["town", "build"]:
        argv = [each for each in argv if each not in ("town03", "quickstart")]
    if name in ("radiomap", "view", "render", "town"):
        argv = [each for each in argv if each not in ("town03", "quickstart")]
    return argv


def _arguments(rng: random.Random, action: argparse.Action) -> list[str]:
    option = [rng.choice(action.option_strings)] if action.option_strings else []
    if action.nargs == 0:
        return option
    count = action.nargs if isinstance(action.nargs, int) else rng.choice((1, 1, 1, 0, 2, 3))
    if rng.random() < 0.05:
        count += 1
    return option + [_value(rng, action) for _ in range(count)]


def _value(rng: random.Random, action: argparse.Action) -> str:
    kind = rng.random()
    if kind < 0.3 and action.choices:
        return str(rng.choice(list(action.choices)))
    if kind < 0.5:
        return rng.choice(("d", "mine.yaml", "mine.usda", "d", "none", "d/poses", "d/dataset.json"))
    if kind < 0.6 and action.type in (int, float):
        return rng.choice(("0", "1", "2", "4", "-1", "16", "1e30", "100000", "10000000"))
    return rng.choice(WORDS)


class _Captured(Exception):
    """Carries a parser out of its command."""


def _parsers() -> Parsers:
    """Return the parser of every command and subcommand, as the command makes it."""
    found: Parsers = {(): argparse.ArgumentParser(), ("run",): run_parser()}

    def capture(self: argparse.ArgumentParser, *_: object, **__: object) -> None:
        raise _Captured(self)

    patches = [
        mock.patch.object(argparse.ArgumentParser, name, capture) for name in ("parse_args", "parse_intermixed_args")
    ]
    for name in COMMANDS:
        with patches[0], patches[1]:
            try:
                COMMANDS[name]([], prog=f"mmw {name}")
            except _Captured as caught:
                parser = caught.args[0]
        inner = next((a for a in parser._actions if isinstance(a, argparse._SubParsersAction)), None)
        for sub, own in inner.choices.items() if inner else {"": parser}.items():
            found[(name, sub) if sub else (name,)] = own
    return found
