"""Lobes and echoes of radars over flat ground, against the two-ray model."""

from dataclasses import replace

import numpy as np
import pytest

from mmw.physics.em.surface_response import material_response
from mmw.physics.materials.material import Material
from mmw.physics.materials.permittivity import relative_permittivity
from mmw.scene.scene_data import SceneData
from mmw.sensors import Radar
from mmw.sensors.radar.points import RadarPoints
from tests.fixtures.radar_echoes import CONDUCTOR, LEAVES, echoes, of_path, watts
from tests.fixtures.radar_scenes import AT_ORIGIN, dense, watched
from tests.fixtures.scenes import box_model, box_part, ground_part, material, pose
from tests.oracles.radar_multipath import propagation_factor, vertical_reflection

NARROW = Radar(
    mount=AT_ORIGIN, multipath="ground", horizontal_fov_deg=1.0, vertical_fov_deg=3.0, horizontal_beam_deg=110.0,
    vertical_beam_deg=30.0, azimuth_rays=10, elevation_rays=60, range_m=120.0, frame_time_s=1e-3,
)  # fmt: skip


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
    direct, resolved = of_path(found, 0), of_path(found, 1)
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
