"""The product on imported worlds: one frame with every sensor, with the right bounds and materials in the tables."""

import io
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mmw.cli.import_scene import main as import_main
from mmw.cli.run import main as run_main
from mmw.dataset import connect
from tests.fixtures.import_files import (
    HIGH,
    HOUSE_HIGH,
    HOUSE_LOW,
    LOW,
    write_glb,
    write_mitsuba,
    write_obj,
    write_stage,
)

DATA = Path(__file__).parents[1] / "fixtures" / "data"
CAMERA_X = 1.5
"""Place of the camera of `on_import.yaml` on its vehicle [m]."""


def write_source(folder: Path, kind: str) -> tuple[Path, bool]:
    """Write a world and return it, and whether it needs a material map."""
    folder.mkdir()
    if kind.startswith("mitsuba"):
        return write_mitsuba(folder, kind.partition("-")[2]), False
    if kind == "usd-cm-y-up":
        write_stage(folder / "w.usda", up="Y", metres_per_unit=0.01).Save()
        return folder / "w.usda", True
    return (write_glb if kind == "glb" else write_obj)(folder / f"w.{kind}"), True


def run_imported(source: Path, config: str, folder: Path, has_map: bool) -> Callable[[str], list[tuple]]:
    """Import a world, run a configuration on it, and return the function that queries the dataset."""
    shutil.copy(DATA / config, folder)
    extra = ["--materials", str(DATA / "import_map.yaml")] if has_map else []
    assert import_main([str(source), "--out", str(folder / "town" / "world.usda"), *extra]) == 0
    assert run_main(["--config", str(folder / config), "--out", str(folder / "d"), "--device", "cpu"]) == 0
    connection = connect(folder / "d")
    return lambda query: connection.sql(query).fetchall()


@pytest.mark.parametrize("kind", ["mitsuba-new", "mitsuba-old", "glb", "obj", "usd-cm-y-up"])
def test_an_imported_world_runs(tmp_path: Path, kind: str) -> None:
    source, has_map = write_source(tmp_path / "source", kind)
    shutil.copy(DATA / "on_import.usda", tmp_path)
    rows = run_imported(source, "on_import.yaml", tmp_path, has_map)

    objects = {path.rpartition("/")[2]: (number, label, names) for number, path, label, names in rows(
        "SELECT object_id, prim_path, label, materials FROM objects WHERE actor IS NULL")}  # fmt: skip
    assert len(objects) == 2
    (ground,) = (value for name, value in objects.items() if "ground" in name)
    (house,) = (value for value in objects.values() if value is not ground)
    rows_of = dict(rows("SELECT name, itu FROM materials WHERE weather = 'rainy'"))
    if has_map:
        assert (house[1], ground[1]) == ("building", "road")
        assert rows_of[ground[2][0]] == "itu_wet_ground"
    else:
        assert rows_of[ground[2][0]] == "itu_concrete"
    assert rows_of[house[2][0]] == "itu_brick"

    # the LiDAR, whose axes are the world's, sees the west and the south wall of the house, and ground
    (x, y, z, ids), = rows("SELECT x, y, z, object_id FROM lidar WHERE weather = 'sunny'")  # fmt: skip
    mount = np.array(rows("SELECT x, y, z FROM sensors WHERE sensor = 'lidar'")[0])
    at = np.array(rows("SELECT x, y, z FROM poses WHERE agent = 'Ego'")[0])
    points, ids = np.stack([x, y, z], axis=1) + mount + at, np.array(ids)
    assert np.allclose(at, (-2.6, 6, 0))
    assert (points >= np.array(LOW) - 0.01).all()
    assert (points <= np.array(HIGH) + 0.01).all()
    assert np.abs(points[ids == ground[0], 2]).max() < 0.01
    walls = points[ids == house[0]]
    assert len(walls) > 20
    assert np.abs(walls[:, 0] - HOUSE_LOW[0]).max() < 0.01  # from (-2.6, 6) only the west wall is in sight
    assert walls[:, 1].min() >= HOUSE_LOW[1] - 0.01
    assert walls[:, 1].max() <= HOUSE_HIGH[1] + 0.01

    (png,), = rows("SELECT image FROM depth WHERE weather = 'sunny'")  # fmt: skip
    depth = np.asarray(Image.open(io.BytesIO(png["bytes"])), dtype=np.float64) * 0.01
    wall = np.abs(depth - (HOUSE_LOW[0] - at[0] - CAMERA_X)) < 0.011
    assert 0.05 < wall.mean() < 0.5  # the wall spans 8 m of the 22 m that 110 degrees see at 8.1 m

    (ax, az), = rows("SELECT ax_true, az_true FROM imu WHERE weather = 'sunny'")  # fmt: skip
    assert (ax, az) == pytest.approx((0, 9.81), abs=0.01)
    kinds = rows("SELECT kind, objects FROM paths WHERE weather = 'sunny' AND \"order\" < 2")
    assert ("los", []) in kinds
    assert ("specular", [ground[0]]) in kinds
    assert ("specular", [house[0]]) in kinds


def test_recorded_vehicles_drive_on_a_town_without_lanes(tmp_path: Path) -> None:
    """Three vehicles drive east at 8 m/s on the ground of a GLB, 12 m apart; the last one to the west."""
    write_glb(tmp_path / "w.glb")
    starts = {
        "ego": (-15.0, -6.0, 8.0),
        "probe": (-3.0, -6.0, 8.0),
        "lead": (9.0, -6.0, 8.0),
        "van": (-12.0, 0.0, -5.0),
    }
    times = np.arange(0.0, 0.51, 0.1).tolist()
    lines = [f"{t:.1f},{name},{x + v * t:.3f},{y}" for name, (x, y, v) in starts.items() for t in times]
    (tmp_path / "drive.csv").write_text("\n".join(["t,id,x,y", *lines]))
    rows = run_imported(tmp_path / "w.glb", "recorded.yaml", tmp_path, True)
    poses = {agent: row for agent, *row in rows("SELECT agent, x, y, z, qz, vx, vy, vz FROM poses")}
    assert set(poses) == {"cav_1", "cav_2", "rsu_1"}
    for agent, x in (("cav_1", -15.0), ("cav_2", -3.0)):
        assert poses[agent][0] == pytest.approx(x, abs=0.2)  # the origin lies between the axles, x and y in the middle
        assert poses[agent][1:] == pytest.approx((-6.0, 0.0, 0.0, 8.0, 0.0, 0.0), abs=0.02)
    bodies = rows("SELECT label, COUNT(*) FROM objects WHERE actor LIKE 'cav%' OR actor LIKE 'veh%' GROUP BY label")
    assert sum(count for _, count in bodies) == 4
    (ground,), (house,) = (rows(f"SELECT object_id FROM objects WHERE label = '{n}'") for n in ("road", "building"))
    kinds = rows('SELECT agent, peer, kind, objects FROM paths WHERE "order" < 2')
    for link in (("cav_1", "rsu_1"), ("cav_2", "rsu_1"), ("cav_1", "cav_2"), ("cav_2", "cav_1")):
        assert (*link, "los", []) in kinds
        assert (*link, "specular", [ground[0]]) in kinds
    assert ("cav_2", "rsu_1", "specular", [house[0]]) in kinds
    assert rows("SELECT agent FROM depth") == [("rsu_1",)]
    (z, ids), = rows("SELECT z, object_id FROM lidar WHERE agent = 'cav_1'")  # fmt: skip
    (mount,), = rows("SELECT z FROM sensors WHERE agent = 'cav_1' AND sensor = 'lidar'")  # fmt: skip
    on_ground = np.array(ids) == ground[0]
    assert on_ground.sum() > 100
    assert np.abs(np.array(z)[on_ground] + mount).max() < 0.01
