"""Bring links into the order of their transmitters, with their ends in the frame of every instance, on the host."""

import warp as wp

from mmw.kernels.core.compiler import AS_NUMPY
from mmw.kernels.core.quaternions import conjugated, normalized, rotated
from mmw.kernels.core.row_order import is_before, sort_rows

wp.set_module_options(AS_NUMPY)

LINK_KEYS = 4
"""Keys by which links are sorted: batch index and position of the transmitter."""


@wp.struct
class GivenLinks:
    """Links as they are given, L of them, and poses."""

    batch_index: wp.array[int]
    """Position of the link's frame in the batch, shape [L]."""
    tx: wp.array[wp.vec3d]
    """Transmitter in the world [m], shape [L]."""
    rx: wp.array[wp.vec3d]
    """Receiver in the world [m], shape [L]."""
    pose: wp.array2d[wp.transformd]
    """Instance-to-world poses, NaN for absent instances, shape [S, V]; the quaternions need not be unit ones."""


@wp.struct
class LinkOrder:
    """Order of links; keys and spare rows are scratch."""

    key: wp.array2d[wp.float64]
    """Shape [L, LINK_KEYS]."""
    spare: wp.array[int]
    """Shape [L]."""
    row: wp.array[int]
    """Row of each link in the order of the transmitters, shape [L]."""
    sources: wp.array[int]
    """Number of transmitters, shape [1]."""


@wp.struct
class OrderedLinks:
    """Links in the order of their A <= L transmitters, and what belongs to these."""

    batch_index: wp.array[int]
    """Position of the link's frame in the batch, shape [L]."""
    source: wp.array[int]
    """Transmitter of each link, shape [L]."""
    tx: wp.array2d[wp.vec3d]
    """Transmitter in the frame of every instance, and in the world (column V) [m], shape [L, V + 1]."""
    rx: wp.array2d[wp.vec3d]
    """Receiver, as `tx`."""
    source_batch_index: wp.array[int]
    """Batch index of each transmitter, shape [L], of which A are used."""
    source_scene: wp.array[wp.vec3]
    """Position of each transmitter in the scene frame [m]."""
    source_world: wp.array[wp.vec3d]
    """Position of each transmitter in the world [m]."""
    first_link: wp.array[int]
    """First link of each transmitter, and the number of links, shape [L + 1], of which A + 1 are used."""
    pose: wp.array2d[wp.transformd]
    """The poses with unit quaternions, shape [S, V]."""


@wp.func
def attitude_of(pose: wp.transformd) -> wp.vec4d:
    """Return the quaternion of a pose."""
    return wp.vec4d(pose[3], pose[4], pose[5], pose[6])


@wp.func
def position_of(pose: wp.transformd) -> wp.vec3d:
    """Return the position of a pose."""
    return wp.vec3d(pose[0], pose[1], pose[2])


@wp.kernel
def order_links_kernel(given: GivenLinks, origin: wp.vec3d, order_out: LinkOrder, links_out: OrderedLinks):
    """Sort links by batch index and transmitter, and compute all of `OrderedLinks`.

    Antennas of one frame at one place are one transmitter. `origin` is that of the scene frame [m]. Launch: dim=1.
    """
    count = given.tx.shape[0]
    instances = given.pose.shape[1]
    for row in range(count):
        at = given.tx[row]
        order_out.key[row, 0] = wp.float64(given.batch_index[row])
        for axis in range(3):
            order_out.key[row, 1 + axis] = at[axis]
        order_out.row[row] = row
    sort_rows(order_out.key, count, order_out.row, order_out.spare)
    for batch_index in range(given.pose.shape[0]):
        for instance in range(instances):
            pose = given.pose[batch_index, instance]
            unit = normalized(attitude_of(pose))
            links_out.pose[batch_index, instance] = wp.transformd(
                position_of(pose), wp.quatd(unit[0], unit[1], unit[2], unit[3])
            )
    source = wp.int32(-1)
    for place in range(count):
        row = order_out.row[place]
        batch_index = given.batch_index[row]
        tx = given.tx[row]
        rx = given.rx[row]
        is_new = place == 0
        if place > 0:
            is_new = is_before(order_out.key, order_out.row[place - 1], row)
        if is_new:
            source = source + 1
            links_out.first_link[source] = place
            links_out.source_batch_index[source] = batch_index
            links_out.source_world[source] = tx
            links_out.source_scene[source] = wp.vec3(
                wp.float32(tx[0] - origin[0]), wp.float32(tx[1] - origin[1]), wp.float32(tx[2] - origin[2])
            )
        links_out.batch_index[place] = batch_index
        links_out.source[place] = source
        for instance in range(instances):
            own = links_out.pose[batch_index, instance]
            back = conjugated(attitude_of(own))
            shift = -rotated(back, position_of(own))
            links_out.tx[place, instance] = rotated(back, tx) + shift
            links_out.rx[place, instance] = rotated(back, rx) + shift
        links_out.tx[place, instances] = tx
        links_out.rx[place, instances] = rx
    links_out.first_link[source + 1] = count
    order_out.sources[0] = source + 1
