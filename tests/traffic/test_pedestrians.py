"""People: figures that are closed bodies, walk lines that are clear of obstacles, and motion without collisions."""

from pathlib import Path

import numpy as np
import pytest
import shapely
import trimesh
from pxr import Usd
from scipy.spatial import cKDTree

from mmw.config import TrafficConfig, load_config
from mmw.core.constants import VACUUM_PERMITTIVITY
from mmw.core.resources import assets_dir, configs_dir, town_path
from mmw.physics.materials.material import RadioMaterial
from mmw.physics.materials.permittivity import relative_permittivity
from mmw.physics.materials.skin import skin_permittivity
from mmw.scene.prepare import prepare_scenario, read_scenario
from mmw.scene.reader import read_stage
from mmw.scene.rows import frame_rows
from mmw.sensors.ground_truth.boxes_3d import make_boxes
from mmw.traffic.demand import TrafficDemand, VehicleTrack
from mmw.traffic.ground_height import Ground
from mmw.traffic.pedestrians import PERSONAL_SPACE, WALKING_SPEED, simulate_pedestrians
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.roads.sidewalk_prims import Sidewalk, read_sidewalks, write_sidewalks
from mmw.traffic.roads.town_asset import Town, open_town
from mmw.usd.validate import validate_stage
from mmw.usd.vehicle_catalog import load_figures
from mmw.worlds.towns.sidewalk_lines import BODY_ROOM, KERB_ROOM, STEP, sidewalk_lines
from mmw.worlds.vehicles.build import build_figures
from mmw.worlds.vehicles.pedestrian_models import FIGURES, build_figure
from tests.fixtures.stages import new_stage


def circle(radius: float, z: float = 0.14) -> np.ndarray:
    angle = np.linspace(0.0, 2 * np.pi, 200, endpoint=False)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(200, z)])


def sidewalk(inner: float, width: float) -> np.ndarray:
    """Return the edge strips of a round sidewalk of a width [m]."""
    radii = (inner, inner, inner + 0.15, inner + 0.15 + width, inner + 0.65 + width)
    return np.stack([circle(radius) for radius in radii], axis=1)


@pytest.mark.parametrize("name", FIGURES)
def test_figure_is_made_of_closed_bodies_of_the_declared_height(name: str) -> None:
    shape = build_figure(name)
    bodies = trimesh.Trimesh(shape.points, shape.faces, process=False).split()
    assert len(bodies) >= 15 and all(body.is_watertight and body.volume > 0 for body in bodies)
    assert shape.points[:, 2].min() == pytest.approx(0.0, abs=1e-9)
    assert shape.points[:, 2].max() == pytest.approx(FIGURES[name].height, abs=0.01)
    shoes = shape.points[np.unique(shape.faces[shape.parts == "rubber"])]
    assert shoes[:, 2].max() < 0.12 * FIGURES[name].height  # both feet on the ground


def test_committed_figures_are_what_the_builder_makes(tmp_path) -> None:
    for path in build_figures(tmp_path):
        shipped = assets_dir() / "pedestrians" / path.stem
        for file in path.parent.iterdir():
            assert file.read_bytes() == (shipped / file.name).read_bytes()
        assert validate_stage(Usd.Stage.Open(str(shipped / path.name))) == []


def test_figures_are_pedestrians_with_their_dimensions() -> None:
    figures = load_figures()
    assert set(figures) == set(FIGURES)
    for name, figure in figures.items():
        assert figure.label == "pedestrian" and figure.paints == (FIGURES[name].colors[0], *sorted(figure.paints[1:]))
        assert figure.height == pytest.approx(FIGURES[name].height, abs=0.01) and figure.width < 0.6


@pytest.mark.parametrize(
    ("ghz", "eps_r", "sigma"), [(2.45, 38.007, 1.4641), (10.0, 31.290, 8.0138), (60.0, 7.9753, 36.397)]
)
def test_skin_equals_the_published_tables(ghz: float, eps_r: float, sigma: float) -> None:
    """Values of the IFAC-CNR tables of dielectric properties, which are made from the same model."""
    value = skin_permittivity(ghz * 1e9)
    assert value.real == pytest.approx(eps_r, rel=1e-3)
    assert -value.imag * 2 * np.pi * ghz * 1e9 * VACUUM_PERMITTIVITY == pytest.approx(sigma, rel=1e-3)
    assert relative_permittivity(RadioMaterial("itu", itu="itu_skin"), ghz * 1e9) == value


def test_walk_line_follows_the_middle_of_a_free_sidewalk() -> None:
    (walk,) = sidewalk_lines([sidewalk(20.0, 2.0)], [])
    assert walk.is_closed
    radius = np.hypot(walk.points[:, 0], walk.points[:, 1])
    assert radius == pytest.approx(21.15, abs=0.06) and np.allclose(walk.points[:, 2], 0.14)


def test_walk_line_steps_aside_for_obstacles_and_stays_on_the_sidewalk() -> None:
    posts = [shapely.Point(21.15 * np.cos(a), 21.15 * np.sin(a)).buffer(0.1) for a in (0.4, 2.0, 4.5)]
    (walk,) = sidewalk_lines([sidewalk(20.0, 2.4)], posts)
    points = np.array(shapely.points(walk.points[:, :2]))
    assert min(shapely.distance(post, points).min() for post in posts) >= BODY_ROOM
    radius = np.hypot(walk.points[:, 0], walk.points[:, 1])
    assert radius.min() >= 20.15 + KERB_ROOM - 0.01 and radius.max() <= 22.55 - KERB_ROOM + 0.01
    assert np.abs(np.diff(np.append(radius, radius[0]))).max() < STEP  # without jumps


def test_walk_line_ends_at_a_wall() -> None:
    wall = shapely.box(18.0, -1.0, 25.0, 1.0)
    (walk,) = sidewalk_lines([sidewalk(20.0, 2.0)], [wall])
    assert not walk.is_closed
    assert shapely.distance(wall, shapely.LineString(walk.points[:, :2])) >= BODY_ROOM - 1e-6
    assert len(walk.points) * STEP > 0.9 * 2 * np.pi * 21.15
    assert sidewalk_lines([sidewalk(20.0, 0.0)], []) == []  # no sidewalk


def test_sidewalks_survive_usd(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "sidewalks.usda")
    sidewalks = sidewalk_lines([sidewalk(20.0, 2.0)], [shapely.box(18.0, -1.0, 25.0, 1.0)])
    write_sidewalks(stage, "/Town/Walks", sidewalks)
    (read,) = read_sidewalks(stage, "/Town/Walks")
    assert read.name == sidewalks[0].name and read.is_closed == sidewalks[0].is_closed
    assert np.abs(read.points - sidewalks[0].points).max() < 1e-5
    assert read_sidewalks(stage, "/Town/Nothing") == []


def pedestrians(
    sidewalks: list[Sidewalk], count: int, frame_count: int = 50, seed: int = 4, vru_ranks: tuple[int, ...] = ()
) -> list[VehicleTrack]:
    """Return the tracks of people on sidewalks without a road."""
    town = Town(Path("town.usda"), LaneGraph(), np.zeros((0, 3)), np.zeros((0, 3), np.int32), tuple(sidewalks))
    traffic = TrafficConfig(spawn_center_m=(0, 0, 0), pedestrian_count=count, vru_ranks=vru_ranks)
    return simulate_pedestrians(TrafficDemand(town, traffic, {}, frame_count, seed))


@pytest.fixture(scope="module")
def people() -> np.ndarray:
    """Poses of thirty people on one closed line and one open one, sixty seconds, shape [P, F, 7]."""
    straight = np.column_stack([np.linspace(0, 200, 401), np.full(401, 60.0), np.zeros(401)])
    sidewalks = [Sidewalk("ring", circle(12.0), True), Sidewalk("line", straight, False)]
    tracks = pedestrians(sidewalks, 30, frame_count=6000, seed=3)
    assert [track.name for track in tracks][:2] == ["ped_001", "ped_002"]
    assert {track.role for track in tracks} == {"pedestrian"}
    return np.stack([track.poses for track in tracks])


def test_people_are_apart_and_walk(people: np.ndarray) -> None:
    position = people[:, ::20, :2]
    apart = np.linalg.norm(position[:, None] - position[None], axis=-1) + 1e3 * np.eye(len(people))[:, :, None]
    assert apart.min() > 0.9 * PERSONAL_SPACE
    speed = np.linalg.norm(np.diff(people[..., :3], axis=1), axis=2) * 100
    assert 0.5 < speed.mean() < WALKING_SPEED[1] and speed.max() < WALKING_SPEED[1] * 1.1
    assert speed[:, -1000:].mean(axis=1).min() > 0.3


def test_people_move_smoothly_and_look_where_they_go(people: np.ndarray) -> None:
    velocity = np.diff(people[..., :2], axis=1) * 100
    assert np.abs(np.diff(velocity, axis=1) * 100).max() < 4.0
    heading = 2 * np.arctan2(people[..., 5], people[..., 6])[:, :-1]
    ahead = np.cos(heading) * velocity[..., 0] + np.sin(heading) * velocity[..., 1]
    assert (ahead > 0.98 * np.linalg.norm(velocity, axis=2) - 1e-6).all()


def test_same_seed_same_people_and_too_many_are_refused() -> None:
    ring = [Sidewalk("ring", circle(12.0), True)]
    first, second = (pedestrians(ring, 5, seed=4) for _ in range(2))
    assert all(np.array_equal(a.poses, b.poses) and a.model == b.model for a, b in zip(first, second, strict=True))
    other = pedestrians(ring, 5, seed=5)
    assert any(not np.array_equal(a.poses, b.poses) for a, b in zip(first, other, strict=True))
    with pytest.raises(ValueError, match=r"pedestrian_count = 500: .* have 37 places"):
        pedestrians(ring, 500)
    with pytest.raises(ValueError, match=r"pedestrian_count: the town has no walk lines"):
        pedestrians([], 5)


@pytest.mark.parametrize("name", ["town03", "town05", "town07", "town10"])
def test_people_of_a_shipped_town_walk_on_its_sidewalks_past_its_props(name: str) -> None:
    """Every meter of the walk lines has a sidewalk under it, nothing that stands within a forearm, and no road."""
    town = open_town(town_path(name))
    assert len(town.sidewalks) >= 4 and len({walk.name for walk in town.sidewalks}) == len(town.sidewalks)
    arrays = read_stage(town_path(name), range(1), ["sunny"])
    label = np.array([object_.label for object_ in arrays.objects])[arrays.object_id]
    points = np.concatenate([walk.points[::2] for walk in town.sidewalks])
    pavement = Ground(arrays.points, arrays.faces[label == "sidewalk"]).heights(points)
    assert np.abs(pavement - points[:, 2]).max() < 0.03  # NaN fails too
    assert np.isnan(Ground(town.points, town.faces).heights(points)).all()  # nothing to drive on
    props = np.isin(label, ["pole", "traffic_light", "traffic_sign", "vegetation", "static"])
    low = arrays.points[arrays.faces[props]].reshape(-1, 3)
    tree = cKDTree(low[:, :2])
    for index, near in enumerate(tree.query_ball_point(points[:, :2], 0.3)):
        height = low[near, 2] - points[index, 2]
        assert not ((height > 0.1) & (height < 2.0)).any(), points[index]


def test_pedestrians_of_a_scenario_have_boxes_and_are_counted(tmp_path) -> None:
    config = load_config(
        configs_dir() / "quickstart.yaml",
        ["frames.count=2", "scenarios.0.traffic.vehicle_count=9", "scenarios.0.traffic.pedestrian_count=6"],
    )
    stage = prepare_scenario(config, config.scenarios[0], configs_dir(), tmp_path)
    arrays = read_scenario(config, config.scenarios[0], stage)
    people = [actor for actor in arrays.actors if actor.role == "pedestrian"]
    assert [actor.name for actor in people] == [f"ped_{k:03d}" for k in range(1, 7)]
    assert {actor.label for actor in people} == {"pedestrian"}
    boxes = make_boxes(arrays, [0, 1])
    mine = np.isin(boxes.actor, [arrays.actors.index(actor) for actor in people])
    assert mine.sum() == 12 and (boxes.size[mine, 2] > 1.2).all()
    assert (np.linalg.norm(boxes.velocity[mine], axis=1) > 0.3).all()
    assert frame_rows(arrays, [0, 1], 42)["pedestrian_count"].tolist() == [6, 6]


def test_connected_people_walk_as_they_would_without_a_phone() -> None:
    (walk,) = sidewalk_lines([sidewalk(20.0, 2.0)], [])
    plain, connected = pedestrians([walk], 4, 500), pedestrians([walk], 4, 500, vru_ranks=(2, 0))
    assert [(track.name, track.role) for track in connected] == [
        ("vru_2", "vru"), ("ped_002", "pedestrian"), ("vru_1", "vru"), ("ped_004", "pedestrian"),
    ]  # fmt: skip
    for one, other in zip(plain, connected, strict=True):
        assert one.role == "pedestrian" and (one.model, one.paint) == (other.model, other.paint)
        np.testing.assert_allclose(
            one.poses[:, :3], other.poses[:, :3], atol=0.0 if other.role == "pedestrian" else 0.01
        )


def test_an_imu_on_connected_people_has_no_jumps() -> None:
    """Of the velocity at the corners of the line's polygon."""
    (walk,) = sidewalk_lines([sidewalk(20.0, 2.0)], [])

    def strongest(vru_ranks: tuple[int, ...]) -> float:
        poses = pedestrians([walk], 1, 1000, vru_ranks=vru_ranks)[0].poses[:, :3]
        return float(np.linalg.norm(np.diff(poses, n=2, axis=0), axis=1).max() * 1e4)

    assert strongest((0,)) < 0.5 < strongest(())
