"""Motion of the surfaces of a frame: bodies as rigid bodies, wheels as wheels that roll without slip.

Over the 10 ms of a frame a body keeps its velocity v and its angular velocity w: time t after the frame its origin is
at p + v t and its rotation is exp(w t) R. A point x of it then moves with v + w x (x - p - v t).

A wheel turns about its axle, the body's y axis through the wheel's center, at v_x / r, where r is its radius and v_x
the part along the body's x axis of the velocity that the center has on the body. The lowest point of the wheel is then
at rest on a straight road, and the highest moves at 2 v. The meshes do not steer: front wheels point along their body,
so in a turn their contact points keep the body's sideways velocity. Nor do the meshes of wheels turn: only the velocity
is that of a turning wheel.

Source: rigid body and rolling kinematics, for example J. L. Meriam, L. G. Kraige, Engineering Mechanics: Dynamics,
chapter 5.
"""

import warp as wp

from mmw.kernels.core.structs import Scene

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})


@wp.func
def moved_pose(pose: wp.transformf, velocity: wp.vec3, rate: wp.vec3, time_offset: float) -> wp.transformf:
    """Return where a body is some time after its pose, at constant velocity and angular velocity.

    Args:
        pose: Body to scene frame.
        velocity: Velocity of the body's origin, scene frame [m/s].
        rate: Angular velocity about the axes of the scene frame [rad/s].
        time_offset: Time after the pose [s]; negative for before.
    """
    turn = 0.5 * time_offset * rate
    angle = wp.length(turn)
    share = wp.where(angle > 0.0, wp.sin(angle) / wp.max(angle, 1.0e-30), 1.0)
    change = wp.quatf(turn[0] * share, turn[1] * share, turn[2] * share, wp.cos(angle))
    return wp.transformf(
        wp.transform_get_translation(pose) + velocity * time_offset, change * wp.transform_get_rotation(pose)
    )


@wp.func
def instance_pose_at(scene: Scene, batch_index: int, instance: int, time_offset: float) -> wp.transformf:
    """Return where an instance is some time [s] after its frame: instance to scene frame."""
    return moved_pose(
        scene.instance_pose[batch_index, instance],
        scene.instance_velocity[batch_index, instance],
        scene.instance_rate[batch_index, instance],
        time_offset,
    )


@wp.func
def wheel_velocity(pose: wp.transformf, velocity: wp.vec3, rate: wp.vec3, wheel: wp.vec4, point: wp.vec3) -> wp.vec3:
    """Return what a wheel's turning adds to the velocity that a point of it has on the body [m/s], scene frame.

    Args:
        pose: Body to scene frame.
        velocity: Velocity of the body's origin, scene frame [m/s].
        rate: Angular velocity of the body about the axes of the scene frame [rad/s].
        wheel: Center of the wheel in the body's frame [m] and radius [m].
        point: Point of the wheel, scene frame [m].
    """
    arm = wp.transform_vector(pose, wp.vec3(wheel[0], wheel[1], wheel[2]))
    forward = wp.transform_vector(pose, wp.vec3(1.0, 0.0, 0.0))
    axle = wp.transform_vector(pose, wp.vec3(0.0, 1.0, 0.0))
    spin = wp.dot(forward, velocity + wp.cross(rate, arm)) / wheel[3]
    return spin * wp.cross(axle, point - wp.transform_get_translation(pose) - arm)


@wp.func
def velocity_on(
    scene: Scene, batch_index: int, instance: int, face: int, pose: wp.transformf, point: wp.vec3
) -> wp.vec3:
    """Return the velocity of a point on an instance that is at `pose`, scene frame [m/s]."""
    velocity = scene.instance_velocity[batch_index, instance]
    rate = scene.instance_rate[batch_index, instance]
    result = velocity + wp.cross(rate, point - wp.transform_get_translation(pose))
    wheel = scene.model_wheel[scene.instance_face_offset[instance] + face]
    if wheel >= 0:
        result += wheel_velocity(pose, velocity, rate, scene.wheels[wheel], point)
    return result


@wp.func
def surface_velocity(scene: Scene, batch_index: int, instance: int, face: int, point: wp.vec3) -> wp.vec3:
    """Return the velocity of a surface point at the instant of its frame, scene frame [m/s].

    Zero for the town; for an instance that of its rigid body, and on a wheel that of the rolling wheel.

    Args:
        scene: Town and vehicles.
        batch_index: Position of the frame in the batch.
        instance: Instance of the surface, -1 for the town.
        face: Face of the instance's model; not read for the town.
        point: The surface point, scene frame [m].
    """
    result = wp.vec3()
    if instance >= 0:
        result = velocity_on(scene, batch_index, instance, face, scene.instance_pose[batch_index, instance], point)
    return result
