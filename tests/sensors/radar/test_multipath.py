"""Multipath of radars: lobes over flat ground, and ghosts behind a plate, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from mmw.config import MountConfig
from mmw.core.errors import InputError
from mmw.core.planar_surfaces import find_surfaces
from mmw.physics.em.surface_response import material_response
from mmw.physics.materials.material import Material, RadioMaterial
from mmw.physics.materials.permittivity import relative_permittivity
from mmw.physics.weather.weather import Weather
from mmw.scene.scene_data import Prototype, SceneData
from mmw.sensors import Radar
from mmw.sensors.radar.mirrors import mirror_table
from mmw.sensors.radar.points import RadarPoints
from mmw.sensors.radar.resolution_cells import bin_rays, sum_cells
from mmw.sensors.radar.trace import dense_points
from tests.fixtures.radar_scenes import AT_ORIGIN, CLEAR, dense, watched, with_paths
from tests.fixtures.scenes import arrays_from_parts, box_model, box_part, ground_part, material, pose, wall_part
from tests.oracles.radar_multipath import lambert_sphere_phase, propagation_factor, vertical_reflection

LEAVES = replace(material("leaves"), nonvisual_base="leaf_grass", radio=RadioMaterial.absorber())
"""Lambert's law alone, and no mirror: it scatters alike to all sides but for the cosines."""

CONDUCTOR = replace(material("metal_pole"), radio=RadioMaterial("itu", itu="itu_pec"))
NARROW = Radar(
    mount=AT_ORIGIN, multipath="ground", horizontal_fov_deg=1.0, vertical_fov_deg=3.0, horizontal_beam_deg=110.0,
    vertical_beam_deg=30.0, azimuth_rays=10, elevation_rays=60, range_m=120.0, frame_time_s=1e-3,
)  # fmt: skip


def echoes(
    arrays: SceneData, device: str, config: Radar, frames=None, weather: Weather = CLEAR, *, merges: bool = True
) -> RadarPoints:
    """Return all echoes of a radar, dense, with those of multipath."""
    rays, _ = with_paths(arrays, device, config, frames, weather, merges=merges)
    return dense_points(rays, config)


def watts(points: RadarPoints) -> np.ndarray:
    assert points.power_db is not None
    return 10.0 ** (points.power_db.astype(np.float64) / 10.0) / 1000.0


def select(points: RadarPoints, kind: int) -> RadarPoints:
    """Return the echoes of a path type, in one list."""
    names = ("range", "azimuth", "elevation", "velocity", "power_db", "snr_db", "rcs_dbsm", "object_id", "label",
             "path_type")  # fmt: skip
    is_kind = points.path_type == kind
    offsets = np.array([0, is_kind.sum()], dtype=np.int32)
    return replace(points, offsets=offsets, **{name: getattr(points, name)[is_kind] for name in names})


# Ground


def over_ground(height: float, ground: Material, distances: np.ndarray, extra=()) -> SceneData:
    """Return a cube of 1 m at distances ahead, one a frame, 0.4 m above the ground, and a radar at a height."""
    model = box_model("cube", (1.0, 1.0, 1.0), (0.5, 0.0, 0.9), material=0)
    materials = {"leaves": LEAVES, "ground": ground}
    poses = np.array([[pose(distance, 0.0)] for distance in distances])
    parts = [ground_part(150.0, material="ground", cells=7), *extra]
    return watched(parts, [model], [("veh_001", "vehicle", 0)], poses, (0.0, 0.0, height), materials=materials)


def two_ray(alone: RadarPoints, mine: np.ndarray, height: float, reflect, rms_height=0.0, beam=30.0) -> np.ndarray:
    """Return F^4 of rays, from the points that they hit: those of `mine`, seen from a radar at a height."""
    at, elevation = alone.range[mine].astype(np.float64), alone.elevation[mine].astype(np.float64)
    up, across = height + at * np.sin(elevation), at * np.cos(elevation)
    return propagation_factor(
        height, up, across, reflect, NARROW.carrier_hz, rms_height=rms_height, beam_rad=np.radians(beam)
    )


@pytest.mark.parametrize(("height", "rms_height", "beam"), [(0.6, 0.0, 30.0), (0.9, 0.004, 30.0), (1.2, 0.0, 4.0)])
def test_lobes_over_ground_are_those_of_the_two_ray_model(device, height, rms_height, beam):
    """Each ray's power over that without ground, against F^4 at its own height: 0.1 dB, except in nulls below 1 %.

    The oracle's heights follow from angles in float32, which turn the phase by up to 0.01; it is 0.06 dB near a null.
    """
    ground = material("asphalt")
    ground = replace(ground, radio=replace(ground.radio, rms_height=rms_height))
    config = NARROW.model_copy(update={"vertical_beam_deg": beam})
    arrays = over_ground(height, ground, np.arange(20.0, 70.0, 0.31))
    found = echoes(arrays, device, config)
    alone = dense(arrays, device, config.model_copy(update={"multipath": "none"}))
    is_target = alone.object_id == arrays.actors[0].object_id
    first = np.flatnonzero(found.path_type == 0)
    np.testing.assert_array_equal(found.range[first], alone.range)
    eta = relative_permittivity(ground.radio, config.carrier_hz)
    expected = two_ray(alone, is_target, height, lambda angle: vertical_reflection(eta, angle), rms_height, beam)
    ratio = watts(found)[first][is_target] / watts(alone)[is_target]
    is_lobe = expected > 0.01
    assert len(ratio) > 2000 and is_lobe.mean() > 0.8
    assert np.abs(10.0 * np.log10(ratio[is_lobe] / expected[is_lobe])).max() < 0.1
    assert ratio[~is_lobe].max() < 0.02
    if rms_height == 0.0 and beam == 30.0:
        assert ratio.max() > 8.0 and ratio.min() < 1e-3  # 12 dB at best for a perfect mirror
    assert np.all(found.path_type == 0)  # none is resolved: 2 h1 h2 / R < 0.5 m


def test_paths_that_are_resolved_are_echoes_of_their_own(device):
    """A radar 8 m up, a target 8 m away: the way over the ground is 1.7 m longer, a range cell is 0.5 m."""
    config = NARROW.model_copy(
        update={"vertical_fov_deg": 100.0, "vertical_beam_deg": 170.0, "elevation_rays": 1000, "azimuth_rays": 4}
    )
    arrays = over_ground(8.0, CONDUCTOR, np.array([8.0]))
    found = echoes(arrays, device, config)
    direct, resolved = select(found, 0), select(found, 1)
    is_target = direct.object_id == arrays.actors[0].object_id
    front = is_target & np.isclose(direct.range * np.cos(direct.elevation) * np.cos(direct.azimuth), 8.0, atol=1e-3)
    height = 8.0 + direct.range[front] * np.sin(direct.elevation[front])
    bounced = np.hypot(np.hypot(8.0, height + 8.0), 0.0)
    assert front.sum() > 100 and len(resolved.range) > 0
    assert set(resolved.object_id) == {arrays.actors[0].object_id}
    for value in ((bounced + direct.range[front]) / 2.0, bounced):
        assert np.abs(resolved.range[:, None] - value).min(axis=1).min() < 0.01
    assert resolved.range.max() < bounced.max() + 0.02
    steep = -np.arctan2(height.max() + 8.0, 8.0)
    assert resolved.elevation.min() == pytest.approx(steep, abs=0.06)  # comes back from the ground


def test_a_blocked_way_to_the_ground_leaves_the_direct_path(device):
    """A low wall hides all reflection points, and the target is seen above it."""
    wall = box_part("Props/kerb", (14.0, 4.0, 0.45), (20.0, 0.0, 0.225), "concrete_facade", "static")
    open_, hidden = (over_ground(0.6, material("asphalt"), np.array([40.0]), extra) for extra in ((), (wall,)))
    config = NARROW.model_copy(update={"vertical_fov_deg": 2.0})
    alone = dense(hidden, device, config.model_copy(update={"multipath": "none"}))
    mine = hidden.actors[0].object_id
    ratio = watts(echoes(hidden, device, config))[: len(alone.range)] / watts(alone)
    np.testing.assert_allclose(ratio[alone.object_id == mine], 1.0, rtol=1e-5)
    assert (alone.object_id == mine).sum() > 20
    free = dense(open_, device, config.model_copy(update={"multipath": "none"}))
    ratio = watts(echoes(open_, device, config))[: len(free.range)] / watts(free)
    assert ratio[free.object_id == open_.actors[0].object_id].std() > 0.5


def test_ground_is_found_over_a_curb(device):
    """The radar stands over a raised platform, the reflection is on the street below: lobes are those of the street."""
    walk = box_part("Roads/walk", (6.0, 6.0, 0.2), (0.0, 0.0, 0.1), "concrete_facade", "sidewalk")
    ground, config = material("asphalt"), NARROW
    arrays = over_ground(1.0, ground, np.arange(25.0, 50.0, 0.5), (walk,))
    found, alone = echoes(arrays, device, config), dense(
        arrays, device, config.model_copy(update={"multipath": "none"})
    )  # fmt: skip
    mine = alone.object_id == arrays.actors[0].object_id
    eta = relative_permittivity(ground.radio, config.carrier_hz)
    expected = two_ray(alone, mine, 1.0, lambda angle: vertical_reflection(eta, angle))
    ratio = watts(found)[found.path_type == 0][mine] / watts(alone)[mine]
    is_lobe = expected > 0.01
    assert np.abs(10.0 * np.log10(ratio[is_lobe] / expected[is_lobe])).max() < 0.1


# Ghosts

WIDE = Radar(
    mount=AT_ORIGIN, multipath="full", horizontal_fov_deg=70.0, vertical_fov_deg=4.0, azimuth_rays=1800,
    elevation_rays=100, horizontal_beam_deg=360.0, vertical_beam_deg=360.0, range_m=60.0,
)  # fmt: skip
RADIUS = 0.5


def ball() -> Prototype:
    """Return a ball about the origin of its frame, of leaves."""
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=RADIUS)
    points, faces = np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int32)
    ids = np.zeros(len(faces), dtype=np.int32)
    return Prototype("ball", points, faces, ids, find_surfaces(points, faces, np.zeros_like(ids), ids))


def behind_a_plate(plate: Material, velocity=(0.0, 0.0), frames: int = 1) -> SceneData:
    """Return a ball 20 m ahead that moves, and a plate 5 m to the left, along the view."""
    t = 0.01 * (np.arange(frames) - frames // 2)
    poses = np.array([[pose(20.0 + velocity[0] * k, velocity[1] * k)] for k in t])
    wall = wall_part("wall", (40.0, 5.0), (4.0, 5.0), 8.0, "plate")
    wall = replace(wall, points=wall.points - [0.0, 0.0, 4.0])
    materials = {"leaves": LEAVES, "plate": plate}
    return watched([wall], [ball()], [("veh_001", "vehicle", 0)], poses, materials=materials)


def test_ghosts_are_where_the_image_is(device):
    """Range, angle and Doppler velocity of the three ghosts, by the image of the ball behind the plate."""
    velocity = np.array([6.0, 3.0])
    arrays = behind_a_plate(CONDUCTOR, tuple(velocity), 5)
    found = echoes(arrays, device, WIDE, [2])
    target, image = np.array([20.0, 0.0]), np.array([20.0, 10.0])
    seen = {kind: select(found, kind) for kind in range(5)}
    direct, bounced = np.linalg.norm(target), np.linalg.norm(image)
    rate = velocity @ target / direct, (velocity * [1.0, -1.0]) @ image / bounced
    angle = 0.0, np.arctan2(image[1], image[0])
    expected = {
        2: ((direct + bounced) / 2.0, angle[0], sum(rate) / 2.0),
        3: ((direct + bounced) / 2.0, angle[1], sum(rate) / 2.0),
        4: (bounced, angle[1], rate[1]),
    }
    assert len(seen[1].range) == 0  # there is no ground
    for kind, (distance, azimuth, speed) in expected.items():
        ghost = seen[kind]
        assert len(ghost.range) > 500 and set(ghost.object_id) == {arrays.actors[0].object_id}
        share = watts(ghost) / watts(ghost).sum()
        # The ball's near side returns most, at most its radius nearer.
        assert distance - RADIUS < share @ ghost.range < distance
        assert share @ ghost.azimuth == pytest.approx(azimuth, abs=0.01)
        assert share @ ghost.velocity == pytest.approx(speed, abs=0.03)
        assert np.ptp(ghost.azimuth) < 2.2 * RADIUS / direct
    # A single point: what is on the ball's surface is mirrored exactly.
    ghost = seen[4]
    at = (
        ghost.range[:, None]
        * np.stack([np.cos(ghost.azimuth), np.sin(ghost.azimuth)], -1)
        * np.cos(ghost.elevation)[:, None]
    )
    up = ghost.range * np.sin(ghost.elevation)
    np.testing.assert_allclose(np.hypot(np.hypot(*(at - image).T), up), RADIUS, atol=0.02)  # its facets


@pytest.mark.parametrize("kind", ["conductor", "brick", "rough"])
def test_ghosts_have_the_power_of_the_image(device, kind):
    """Fresnel's loss once or twice, the radar equation of the longer way, and Lambert's sphere between two directions.

    2 % for the number of rays on the ball, and for its size: the near side of 0.5 m at 20 m.
    """
    plate = CONDUCTOR if kind == "conductor" else material("brick_facade")
    if kind == "rough":
        plate = replace(plate, radio=replace(plate.radio, rms_height=0.0005, scattering=0.3))
    arrays = behind_a_plate(plate)
    found = echoes(arrays, device, WIDE)
    power = {kind: watts(select(found, kind)).sum() for kind in (2, 3, 4)}
    is_ball = (found.path_type == 0) & (found.object_id == arrays.actors[0].object_id)
    direct = watts(found)[is_ball].sum()
    # TE: the electric field is vertical, along the plate.
    cosine = 10.0 / np.hypot(20.0, 10.0)
    if kind == "conductor":
        reflected = 1.0
    else:
        eta = relative_permittivity(plate.radio, WIDE.carrier_hz)
        root = np.sqrt(eta - 1.0 + cosine**2)
        reflected = np.abs((cosine - root) / (cosine + root)) ** 2
    if kind == "rough":
        phase = np.pi * 0.0005 * cosine / WIDE.wavelength
        reflected *= (1.0 - 0.3**2) * np.exp(-16.0 * phase**2)
    near, far = 20.0, np.hypot(20.0, 10.0)
    angle = np.arctan2(10.0, 20.0)
    # From the ball the plate's image of the radar is at (0, 10): the angle to it is that of the image.
    beam = np.exp(-4.0 * np.log(2.0) * (np.degrees(angle) / 360.0) ** 2)
    both = beam * reflected * lambert_sphere_phase(angle) * (near / far) ** 2
    twice = beam**2 * reflected**2 * (near / far) ** 4
    assert power[4] / direct == pytest.approx(twice, rel=0.03)
    assert power[2] == pytest.approx(power[3], rel=1e-4)
    assert power[2] / direct == pytest.approx(both, rel=0.03)


def test_a_mirror_that_moves_gives_the_image_twice_its_speed(device):
    """A plate that nears the radar at 2 m/s beside a ball that drives past: the image moves by 2 v of the plate."""
    t = 0.01 * (np.arange(5) - 2)
    moving = np.array([6.0, 3.0])
    poses = np.array([[pose(20.0 + 6.0 * k, 3.0 * k), pose(20.0, 5.0 - 2.0 * k)] for k in t])
    plate = box_model("plate", (36.0, 0.1, 8.0), (0.0, 0.05, 0.0), material=1)
    actors = [("veh_001", "vehicle", 0), ("veh_002", "vehicle", 1)]
    arrays = watched([], [ball(), plate], actors, poses, materials={"leaves": LEAVES, "plate": CONDUCTOR})
    found = echoes(arrays, device, WIDE, [2])
    image, velocity = np.array([20.0, 10.0]), np.array([moving[0], -2.0 * 2.0 - moving[1]])
    rate = moving[0], velocity @ image / np.linalg.norm(image)
    for kind, speed in ((2, sum(rate) / 2.0), (3, sum(rate) / 2.0), (4, rate[1])):
        ghost = select(found, kind)
        share = watts(ghost) / watts(ghost).sum()
        assert share @ ghost.velocity == pytest.approx(speed, abs=0.05)


def test_the_own_body_is_seen_in_a_mirror_ahead(device):
    """A car 20 m in front of a plate: its radar sees the plate, and its own front again at twice the distance."""
    config = WIDE.model_copy(
        update={"on": ("cav",), "mount": {"cav": MountConfig(position_m=(2.5, 0.0, 0.5))}, "horizontal_fov_deg": 10.0}
    )
    car = box_model("car", (4.5, 1.8, 1.5), (0.0, 0.0, 0.0), material=0)
    plate = box_part("Buildings/plate", (0.2, 30.0, 30.0), (22.35, 0.0, 0.0), "plate", "building")
    poses = np.array([[pose(0.1 * (k - 2), 0.0)] for k in range(5)])
    arrays = arrays_from_parts(
        [plate], [car], [("cav_1", "cav", 0)], poses, materials={"leaves": LEAVES, "plate": CONDUCTOR}
    )
    found = echoes(arrays, device, config, [2])
    ghost, direct = select(found, 4), select(found, 0)
    assert arrays.actors[0].object_id not in direct.object_id
    assert set(ghost.object_id) == {arrays.actors[0].object_id} and len(ghost.range) > 100
    # The plate is 19.75 m ahead of the radar and 20 m ahead of the car's front.
    assert ghost.range.min() == pytest.approx(19.75 + 20.0, abs=1e-3)
    head_on = np.argmin(ghost.range)
    assert ghost.velocity[head_on] == pytest.approx(-20.0, abs=0.01)  # the image comes at twice 10 m/s
    assert len(select(found, 2).range) == len(select(found, 3).range) == 0


def test_ghosts_that_are_not_resolved_add_up(device):
    """With one antenna both ways round the plate are one echo of twice the amplitude."""
    arrays = behind_a_plate(CONDUCTOR)
    config = WIDE.model_copy(update={"azimuth_antennas": 1, "elevation_antennas": 1})
    apart, together = echoes(arrays, device, config, merges=False), echoes(arrays, device, config)
    one, sum_ = (watts(select(points, 2)).sum() for points in (apart, together))
    assert len(select(together, 3).range) == 0 and len(select(together, 4).range) > 0
    assert sum_ == pytest.approx(4.0 * one, rel=1e-4)


# Mirrors


@pytest.mark.parametrize("name", ["glass", "rough", "conductor", "foliage"])
def test_mirrors_are_those_of_the_channel(name):
    """The table holds, at cosines between its own too, what the channel's surfaces reflect of a mirror."""
    radios = {
        "glass": RadioMaterial("itu", itu="itu_glass", thickness=0.004, layers=("itu_glass 0.004", "itu_vacuum 0.016")),
        "rough": RadioMaterial("itu", itu="itu_concrete", scattering=0.3, rms_height=0.0005),
        "conductor": RadioMaterial("itu", itu="itu_pec"),
        "foliage": RadioMaterial("itu", itu="itu_wood", medium="foliage"),
    }
    materials = [replace(material("wood"), radio=radio) for radio in radios.values()]
    index = list(radios).index(name)
    table = mirror_table(materials, [index], 76.5e9)
    assert not table[[k for k in range(4) if k != index]].any()
    if name == "foliage":
        assert not table.any()
        return
    cosine = np.linspace(0.02, 1.0, 1000)
    response, rows = material_response(radios[name], 76.5e9), np.zeros(1000, dtype=np.int64)
    share = response.specular_share(rows, cosine)
    at = np.linspace(0.0, 1.0, table.shape[1])
    for column, coefficient in zip((0, 2), response.reflection(rows, cosine), strict=True):
        for part, expected in ((0, coefficient.real), (1, coefficient.imag)):
            found = np.interp(cosine, at, table[index, :, column + part])
            np.testing.assert_allclose(found, share * expected, atol=2e-3)


def test_water_on_the_road_changes_the_lobes(device):
    """The ground is the material of the weather: below a film of water lobes are those of its layers."""
    dry = material("asphalt")
    wet = replace(dry, radio=replace(dry.radio, layers=("itu_fresh_water 0.0005",)))
    distances, config = np.arange(12.0, 24.0, 0.5), NARROW
    alone = dense(over_ground(1.2, dry, distances), device, config.model_copy(update={"multipath": "none"}))
    mine = alone.object_id == over_ground(1.2, dry, distances[:1]).actors[0].object_id
    factors = []
    for ground in (dry, wet):
        response = material_response(ground.radio, config.carrier_hz)

        def reflect(angle, response=response):
            return response.reflection(np.zeros(len(angle), dtype=np.int64), np.sin(angle))[1]

        factors.append(two_ray(alone, mine, 1.2, reflect))
        found = echoes(over_ground(1.2, ground, distances), device, config)
        ratio = watts(found)[found.path_type == 0][mine] / watts(alone)[mine]
        is_lobe = factors[-1] > 0.01
        assert np.abs(10.0 * np.log10(ratio / factors[-1]))[is_lobe].max() < 0.1
    assert np.abs(10.0 * np.log10(factors[1] / factors[0])).max() > 3.0


@pytest.mark.parametrize("multipath", ["none", "ground", "full"])
def test_no_views_have_no_echoes(device, multipath):
    config = WIDE.model_copy(update={"multipath": multipath, "coherent": True, "on": ("cav",)})
    rays, _ = with_paths(behind_a_plate(CONDUCTOR), device, config)
    assert rays.power.shape[0] == rays.turns.shape[0] == 0
    assert len(sum_cells(bin_rays(config, rays), rays, coherent=True).power) == 0
    assert dense_points(rays, config).offsets.tolist() == [0]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"mode": "carla", "multipath": "ground"}, "mode = carla has no power: multipath = ground"),
        ({"mode": "carla", "coherent": True}, "coherent = True need mode: physical"),
        ({"output": "dense", "coherent": True}, "output = dense has none"),
    ],
)
def test_options_without_effect_are_refused(values, message):
    with pytest.raises(InputError, match=message):
        Radar(**values)
