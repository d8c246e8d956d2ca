"""Compute the glow and the light of vehicle lights and street lights.

- Headlights burn in a low beam: below a cut-off, which rises on the right for right-hand traffic. Both lights of a
  vehicle are one beam from the middle of its front. Taillights glow with them, and brighter in braking, by day too.
- Street lights shine downward as Lambert sources. A grid over the town lists those that reach each cell.

No shadow ray is sent to a light: light passes through other vehicles and corners of houses. With no light on all this
costs one comparison.
"""

import warp as wp

from mmw.kernels.core.structs import Scene
from mmw.kernels.shading.brdf import direct_light
from mmw.kernels.shading.structs import Appearance, SurfacePoint
from mmw.kernels.shading.wet_surfaces import Wetted, film_light, film_weights

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": True})

HEADLIGHT = wp.constant(1)
TAILLIGHT = wp.constant(2)
STREET = wp.constant(3)
BRAKE = wp.constant(4)
"""Kinds of lamp; `mmw.physics.materials.appearance.LAMPS`."""

BEAM_PEAK_KCD = wp.constant(13.0)
"""Luminous intensity of one low beam just below the cut-off [kcd]. Design value: UNECE Regulation 112, class B, asks
for 10.1 kcd or more at 75R and 50R and for 13.2 or less at 50L."""
BEAM_STRAY_KCD = wp.constant(0.25)
"""Of one low beam above the cut-off [kcd]. Design value: Regulation 112 allows 0.35 at B50L and 0.625 in zone III."""
CUT_OFF = wp.constant(-0.01)
"""Tangent of the cut-off's elevation: 1 % down, which Regulation 48 asks of lights below 0.8 m."""
CUT_OFF_RISE = wp.constant(0.268)
"""Slope of the cut-off on the right, tan 15 degrees. Source: Regulation 112."""
CUT_OFF_TOP = wp.constant(0.03)
"""Highest tangent that the slope adds; design value."""
CUT_OFF_BLUR = wp.constant(0.004)
"""Half width of the edge, as a tangent; design value."""
BEAM_WIDTH = wp.constant(0.15)
"""Tangent of the azimuth at which a beam has half its intensity; design value for 25L and 25R of Regulation 112."""
BEAM_DEPTH = wp.constant(0.03)
"""Tangent below the cut-off at which a beam has half its intensity; design value for the same points."""
BEAM_REACH_M = wp.constant(80.0)
"""Distance at which the light of a beam is taken to zero [m]: twice a low beam's range of sight. Design value."""

STREET_KCD = wp.constant(3.183)
"""Luminous intensity of a street light straight down [kcd]: 10 klm over pi. Design value, a lamp of 100 W LED."""
STREET_REACH_M = wp.constant(30.0)
"""Distance at which the light of a street light is taken to zero [m]: about the distance of posts. Design value."""

BRAKE_GAIN = wp.constant(10.0)
"""Luminance of brake lights over that of taillights. Source: UNECE Regulation 7, 4 to 17 cd for a taillight (R1) and
60 to 260 cd for a stop light (S1)."""
LIGHT_ALPHA2 = wp.constant(1.0e-3)
"""Added to the square of GGX's alpha in the glint of a light on water [-]: a light of 0.2 m at 3 m and more. Design
value."""
NEAR_M2 = wp.constant(0.1)
"""Least square of the distance to a light [m2]: nearer than 0.3 m it is no point."""


@wp.struct
class Lights:
    """The lights of a scene in one weather, for the frames of one batch."""

    is_on: wp.bool
    """True if head and taillights are on."""
    is_street_on: wp.bool
    brake: wp.array2d[float]
    """Braking of each instance, 0 to 1, shape [S, V]; -1 for one without lights, parked, or absent."""
    beam_count: int
    """Number of beams, 0 while they are off."""
    beam_instance: wp.array[int]
    """Instance of each beam, shape [B]."""
    beam_position: wp.array[wp.vec3]
    """Origin of each beam, frame of its instance [m], shape [B]."""
    beam_color: wp.vec3
    """Color of the beams, luminance 1."""
    street_count: int
    """Number of street lights, 0 while they are off."""
    street_position: wp.array[wp.vec3]
    """Scene frame [m], shape [L]."""
    street_color: wp.vec3
    grid_low: wp.vec2
    """Corner of the grid's first cell, scene frame [m]."""
    grid_cell: float
    """Side of a cell [m]."""
    grid_columns: int
    """Cells along x; cell = row * columns + column."""
    grid_rows: int
    grid_first: wp.array[int]
    """First entry of each cell in `grid_light`, and one past the last, shape [cells + 1]."""
    grid_light: wp.array[int]
    """Street lights that reach into each cell, cell after cell."""


@wp.func
def beam_kcd(away: wp.vec3) -> float:
    """Return the luminous intensity of one low beam [kcd].

    Args:
        away: Direction away from the light, unit, frame of the vehicle: x forward, y left, z up.

    Source: lobe of ours through the test points of UNECE Regulation 112, class B, right-hand traffic.
    """
    result = wp.float32(0.0)
    if away[0] > 0.02:
        y = away[1] / away[0]
        z = away[2] / away[0]
        cut = CUT_OFF + wp.clamp(-CUT_OFF_RISE * y, 0.0, CUT_OFF_TOP)
        below = cut - z
        edge = wp.clamp(0.5 + 0.5 * below / CUT_OFF_BLUR, 0.0, 1.0)
        deep = wp.max(below, 0.0) / BEAM_DEPTH
        wide = y / BEAM_WIDTH
        lobe = BEAM_PEAK_KCD * edge * edge * (3.0 - 2.0 * edge) / (1.0 + deep * deep + wide * wide)
        result = lobe + BEAM_STRAY_KCD * away[0]
    return result


@wp.func
def fade(distance2: float, reach: float) -> float:
    """Return 1 near a light and 0 at its reach. Source: window of Karis 2013."""
    x = distance2 / (reach * reach)
    rest = wp.clamp(1.0 - x * x, 0.0, 1.0)
    return rest * rest


@wp.func
def light_emission(
    lights: Lights,
    scene: Scene,
    batch_index: int,
    instance: int,
    appearance: Appearance,
    surface_point: SurfacePoint,
    to_viewer: wp.vec3,
) -> wp.vec3:
    """Return the luminance that a surface emits [kcd/m2]: that of its appearance, of a light as it is switched.

    The emission of a headlight's appearance is what an oncoming driver sees above the cut-off.
    """
    share = wp.float32(1.0)
    if appearance.lamp == STREET:
        share = wp.where(lights.is_street_on, 1.0, 0.0)
    elif appearance.lamp == HEADLIGHT or appearance.lamp == TAILLIGHT or appearance.lamp == BRAKE:
        share = 0.0
        if instance >= 0:
            brake = lights.brake[batch_index, instance]
            if brake >= 0.0:
                if lights.is_on and appearance.lamp != BRAKE:
                    share = 1.0
                if appearance.lamp != HEADLIGHT:
                    share = wp.max(share, BRAKE_GAIN * brake)
                elif lights.is_on:
                    turn = wp.transform_get_rotation(scene.instance_pose[batch_index, instance])
                    share = beam_kcd(wp.quat_rotate_inv(turn, to_viewer)) / BEAM_STRAY_KCD
    return surface_point.emission * share


@wp.func
def reflected(wet: Wetted, appearance: Appearance, to_viewer: wp.vec3, to_light: wp.vec3, share: float) -> wp.vec3:
    """Return BRDF times cosine of a wet surface, film and all [1/sr]; `share` is that of `film_weights`."""
    result = direct_light(wet.surface_point, appearance, to_viewer, to_light) * (1.0 - share)
    if share > 0.0:
        glint = film_light(wet, to_viewer, to_light, LIGHT_ALPHA2)
        result += wp.vec3(glint, glint, glint)
    return result


@wp.func
def reflected_lights(
    lights: Lights, scene: Scene, batch_index: int, wet: Wetted, appearance: Appearance, to_viewer: wp.vec3
) -> wp.vec3:
    """Return the luminance that a surface and the film over it send on from lights [kcd/m2]."""
    light = wp.vec3(0.0, 0.0, 0.0)
    if lights.beam_count + lights.street_count > 0:
        point = wet.surface_point.point
        share = film_weights(wet, to_viewer)
        for b in range(lights.beam_count):
            instance = lights.beam_instance[b]
            if lights.brake[batch_index, instance] >= 0.0:
                pose = scene.instance_pose[batch_index, instance]
                offset = wp.transform_point(pose, lights.beam_position[b]) - point
                distance2 = wp.dot(offset, offset)
                if distance2 < BEAM_REACH_M * BEAM_REACH_M:
                    to_light = wp.normalize(offset)
                    away = wp.quat_rotate_inv(wp.transform_get_rotation(pose), -to_light)
                    klux = 2.0 * beam_kcd(away) * fade(distance2, BEAM_REACH_M) / wp.max(distance2, NEAR_M2)
                    if klux > 0.0:
                        light += (
                            wp.cw_mul(lights.beam_color, reflected(wet, appearance, to_viewer, to_light, share)) * klux
                        )
        if lights.street_count > 0:
            column = int(wp.floor((point[0] - lights.grid_low[0]) / lights.grid_cell))
            row = int(wp.floor((point[1] - lights.grid_low[1]) / lights.grid_cell))
            if column >= 0 and column < lights.grid_columns and row >= 0 and row < lights.grid_rows:
                cell = row * lights.grid_columns + column
                for k in range(lights.grid_first[cell], lights.grid_first[cell + 1]):
                    offset = lights.street_position[lights.grid_light[k]] - point
                    distance2 = wp.dot(offset, offset)
                    if distance2 < STREET_REACH_M * STREET_REACH_M and offset[2] > 0.0:
                        to_light = wp.normalize(offset)
                        klux = STREET_KCD * to_light[2] * fade(distance2, STREET_REACH_M) / wp.max(distance2, NEAR_M2)
                        light += (
                            wp.cw_mul(lights.street_color, reflected(wet, appearance, to_viewer, to_light, share))
                            * klux
                        )
    return light
