"""A run among the trees of a town with `channel.foliage`: no crown is a mirror, and some lines of sight pass them."""

from pathlib import Path

import pytest

from mmw.cli.run import main
from mmw.dataset import Dataset, open_dataset
from mmw.generation.provenance import stored_config
from mmw.generation.verification.physics import check_physics
from mmw.storage.file_checks import verify

pytestmark = pytest.mark.slow


def made(name: str, folder: Path, *changes: str) -> Dataset:
    """Run some frames of a scenario with many CAVs."""
    many = "scenarios.0.traffic.cav_ranks=[1,2,3,4,5,6,7,8,9,10,11,12]"
    given = ("sensors=[]", "frames={start: 300, count: 3}", many, *changes)
    assert main(["--config", name, *given, "--out", str(folder), "--device", "cpu"]) == 0
    return open_dataset(folder)


def mirrors_of_leaves(data: Dataset) -> int:
    leaves = {row["material_id"] for row in data.read("materials").to_pylist() if row["medium"] == "foliage"}
    assert leaves
    return sum(
        code == 1 and material in leaves
        for row in data.read("path_geometry").to_pylist()
        for code, material in zip(row["interactions"], row["materials"], strict=True)
    )


def links_of(data: Dataset) -> dict[tuple, dict]:
    rows = data.read("links").to_pylist()
    return {tuple(row[name] for name in ("frame", "agent", "peer")): row for row in rows}


@pytest.mark.parametrize(("name", "has_sight"), [("town07_single_lane", False), ("town03_roundabout", True)])
def test_trees_of_a_town_weaken_and_do_not_mirror(name: str, has_sight: bool, tmp_path: Path) -> None:
    options = (
        "channel.max_depth=2", "channel.samples_per_tx=200_000", "channel.links=[v2i,v2v]",
        "channel.carriers_hz=[28e9]",
    )  # fmt: skip
    solid = made(name, tmp_path / "solid", *options)
    leafy = made(name, tmp_path / "leafy", *options, "channel.foliage=true")
    assert mirrors_of_leaves(solid) > 0
    assert mirrors_of_leaves(leafy) == 0
    before, after = (links_of(data) for data in (solid, leafy))
    states = {key: row["los_state"] for key, row in after.items()}
    assert set(states.values()) == {"clear", "blocked", *(["foliage"] if has_sight else [])}
    for key, row in before.items():  # what was clear stays clear; crowns open some of the others
        assert (row["los_state"] == "clear") == row["is_los"] == (states[key] == "clear")
        assert row["los_state"] != "foliage"
    lost = [row["foliage_db"] for row in leafy.read("paths").to_pylist()]
    assert min(lost) == 0.0 and max(lost) > 1.0
    assert max(row["foliage_db"] for row in solid.read("paths").to_pylist()) == 0.0
    for folder in ("solid", "leafy"):
        assert verify(tmp_path / folder) == []
        assert check_physics(tmp_path / folder, stored_config(tmp_path / folder), 3) == []
