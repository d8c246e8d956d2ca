"""Hostile configurations, town descriptions, material maps and trajectories."""

import copy
import random
import shutil
from pathlib import Path
from typing import Any

import yaml

from mmw.cli.import_scene import main as import_main
from mmw.config import load_config
from mmw.config.load import to_yaml
from mmw.config.shipped import shipped_configs
from tests.fixtures.import_files import write_glb
from tests.fixtures.own_world import DATA, write_own_world
from tests.fuzz.cases import Step, command
from tests.fuzz.mutations import mutate_bytes, mutate_text, mutate_tree

OWN = ("mine.yaml", "every_sensor.yaml", "recorded.yaml")


class Configurations:
    """YAML files, mutated as bytes, text and values; a sound configuration is dry-run too."""

    def prepare(self, folder: Path) -> None:
        self.folder = folder
        write_own_world(folder)
        write_glb(folder / "w.glb")
        arguments = ["--out", str(folder / "town" / "world.usda"), "--materials", str(DATA / "import_map.yaml")]
        assert import_main([str(folder / "w.glb"), *arguments]) == 0
        rows = [f"{k / 10},{name},{x + k * 0.8},-6" for name, x in (("ego", -15), ("probe", -3)) for k in range(6)]
        (folder / "drive.csv").write_text("\n".join(["t,id,x,y", *rows]) + "\n")
        for name in (*OWN, "places.yaml", "import_map.yaml"):
            shutil.copy(DATA / name, folder)
        shipped = shipped_configs()
        self.texts = {name: path.read_text() for name, path in shipped.items() if name != "full"}
        self.texts |= {name: (folder / name).read_text() for name in OWN}
        self.trees = {name: yaml.safe_load(text) for name, text in self.texts.items()}
        for name in ("quickstart", "town03_roundabout"):  # every key, with its default
            self.trees[f"{name} resolved"] = yaml.safe_load(to_yaml(load_config(shipped[name])))
        self.trees["every key"] = yaml.safe_load(to_yaml(load_config(folder / "every_sensor.yaml")))

    def make(self, rng: random.Random, folder: Path) -> list[Step]:
        kind = rng.random()
        if kind < 0.08:
            return self._trajectories(rng, folder)
        if kind < 0.14:
            path = folder / "map.yaml"
            self._write(rng, path, (self.folder / "import_map.yaml").read_text(), None)
            source, out = str(self.folder / "w.glb"), str(folder / "out")
            return [command("import", source, "--out", out, "--materials", str(path))]
        if kind < 0.18:
            path = folder / "places.yaml"
            text = (self.folder / "places.yaml").read_text()
            self._write(rng, path, text, yaml.safe_load(text))
            return [command("town", "build", str(path), "--out", str(folder / "out"))]
        for name in ("mine.usda", "town", "drive.csv"):
            (folder / name).symlink_to(self.folder / name)
        path = folder / "config.yaml"
        name = rng.choice(list(self.trees))
        self._write(rng, path, self.texts.get(name, ""), self.trees[name])
        overrides = [self._override(rng)] if rng.random() < 0.3 else []
        given = ("--config", str(path), *overrides)
        return [
            command("run", *given, "--print-config"),
            command("run", *given, "--dry-run", "--quick", "--out", str(folder / "d")),
        ]

    def _write(self, rng: random.Random, path: Path, text: str, tree: Any) -> None:
        kind = rng.random()
        if tree is not None and (kind < 0.6 or not text):
            path.write_text(yaml.safe_dump(mutate_tree(rng, copy.deepcopy(tree)), allow_unicode=True))
        elif kind < 0.9:
            path.write_bytes(mutate_text(rng, text).encode(errors="surrogateescape"))
        else:
            path.write_bytes(mutate_bytes(rng, text.encode()))

    def _override(self, rng: random.Random) -> str:
        parts = ["scenarios", "frames", "sensors", "channel", "output", "compute", "weathers", "air", "seed", "0", "*",
                 "lidar", "name", "count", "type", "traffic", "", "x", "-1", "²", "mount", "rsu"]  # fmt: skip
        key = ".".join(rng.choice(parts) for _ in range(rng.choice((1, 2, 2, 3, 4, 150))))
        values = ("1", "nan", "[", "{}", "[]", "null", "&a [*a]", "!!int x", "1e400", "-5", "a: b", "9" * 5000,
                  "[[[1]]]",
                  "{type: lidar}", "*x", "'", "\udcff", "sunny")  # fmt: skip
        return key + rng.choice(("=", "=", "=", "", "==")) + rng.choice(values)

    def _trajectories(self, rng: random.Random, folder: Path) -> list[Step]:
        (folder / "town").symlink_to(self.folder / "town")
        shutil.copy(self.folder / "recorded.yaml", folder)
        data = (self.folder / "drive.csv").read_text()
        path = folder / "drive.csv"
        if rng.random() < 0.8:
            path.write_bytes(mutate_text(rng, data).encode(errors="surrogateescape"))
        else:
            path.write_bytes(mutate_bytes(rng, data.encode()))
        given = ("--config", str(folder / "recorded.yaml"), "sensors=[{type: imu}]", "channel.enabled=false")
        out = ("--out", str(folder / "d"), "--device", "cpu", "--workers", "1")
        return [command("run", *given, *out)]
