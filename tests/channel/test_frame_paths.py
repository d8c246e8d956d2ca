"""Paths of links in memory are, bit for bit, those that rows of tables give."""

from dataclasses import fields

import numpy as np
import pytest

from mmw.channel.frame_paths import FramePaths
from mmw.channel.links import make_links
from mmw.channel.path_solver.solver import solve_paths
from mmw.channel.path_table import CarrierPaths
from mmw.channel.paths_by_frame import PathsByFrame
from mmw.channel.rows import link_rows
from mmw.config import ChannelConfig
from mmw.config.antennas import AntennaConfig
from mmw.config.sensor import MountConfig
from mmw.storage.arrow_tables import table_from_columns
from tests.fixtures.device_rays import loaded
from tests.oracles.channel import driving, traffic
from tests.oracles.path_rows import path_rows, path_table

CARRIERS = (28e9, 4.9e9)


@pytest.mark.parametrize("names", [("roof", "bumper"), ("roof",)], ids=["mixed", "sorted"])
@pytest.mark.parametrize(
    "settings", [{"max_depth": 0}, {"max_depth": 1, "diffraction": True}, {"max_depth": 2}], ids=["los", "one", "two"]
)
def test_arrays_and_their_order_are_those_of_the_tables(settings: dict, names: tuple[str, ...]) -> None:
    """Links in an order of their own, and links that are in the order of the tables."""
    data = traffic(driving(np.arange(5) * 0.01))
    places = {"roof": (0.2, 0.1, 2.5), "bumper": (1.9, 0.0, 0.4)}  # not in the order of their names
    mounts = {name: places[name] for name in names}
    antennas = tuple(
        AntennaConfig(
            name=name, mount={"cav": MountConfig(position_m=at)}, on=("cav", "rsu") if name == "roof" else ("cav",)
        )
        for name, at in mounts.items()
    )
    config = ChannelConfig(
        carriers_hz=CARRIERS, links=("v2i", "v2v")[: len(names)], candidates="exhaustive", antennas=antennas, **settings
    )
    frames = [2, 1] if len(names) > 1 else [1, 2]
    links = make_links(data, frames, config)
    paths = solve_paths(loaded(data, "cpu", frames), links, config, data.materials)
    agents = tuple(actor.name for actor in data.actors)
    fixed = {"scenario": "s", "weather": "sunny"}
    rows = link_rows(agents, config.antenna_names, config.link_names, links, paths, "sunny")
    of_links = table_from_columns("links", {**fixed, **rows})
    view = path_table({**fixed, **path_rows(agents, links, paths, "sunny", config.antenna_names)})
    assert len(paths) > 0
    of_frames = FramePaths(links, paths, "sunny", agents, config.antenna_names, "s")
    for column, carrier in enumerate(CARRIERS):
        expected = CarrierPaths.from_table(view, carrier, of_links)
        found = of_frames.at(column)
        _check_same(found, expected)
        for frame in frames:
            own = links.take(np.flatnonzero(links.frame == frame))
            alone = solve_paths(loaded(data, "cpu", [frame]), make_links(data, [frame], config), config, data.materials)
            by_itself = FramePaths(own, alone, "sunny", agents, config.antenna_names, "s").at(column)
            _check_same(PathsByFrame(found, [0, 1, 2], len(CARRIERS)).of(frame), by_itself)
        parted = PathsByFrame(found, [5, 70, 2], len(CARRIERS))
        assert set(parted.of(1).keys["frame"]) == {70} and parted.of(0).link_count == len(parted.of(0)) == 0
        assert found.carrier_hz == carrier
        assert {field.name for field in fields(CarrierPaths)} == set(vars(found))
    one, other = (of_frames.at(column) for column in range(2))
    shared = {name for name, values in vars(one).items() if values is getattr(other, name)}
    assert shared == set(vars(one)) - {"carrier_hz", "row", "transfer", "a", "doppler_hz"}
    assert not any(getattr(one, name).flags.writeable for name in shared)


def _check_same(found: CarrierPaths, expected: CarrierPaths) -> None:
    for field in fields(CarrierPaths):
        one, other = getattr(found, field.name), getattr(expected, field.name)
        if field.name == "keys":
            assert one.dtype == other.dtype and one.tolist() == other.tolist()
        elif field.name != "carrier_hz":
            assert one.dtype == other.dtype and one.shape == other.shape, field.name
            assert np.ascontiguousarray(one).tobytes() == np.ascontiguousarray(other).tobytes(), field.name
