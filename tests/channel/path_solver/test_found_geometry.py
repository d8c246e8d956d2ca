"""Bodies and materials of interactions, and rates of change of the lengths of paths that moving vehicles carry."""

import numpy as np

from mmw.channel.links import make_links
from mmw.channel.path_solver.solver import trace_links
from mmw.channel.path_solver.surface_table import make_surface_table
from mmw.core.kinematics import differentiate
from mmw.physics.em.interaction import DIFFRACTION
from mmw.physics.em.vectors import dot
from tests.fixtures.antennas import antenna_at
from tests.fixtures.device_rays import loaded
from tests.oracles.channel import channel, driving, traffic


def test_rates_against_numpy(device: str) -> None:
    """The same sums in float64 as the kernel's, of velocities up to 20 m/s: they differ in the last places."""
    data, frames = traffic(driving(np.arange(7) * 0.01)), [3, 4]
    antennas = antenna_at({"cav": (0.5, 0.0, 2.0), "rsu": (0.0, 0.0, 5.0)})
    config = channel(max_depth=2, diffraction=True, links=("v2i", "v2v"), antennas=antennas)
    scene = loaded(data, device, frames)
    table = make_surface_table(scene, **config.surface_options)
    trace = trace_links(scene, make_links(data, frames, config), config, table)
    found, links, direction = trace.found, trace.search.links, trace.geometry.direction
    velocity, world_rate = (getattr(differentiate(data.poses), name) for name in ("velocity", "world_rate"))
    rate = -dot(links.tx.velocity[found.link], direction[:, 0]) + dot(links.rx.velocity[found.link], direction[:, -1])
    carried, names = 0, trace.names
    assert (names.body[found.kind == 0] == -1).all() and (names.material_id[found.kind == 0] == -1).all()
    assert names.material_id is trace.interactions.material_id
    for path, step in zip(*np.nonzero(found.kind), strict=True):
        surface = found.surface[path, step]
        face = table.wedges.surface_0[surface] if found.kind[path, step] == DIFFRACTION else surface
        owner, batch_index = table.owner[face], links.batch_index[found.link[path]]
        body = batch_index * len(data.actors) + scene.instance_actor[owner] if owner >= 0 else -1
        assert (names.body[path, step], names.material_id[path, step]) == (body, table.material_id[face])
        if owner >= 0:
            row, actor = frames[batch_index], scene.instance_actor[owner]
            arm = found.vertex[path, step] - data.poses[row, actor, :3]
            moving = velocity[row, actor] + np.cross(world_rate[row, actor], arm)
            rate[path] += moving @ (direction[path, step] - direction[path, step + 1])
            carried += 1
    assert carried > 20 and np.abs(rate).max() > 1.0
    np.testing.assert_allclose(trace.geometry.range_rate, rate, rtol=0.0, atol=1e-12)
