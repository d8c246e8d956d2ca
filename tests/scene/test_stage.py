"""The composed scenario stage: what it holds, how exact it is, and that it can be moved."""

import errno
import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdSemantics

from mmw.config import MountConfig
from mmw.core.resources import assets_dir
from mmw.core.transforms import pose_from_ypr, pose_to_matrix
from mmw.scene.reader import read_stage
from mmw.scene.stage.asset_copies import collect_assets
from mmw.scene.stage.compose import compose_scenario
from mmw.sensors import DepthCamera, Imu, Lidar
from mmw.traffic.demand import VehicleTrack
from mmw.usd.validate import validate_stage
from mmw.usd.vehicle_catalog import load_catalog
from tests.fixtures.antennas import antenna_at
from tests.fixtures.stages import write_town

FRAMES = 40
SENSORS = (Lidar(), DepthCamera(fov_deg=90.0), Imu(), DepthCamera(name="front-depth", on=("cav",)))
META = {"mmw": "0.1.0", "scenario": "test", "seed": 7}
RSU = pose_from_ypr((5.0, -3.0, 0.5), math.radians(200.0))


def make_town(folder: Path, materials: str = "") -> Path:
    """Write a town in a folder of its own, with the shipped materials beside it unless told otherwise."""
    (folder / "town").mkdir(parents=True)
    path = write_town(folder / "town" / "square.usda")
    if not materials:
        shutil.copytree(assets_dir() / "materials", folder / "materials")
        materials = "../materials/materials.usda"
    geometry = Usd.Stage.Open(str(path.with_name("geometry.usda")))
    wood = geometry.DefinePrim("/Town/Materials/wood", "Material")
    wood.GetReferences().AddReference(materials, "/Materials/wood")
    geometry.Save()
    return path


def make_tracks() -> list[VehicleTrack]:
    """Three vehicles far from the origin: one turning all around, one that comes and goes, one parked."""
    time = np.arange(FRAMES) / 100
    turning = pose_from_ypr(
        np.stack([250 + 10.123456789 * time, -200 + time**2, 0 * time], axis=1), 20 * time, 0.01 * time, 0.02
    )
    turning[10:20, 3:] *= -1  # the same turn, written with the other sign
    coming = pose_from_ypr(np.stack([-50 - time, time, 0 * time], axis=1), 1.0)
    coming[:5] = coming[30:] = np.nan
    parked = np.tile(pose_from_ypr((3.0, 4.0, 0.0), 0.5), (FRAMES, 1))
    return [
        VehicleTrack("cav_1", "cav", "sedan", "red", turning),
        VehicleTrack("veh_001", "vehicle", "van", "white", coming),
        VehicleTrack("veh_002", "vehicle", "sedan", "black", parked),
    ]


def compose(path: Path, town: Path, **changes) -> Path:
    arguments = {
        "town_path": town,
        "tracks": make_tracks(),
        "catalog": load_catalog(),
        "rsus": [("rsu_1", RSU)],
        "sensors": SENSORS,
        "weather": "rainy",
        "meta": META,
        "antennas": antenna_at(on=("cav",)),
    }
    return compose_scenario(path, **arguments | changes)


@pytest.fixture(scope="module")
def stage_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stage")
    return compose(folder / "data" / "stages" / "test.usdc", make_town(folder / "source"))


@pytest.fixture(scope="module")
def stage(stage_path: Path) -> Usd.Stage:
    return Usd.Stage.Open(str(stage_path))


def test_structure(stage):
    assert stage.GetDefaultPrim().GetPath() == "/World" and Usd.ModelAPI(stage.GetDefaultPrim()).GetKind() == "assembly"
    assert UsdGeom.GetStageUpAxis(stage) == "Z" and UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert (stage.GetTimeCodesPerSecond(), stage.GetFramesPerSecond()) == (100.0, 100.0)
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0.0, FRAMES - 1.0)
    assert stage.GetRootLayer().customLayerData == META
    assert [prim.GetName() for prim in stage.GetPrimAtPath("/World").GetChildren()] == ["Town", "Actors", "RSU"]
    assert [p.GetName() for p in stage.GetPrimAtPath("/World/Actors").GetChildren()] == ["cav_1", "veh_001", "veh_002"]
    assert stage.GetPrimAtPath("/World/Town").GetVariantSet("weather").GetVariantSelection() == "rainy"
    assert stage.GetPrimAtPath("/World/Town/Materials/asphalt").GetAttribute("mmw:radio:itu").Get() == "itu_wet_ground"


def test_vehicles_are_instances_of_the_catalogue(stage):
    model = load_catalog()["van"]
    prim = stage.GetPrimAtPath("/World/Actors/veh_001")
    values = {name: prim.GetAttribute(f"mmw:actor:{name}").Get() for name in ("role", "model", "size", "center")}
    assert values["role"] == "vehicle" and values["model"] == "van"
    np.testing.assert_allclose(values["size"], (model.length, model.width, model.height), rtol=1e-6)
    np.testing.assert_allclose(values["center"], model.center, rtol=1e-6, atol=1e-7)
    assert list(UsdSemantics.LabelsAPI(prim, "class").GetLabelsAttr().Get()) == [model.label]
    body = prim.GetChild("Model")
    assert body.IsInstance() and body.GetVariantSet("paint").GetVariantSelection() == "white"
    assert any(p.IsA(UsdGeom.Mesh) for p in Usd.PrimRange(body, Usd.TraverseInstanceProxies()))
    assert not stage.GetPrimAtPath("/World/Actors/veh_001/Sensors")


def test_poses_are_exact(stage):
    """Positions and rotations are the float64 that went in, up to the sign of a quaternion and its length."""
    for track in make_tracks():
        prim = stage.GetPrimAtPath(f"/World/Actors/{track.name}")
        translate, orient = prim.GetAttribute("xformOp:translate"), prim.GetAttribute("xformOp:orient")
        for frame in np.flatnonzero(np.isfinite(track.poses[:, 0])).tolist():
            assert tuple(translate.Get(frame)) == tuple(track.poses[frame, :3])
            q = orient.Get(frame)
            q = np.array([*q.GetImaginary(), q.GetReal()])
            assert abs(abs(q @ track.poses[frame, 3:]) - 1) < 1e-14
        assert translate.GetTypeName() == "double3" and orient.GetTypeName() == "quatd"


def test_quaternions_never_jump(stage):
    orient = stage.GetPrimAtPath("/World/Actors/cav_1").GetAttribute("xformOp:orient")
    q = np.array([[*orient.Get(f).GetImaginary(), orient.Get(f).GetReal()] for f in range(FRAMES)])
    assert np.sum(q[1:] * q[:-1], axis=1).min() > 0.9
    half = orient.Get(9.5)  # halfway to the pose whose sign was flipped
    expected = pose_from_ypr(np.zeros(3), 20 * 0.095, 0.01 * 0.095, 0.02)[3:]
    assert abs(np.dot([*half.GetImaginary(), half.GetReal()], expected)) > 1 - 1e-5


def test_absent_vehicles_are_invisible(stage):
    image = UsdGeom.Imageable(stage.GetPrimAtPath("/World/Actors/veh_001"))
    shown = [image.ComputeVisibility(frame) != "invisible" for frame in range(FRAMES)]
    assert shown == [5 <= frame < 30 for frame in range(FRAMES)]
    assert not stage.GetPrimAtPath("/World/Actors/cav_1").GetAttribute("visibility").HasAuthoredValue()


def test_camera_looks_where_the_sensor_looks(tmp_path):
    """The image of a sensor's axes under the camera's transform: forward is -z, left is -x, up is y of the camera."""
    mount = {"rsu": MountConfig(position_m=(1, 2, 3), yaw_deg=30, pitch_deg=20, roll_deg=10)}
    sensor = DepthCamera(fov_deg=90.0, mount=mount, width_px=640, height_px=480, range_m=200)
    stage = Usd.Stage.Open(str(compose(tmp_path / "s.usda", make_town(tmp_path), sensors=(sensor,))))
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/RSU/rsu_1/Sensors/depth"))
    to_world = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(camera.GetPrim())).T
    mounted = pose_to_matrix(RSU) @ pose_to_matrix(pose_from_ypr((1, 2, 3), *np.radians([30, 20, 10])))
    axes = np.array([[0, 0, -1], [-1, 0, 0], [0, 1, 0]]).T
    np.testing.assert_allclose(to_world[:3, :3] @ axes, mounted[:3, :3], atol=1e-6)
    np.testing.assert_allclose(to_world[:3, 3], mounted[:3, 3], atol=1e-6)
    lens = camera.GetCamera()
    assert lens.GetFieldOfView(Gf.Camera.FOVHorizontal) == pytest.approx(90.0, abs=1e-4)
    assert lens.horizontalAperture / lens.verticalAperture == pytest.approx(640 / 480, rel=1e-6)
    assert tuple(camera.GetClippingRangeAttr().Get()) == pytest.approx((0.01, 200.0))


def test_sensors_follow_the_roles(stage):
    def names(path: str) -> list[str]:
        return [prim.GetName() for prim in stage.GetPrimAtPath(f"{path}/Sensors").GetChildren()]

    assert names("/World/Actors/cav_1") == ["lidar", "imu", "front_depth", "antenna"]
    assert names("/World/RSU/rsu_1") == ["lidar", "depth"]
    lidar = stage.GetPrimAtPath("/World/Actors/cav_1/Sensors/lidar")
    assert lidar.GetAttribute("mmw:sensor:type").Get() == "lidar"
    assert tuple(lidar.GetAttribute("xformOp:translate").Get()) == (0.0, 0.0, 2.5)


def test_usd_finds_nothing_wrong(stage):
    assert validate_stage(stage) == []


def test_equal_input_gives_an_equal_file(stage_path, tmp_path):
    town = make_town(tmp_path / "source")
    again = compose(tmp_path / "data" / "stages" / "test.usdc", town)
    assert again.read_bytes() == stage_path.read_bytes()
    assert not list(again.parent.rglob(".*"))


def test_a_new_stage_replaces_an_open_one(tmp_path):
    town = make_town(tmp_path / "source")
    path = compose(tmp_path / "s.usdc", town)
    before = Usd.Stage.Open(str(path))
    compose(path, town, tracks=make_tracks()[:1])
    assert not before.GetPrimAtPath("/World/Actors/veh_001")
    assert not Usd.Stage.Open(str(path)).GetPrimAtPath("/World/Actors/veh_001")


def test_stage_and_assets_move_together(tmp_path):
    """With the town's source gone and the folder moved, the stage still finds every file."""
    compose(tmp_path / "first" / "stages" / "s.usdc", make_town(tmp_path / "source"))
    shutil.rmtree(tmp_path / "source")
    (tmp_path / "first").rename(tmp_path / "second")
    path = tmp_path / "second" / "stages" / "s.usdc"
    layer = Sdf.Layer.FindOrOpen(str(path))
    assert all(not Path(name).is_absolute() for name in layer.GetCompositionAssetDependencies())
    stage = Usd.Stage.Open(str(path))
    assert validate_stage(stage) == []
    root = str((tmp_path / "second").resolve())
    assert all(used.realPath.startswith(root) for used in stage.GetUsedLayers() if used.realPath)
    meshes = [p for p in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()) if p.IsA(UsdGeom.Mesh)]
    assert len(meshes) > 10


def test_shipped_assets_keep_their_tree(tmp_path):
    source = load_catalog()["sedan"].asset
    copies = collect_assets([source, source], tmp_path)
    assert copies == {source: tmp_path / "vehicles/sedan/sedan.usda"}
    copied, shipped = (root / "materials/materials.usda" for root in (tmp_path, assets_dir()))
    assert copied.read_bytes() == shipped.read_bytes()
    stamp = (tmp_path / "vehicles/sedan/geometry.usdc").stat().st_mtime_ns
    collect_assets([source], tmp_path)
    assert (tmp_path / "vehicles/sedan/geometry.usdc").stat().st_mtime_ns == stamp


def test_an_asset_with_absolute_paths_stays_where_it_is(tmp_path):
    town = make_town(tmp_path / "source", materials=str(assets_dir() / "materials" / "materials.usda"))
    assert collect_assets([town], tmp_path / "copies") == {town.resolve(): town.resolve()}
    path = compose(tmp_path / "data" / "s.usdc", town)
    assert town.resolve().as_posix() in Sdf.Layer.FindOrOpen(str(path)).GetCompositionAssetDependencies()
    assert validate_stage(Usd.Stage.Open(str(path))) == []


def test_missing_file_is_named(tmp_path):
    town = make_town(tmp_path)
    (town.parent / "geometry.usda").unlink()
    with pytest.raises(ValueError, match=r"square\.usda: cannot find.*geometry\.usda"):
        collect_assets([town], tmp_path / "copies")


@pytest.mark.parametrize(
    ("text", "code"), [("Error: No space left on device\n" * 300, errno.ENOSPC), ("torn", errno.EIO)]
)
def test_a_stage_that_cannot_be_written_is_one_clear_error(tmp_path, monkeypatch, text, code):
    """USD tells a full disk in hundreds of lines; the stage that was there stays, and no temporary file."""
    town = make_town(tmp_path / "source")
    path = compose(tmp_path / "s.usdc", town)
    before = path.read_bytes()

    def full(layer: Sdf.Layer, name: str) -> bool:
        Path(name).write_bytes(b"PXR-USDC")
        raise Tf.ErrorException(text)

    monkeypatch.setattr(Sdf.Layer, "Export", full)
    with pytest.raises(OSError, match=r"s\.usdc") as error:
        compose(path, town, tracks=make_tracks()[:1])
    assert error.value.errno == code and len(str(error.value).splitlines()) == 1
    assert path.read_bytes() == before and not list(tmp_path.glob(".*"))


def track(**changes) -> VehicleTrack:
    values = {"name": "cav_1", "role": "cav", "model": "sedan", "paint": "red", "poses": make_tracks()[0].poses}
    return VehicleTrack(**values | changes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tracks": [track(model="tank")]}, "'tank' is not known; the models are"),
        ({"tracks": [track(paint="pink")]}, "paint = 'pink'; sedan has"),
        ({"tracks": [track(role="rsu")]}, "role = 'rsu'"),
        ({"tracks": [track(name="cav-1")]}, "'cav-1' cannot be the name of a USD prim"),
        ({"tracks": [track(), track()]}, "'cav_1' is there twice"),
        ({"tracks": []}, "tracks have no poses"),
        ({"tracks": [track(), track(name="b", poses=np.zeros((3, 7)))]}, "all of the same number"),
        ({"tracks": [track(poses=np.full((FRAMES, 7), np.nan))]}, "not all NaN"),
        ({"rsus": [("rsu-1", RSU)]}, "'rsu-1' cannot be the name"),
    ],
)
def test_bad_input_is_refused_and_writes_no_stage(tmp_path, changes, words):
    with pytest.raises(ValueError, match=words):
        compose(tmp_path / "s.usdc", make_town(tmp_path), **changes)
    assert not (tmp_path / "s.usdc").exists()


def test_the_tracer_reads_back_what_went_in(stage_path):
    arrays = read_stage(stage_path, range(FRAMES), ["sunny", "rainy"])
    assert [actor.name for actor in arrays.actors] == ["cav_1", "veh_001", "veh_002", "rsu_1"]
    assert [actor.role for actor in arrays.actors] == ["cav", "vehicle", "vehicle", "rsu"]
    for row, expected in enumerate([*(track.poses for track in make_tracks()), np.tile(RSU, (FRAMES, 1))]):
        poses = arrays.poses[:, row]
        np.testing.assert_array_equal(np.isfinite(poses), np.isfinite(expected))
        there = np.isfinite(expected[:, 0])
        np.testing.assert_allclose(poses[there, :3], expected[there, :3], rtol=1e-14, atol=1e-14)
        assert np.abs(np.abs(np.sum(poses[there, 3:] * expected[there, 3:], axis=1)) - 1).max() < 1e-6
    catalog = load_catalog()
    assert [model.name for model in arrays.models][:1] == ["sedan"]
    for actor, name in zip(arrays.actors, ("sedan", "van", "sedan"), strict=False):
        model = catalog[name]
        assert actor.size == pytest.approx((model.length, model.width, model.height)) and actor.label == model.label
        lo, hi = (f(arrays.models[actor.model].points[:, 2]) for f in (np.min, np.max))
        assert lo == pytest.approx(0, abs=0.01) and hi == pytest.approx(model.height, abs=0.1)
