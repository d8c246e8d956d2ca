"""Sound datasets of many kinds: `mmw verify` has nothing to say of any."""

import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
import warp as wp

from mmw.__main__ import main as mmw
from mmw.cli.run import main
from mmw.dataset import open_dataset
from mmw.storage import atomic_files
from tests.fixtures.own_world import DATA, SMALL, STAGE, run_own, write_own_world
from tests.fixtures.small_dataset import small_dataset

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_own_world(tmp_path_factory.mktemp("sound"))


def assert_sound(address: object, capsys: pytest.CaptureFixture) -> None:
    """Check that `mmw verify` prints its one line and ends with 0."""
    capsys.readouterr()
    assert mmw(["verify", str(address)]) == 0
    told = capsys.readouterr()
    assert told.out.count("\n") == 1 and "counts, keys and physics are right" in told.out


KEYS = {
    "as it is": (),
    "one frame": ("frames.count=1",),
    "later frames": ("frames.start=4", "frames.count=3"),
    "one weather": ("weathers=[foggy]",),
    "a short last shard": ("output.shard_frames=3",),
    "a shard for each frame": ("output.shard_frames=1", "frames.count=4"),
    "two workers": ("output.shard_frames=2", "compute.workers=2"),
    "batches of one frame": ("compute.batch_frames=1",),
    "no channel": ("channel.enabled=false",),
    "no sensors": ("sensors=[]",),
    "no links": ("channel.links=[v2v]",),
    "no paths": ("channel.los=false", "channel.specular_reflection=false"),
    "many interactions": ("channel.max_depth=2", "channel.diffraction=true", "channel.refraction=true"),
    "diffuse reflection": ("channel.diffuse_reflection=true", "channel.diffuse_samples=2000", "frames.count=2"),
    "three carriers": ("channel.carriers_hz=[1.2e9, 3.5e9, 60e9]",),
    "slow sensors": ("sensors=[{type: lidar, rate_hz: 50}, {type: gnss, rate_hz: 1}, {type: radar, rate_hz: 20}]",),
    "two sensors of a type": ("sensors=[{type: imu}, {type: imu, name: second, on: [rsu]}]",),
}  # fmt: skip


@pytest.mark.parametrize("name", KEYS)
def test_configurations(folder: Path, name: str, capsys: pytest.CaptureFixture) -> None:
    assert run_own(folder, name, *KEYS[name]) == 0
    assert_sound(folder / name, capsys)


@pytest.mark.skipif(not wp.get_cuda_device_count(), reason="no GPU")
@pytest.mark.parametrize("name", ["as it is", "many interactions", "diffuse reflection", "slow sensors"])
def test_configurations_on_a_gpu(folder: Path, name: str, capsys: pytest.CaptureFixture) -> None:
    out = folder / f"{name} on a GPU"
    assert main(["--config", str(folder / "mine.yaml"), *KEYS[name], "--out", str(out), "--device", "cuda:0"]) == 0
    assert_sound(out, capsys)


def test_every_sensor(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    shutil.copy(DATA / "mine.usda", tmp_path)
    shutil.copy(DATA / "every_sensor.yaml", tmp_path)
    assert run_own(tmp_path, "d", config="every_sensor.yaml") == 0
    assert_sound(tmp_path / "d", capsys)


def test_ghosts_are_on_no_object(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """A car sees itself in a wall ahead, and nothing of itself directly: it has no row in `box_visibility`."""
    write_own_world(tmp_path)
    wall = """    def Mesh "Wall"
    {
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(20, -9, 0), (20, -9, 9), (20, 9, 9), (20, 9, 0)]
    }
    def Xform "Ego"
"""
    (tmp_path / "mine.usda").write_text(STAGE.replace('    def Xform "Ego"\n', wall))
    radar = "{type: radar, on: [cav], multipath: full, output: dense, mount: {cav: {position_m: [3, 0, 0.5]}}}"
    assert run_own(tmp_path, "d", f"sensors=[{radar}]", "channel.enabled=false") == 0
    frame = open_dataset(tmp_path / "d").frame("mine", "sunny", 0)
    (car,) = (agent for agent in frame.agents.values() if agent.role == "cav")
    own, row = car.row["object_id"], frame.row_of("radar", car.name, "radar")
    paths = {kind for kind, number in zip(row["path_type"], row["object_id"], strict=True) if number == own}
    assert paths == {4}
    assert_sound(tmp_path / "d", capsys)


def test_a_shipped_town(capsys: pytest.CaptureFixture) -> None:
    assert_sound(small_dataset(), capsys)


def in_parts(folder: Path, out: str) -> None:
    for part in ("1/3", "0/3", "2/3"):
        assert run_own(folder, out, *SMALL, "--shard", part) == 0


def overwritten(folder: Path, out: str) -> None:
    assert run_own(folder, out, "seed=7", "frames.count=2") == 0
    assert run_own(folder, out, *SMALL, "--overwrite") == 0


def finalized(folder: Path, out: str) -> None:
    assert run_own(folder, out, *SMALL) == 0
    (folder / out / "_manifest.parquet").unlink()
    (folder / out / "README.md").unlink()
    assert mmw(["finalize", str(folder / out)]) == 0


def resumed(folder: Path, out: str) -> None:
    """Run, fail to publish the tenth file and all later ones, and run again."""
    publish, count = atomic_files.os.replace, 0

    def stop(source: str, target: str) -> None:
        nonlocal count
        count += 1
        if count >= 10:
            raise KeyboardInterrupt
        publish(source, target)

    with pytest.MonkeyPatch.context() as patch, suppress(KeyboardInterrupt):
        patch.setattr(atomic_files.os, "replace", stop)
        run_own(folder, out, *SMALL)
    assert count >= 10 and not (folder / out / "_manifest.parquet").exists()
    assert run_own(folder, out, *SMALL) == 0


def repaired(folder: Path, out: str) -> None:
    """Remove a file of a finished dataset, and run again."""
    assert run_own(folder, out, *SMALL) == 0
    next((folder / out / "imu").rglob("*.parquet")).unlink()
    assert run_own(folder, out, *SMALL) == 0


def copied(folder: Path, out: str) -> None:
    """Copy a dataset, and rename its folder."""
    assert run_own(folder, f"{out} first", *SMALL) == 0
    shutil.copytree(folder / f"{out} first", folder / out)
    shutil.rmtree(folder / f"{out} first")


@pytest.mark.parametrize("make", [in_parts, overwritten, finalized, resumed, repaired, copied])
def test_histories(folder: Path, make: Callable[[Path, str], None], capsys: pytest.CaptureFixture) -> None:
    make(folder, make.__name__)
    assert_sound(folder / make.__name__, capsys)
