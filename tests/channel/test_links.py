"""Links between several antennas of agents, with rules, mounts and elements of their own."""

import numpy as np
import pytest

from mmw.channel import apply_arrays, array_from_row, rows_from_paths
from mmw.channel.antennas.arrays import PlanarArray
from mmw.channel.links import make_links
from mmw.channel.path_solver.solver import launched_rays, solve_paths
from mmw.channel.radio_map.transmitters import actor_transmitters
from mmw.config import AntennaConfig, ChannelConfig, Config, LinkRule, MountConfig, ScenarioConfig
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.errors import InputError
from mmw.core.transforms import quaternion_to_matrix
from mmw.scene.rows import static_rows
from mmw.scene.scene_data import SceneData
from tests.fixtures.antennas import antenna_at
from tests.fixtures.scenes import arrays_from_parts, ground_part, pose, wall_part
from tests.fixtures.sensor_runs import loaded

CARRIER_HZ = 60e9
TILT_DEG = 10.0


def sectors(count: int = 3, tilt_deg: float = TILT_DEG, **options) -> tuple[AntennaConfig, ...]:
    """Return sectors around a unit, with downtilt, and a dipole on each CAV."""
    return (
        AntennaConfig(name="roof", on=("cav",)),
        *(
            AntennaConfig(
                name=f"sector_{number + 1}",
                on=("rsu",),
                mount={"rsu": MountConfig(position_m=(0, 0, 6), yaw_deg=360 * number / count, pitch_deg=tilt_deg)},
                pattern="tr38901",
                **options,
            )
            for number in range(count)
        ),
    )


@pytest.fixture
def street() -> SceneData:
    """Return two CAVs, a roadside unit and a car without radio on the ground beside a wall."""
    actors = [("cav_1", "cav", -1), ("car", "vehicle", -1), ("cav_2", "cav", -1), ("rsu_1", "rsu", -1)]
    here = [pose(20, 3, 0, 0.3), pose(2, 0), pose(-15, 12, 0, 2.0), pose(0, 0, 0, 0.5)]
    parts = [ground_part(80.0), wall_part("wall", (-60.0, 20.0), (60.0, 20.0), 15.0)]
    return arrays_from_parts(parts, actors=actors, poses=np.array([here, here]))


def names_of(arrays: SceneData, config: ChannelConfig) -> list[tuple[str, str, str, str, str]]:
    """Return rule, transmitter, its antenna, receiver and its antenna of the links of the first frame."""
    links = make_links(arrays, [0], config)
    actors, antennas = [actor.name for actor in arrays.actors], config.antenna_names
    return [
        (config.link_names[kind], actors[tx], antennas[tx_antenna], actors[rx], antennas[rx_antenna])
        for kind, tx, tx_antenna, rx, rx_antenna in zip(
            links.kind, links.tx_actor, links.tx_antenna, links.rx_actor, links.rx_antenna, strict=True
        )
    ]


def test_rules_name_agents_and_antennas(street: SceneData) -> None:
    uplink = LinkRule(name="uplink", tx=("cav_2",), rx=("rsu",), rx_antennas=("sector_2",))
    config = ChannelConfig(links=("v2i", uplink, "v2v", "i2i"), antennas=sectors(2))
    assert names_of(street, config) == [
        ("v2i", "rsu_1", "sector_1", "cav_1", "roof"),
        ("v2i", "rsu_1", "sector_1", "cav_2", "roof"),
        ("v2i", "rsu_1", "sector_2", "cav_1", "roof"),
        ("v2i", "rsu_1", "sector_2", "cav_2", "roof"),
        ("uplink", "cav_2", "roof", "rsu_1", "sector_2"),
        ("v2v", "cav_1", "roof", "cav_2", "roof"),
        ("v2v", "cav_2", "roof", "cav_1", "roof"),
    ]


def test_the_first_rule_that_fits_has_a_link_and_no_agent_one_to_itself(street: SceneData) -> None:
    every = LinkRule(name="every", tx=("cav", "rsu"), rx=("cav", "rsu"))
    found = names_of(street, ChannelConfig(links=("v2v", every)))
    assert [row[0] for row in found] == ["v2v"] * 2 + ["every"] * 4
    assert all(row[1] != row[3] for row in found) and len({row[1:] for row in found}) == 6


def test_the_line_of_sight_has_the_gain_of_its_sector(street: SceneData, device: str) -> None:
    """Compare with the sector of TR 38.901, table 7.3-1, in the axes of the tilted mount, in closed form."""
    config = ChannelConfig(carriers_hz=(CARRIER_HZ,), max_depth=0, antennas=sectors())
    links = make_links(street, [0], config)
    paths = solve_paths(loaded(street, device, [0]), links, config, street.materials)
    assert len(paths) == len(links) == 6
    for row, number in enumerate(links.tx_antenna - 1):
        sent = links.rx.position[row] - np.array([0.0, 0.0, 6.0])
        length = np.linalg.norm(sent)
        yaw, tilt = 0.5 + 2 * np.pi * number / 3, np.radians(TILT_DEG)
        x = np.array([np.cos(yaw) * np.cos(tilt), np.sin(yaw) * np.cos(tilt), -np.sin(tilt)])
        y = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
        ahead, left, up = (sent @ axis / length for axis in (x, y, np.cross(x, y)))
        theta, phi = np.degrees(np.arccos(up)), np.degrees(np.arctan2(left, ahead))
        lost = min(12 * ((theta - 90) / 65) ** 2, 30) + min(12 * (phi / 65) ** 2, 30)
        sector_db = 8.0 - min(lost, 30.0)
        # The tilted polarization against the vertical one of the dipole, whose gain is 1.5 sin^2.
        zenith = np.arccos(sent[2] / length)
        theta_hat = np.array([*(np.cos(zenith) * sent[:2] / np.linalg.norm(sent[:2])), -np.sin(zenith)])
        own = np.cos(np.radians(theta)) * (np.cos(np.radians(phi)) * x + np.sin(np.radians(phi)) * y)
        aligned = (own - np.sin(np.radians(theta)) * np.cross(x, y)) @ theta_hat
        dipole = 1.5 * np.sin(zenith) ** 2
        free = (SPEED_OF_LIGHT / CARRIER_HZ / (4 * np.pi * length)) ** 2
        expected = 10 ** (sector_db / 10) * aligned**2 * dipole * free
        np.testing.assert_allclose(np.abs(paths.a["sunny"][row, 0]) ** 2, expected, rtol=1e-9)


def test_links_of_several_antennas_are_those_of_each_alone(street: SceneData, device: str) -> None:
    antennas = (
        *antenna_at({"cav": (0.5, 0, 2), "rsu": (0, 0, 5)}, name="low", on=("cav", "rsu")),
        *antenna_at({"cav": (-0.5, 0, 2.2), "rsu": (0, 0, 7)}, name="high", on=("cav", "rsu"), polarization="H"),
    )
    options = {"candidates": "exhaustive", "max_depth": 2, "links": ("v2i", "v2v")}
    scene = loaded(street, device, [0, 1])
    both = ChannelConfig(antennas=antennas, **options)
    links = make_links(street, [0, 1], both)
    found = solve_paths(scene, links, both, street.materials)
    assert len(np.unique(found.path_id)) * 2 == len(found)  # each is there in two frames
    for number, antenna in enumerate(antennas):
        config = ChannelConfig(antennas=(antenna,), **options)
        alone = solve_paths(scene, make_links(street, [0, 1], config), config, street.materials)
        rows = np.flatnonzero((links.tx_antenna == number) & (links.rx_antenna == number))
        own = np.flatnonzero(np.isin(found.link, rows))
        for name in ("tau", "vertex", "order", "range_rate"):
            np.testing.assert_array_equal(getattr(found, name)[own], getattr(alone, name))
        np.testing.assert_array_equal(found.transfer["sunny"][own], alone.transfer["sunny"])
        np.testing.assert_allclose(found.a["sunny"][own], alone.a["sunny"], rtol=1e-12, atol=1e-18)


def test_a_link_between_different_antennas_has_the_coefficient_of_its_reverse(street: SceneData, device: str) -> None:
    """One trace serves both directions where polarizations are equal; two traces give the same numbers."""
    antennas = (
        *antenna_at({"cav": (0.5, 0, 2)}, name="front", on=("cav",), pattern="tr38901"),
        *antenna_at({"cav": (-0.5, 0, 2)}, name="back", on=("cav",), pattern="hw_dipole"),
    )
    config = ChannelConfig(antennas=antennas, candidates="exhaustive", max_depth=2, links=("v2v",))
    links = make_links(street, [0], config)
    scene = loaded(street, device, [0])
    together = solve_paths(scene, links, config, street.materials)
    apart = [solve_paths(scene, links.take(np.array([row])), config, street.materials) for row in range(len(links))]
    assert len(links) == 8
    np.testing.assert_array_equal(together.count, [len(paths) for paths in apart])
    for link, alone in enumerate(apart):
        own = together.link == link
        order = np.lexsort((alone.vertex[:, 0, 0], alone.tau))
        mine = np.flatnonzero(own)[np.lexsort((together.vertex[own, 0, 0], together.tau[own]))]
        np.testing.assert_allclose(together.tau[mine], alone.tau[order], rtol=1e-13)
        np.testing.assert_allclose(together.a["sunny"][mine], alone.a["sunny"][order], rtol=1e-8, atol=1e-16)


def test_antennas_at_one_place_share_rays(street: SceneData) -> None:
    config = ChannelConfig(antennas=sectors(), samples_per_tx=1000)
    assert launched_rays(make_links(street, [0, 1], config), config) == 2 * 1000


def test_transmitters_of_a_map_are_the_antennas(street: SceneData) -> None:
    antennas = sectors(power_dbm=30.0, num_cols=8)
    found = actor_transmitters(street, 0, antennas=antennas)
    assert found.names == ("rsu_1.sector_1", "rsu_1.sector_2", "rsu_1.sector_3")
    assert found.power_dbm.tolist() == [30.0] * 3
    assert found.array == (PlanarArray(pattern="tr38901", num_cols=8),) * 3
    np.testing.assert_allclose(found.position, [[0, 0, 6]] * 3, atol=1e-12)
    down = np.sin(np.radians(TILT_DEG))
    np.testing.assert_allclose(found.rotation[:, 2, 0], -down, atol=1e-12)
    assert actor_transmitters(street, 0, antennas=antennas, power_dbm=10).power_dbm.tolist() == [10.0] * 3
    assert actor_transmitters(street, 0, antennas=antennas, roles=("cav",)).names == ("cav_1", "cav_2")


def test_arrays_of_rows_give_the_stored_coefficients(street: SceneData) -> None:
    """Patterns, arrays and downtilt come back from table `sensors`: first elements have the coefficients of the run."""
    antennas = sectors(num_rows=2, num_cols=4, polarization="cross", power_dbm=30.0)
    channel = ChannelConfig(carriers_hz=(CARRIER_HZ,), antennas=antennas, candidates="exhaustive", max_depth=1)
    config = Config(scenarios=[ScenarioConfig(name="s", stage="s.usda")], sensors=[], channel=channel)
    columns = static_rows(street, config)["sensors"]
    rows = [{key: list(values)[n] for key, values in columns.items()} for n in range(len(columns["agent"]))]
    found = {(row["agent"], row["sensor"]): array_from_row(row) for row in rows}
    assert sorted(found) == [("cav_1", "roof"), ("cav_2", "roof"), *(("rsu_1", f"sector_{n}") for n in (1, 2, 3))]
    assert found["rsu_1", "sector_1"].antenna_count == 16
    links = make_links(street, [0], channel)
    paths = solve_paths(loaded(street, "cpu", [0]), links, channel, street.materials)
    turn = quaternion_to_matrix(street.poses[0, :, 3:])  # of the agents, as table `poses` has them
    for number in range(len(links)):
        link = links.take(np.array([number]))
        own = paths.link == number
        alone = solve_paths(loaded(street, "cpu", [0]), link, channel, street.materials)
        one = rows_from_paths(link, alone, "sunny", CARRIER_HZ)
        tx, rx = link.tx_actor[0], link.rx_actor[0]
        sector = found["rsu_1", channel.antenna_names[link.tx_antenna[0]]]
        roof = found[street.actors[rx].name, "roof"]
        a = apply_arrays(one, sector, roof, CARRIER_HZ, turn[tx], turn[rx])
        assert a.shape == (own.sum(), 1, 16)
        middle = np.abs(a[:, 0, :8]).mean(axis=1)  # elements of the first polarization differ by phases only
        np.testing.assert_allclose(middle, np.abs(paths.a["sunny"][own, 0]), rtol=1e-9, atol=1e-18)
    with pytest.raises(InputError, match="a row of an antenna is needed"):
        array_from_row({"type": "lidar"})
