"""Ghosts of radars behind a plate, against the image of the target, and mirrors."""

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
from mmw.scene.scene_data import Prototype, SceneData
from mmw.sensors import Radar
from mmw.sensors.radar.mirrors import mirror_table
from mmw.sensors.radar.resolution_cells import bin_rays, sum_cells
from mmw.sensors.radar.trace import dense_points
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.radar_echoes import CONDUCTOR, LEAVES, echoes, of_path, watts
from tests.fixtures.radar_scenes import AT_ORIGIN, watched, with_paths
from tests.fixtures.scenes import arrays_from_parts, box_mesh, box_model, box_part, material, pose, wall_part
from tests.oracles.radar_multipath import lambert_sphere_phase

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
    seen = {kind: of_path(found, kind) for kind in range(5)}
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
    power = {kind: watts(of_path(found, kind)).sum() for kind in (2, 3, 4)}
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
        ghost = of_path(found, kind)
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
    ghost, direct = of_path(found, 4), of_path(found, 0)
    assert arrays.actors[0].object_id not in direct.object_id
    assert set(ghost.object_id) == {arrays.actors[0].object_id} and len(ghost.range) > 100
    # The plate is 19.75 m ahead of the radar and 20 m ahead of the car's front.
    assert ghost.range.min() == pytest.approx(19.75 + 20.0, abs=1e-3)
    head_on = np.argmin(ghost.range)
    assert ghost.velocity[head_on] == pytest.approx(-20.0, abs=0.01)  # the image comes at twice 10 m/s
    assert len(of_path(found, 2).range) == len(of_path(found, 3).range) == 0


def test_two_bounces_within_a_body_are_left_to_its_roughness(device):
    """Two plates at a right angle give ghosts as parts of the town, and none as parts of one vehicle."""
    sides = [box_mesh((0.1, 4.0, 4.0), (22.0, 0.0, 0.0)), box_mesh((4.0, 0.1, 4.0), (20.0, 2.0, 0.0))]
    points = np.concatenate([corners for corners, _ in sides])
    faces = np.concatenate([sides[0][1], sides[1][1] + len(sides[0][0])]).astype(np.int32)
    ids = np.zeros(len(faces), dtype=np.int32)
    corner = Prototype("corner", points, faces, ids, find_surfaces(points, faces, np.zeros_like(ids), ids))
    body = watched([], [corner], [("veh_001", "vehicle", 0)], np.array([[pose(0.0, 0.0)]]), materials={"m": CONDUCTOR})
    town = watched([MeshPart("Buildings/corner", points, faces, "m", "building")], materials={"m": CONDUCTOR})
    config = WIDE.model_copy(update={"horizontal_fov_deg": 20.0, "azimuth_rays": 200})
    assert len(of_path(echoes(town, device, config), 4).range) > 100
    assert set(echoes(body, device, config).path_type) == {0}


def test_ghosts_that_are_not_resolved_add_up(device):
    """With one antenna both ways round the plate are one echo of twice the amplitude."""
    arrays = behind_a_plate(CONDUCTOR)
    config = WIDE.model_copy(update={"azimuth_antennas": 1, "elevation_antennas": 1})
    apart, together = echoes(arrays, device, config, merges=False), echoes(arrays, device, config)
    one, sum_ = (watts(of_path(points, 2)).sum() for points in (apart, together))
    assert len(of_path(together, 3).range) == 0 and len(of_path(together, 4).range) > 0
    assert sum_ == pytest.approx(4.0 * one, rel=1e-4)


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
