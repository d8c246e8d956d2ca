"""The radio channel of a batch: traced once, its field evaluated in every weather."""

from collections.abc import Sequence

from mmw.channel.links import make_links
from mmw.channel.path_solver.solver import launched_rays, solve_paths
from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.channel.rows import link_rows, path_rows
from mmw.sensors.batch import Batch, TableRows


def record_channel(job: Batch, surfaces: SurfaceTable, frames: Sequence[int], collected: TableRows) -> None:
    """Add links and paths."""
    config = job.config.channel
    with job.clock.stage("channel"):
        links = make_links(job.arrays, frames, config)
        materials = {weather: job.arrays.materials[weather] for weather in collected}
        air = {weather: job.weather(weather) for weather in collected}
        paths = solve_paths(job.scene, links, config, materials, surfaces, air)
        for weather, tables in collected.items():
            tables["links"].append(link_rows(job.arrays, links, paths, weather))
            tables["paths"].append(path_rows(job.arrays, links, paths, weather))
    job.clock.rays["channel"] += launched_rays(links, config)
