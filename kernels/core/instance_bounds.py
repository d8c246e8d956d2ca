"""World boxes of vehicle instances, from their poses, the boxes of their models and their motion during a sweep."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})

BOX_PADDING = wp.constant(1.0e-3)
"""Boxes grow by this on every side [m], so that float32 rounding never puts a face outside its box."""


@wp.kernel
def instance_bounds_kernel(
    pose: wp.array2d[wp.transformf],
    is_present: wp.array2d[wp.bool],
    model_lower: wp.array[wp.vec3],
    model_upper: wp.array[wp.vec3],
    velocity: wp.array2d[wp.vec3],
    rate: wp.array2d[wp.vec3],
    sweep_s: float,
    # out
    lower_out: wp.array[wp.vec3],
    upper_out: wp.array[wp.vec3],
    group_out: wp.array[int],
):
    """Write the box and the group of every instance of every frame; item = batch_index * V + instance.

    The box holds the instance wherever it is from `sweep_s` before the frame to the frame (see `rigid_motion`): it is
    stretched along the path of the origin, and widened by the farthest that turning by |w| `sweep_s` brings any
    corner of the model. A sweep of 0 leaves the box of the frame. An absent instance gets an empty box in group S,
    which no query reads. Launch: dim=(S, V).
    """
    batch_index, instance = wp.tid()
    item = batch_index * pose.shape[1] + instance
    if not is_present[batch_index, instance]:
        lower_out[item] = wp.vec3()
        upper_out[item] = wp.vec3()
        group_out[item] = pose.shape[0]
        return
    half = 0.5 * (model_upper[instance] - model_lower[instance])
    middle = 0.5 * (model_upper[instance] + model_lower[instance])
    to_scene = pose[batch_index, instance]
    rotation = wp.quat_to_matrix(wp.transform_get_rotation(to_scene))
    centre = wp.transform_point(to_scene, middle)
    reach = wp.vec3()
    for axis in range(3):
        reach[axis] = wp.dot(wp.abs(rotation[axis]), half) + BOX_PADDING
    far = wp.length(wp.abs(middle) + half)  # distance of the furthest corner of the box from the instance's origin
    swing_length = (
        wp.min(wp.length(rate[batch_index, instance]) * sweep_s, 2.0) * far
    )  # an arc is longer than its chord
    shift = -velocity[batch_index, instance] * sweep_s
    swing = wp.vec3(swing_length, swing_length, swing_length)
    lower_out[item] = centre - reach + wp.min(shift, wp.vec3()) - swing
    upper_out[item] = centre + reach + wp.max(shift, wp.vec3()) + swing
    group_out[item] = batch_index
